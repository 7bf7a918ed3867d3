"""Parts of the light in a joint trace: closed forms, separate estimates, and mutants that fail."""

from pathlib import Path
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest

from pbrnet.pipeline.passes.groundtruth import path_integrator, render_both
from pbrnet.pipeline.pathtrace.launches import make_sensor
from pbrnet.pipeline.pathtrace.light_parts import LightParts, PathParts
from pbrnet.pipeline.render.scene import RenderScene, open_scene
from pbrnet.pipeline.views import View
from pbrnet.scenes.geometry.directions import pixel_directions
from tests.fixtures.joint import (
    FAITHFUL,
    MAX_DEPTH,
    PARTING,
    deviations,
    in_parts,
    region_means,
    shelf,
)
from tests.fixtures.params import plain_truth
from tests.fixtures.render import diffuse, glow, make_view, quad, room_walls, write_scene
from tests.fixtures.xml import bsdf, emitter

pytestmark = pytest.mark.usefixtures("wavefront")

BASE, METALLIC, ROUGHNESS = (0.7, 0.3, 0.1), 0.3, 0.4
MATERIALS = {
    "principled": bsdf(
        "principled", base_color=BASE, metallic=METALLIC, roughness=ROUGHNESS, clearcoat=0.8
    ),
    "texture": FAITHFUL["texture"],
    "rough copper": FAITHFUL["rough copper"],
}
COPIES, SPP = 16, 32


def stacked(channels: dict[str, np.ndarray]) -> np.ndarray:
    return np.stack([channels[band] for band in "RGB"], axis=-1).astype(np.float64)


def parts_of(scene: RenderScene, view: View, **settings: Any) -> dict[str, np.ndarray]:
    """Colour and its parts by the pass, (H, W, 3) each."""
    truths = render_both(scene, view, plain_truth(**settings), 0.5, 3, light=True)
    return {
        "color": stacked(truths.color[0]),
        **{name: stacked(part[0]) for name, part in truths.parts.items()},
    }


def test_a_point_light_over_a_plane_is_direct_and_diffuse(tmp_path: Path) -> None:
    """E = I cos / d^2; radiance = reflectance x E / pi; nothing is left for the other parts."""
    reflectance, height = np.array([0.2, 0.5, 0.8]), 2.0
    body = quad("floor", (0, 0, 0), (0, 0, 1), (9, 9), diffuse("0.2,0.5,0.8"), (0, 1, 0))
    place = f'<point name="position" x="0" y="3" z="{height}"/>'
    body += emitter("point", place, intensity=(5,))
    scene = open_scene(write_scene(tmp_path / "plane", body))
    view = make_view((0, 0, 1.5), (0, 1, -1), size=(24, 18))
    rays = pixel_directions(view.intrinsics, 24, 18) @ view.pose[:3, :3].T
    points = view.eye + rays * (-view.eye[2] / rays[..., 2:])
    offset = np.array([0, 3, height]) - points
    squared = (offset**2).sum(axis=-1, keepdims=True)
    irradiance = 5 * height / squared**1.5
    found = parts_of(scene, view, spp=16, max_depth=6)
    closed = reflectance * irradiance / np.pi
    np.testing.assert_allclose(found["direct"], closed, rtol=0.01)
    np.testing.assert_allclose(found["diffuse"], closed, rtol=0.01)
    np.testing.assert_allclose(found["irradiance"], irradiance.repeat(3, -1) / np.pi, rtol=0.01)
    assert found["indirect"].max() < 1e-6 * closed.max() > found["specular"].max()


@pytest.mark.slow
def test_bounces_in_a_closed_room_are_divided_as_the_series_says(tmp_path: Path) -> None:
    """Emission and the first bounce are direct; all but emission is diffuse."""
    reflectances = np.array([0.2, 0.5, 0.9])
    emit = emitter("area", radiance=(0.5,))
    walls, _ = room_walls(diffuse("0.2,0.5,0.9") + emit)
    scene = open_scene(write_scene(tmp_path / "closed", walls))
    found = parts_of(scene, make_view(size=(32, 24)), spp=64, max_depth=6, rr_depth=2)
    means = {name: image.mean(axis=(0, 1)) for name, image in found.items()}
    total = 0.5 * (1 - reflectances**6) / (1 - reflectances)
    np.testing.assert_allclose(means["direct"], 0.5 * (1 + reflectances), rtol=0.02)
    np.testing.assert_allclose(means["indirect"], total - 0.5 * (1 + reflectances), rtol=0.04)
    np.testing.assert_allclose(means["diffuse"], total - 0.5, rtol=0.02)
    np.testing.assert_allclose(means["specular"], 0.5, rtol=1e-3)
    np.testing.assert_allclose(means["irradiance"], (total - 0.5) / reflectances, rtol=0.02)
    np.testing.assert_allclose(found["direct"] + found["indirect"], found["color"], rtol=1e-5)
    np.testing.assert_allclose(found["diffuse"] + found["specular"], found["color"], rtol=1e-5)


