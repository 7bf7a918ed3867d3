"""Light transport without paths: closed forms, and agreement with path-traced light."""

import math
import os
import subprocess
import sys
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest

from pbrnet.pipeline.channels import RGB, channels_of
from pbrnet.pipeline.passes.denoise import guides
from pbrnet.pipeline.passes.groundtruth import render_both
from pbrnet.pipeline.passes.transport import (
    Transport,
    render_transport,
    samples_for,
    surfels_for,
    transport_of,
)
from pbrnet.pipeline.render.scene import open_scene
from pbrnet.pipeline.transport import pixels
from pbrnet.pipeline.transport.guides import fast_guides
from pbrnet.pipeline.transport.pixels import means
from pbrnet.pipeline.transport.radiosity import RAYS, Rays, Surfels, cells_of, solve
from pbrnet.pipeline.transport.settings import TransportParams
from pbrnet.pipeline.transport.smoothing import smooth, spread_fireflies
from pbrnet.pipeline.views import View
from pbrnet.scenes.errors import InputError
from tests.fixtures.params import plain_truth
from tests.fixtures.paths import ROOT
from tests.fixtures.render import (
    WINDOW,
    ball,
    diffuse,
    glow,
    make_view,
    quad,
    room_walls,
    write_scene,
)
from tests.fixtures.xml import bsdf, emitter, texture

pytestmark = pytest.mark.usefixtures("wavefront")

PARAMS = TransportParams(samples=16)


def computed(folder: Path, body: str, view: View, params: TransportParams = PARAMS) -> Transport:
    return transport_of(open_scene(write_scene(folder, body)), view, params, 1)


def emitting(reflectance: float, radiance: float) -> str:
    """Material of a surface that shines and reflects."""
    return diffuse(reflectance) + emitter("area", radiance=(radiance,))


def test_samples_and_surfels_suit_the_size_of_the_image() -> None:
    found = [(samples_for(n), surfels_for(n)) for n in (160 * 120, 320 * 240, 480 * 360)]
    assert found == [(16, 16_000), (8, 32_000), (4, 32_000)]
    usual, few = TransportParams(), TransportParams(surfels=6000)
    assert [usual.reduced(n).surfels for n in (1, 2, 4, 16)] == [4000, 8000, 0, 0]
    assert [few.reduced(n).surfels for n in (1, 2)] == [4000, 6000]
    with pytest.raises(ValueError, match="surfels: 3; 0, or at least 8"):
        TransportParams(surfels=3).verify("transport")


def test_a_closed_white_furnace_has_the_sum_of_its_bounces(tmp_path: Path) -> None:
    # All walls shine with 1 and reflect half: light on them is 1, then 1/2 + 1/4 + ... = 1 more.
    walls, _ = room_walls(emitting(0.5, 1.0))
    found = computed(tmp_path / "a", walls, make_view((0.3, -0.5, 1.4), (0.2, 1, -0.3)))
    assert found.direct.mean() == pytest.approx(1, rel=5e-3)
    assert np.abs(found.direct - 1).mean() < 0.02
    series = sum(0.5**bounce for bounce in range(1, PARAMS.bounces + 2))
    assert found.indirect.mean() == pytest.approx(series, rel=1e-2)
    assert np.abs(found.indirect - series).mean() < 0.02
    assert found.color.mean() == pytest.approx(1 + 0.5 * (1 + series), rel=1e-2)


