"""Visibility of the panorama's light sources, against analytic shadows."""

from dataclasses import replace
from pathlib import Path
from typing import ClassVar

import numpy as np
import pytest

from pbrnet.model.data.direct_light import direct_light
from pbrnet.model.evaluation.predict import Rendered, example_of
from pbrnet.pipeline.frames import Channels
from pbrnet.pipeline.passes.illumination import render_illumination
from pbrnet.pipeline.passes.inputs import render_inputs
from pbrnet.pipeline.passes.settings import IlluminationParams
from pbrnet.pipeline.passes.visibility import choose_sources, render_visibility, surface_mean
from pbrnet.pipeline.render.scene import RenderScene, open_scene
from pbrnet.pipeline.views import View
from pbrnet.scenes.arrays import Float64Array
from pbrnet.scenes.contract import Portal
from pbrnet.scenes.geometry.directions import pixel_directions
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

pytestmark = pytest.mark.usefixtures("variant")

PARAMS = IlluminationParams(width=128, shadow_rays=16)
EYE = (0.0, 0.0, 1.5)


class Card:
    """The part of a model card that `example_of` reads."""

    tone: ClassVar = {"key": 0.8, "burn": 0.2}
    white = 20.0


def opened(folder: Path, body: str, portals: tuple[Portal, ...] = ()) -> RenderScene:
    return open_scene(write_scene(folder / "scene", body, portals=portals))


def looking_at_a_wall() -> View:
    """From 3 metres before a wall at y = 3, square to it; 80x60 pixels, one metre to 20."""
    return make_view(EYE, (0, 1, 0), (80, 60), 60.0)


def on_the_wall(view: View) -> Float64Array:
    """Intersection of each pixel's ray with the plane y = 3: x and z (H, W, 2)."""
    rays = pixel_directions(view.intrinsics, view.width, view.height) @ view.pose[:3, :3].T
    return (np.array(EYE) + rays * (3 / rays[..., 1:2]))[..., [0, 2]]


WALL = quad("wall", (0, 3, 1.5), (0, -1, 0), (4, 3), diffuse())


@pytest.mark.parametrize("radius", [0.01, 0.08])
def test_a_board_before_a_lamp_throws_the_shadow_that_geometry_says(
    tmp_path: Path, radius: float
) -> None:
    """Lamp behind the camera, board halfway: its shadow on the wall is twice its size."""
    lamp = np.array([0.6, -1.0, 2.0])
    board = quad("board", (0.3, 1.0, 1.75), (0, -1, 0), (0.25, 0.2), diffuse())
    body = WALL + board + ball("lamp", tuple(lamp), radius, glow(50))
    view = looking_at_a_wall()
    scene = opened(tmp_path, body)
    share = render_visibility(scene, view, PARAMS)["visibility.Y"]
    inputs = render_inputs(scene, view)
    on_wall = np.abs(inputs["Z"] - 3) < 1e-3
    centre = lamp[[0, 2]] + (np.array([0.3, 1.75]) - lamp[[0, 2]]) * 2
    away = np.abs(on_the_wall(view) - centre) - np.array([0.5, 0.4])
    edge = 2 * radius + 0.2  # a penumbra, a cell of the panorama, and averaging over pixels
    inside, outside = (away < -edge).all(axis=-1), (away > edge).any(axis=-1)
    assert (inside & on_wall).sum() > 10 and (outside & on_wall).sum() > 1000
    assert not share[inside & on_wall].any()
    assert (share[outside & on_wall] == 1).all()