@pytest.mark.slow
def test_mirrors_and_panes_show_direct_light_and_the_reflectance_behind(tmp_path: Path) -> None:
    """A lamp above the camera, a mirror on the left, a pane before the wall on the right."""
    walls, _ = room_walls(diffuse(0.5))
    lamp = quad("lamp", (0, 0, 2.95), (0, 0, -1), (0.8, 0.8), glow(4), (0, 1, 0))
    mirror = quad("mirror", (-1, 1.9, 1.5), (0, -1, 0), (0.9, 1.2), FAITHFUL["mirror"])
    pane = quad("pane", (1, 1.8, 1.5), (0, -1, 0), (0.9, 1.2), bsdf("thindielectric"))
    scene = open_scene(write_scene(tmp_path / "glass", walls + lamp + mirror + pane))
    view = make_view((0, -1.9, 1.5), size=(32, 16))
    found = parts_of(scene, view, spp=64, max_depth=2)
    deep = parts_of(scene, view, spp=256, max_depth=8)
    left, right, middle = np.s_[5:11, 6:12], np.s_[5:11, 20:26], np.s_[5:11, 15:17]
    shallow = found["direct"][middle].mean()
    # One vertex more for the mirror and for the pane: direct light does not end there.
    assert deep["direct"][left].mean() > 0.5 * shallow
    assert deep["diffuse"][left].max() == 0 == deep["irradiance"][left].max()
    assert deep["direct"][right].mean() == pytest.approx(shallow, rel=0.3)
    assert 0.7 < deep["diffuse"][right].mean() / deep["color"][right].mean() < 1
    np.testing.assert_allclose(deep["diffuse"], 0.5 * deep["irradiance"], rtol=1e-4, atol=1e-6)


@pytest.fixture(scope="module")
def balls(tmp_path_factory: pytest.TempPathFactory) -> Any:
    """A room with balls of three materials, its regions, and the parts of its light by other ways.

    Direct light is `path` with one bounce. For the diffuse parts, a direction is drawn evenly over
    the cosine at the first surface, `path` gives the light from there, and the lobes are formulas,
    of the balls alone: around them, pixels hold rims of balls.
    """
    scene, view, regions = shelf(tmp_path_factory.mktemp("balls"), MATERIALS, wide=True)
    integrator = path_integrator(2, 9)
    sensor = make_sensor(view, COPIES)
    direct = mi.render(scene.mitsuba, sensor=sensor, integrator=integrator, spp=4 * SPP, seed=5)
    shape = (view.height, COPIES, view.width, 3)
    images = np.moveaxis(np.asarray(direct, dtype=np.float64).reshape(shape), 1, 0)
    wanted = {"direct": region_means(images, regions)}
    for name, images in zip(("diffuse", "irradiance"), gathered(scene, view, regions), strict=True):
        wanted[name] = region_means(images, regions)[:, : len(MATERIALS)]
    return scene, view, regions, wanted