def test_gloss_takes_part_in_the_exchange_of_light(tmp_path: Path) -> None:
    # The furnace with walls of plastic: in the mean they reflect what all lobes reflect of light
    # from all sides, more than their base colour.
    plastic = bsdf("principled", base_color=(0.4,), roughness=0.3)
    walls, _ = room_walls(plastic + emitting(0.0, 1.0).removeprefix(diffuse(0.0)))
    scene = open_scene(write_scene(tmp_path / "a", walls))
    params = TransportParams(samples=16, bounces=30)
    found = transport_of(scene, make_view((0.3, -0.5, 1.4), (0.2, 1, -0.3)), params, 1)
    sampler = mi.load_dict({"type": "independent"})
    sampler.seed(1, 1 << 18)
    si = dr.zeros(mi.SurfaceInteraction3f, 1 << 18)
    si.wi = mi.warp.square_to_cosine_hemisphere(sampler.next_2d())
    out = mi.warp.square_to_cosine_hemisphere(sampler.next_2d())
    value = scene.geometry.shapes[0].bsdf().eval(mi.BSDFContext(), si, out)
    density = mi.warp.square_to_cosine_hemisphere_pdf(out)
    albedo = float(dr.mean(value[0] / density)[0])
    assert 0.43 < albedo < 0.55
    assert found.indirect.mean() == pytest.approx(albedo / (1 - albedo), rel=0.03)


def test_bright_surfaces_in_bright_light_keep_their_energy_among_dark_ones() -> None:
    # A lamp's bowl before a wall: what a cell reflects is the mean of the products.
    def rows(*values: float) -> np.ndarray:
        return np.array(values, dtype=np.float32)[:, None].repeat(3, axis=1)

    empty = np.zeros((2 * RAYS, 3), dtype=np.float32)
    surfels = Surfels(
        points=rows(0.1, 0.12),
        normals=np.array([[0, 0, 1]] * 2, dtype=np.float32),
        measure=np.ones(2, dtype=np.float32),
        albedo=rows(0.9, 0.1),
        rough_albedo=rows(0.9, 0.1),
        direct=rows(8.0, 0.0),
        met_points=empty,
        met_normals=empty,
        weights=empty[:, 0],
        met_light=empty,
    )
    cells = cells_of(surfels, np.zeros(3))
    irradiance, radiosity = solve(surfels, cells, no_rays())
    assert irradiance == pytest.approx(4.0)
    assert radiosity[cells.is_fine] == pytest.approx(0.9 * 8 / 2)
    # Far from all surfels a ray samples the direct light that it meets reflected.
    assert radiosity[~cells.is_fine] == pytest.approx(0)


def no_rays() -> Rays:
    return Rays(np.zeros(0, dtype=np.int64), np.float32([]), np.zeros((0, 3), dtype=np.float32))


def test_light_near_a_lamp_comes_from_what_rays_meet_and_not_from_a_few_surfels() -> None:
    # 40 surfels of a wall, and two beside a lamp, of which one has a thousand times its light;
    # each of the rays of one surfel meets a place there that has as much as the other.
    rng = np.random.default_rng(1)
    places = np.float32(rng.uniform(0, 0.2, (42, 3)) * (1, 1, 0))
    places[:40, 0] += 3
    normals = np.tile(np.float32([0, 0, 1]), (42, 1))
    direct = np.full((42, 3), 0.1, dtype=np.float32)
    direct[40:] = [[1000.0], [1.0]]
    met_points = np.tile(np.float32([3.1, 0.1, 0]), (42 * RAYS, 1))
    met_points[: 4 * RAYS] = [0.1, 0.1, 0]
    weights = np.ones(42 * RAYS, dtype=np.float32)
    met_light = np.full((42 * RAYS, 3), 0.05, dtype=np.float32)
    met_light[: 4 * RAYS] = 0.5
    surfels = Surfels(
        points=places,
        normals=normals,
        measure=np.ones(42, dtype=np.float32),
        albedo=np.full((42, 3), 0.5, dtype=np.float32),
        rough_albedo=np.full((42, 3), 0.4, dtype=np.float32),  # without gloss
        direct=direct,
        met_points=met_points,
        met_normals=np.tile(normals[:1], (42 * RAYS, 1)),
        weights=weights,
        met_light=met_light,
    )
    cells = cells_of(surfels, np.zeros(3))
    lamp, wall = cells.find(np.float32([[0.1, 0.1, 0], [3.1, 0.1, 0]]), normals[:2])
    irradiance, radiosity = solve(surfels, cells, no_rays(), bounces=1)
    assert irradiance[lamp] == pytest.approx(500.5 + 1.25 * 0.05, rel=1e-3)
    # Pixels without rays see what surfels themselves have; surfels, what all of their rays meet.
    assert radiosity[lamp] == pytest.approx(0.5 * (500.5 + 1.25 * 0.05), rel=1e-3)
    # Those find it without gloss, which adds a quarter.
    once = 1.25 * 0.05
    got = 0.1 + (4 * 1.25 * 0.5 + 36 * once) / 40
    assert irradiance[wall] == pytest.approx(got, rel=1e-3)
    # Of two rays of pixels there one meets more light, the other counts half.
    light = np.float32([[0.9], [0.3]]).repeat(3, axis=1)
    of_pixels = Rays(np.array([lamp, lamp]), np.float32([1, 0.5]), light)
    irradiance, radiosity = solve(surfels, cells, of_pixels, bounces=1)
    assert radiosity[lamp] == pytest.approx(1.25 * 1.2 / 1.5 + 0.5 * once, rel=1e-3)
    mean = 1.25 * (4 * RAYS * 0.5 + 1.2) / (4 * RAYS + 1.5)
    assert irradiance[wall] == pytest.approx(0.1 + (4 * mean + 36 * once) / 40, rel=1e-3)


