"""Joint path tracer: each of its two images equals a render of its own."""

from pathlib import Path
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest

from pbrnet.pipeline.passes.groundtruth import render_both, render_truth
from pbrnet.pipeline.pathtrace.integrator import JointPath
from pbrnet.pipeline.pathtrace.scattering import PathState, Scattering
from pbrnet.pipeline.render.scene import open_scene
from tests.fixtures.joint import (
    ALBEDO,
    BASED,
    FAITHFUL,
    MAX_DEPTH,
    PARTING,
    alone,
    deviations,
    each_sample,
    each_sample_of_path,
    joined,
    plain,
    region_means,
    shelf,
)
from tests.fixtures.params import plain_truth
from tests.fixtures.render import ball, diffuse, make_view, room_walls, write_scene

pytestmark = pytest.mark.usefixtures("wavefront")

COPIES, SPP = 16, 16
SUSPECT_SPP = 64


def stacked(truth: tuple[dict[str, np.ndarray], dict[str, Any]]) -> np.ndarray:
    return np.stack([truth[0][band] for band in "RGB"], axis=-1).astype(np.float64)


def same_samples(ours: np.ndarray, theirs: np.ndarray) -> np.ndarray:
    """Samples that agree but for rounding: products are formed in another order than in `path`."""
    return np.isclose(ours, theirs, rtol=1e-4, atol=1e-6).all(axis=-1)


@pytest.mark.slow
def test_shading_depends_on_no_colour(tmp_path: Path) -> None:
    """Bit-identical, with roulette, where both materials choose the same direction."""
    others = {"0.8,0.1,0.05": "0.1,0.6,0.9", "black.png": "checks.png", '"Au"': '"Ag"'}
    repainted = {}
    for name, text in FAITHFUL.items():
        for before, after in others.items():
            text = text.replace(before, after)
        repainted[name] = text
    pairs = []
    for folder, materials in (("one", FAITHFUL), ("other", repainted)):
        scene, view, _ = shelf(tmp_path / folder, materials)
        pairs.append(joined(scene, view, 2, 16, 2, 7))
    assert np.array_equal(pairs[0][1], pairs[1][1])
    assert not np.array_equal(pairs[0][0], pairs[1][0])


@pytest.mark.slow
def test_without_roulette_both_images_are_paths_own(tmp_path: Path) -> None:
    scene, view, regions = shelf(tmp_path, FAITHFUL)
    pair = each_sample(scene, view, MAX_DEPTH + 1, 16, 5)
    for got, albedo in zip(pair, (None, ALBEDO), strict=True):
        wanted = each_sample_of_path(scene, view, albedo, MAX_DEPTH + 1, 16, 5)
        for name, pixels in regions.items():
            assert same_samples(got, wanted)[pixels].mean() > 0.999, name
            np.testing.assert_allclose(
                got[pixels].mean(), wanted[pixels].mean(), rtol=1e-4, err_msg=name
            )
    assert abs(pair[0] - pair[1]).mean() > 0.1 * pair[0].mean()


@pytest.mark.slow
def test_colour_alone_is_paths_own(tmp_path: Path) -> None:
    """Sample by sample without roulette, where a twin would part from it; with it unbiased."""
    scene, view, regions = shelf(tmp_path, PARTING)
    (got,) = each_sample(scene, view, MAX_DEPTH + 1, 16, 5, alone=True)
    wanted = each_sample_of_path(scene, view, None, MAX_DEPTH + 1, 16, 5)
    for name, pixels in regions.items():
        assert same_samples(got, wanted)[pixels].mean() > 0.999, name
    ours, theirs = (
        region_means(images, regions)
        for images in (
            alone(scene, view, 2, SPP, COPIES, 1),
            plain(scene, view, None, 2, SPP, COPIES, 2),
        )
    )
    assert abs(deviations(ours, theirs)).max() < 4.5