def test_two_lamps_of_which_one_is_hidden_count_by_what_they_would_bring(tmp_path: Path) -> None:
    """At each point the visible share is one lamp's analytic irradiance over that of both."""
    lamps = {np.float64(3.0): (-1.2, 1.0, 1.5), np.float64(1.0): (1.2, 1.5, 1.5)}
    screen = quad("screen", (1.6, 2.3, 1.5), (0, -1, 0), (1.2, 3), diffuse())
    body = WALL + screen
    for power, place in lamps.items():
        body += ball(f"lamp{power}", place, 0.02, glow(float(power) / (np.pi * 0.02**2)))
    view = looking_at_a_wall()
    scene = opened(tmp_path, body)
    params = replace(PARAMS, shadow_rays=256)
    share = render_visibility(scene, view, params)["visibility.Y"]
    x, z = np.moveaxis(on_the_wall(view), -1, 0)
    brought = []
    for power, place in lamps.items():
        towards = np.array(place) - np.stack([x, np.full_like(x, 3.0), z], axis=-1)
        brought.append(power * -towards[..., 1] / np.linalg.norm(towards, axis=-1) ** 3)
    share_of_first = brought[0] / (brought[0] + brought[1])
    on_wall = np.abs(render_inputs(scene, view)["Z"] - 3) < 1e-3
    # The screen's edge at x = 0.4 hides the second lamp, from 1.2 on, right of x = -0.3.
    one, both = on_wall & (x > -0.1) & (x < 0.35), on_wall & (x < -0.5)
    assert one.sum() > 300 and both.sum() > 300
    assert (share[both] == 1).all()
    assert share[one] == pytest.approx(share_of_first[one], abs=0.02)


def test_under_a_table_as_much_of_the_window_is_hidden_as_geometry_says(tmp_path: Path) -> None:
    """On the floor: the share of the window's light that the table top occludes, point by point."""
    walls, _ = room_walls(diffuse(), window=True)
    table = (
        '<shape type="cube"><transform name="to_world"><scale x="0.5" y="0.5" z="0.005"/>'
        f'<translate x="0" y="0.5" z="0.7"/></transform>{diffuse()}</shape>'
    )
    scene = opened(tmp_path, walls + table + '<emitter type="constant"/>', (WINDOW,))
    view = make_view((0.0, -1.8, 1.2), (0, 1, -0.8), (80, 60), 60.0)
    share = render_visibility(scene, view, replace(PARAMS, shadow_rays=64))["visibility.Y"]
    inputs = render_inputs(scene, view)
    rays = pixel_directions(view.intrinsics, 80, 60) @ view.pose[:3, :3].T
    point = view.eye + rays * inputs["Z"][..., None]
    floor = np.abs(point[..., 2]) < 0.01
    x, z = np.meshgrid((np.arange(20) + 0.5) / 20 - 0.5, (np.arange(20) + 0.5) / 20 + 1)
    pane = np.stack([x, np.full_like(x, 2.0), z], axis=-1).reshape(-1, 3)
    # A piece of the pane is as bright a source as it is large to the camera.
    power = (pane - view.eye)[:, 1] / np.linalg.norm(pane - view.eye, axis=-1)
    towards = pane - point[floor][:, None]
    brought = power * towards[..., 2] / np.linalg.norm(towards, axis=-1) ** 3
    at_table = point[floor][:, None] + towards * (0.7 / pane[:, 2])[:, None]
    hidden = (np.abs(at_table[..., 0]) < 0.5) & (np.abs(at_table[..., 1] - 0.5) < 0.5)
    expected = (brought * ~hidden).sum(axis=1) / brought.sum(axis=1)
    assert floor.sum() > 1000 and np.ptp(expected) > 0.9
    # The pane is known by the nine cells of the panorama that it fills.
    assert np.abs(share[floor] - expected).mean() < 0.07
    assert np.corrcoef(share[floor], expected)[0, 1] > 0.97


def test_a_lamp_does_not_stand_in_its_own_light(tmp_path: Path) -> None:
    """From behind a spherical lamp, its mean position on the near side is occluded by itself."""
    body = WALL + ball("lamp", (0.0, 2.0, 1.5), 0.3, glow(5))
    view = looking_at_a_wall()
    share = render_visibility(opened(tmp_path, body), view, PARAMS)["visibility.Y"]
    assert (share == 1).all()