def gathered(scene: RenderScene, view: View, regions: Any) -> tuple[np.ndarray, np.ndarray]:
    """Diffuse light and irradiance over pi by gathering at the first surface, (copies, H, W, 3)."""
    spp, path = 2 * SPP, mi.load_dict({"type": "path", "max_depth": MAX_DEPTH - 1})
    sensor = make_sensor(view, COPIES)
    width, height = view.width * COPIES, view.height
    sampler = mi.load_dict({"type": "independent"})
    sampler.seed(9, width * height * spp)
    index = dr.arange(mi.UInt32, width * height * spp) // spp
    pixel = mi.Point2f(mi.Float(index % width), mi.Float(index // width)) + sampler.next_2d()
    ray, _ = sensor.sample_ray(0, 0.5, pixel / mi.Point2f(width, height), mi.Point2f(0.5))
    si = scene.mitsuba.ray_intersect(mi.Ray3f(ray))
    wo = mi.warp.square_to_cosine_hemisphere(sampler.next_2d())
    bsdfs, onward = si.bsdf(), si.spawn_ray(si.to_world(wo))
    light = path.sample(scene.mitsuba, sampler, mi.RayDifferential3f(onward))[0]
    colour = bsdfs.eval_diffuse_reflectance(si)
    lobe = dr.select(dr.max(colour) > 0, mi.Float(1), 0)
    names = np.zeros((height, view.width), dtype=np.float32)
    for number_, name in enumerate(MATERIALS):
        names[regions[name]] = number_ + 1
    which = dr.gather(mi.Float, mi.Float(np.tile(names, (1, COPIES)).ravel()), index)
    fo, fi = (dr.power(1 - dr.abs(v.z), 5) for v in (wo, si.wi))
    half = dr.normalize(wo + si.wi)
    rr = 2 * ROUGHNESS * dr.square(dr.dot(half, wo))
    burley = (1 - 0.5 * fi) * (1 - 0.5 * fo) + rr * (fo + fi + fo * fi * (rr - 1))
    lobe = dr.select(which == 1, (1 - METALLIC) * burley, lobe)
    lobe = dr.select((which == 3) | (si.wi.z * wo.z <= 0), 0, lobe)
    shape = (height, COPIES, view.width, spp, 3)
    found = []
    for image in (colour * lobe * light, lobe * light):
        values = np.array(image, dtype=np.float64).T.reshape(shape).mean(axis=3)
        found.append(np.moveaxis(values, 1, 0))
    return found[0], found[1]


def worst(balls: Any, kind: type[LightParts]) -> dict[str, float]:
    """Largest deviation of each part from its separate estimate, in standard errors."""
    scene, view, regions, wanted = balls
    found = in_parts(scene, view, SPP, COPIES, 4, kind)
    return {
        name: float(
            abs(deviations(region_means(found[name], regions)[:, : theirs.shape[1]], theirs)).max()
        )
        for name, theirs in wanted.items()
    }


@pytest.mark.slow
def test_each_part_is_unbiased(balls: Any) -> None:
    assert max(worst(balls, LightParts).values()) < 4.5


class AllIsDiffuse(LightParts):
    """Wrong weights of lobes: gloss counts as diffuse."""

    def shares(self, *vertex: Any) -> tuple[Any, Any, Any]:
        *_, reflectance = super().shares(*vertex)
        return mi.Color3f(1), mi.Color3f(1), reflectance


class _NoEmission(PathParts):
    def add_emission(self, *contribution: Any) -> None:
        pass


class LostEmission(LightParts):
    """A lost bounce: what BSDF sampling finds is left out."""

    def start(self) -> PathParts:
        return _NoEmission(**vars(super().start()))


class _Late(PathParts):
    def add_emission(self, parts: Any, ds: Any, throughput: Any, arriving: Any) -> None:
        late = dr.select(self.scattered == 2, throughput, 0)
        self.direct += late * arriving
        super().add_emission(parts, ds, throughput, arriving)


class OneBounceMore(LightParts):
    """Direct light with some light of the second bounce."""

    def start(self) -> PathParts:
        return _Late(**vars(super().start()))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("kind", "part"),
    [(AllIsDiffuse, "diffuse"), (LostEmission, "direct"), (OneBounceMore, "direct")],
)
def test_the_comparison_finds_what_is_wrong(balls: Any, kind: type[LightParts], part: str) -> None:
    assert worst(balls, kind)[part] > 6


@pytest.mark.slow
def test_parts_change_no_bit_of_colour_and_shading(tmp_path: Path) -> None:
    chosen = {name: {**FAITHFUL, **PARTING}[name] for name in ("principled", "glass", "plastic")}
    scene, view, _ = shelf(tmp_path, chosen)
    params = plain_truth(spp=16, block_spp=8)
    bare, full = (render_both(scene, view, params, 0.5, 3, light) for light in (False, True))
    for kind in ("color", "shading"):
        one, other = (stacked(getattr(truths, kind)[0]) for truths in (bare, full))
        np.testing.assert_array_equal(one, other)
        assert getattr(bare, kind)[1] == getattr(full, kind)[1]
    color = stacked(full.color[0])
    for name in ("direct", "diffuse", "indirect", "specular"):
        part = stacked(full.parts[name][0])
        assert part.mean() > 0 and (part <= color * (1 + 1e-5) + 1e-9).all(), name