def test_energy_is_neither_made_nor_lost_in_a_room_with_a_lamp(tmp_path: Path) -> None:
    # In a closed room the flux is that of the lamp over the part that walls absorb, whatever the
    # room's shape: the mean over all walls of the light on them.
    albedo, radius = 0.8, 0.1
    walls, _ = room_walls(diffuse(albedo))
    body = walls + ball("lamp", (0.3, -0.2, 1.6), radius, glow(50.0))
    scene = open_scene(write_scene(tmp_path / "a", body))
    flux = 50.0 * math.pi * 4 * math.pi * radius**2
    area = 2 * 16 + 4 * 12
    expected = flux / math.pi / area / (1 - albedo)
    eye, total, weight = (1.2, -1.2, 1.5), 0.0, 0.0
    for towards, up in (
        ((1, 0, 0), (0, 0, 1)),
        ((-1, 0, 0), (0, 0, 1)),
        ((0, 1, 0), (0, 0, 1)),
        ((0, -1, 0), (0, 0, 1)),
        ((0, 1e-3, 1), (0, 1, 0)),
        ((0, 1e-3, -1), (0, 1, 0)),
    ):
        view = make_view(eye, towards, size=(24, 24), focal=12, up=up)  # a face of a cube
        found = transport_of(scene, view, TransportParams(samples=16, bounces=40), 1)
        share = areas(view, found)
        total += float((share * (found.direct + found.indirect)[..., 0]).sum())
        weight += float(share.sum())
    assert weight == pytest.approx(area, rel=0.03)  # without the lamp's shadow
    assert total / weight == pytest.approx(expected, rel=0.04)


def areas(view: View, found: Transport) -> np.ndarray:
    """Surface area that each pixel sees in the room of `room_walls`, (H, W)."""
    low, high = np.array([-2, -2, 0.0]), np.array([2, 2, 3.0])
    rows, columns = np.mgrid[: view.height, : view.width]
    pixels = np.stack([columns + 0.5, rows + 0.5, np.ones_like(rows)], axis=-1)
    directions = pixels @ np.linalg.inv(view.intrinsics).T @ view.pose[:3, :3].T
    lengths = np.linalg.norm(directions, axis=-1, keepdims=True)
    with np.errstate(divide="ignore"):
        walls = np.where(directions > 0, high - view.eye, low - view.eye) / directions
    axis = walls.argmin(axis=-1)
    metres = walls.min(axis=-1) * lengths[..., 0]
    cosine = np.abs(np.take_along_axis(directions / lengths, axis[..., None], -1))[..., 0]
    solid = 1 / (view.intrinsics[0, 0] ** 2 * lengths[..., 0] ** 3)
    shining = found.emitted[..., 0] > 0
    return np.where(shining, 0, solid * metres**2 / cosine)