def test_no_light_and_no_surface_hide_nothing(tmp_path: Path) -> None:
    view = looking_at_a_wall()
    small = quad("wall", (0, 3, 1.5), (0, -1, 0), (0.5, 0.5), diffuse())
    dark = render_visibility(opened(tmp_path / "dark", WALL), view, PARAMS)["visibility.Y"]
    assert (dark == 1).all()
    body = small + ball("lamp", (0, -1, 1.5), 0.05, glow(9))
    scene = opened(tmp_path / "small", body)
    share = render_visibility(scene, view, PARAMS)["visibility.Y"]
    nothing = render_inputs(scene, view)["valid"] == 0
    assert nothing.any() and (share[nothing] == 1).all()


def test_pixels_lend_their_rays_to_their_own_surface_alone() -> None:
    """A wall, another one a metre behind, and a floor: noise is averaged, edges stay sharp."""
    rng = np.random.default_rng(0)
    row, column = np.mgrid[:40, :40] - 20.0
    rays = np.stack([column / 40, row / 40, np.ones_like(row)], axis=-1)
    normals = np.zeros((40, 40, 3))
    normals[..., 2] = -1
    depth = np.where(column < 0, 2.0, 3.0)
    floor = row > 9
    normals[floor] = (0, -1, 0)
    depth[floor] = 0.7 * 40 / row[floor]
    truth = np.where(floor, 0.3, np.where(column < 0, 0.9, 0.1))
    noisy = truth + rng.uniform(-0.1, 0.1, truth.shape)
    seen = np.ones_like(floor)
    seen[:3] = False
    mean = surface_mean(noisy, rays * depth[..., None], normals, seen)
    assert np.abs(mean - truth)[3:].max() < 0.08, "nothing crosses an edge"
    assert np.abs(mean - truth)[3:].std() < 0.35 * np.abs(noisy - truth)[3:].std()
    assert np.array_equal(mean[:3], noisy[:3])


def test_sources_are_drawn_by_their_weight() -> None:
    weights = np.array([[1.0, 0, 3.0], [0, 0, 0], [0, 2.0, 0]])
    strata = np.tile((np.arange(8) + 0.5) / 8, (3, 1))
    number, some = choose_sources(weights, strata)
    assert number[0].tolist() == [0, 0, 2, 2, 2, 2, 2, 2]
    assert some.tolist() == [True, False, True]
    assert (number[2] == 1).all() and ((number >= 0) & (number < 3)).all()
    (first,), _ = choose_sources(np.array([[0.0, 1.0]]), np.zeros((1, 1)))
    assert first == 1, "a source without weight is never drawn"


def test_direct_light_of_the_panorama_has_the_shadows(tmp_path: Path) -> None:
    lamp = ball("lamp", (0.6, -1.0, 2.0), 0.03, glow(50))
    board = quad("board", (0.3, 1.0, 1.75), (0, -1, 0), (0.25, 0.2), diffuse())
    scene, view = opened(tmp_path, WALL + board + lamp), looking_at_a_wall()
    light: Channels = render_illumination(scene, view, PARAMS)
    light |= render_visibility(scene, view, PARAMS, light)
    assert light["intensity.Y"].shape == (64, 128) and light["visibility.Y"].shape == (60, 80)
    given = Rendered({"inputs": render_inputs(scene, view), "illumination": light})
    example = example_of(view, given, Card(), None)  # type: ignore[arg-type]
    shadows = light["visibility.Y"].astype(np.float32)
    lit = direct_light(example, 0.5)[0]
    shaded = direct_light(example.having(visibility=shadows), 0.5)[0]
    assert shadows.min() < 0.5 < shadows.max()
    assert np.array_equal(shaded, lit * shadows[..., None]) and lit.max() > 0


def test_shadows_repeat_bit_for_bit(tmp_path: Path) -> None:
    walls, _ = room_walls(diffuse(), window=True)
    body = walls + ball("l", (1, 0, 2.5), 0.05, glow(9)) + '<emitter type="sunsky"/>'
    scene, view = opened(tmp_path, body, (WINDOW,)), make_view()
    panorama = render_illumination(scene, view, PARAMS)
    first = render_visibility(scene, view, PARAMS)["visibility.Y"]
    assert np.array_equal(first, render_visibility(scene, view, PARAMS, panorama)["visibility.Y"])