@pytest.fixture(scope="module", params=[(FAITHFUL, 1.05), (PARTING, 1.15)], ids=["same", "parting"])
def both_ways(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Any:
    """Regions, largest ratio of noise, and pairs of images (joint trace, Mitsuba's own)."""
    materials, most = request.param
    scene, view, regions = shelf(tmp_path_factory.mktemp("shelf"), materials)
    pair = joined(scene, view, 2, SPP, COPIES, 1)
    others = [
        plain(scene, view, None, 2, SPP, COPIES, 2),
        plain(scene, view, ALBEDO, 2, SPP, COPIES, 3),
    ]
    return regions, most, list(zip(pair, others, strict=True))


@pytest.mark.slow
def test_each_image_is_unbiased(both_ways: Any) -> None:
    regions, _, images = both_ways
    for joint, separate in images:
        ours, theirs = region_means(joint, regions), region_means(separate, regions)
        off = abs(deviations(ours, theirs))
        for name, worst in zip(regions, off.max(axis=-1), strict=True):
            assert worst < 4.5, name
        lit = theirs.mean(axis=0) > 0
        error = (ours.std(axis=0, ddof=1) / np.sqrt(COPIES))[lit] / theirs.mean(axis=0)[lit]
        assert np.median(error) < 0.02  # so that a bias of a few per cent cannot hide


@pytest.mark.slow
def test_a_joint_trace_is_hardly_noisier_than_separate_ones(both_ways: Any) -> None:
    """With roulette from the second vertex on; directions that differ cost samples."""
    _, most, images = both_ways
    for pair in images:
        ours, theirs = (np.log(each.std(axis=0, ddof=1).mean(axis=-1) + 1e-9) for each in pair)
        assert np.mean(ours - theirs) < np.log(most)


class NoCosine(JointPath):
    def scatter(self, bsdf: Any, si: Any, wo: Any, *rest: Any) -> Scattering:
        got = super().scatter(bsdf, si, wo, *rest)
        got.weight = got.weight * dr.abs(mi.Frame3f.cos_theta(got.sample.wo))
        return got


class NoDelta(JointPath):
    def scatter(self, *arguments: Any) -> Scattering:
        got = super().scatter(*arguments)
        delta = mi.has_flag(got.sample.sampled_type, mi.BSDFFlags.DeltaReflection)
        got.weight = dr.select(delta, 0, got.weight)
        return got


class LightCountedTwice(JointPath):
    def emitter_sampling_value(self, scattering: Scattering, ds: Any) -> Any:
        return scattering.value


class DensityOfTheOther(JointPath):
    def choose_direction(self, colour: PathState, neutral: PathState, *rest: Any) -> Any:
        chosen = super().choose_direction(colour, neutral, *rest)
        neutral.pdf = 0.3 * colour.pdf
        return chosen


class CoinNotPaidFor(JointPath):
    def choose_direction(
        self, colour: PathState, neutral: PathState, one: Any, other: Any, random: Any
    ) -> Any:
        before = mi.Color3f(colour.throughput), mi.Color3f(neutral.throughput)
        chosen = super().choose_direction(colour, neutral, one, other, random)
        for branch, old, scattering in zip((colour, neutral), before, (one, other), strict=True):
            branch.throughput = dr.minimum(branch.throughput, old * scattering.weight)
        return chosen


class ColourLeads(JointPath):
    """Always follows the colour's direction, as if the neutral twin had chosen it."""

    def choose_direction(
        self, colour: PathState, neutral: PathState, one: Any, other: Any, random: Any
    ) -> Any:
        neutral.throughput = neutral.throughput * other.weight
        colour.throughput = colour.throughput * one.weight
        for branch, scattering in ((colour, one), (neutral, other)):
            branch.pdf = scattering.sample.pdf
            branch.delta = mi.has_flag(scattering.sample.sampled_type, mi.BSDFFlags.Delta)
        return one.sample.wo, one.sample.eta, random


class RouletteOfColour(JointPath):
    def roulette(self, colour: PathState, neutral: PathState, eta: Any, depth: Any) -> Any:
        return super().roulette(colour, colour, eta, depth)


class RouletteNotPaidFor(JointPath):
    def roulette(self, *arguments: Any) -> Any:
        return super().roulette(*arguments)[0], mi.Float(1)


WRONG = [
    NoCosine,
    NoDelta,
    LightCountedTwice,
    DensityOfTheOther,
    CoinNotPaidFor,
    ColourLeads,
    RouletteOfColour,
    RouletteNotPaidFor,
]


@pytest.fixture(scope="module")
def suspects(tmp_path_factory: pytest.TempPathFactory) -> Any:
    """A small room, and region means of its two images by Mitsuba's own path tracer."""
    chosen = {name: {**FAITHFUL, **PARTING}[name] for name in ("black texture", "gold", "plastic")}
    chosen["polished plastic"] = PARTING["rough plastic"].replace("0.2", "0.05")
    scene, view, regions = shelf(tmp_path_factory.mktemp("suspects"), chosen, wide=True)
    wanted = [
        region_means(plain(scene, view, albedo, 1, SUSPECT_SPP, COPIES, 3), regions)
        for albedo in (None, ALBEDO)
    ]
    return scene, view, regions, wanted


def worst(suspects: Any, kind: type[JointPath]) -> float:
    scene, view, regions, wanted = suspects
    pair = joined(scene, view, 1, SUSPECT_SPP, COPIES, 4, kind)
    return max(
        float(abs(deviations(region_means(images, regions), theirs)).max())
        for images, theirs in zip(pair, wanted, strict=True)
    )


@pytest.mark.slow
def test_the_comparison_passes_what_is_right(suspects: Any) -> None:
    assert worst(suspects, JointPath) < 4.5


@pytest.mark.slow
@pytest.mark.parametrize("kind", WRONG)
def test_the_comparison_finds_what_is_wrong(suspects: Any, kind: type[JointPath]) -> None:
    assert worst(suspects, kind) > 6


def test_bases_give_the_images_of_each_material_and_its_twin(tmp_path: Path) -> None:
    """Among materials that have none; the random numbers are the same."""
    apart = {name: PARTING[name] for name in ("plastic", "tinted gloss")}
    apart |= {name: FAITHFUL[name] for name in ("gold", "principled glass", "blend")}
    scene, view, regions = shelf(tmp_path / "room", BASED | apart)
    with_bases = joined(scene, view, 2, 16, 1, 1, with_bases=True)
    for based, apiece in zip(with_bases, joined(scene, view, 2, 16, 1, 1), strict=True):
        gap = abs(based - apiece).max(axis=-1)[0] / (abs(apiece).max(axis=-1)[0] + 1e-3)
        assert np.quantile(gap, 0.98) < 1e-3  # rounding turns a few paths another way
        for name, pixels in regions.items():
            assert np.median(gap[pixels]) < 1e-4, name
    bases = sum(each.basis is not None for each in scene.materials.bases(ALBEDO))
    assert bases >= len(BASED)
    assert sum(each.twin is not None for each in scene.materials.bases(ALBEDO)) >= len(apart)


@pytest.mark.slow
def test_bounces_in_a_closed_room_are_the_geometric_series(tmp_path: Path) -> None:
    emit = '<emitter type="area"><rgb name="radiance" value="0.5"/></emitter>'
    walls, _ = room_walls(diffuse("0.2,0.5,0.9") + emit)
    scene = open_scene(write_scene(tmp_path / "closed", walls))
    view = make_view(size=(32, 24))
    for depth in (1, 2, 6):
        params = plain_truth(spp=64, max_depth=depth, rr_depth=2)
        both = render_both(scene, view, params, 0.7, 3)
        for truth, reflectances in ((both.color, (0.2, 0.5, 0.9)), (both.shading, (0.7,) * 3)):
            means = stacked(truth).mean(axis=(0, 1))
            series = [0.5 * (1 - r**depth) / (1 - r) for r in reflectances]
            np.testing.assert_allclose(means, series, rtol=0.02)


def test_a_white_furnace_is_white_in_both(tmp_path: Path) -> None:
    sky = '<emitter type="constant"><rgb name="radiance" value="1"/></emitter>'
    body = ball("s", (0, 2, 1.5), 1.0, diffuse(1.0)) + sky
    scene = open_scene(write_scene(tmp_path / "furnace", body))
    both = render_both(scene, make_view(size=(16, 16)), plain_truth(spp=256), 1.0, 3)
    for truth in (both.color, both.shading):
        assert stacked(truth).mean() == pytest.approx(1, rel=2e-3)


def test_black_things_have_shading(tmp_path: Path) -> None:
    walls, _ = room_walls(diffuse(0))
    lamp = '<emitter type="constant"><rgb name="radiance" value="1"/></emitter>'
    scene = open_scene(write_scene(tmp_path / "black", walls.replace('z="3"', 'z="4"') + lamp))
    params = plain_truth(spp=64, max_depth=6, rr_depth=1)
    view = make_view(size=(16, 12))
    both = render_both(scene, view, params, 0.5, 0)
    alone = stacked(render_truth(scene.neutral(0.5), view, params, 1))
    assert stacked(both.shading).mean() == pytest.approx(alone.mean(), rel=0.03)