def test_parallel_plates_have_the_known_form_factor(tmp_path: Path) -> None:
    # A shining square of side 2 opposite to a point 1 m before its centre: the form factor of a
    # corner of a unit square is (2 / 2 pi) (1 / sqrt 2) atan(1 / sqrt 2) each, four of them.
    lamp = quad("lamp", (0, 0, 1), (0, 0, -1), (1, 1), glow(1.0), (0, 1, 0))
    plate = quad("plate", (0, 0, 0), (0, 0, 1), (1, 1), diffuse(0.0), (0, 1, 0))
    view = make_view((0, 0, 0.5), (0, 1e-3, -1), size=(9, 9), focal=90, up=(0, 1, 0))
    found = computed(tmp_path / "a", lamp + plate, view, TransportParams(samples=64))
    factor = 4 * (1 / math.pi) * (1 / math.sqrt(2)) * math.atan(1 / math.sqrt(2))
    assert found.direct[..., 0].mean() == pytest.approx(factor, rel=0.01)
    assert found.indirect.max() == 0
    # Plates that reflect as well: the radiosity equation of small squares, solved directly.
    bright = computed(
        tmp_path / "b",
        quad("lamp", (0, 0, 1), (0, 0, -1), (1, 1), emitting(0.9, 1.0), (0, 1, 0))
        + quad("plate", (0, 0, 0), (0, 0, 1), (1, 1), diffuse(0.9), (0, 1, 0)),
        view,
    )
    side = (np.arange(31) + 0.5) * 2 / 31 - 1
    places = np.stack(np.meshgrid(side, side), axis=-1).reshape(-1, 2)
    squared = ((places[:, None] - places[None]) ** 2).sum(axis=-1) + 1
    factors = (2 / 31) ** 2 / (math.pi * squared**2)
    light = np.zeros(len(places))  # on the plate, from the lamp's own shine and its reflection
    for _ in range(60):
        light = factors @ (1 + 0.9 * factors @ (0.9 * light))
    middle = len(places) // 2
    assert light[middle] - (factors @ np.ones(len(places)))[middle] == pytest.approx(
        bright.indirect[..., 0].mean(), rel=0.05
    )


def test_walls_colour_each_other_as_in_the_path_tracer(tmp_path: Path) -> None:
    grey = diffuse(0.7)
    walls, _ = room_walls(grey)
    walls = walls.replace(
        quad("west", (-2, 0, 1.5), (1, 0, 0), (2, 1.5), grey),
        quad("west", (-2, 0, 1.5), (1, 0, 0), (2, 1.5), diffuse("0.7,0.1,0.1")),
    ).replace(
        quad("east", (2, 0, 1.5), (-1, 0, 0), (2, 1.5), grey),
        quad("east", (2, 0, 1.5), (-1, 0, 0), (2, 1.5), diffuse("0.1,0.7,0.1")),
    )
    lamp = quad("lamp", (0, 0, 2.98), (0, 0, -1), (0.6, 0.6), glow(8.0), (0, 1, 0))
    box = quad("screen", (0.6, 0.9, 0.8), (-0.5, -1, 0), (0.5, 0.8), grey)
    scene = open_scene(write_scene(tmp_path / "a", walls + lamp + box))
    view = make_view((0, -1.7, 1.5), (0, 1, -0.1), size=(48, 36), focal=26)
    found = transport_of(scene, view, PARAMS, 1)
    truth = plain_truth(spp=256, block_spp=64, max_depth=11, rr_depth=11, denoise="none")
    traced = render_both(scene, view, truth, 0.5, 1, light=True)
    true = {name: stacked(traced.parts[name][0]) for name in ("direct", "irradiance")}
    color, lit = stacked(traced.color[0]), found.emitted.max(axis=-1) == 0
    blocks = {
        "irradiance": (true["irradiance"], found.direct + found.indirect),
        "color": (color, found.color),
        "direct": (true["direct"], found.albedo * found.direct),
    }
    for name, (expected, got) in blocks.items():
        expected, got = (np.where(lit[..., None], image, 0) for image in (expected, got))
        assert got.mean(axis=(0, 1)) == pytest.approx(expected.mean(axis=(0, 1)), rel=0.03), name
        cells = [image.reshape(6, 6, 6, 8, 3).mean(axis=(1, 3)) for image in (expected, got)]
        assert np.abs(cells[1] - cells[0]).mean() < 0.05 * cells[0].mean(), name
    # What faces the red wall gets red light, the back wall's right half faces it no more.
    left, right = found.indirect[:, 6:12].mean(axis=(0, 1)), found.indirect[:, -12:-6].mean((0, 1))
    assert left[0] / left[1] > right[0] / right[1]


def stacked(channels: dict[str, np.ndarray]) -> np.ndarray:
    return np.stack([channels[band] for band in RGB], axis=-1)


def test_a_mirror_shows_the_lamp_and_the_wall_behind_the_camera(tmp_path: Path) -> None:
    walls, _ = room_walls(diffuse(0.5))
    mirror = '<bsdf type="conductor"><string name="material" value="none"/></bsdf>'
    glass = quad("mirror", (0, 1.9, 1.5), (0, -1, 0), (1, 1), mirror)
    lamp = ball("lamp", (0, -1.5, 1.5), 0.3, glow(4.0))
    view = make_view((0, 0.5, 1.5), (0, 1, 0), size=(32, 24), focal=60)
    found = computed(tmp_path / "a", walls + glass + lamp, view)
    assert found.parts[12, 16] == pytest.approx(4, rel=1e-3)
    assert found.color[12, 16] == pytest.approx(4, rel=1e-2)
    wall = found.parts[2, 2]
    assert wall == pytest.approx(found.albedo[2, 2] * (found.direct + found.indirect)[2, 2])
    assert wall.min() > 0


@pytest.mark.parametrize("through", [0.4, 2.0])
def test_cloth_shows_the_light_of_both_sides(tmp_path: Path, through: float) -> None:
    # A sheet close before a large lamp, and a smaller, dimmer one behind the camera: it transmits
    # `through` / 2 of what its back gets, and reflects the rest of what its front gets.
    cloth = bsdf(
        "principledthin", base_color=(0.8,), roughness=0.9, diff_trans=float(through), eta=1.001
    )
    body = (
        quad("sheet", (0, 2, 1.5), (0, -1, 0), (1, 1), cloth)
        + quad("back", (0, 2.02, 1.5), (0, -1, 0), (4, 4), glow(3.0))
        + quad("front", (0, -1, 1.5), (0, 1, 0), (1, 1), glow(20.0))
    )
    view = make_view((0, 0, 1.5), (0, 1, 0), size=(32, 24), focal=60)
    scene = open_scene(write_scene(tmp_path / "a", body))
    assert scene.geometry.transmitted[0] == pytest.approx(through / 2)
    found = transport_of(scene, view, PARAMS, 1)
    truth = plain_truth(spp=256, block_spp=64, max_depth=11, rr_depth=11, denoise="none")
    traced = stacked(render_both(scene, view, truth, 0.5, 1).color[0])
    assert found.color[4:-4, 4:-4].mean() == pytest.approx(traced[4:-4, 4:-4].mean(), rel=0.04)
    # Rough surfaces of this material reflect a little more than their base colour.
    assert 0.8 <= found.albedo[12, 16].mean() < 0.84


def test_the_part_that_goes_through_is_found_in_all_wrappers(tmp_path: Path) -> None:
    thin = partial(bsdf, "principledthin")
    cases = {
        thin(diff_trans=1.0): 0.5,
        thin(): 0.0,
        thin(texture("checkerboard", name="diff_trans")): 0.5,
        bsdf("mask", thin(diff_trans=2.0), opacity=0.5): 1.0,
        bsdf("blendbsdf", thin(diff_trans=1.0), diffuse(0.5), weight=0.5): 0.25,
        bsdf("twosided", diffuse(0.5)): 0.0,
        "": 0.0,
    }
    body = "".join(
        quad(f"quad-{number}", (0, number, 1), (0, -1, 0), (1, 1), material)
        for number, material in enumerate(cases)
    )
    geometry = open_scene(write_scene(tmp_path / "a", body)).geometry
    assert geometry.transmitted.tolist() == pytest.approx(list(cases.values()))


def test_light_through_a_curtain_reaches_the_room(tmp_path: Path) -> None:
    # A closed room whose only light is a lamp behind a curtain that divides it.
    cloth = bsdf("principledthin", base_color=(0.9,), roughness=0.9, diff_trans=1.0, eta=1.001)
    walls, _ = room_walls(diffuse(0.6))
    curtain = quad("curtain", (0, 1, 1.5), (0, -1, 0), (2, 1.5), cloth)
    body = walls + curtain + ball("lamp", (0, 1.5, 1.5), 0.1, glow(50.0))
    scene = open_scene(write_scene(tmp_path / "a", body))
    view = make_view((0, 0.8, 1.5), (0, -1, -0.2), size=(32, 24), focal=16)
    found = transport_of(scene, view, PARAMS, 1)
    truth = plain_truth(spp=256, block_spp=64, max_depth=11, rr_depth=11, denoise="none")
    traced = stacked(render_both(scene, view, truth, 0.5, 1).color[0])
    assert found.direct.max() == 0
    assert found.color.mean() == pytest.approx(traced.mean(), rel=0.06)


@pytest.mark.parametrize("panes", [1, 2])
def test_a_pane_shows_the_room_behind_the_camera_before_the_dark(
    tmp_path: Path, panes: int
) -> None:
    walls, _ = room_walls(diffuse(0.5), window=True)
    body = walls + ball("lamp", (0.8, -1.5, 2.2), 0.3, glow(4.0))
    glazed = replace(WINDOW, panes=panes)
    scene = open_scene(write_scene(tmp_path / "a", body, portals=[glazed]))
    view = make_view((0, 0, 1.5), (0, 1, 0), size=(32, 24), focal=40)
    found = transport_of(scene, view, PARAMS, 1)
    truth = plain_truth(spp=512, block_spp=64, max_depth=11, rr_depth=11, denoise="none")
    traced = stacked(render_both(scene, view, truth, 0.5, 1).color[0])
    inside = np.s_[4:20, 8:24]
    assert found.albedo[inside].max() == 0  # what is behind the pane is dark
    shown = found.color[inside]
    lamp = traced[inside] > 0.01
    assert lamp.any()
    assert 0 < shown[~lamp].mean() < 0.2 * found.color[:3].mean()
    assert shown.mean() == pytest.approx(traced[inside].mean(), rel=0.1)
    assert shown[~lamp].mean() == pytest.approx(traced[inside][~lamp].mean(), rel=0.1)


def test_a_pixel_whose_normals_cancel_keeps_its_light_and_leaves_its_neighbours_theirs() -> None:
    # Both sides of a thin edge in one pixel: the mean of their normals is zero.
    normals = np.tile(np.array([[0.0], [0.0], [1.0]]), 81)
    normals[:, 40] = 0
    light = np.full(81, 2.0)
    light[40] = 7.0
    index = dr.arange(mi.UInt32, 81)
    position = mi.Vector3f(mi.Float(index % 9), mi.Float(index // 9), 0)
    [smoothed] = smooth(
        [mi.Color3f(mi.Float(light))],
        [mi.Float(np.full(81, 100.0))],
        (mi.Vector3f(normals), position, mi.Float(np.ones(81))),
        mi.Float(np.ones(81)),
        mi.Vector3f(4, 4, 5),
        (9, 9),
    )
    assert np.allclose(np.array(smoothed), light, rtol=1e-5)


def test_an_edge_before_a_bright_wall_has_the_mean_of_both_colours(tmp_path: Path) -> None:
    # A white screen in the shade hides half of a dark wall in bright light. The mean reflectance
    # times the mean light would be five times as bright as either half of the pixel.
    lamp = quad("lamp", (-1, 0.1, 1), (0, 1, 0), (0.5, 0.5), glow(40.0))
    screen = quad("screen", (-2, 0, 1), (0, -1, 0), (2, 2), diffuse(0.9))
    wall = quad("wall", (0, 2, 1), (0, -1, 0), (4, 4), diffuse(0.1))
    view = make_view((0, -2, 1), (0, 1, 0), size=(17, 24), focal=14)
    found = computed(tmp_path / "a", lamp + screen + wall, view)
    light = found.direct + found.indirect
    assert light[:, 9].mean() > 8 * light[:, 7].mean()
    middle = found.parts[8:16]  # above and below, light changes over the lengths that are smoothed
    halves = (middle[:, 7] + middle[:, 9]) / 2
    assert middle[:, 8].mean() == pytest.approx(halves.mean(), rel=0.2)


def test_a_lone_bright_pixel_shares_its_energy_with_its_neighbours() -> None:
    random = np.random.default_rng(3)
    image = random.uniform(0.9, 1.1, (7, 9)).astype(np.float32)
    image[3, 4], image[0, 8] = 91.0, 41.0
    noise = np.zeros_like(image)
    noise[3, 4] = 81.0**2
    spread, uncertain = spread_fireflies(
        mi.Color3f(mi.Float(image.ravel())), (9, 7), mi.Float(noise.ravel())
    )
    got = np.array(spread)[0].reshape(7, 9)
    assert got.sum() == pytest.approx(image.sum(), rel=1e-5)
    assert got[2:5, 3:6] == pytest.approx(11, abs=0.5)  # 90 among nine pixels
    assert got[:2, 7:] == pytest.approx(11, abs=0.5)  # 40 among the four of a corner
    assert got[5:, :3] == pytest.approx(image[5:, :3], abs=0.15)
    # Its neighbours are as uncertain as they are bright: the filter does not keep them.
    assert np.sqrt(np.array(uncertain).reshape(7, 9)[2, 3]) == pytest.approx(9, rel=0.05)


def test_samples_that_are_not_finite_are_counted() -> None:
    number = dr.arange(mi.UInt32, 16 * 12 * 4)
    faulty = (number % 4 < 2) & ((number // 4) % 16 < 8)
    two = dr.full(mi.Float, 2, 16 * 12 * 4)
    images = {"value": [dr.select(faulty, mi.Float(math.nan), 1), two]}
    value, other, lost = (np.array(band).reshape(12, 16) for band in means(images, 4))
    assert (value[:, :8] == 0.5).all() and (value[:, 8:] == 1).all()
    assert (other == 2).all()
    assert (lost[:, :8] == 0.5).all() and (lost[:, 8:] == 0).all()


def test_light_that_is_not_finite_on_what_rays_meet_is_counted(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    body = room_walls(diffuse(0.5))[0] + ball("lamp", (0.3, -0.2, 1.6), 0.1, glow(50.0))
    view = make_view((1.2, -1.2, 1.5), (-1, 1, -0.2), size=(16, 12))
    whole = computed(tmp_path / "a", body, view)
    reflected = pixels.reflected

    def faulty(*inputs: Any) -> Any:
        once = reflected(*inputs)
        left = (dr.arange(mi.UInt32, dr.width(once)) // 16) % 16 < 8
        return dr.select(left, mi.Color3f(math.inf), once)

    monkeypatch.setattr(pixels, "reflected", faulty)
    found = computed(tmp_path / "b", body, view)
    assert found.nan_pixels == found.lost_pixels == 16 * 12 / 2
    assert np.isfinite(found.color).all()
    ratio = found.indirect[:, 8:].mean() / whole.indirect[:, 8:].mean()
    assert ratio == pytest.approx(1, rel=0.1)


def test_channels_are_those_of_the_table_and_of_any_light(tmp_path: Path) -> None:
    walls, _ = room_walls(diffuse(0.5))
    view = make_view(size=(16, 12))
    dark, facts = render_transport(open_scene(write_scene(tmp_path / "a", walls)), view, PARAMS, 1)
    assert facts == {"nan_pixels": 0, "nan_surfels": 0, "lost_pixels": 0}
    assert set(dark) == {band for each in channels_of("transport") for band in each.bands}
    assert all(not image.any() for image in dark.values())


def test_scalar_variants_are_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    scene = open_scene(write_scene(tmp_path / "a", room_walls(diffuse(0.5))[0]))
    monkeypatch.setattr("pbrnet.pipeline.passes.transport.integrator.available", lambda: False)
    with pytest.raises(InputError, match="transport needs a variant other than scalar_rgb"):
        transport_of(scene, make_view(), PARAMS, 1)


THREADS = """
import sys
from pathlib import Path
import drjit as dr
from pbrnet.pipeline.render.scene import open_scene, set_variant
from pbrnet.pipeline.transport.settings import TransportParams
from pbrnet.pipeline.passes.transport import render_transport
from pbrnet.scenes.contract import load_scene
from pbrnet.scenes.files import digest_bytes
from tests.fixtures.render import make_view
set_variant()
dr.set_thread_count(int(sys.argv[2]))
view = make_view((0.3, -0.5, 1.4), (0.2, 1, -0.3))
found, _ = render_transport(open_scene(load_scene(Path(sys.argv[1]))), view, TransportParams(), 1)
print(digest_bytes(*(found[name].tobytes() for name in sorted(found))))
"""


def test_bits_do_not_depend_on_the_number_of_threads(tmp_path: Path) -> None:
    walls, _ = room_walls(diffuse(0.5), window=True)
    sky = '<emitter type="constant"><rgb name="radiance" value="1"/></emitter>'
    write_scene(tmp_path / "a", walls + sky + ball("lamp", (0.5, 0, 2), 0.1, glow(20.0)))
    digests = {
        subprocess.run(
            [sys.executable, "-c", THREADS, str(tmp_path / "a"), count],
            cwd=ROOT,
            env={**os.environ, "PYTHONPATH": str(ROOT)},
            capture_output=True,
            text=True,
            check=True,
        ).stdout
        for count in ("1", "2")
    }
    assert len(digests) == 1


def test_fast_guides_are_those_of_the_ground_truth(tmp_path: Path) -> None:
    walls, _ = room_walls(diffuse("0.7,0.4,0.1"), window=True)
    glass = '<bsdf type="thindielectric"/>'
    body = walls + quad("pane", (0, 0.5, 1.2), (0, -1, 0), (0.4, 0.4), glass)
    body += ball("ball", (0.6, 0.8, 1), 0.4, diffuse(0.3)) + ball("lamp", (0, 0, 2.5), 0.1, glow())
    scene = open_scene(write_scene(tmp_path / "a", body))
    for eye in ((0.1, -1.7, 1.4), (-0.4, -1.5, 1.1)):  # the second replays the recording
        view = make_view(eye, (0.1, 1, -0.1), size=(40, 30))
        for fast, slow in zip(fast_guides(scene, view), guides(scene, view), strict=True):
            assert fast.shape == slow.shape
            assert fast.dtype == np.float32
            assert np.abs(fast - slow).mean() < 1e-4
            assert (np.abs(fast - slow).max(axis=-1) > 1e-3).mean() < 0.005
