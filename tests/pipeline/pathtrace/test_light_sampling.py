"""Emitter sampling and path guiding: unbiased, and less noise where most lights are hidden."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest

from pbrnet.pipeline.lenses.model import Lens
from pbrnet.pipeline.passes.groundtruth import render_both
from pbrnet.pipeline.pathtrace.guiding import plan_guiding
from pbrnet.pipeline.pathtrace.light_plan import LightPlan, plan_lights
from pbrnet.pipeline.pathtrace.light_sampling import MAX_WEIGHTED, PlannedLights
from pbrnet.pipeline.pathtrace.portals import portal_rectangles
from pbrnet.pipeline.render.drjit_arrays import vector
from pbrnet.pipeline.render.scene import RenderScene, open_scene
from pbrnet.scenes.color import luminance
from pbrnet.scenes.contract import Portal
from tests.fixtures.encoded import picture
from tests.fixtures.joint import (
    ALBEDO,
    FAITHFUL,
    LAMP,
    PARTING,
    blocks,
    deviations,
    joined,
    plain,
    region_means,
    shelf,
    sunsky,
)
from tests.fixtures.params import plain_truth
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

pytestmark = pytest.mark.usefixtures("wavefront")

SPP, COPIES = 64, 16
SPHERE = Lens("equirectangular", 16, 8, ())
VIEW = make_view((0, -1.8, 1.5), (0.2, 1, -0.1), size=(24, 18))
SUN = sunsky()
SKY = SUN.replace('y="0.7"', 'y="-0.7"')  # the sun stands behind the house
# Lamps in a second room, behind the wall y = 2 and beside the window: none reaches the view.
HIDDEN = "".join(
    ball(f"far{index}", (3.0 + 0.3 * index, 0.5, 1.5), 0.1, glow(20)) for index in range(8)
)
# Ground before the window, which lies in the sun.
GROUND = quad("ground", (0, 8, -0.5), (0, 0, 1), (8, 5.9), diffuse(0.8), (0, 1, 0))


def room(
    folder: Path, *things: str, wall: str = "0.6,0.5,0.4", files: dict[str, bytes] | None = None
) -> RenderScene:
    walls, _ = room_walls(diffuse(wall), window=True)
    balls = ball("ball", (0.5, 1.0, 0.5), 0.5, diffuse("0.2,0.6,0.3"))
    return open_scene(
        write_scene(folder / "room", walls + balls + "".join(things), portals=[WINDOW], files=files)
    )


def planned(scene: RenderScene, kind: type[PlannedLights] = PlannedLights) -> PlannedLights:
    return kind(scene.mitsuba, plan_lights(scene.mitsuba, VIEW, scene.scene.portals, 3))


def guided(scene: RenderScene, kind: type[PlannedLights] = PlannedLights) -> PlannedLights:
    """The same, with path guiding."""
    plan = plan_lights(scene.mitsuba, VIEW, scene.scene.portals, 3)
    lights = kind(scene.mitsuba, plan, plan_guiding(scene.mitsuba, plan, 3))
    assert lights.guide is not None
    return lights


REGIONS = blocks(24, 18, 3, 1)
_REFERENCES: dict[str, np.ndarray] = {}


def reference(scene: RenderScene) -> np.ndarray:
    """Region means of images by Mitsuba's own path tracer, rendered once per scene."""
    key = scene.scene.xml.read_text()
    if key not in _REFERENCES:
        _REFERENCES[key] = region_means(plain(scene, VIEW, None, 3, 4 * SPP, COPIES, 2), REGIONS)
    return _REFERENCES[key]


def off_by(scene: RenderScene, lights: Any) -> np.ndarray:
    """Standard errors between our images' regions and Mitsuba's own, (regions, 3)."""
    ours, _ = joined(scene, VIEW, 3, SPP, COPIES, 1, lights=lights)
    return deviations(region_means(ours, REGIONS), reference(scene))


@pytest.mark.slow
@pytest.mark.parametrize(
    "things", [(LAMP, SUN), (LAMP, HIDDEN, SUN), (LAMP, HIDDEN)], ids=["sun", "all", "night"]
)
def test_planned_light_is_unbiased(things: tuple[str, ...], tmp_path: Path) -> None:
    scene = room(tmp_path, *things)
    assert abs(off_by(scene, planned(scene))).max() < 4.5


@pytest.mark.slow
def test_every_material_is_unbiased_under_it(tmp_path: Path) -> None:
    scene, view, regions = shelf(tmp_path, FAITHFUL)
    lights = PlannedLights(scene.mitsuba, plan_lights(scene.mitsuba, view, (WINDOW,), 3))
    assert lights.outdoors is not None and not lights.outdoors.own_sampling
    ours, _ = joined(scene, view, 3, SPP // 2, COPIES, 1, lights=lights)
    theirs = plain(scene, view, None, 3, SPP // 2, COPIES, 2)
    off = abs(deviations(region_means(ours, regions), region_means(theirs, regions)))
    assert off.max() < 4.5


def every_strategy(plan: LightPlan) -> LightPlan:
    """The plan with a third of the probability for the environment's own sampling."""
    emitters = plan.emitters.copy()
    emitters[emitters == 0] = 0.5
    total = emitters.sum() + plan.portals.sum() + plan.sun
    return replace(
        plan,
        emitters=emitters / total,
        portals=plan.portals / total,
        sun=plan.sun / total,
        strengths=None,  # by these shares everywhere
    )


class EveryStrategy(PlannedLights):
    """Samples the environment itself as well: three strategies give the same directions."""

    def __init__(self, scene: Any, plan: LightPlan) -> None:
        super().__init__(scene, every_strategy(plan))
        assert self.outdoors is not None and self.outdoors.own_sampling


class StrategiesForgotten(EveryStrategy):
    """Uses the density of the one strategy that was used, as if there were no others."""

    def __init__(self, scene: Any, plan: LightPlan) -> None:
        super().__init__(scene, plan)
        assert self.outdoors is not None
        self.outdoors.own_sampling = False


class ChoiceForgotten(PlannedLights):
    """Ignores the probability with which an emitter was sampled."""

    def _sample_emitter(self, *given: Any) -> tuple[Any, Any]:
        ds, light = super()._sample_emitter(*given)
        return ds, light * 0.8


class DensityDoubled(PlannedLights):
    """Doubles its density where BSDF sampling found a light."""

    def density(self, scene: Any, before: Any, choice: Any, ds: Any, active: Any) -> Any:
        return 2 * super().density(scene, before, choice, ds, active)


WIDE = quad("wide", (0, 0, 2.95), (0, 0, -1), (1.6, 1.6), glow("3,2,1"), (0, 1, 0))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("kind", "things"),
    [(EveryStrategy, (LAMP, SUN)), (PlannedLights, (WIDE, SUN))],
    ids=["ways", "one"],
)
def test_the_comparison_passes_what_is_right(
    kind: type[PlannedLights], things: tuple[str, ...], tmp_path: Path
) -> None:
    scene = room(tmp_path, *things)
    assert abs(off_by(scene, planned(scene, kind))).max() < 4.5


@pytest.mark.slow
@pytest.mark.parametrize("kind", [StrategiesForgotten, ChoiceForgotten, DensityDoubled])
def test_the_comparison_finds_mistakes(kind: type[PlannedLights], tmp_path: Path) -> None:
    scene = room(tmp_path, LAMP if issubclass(kind, EveryStrategy) else WIDE, SUN)
    assert abs(off_by(scene, planned(scene, kind))).max() > 6


def test_less_noise_where_lamps_are_hidden_and_the_sky_is_behind_walls(tmp_path: Path) -> None:
    """Mean squared error, the brightest thousandth left out, at equal samples."""
    for name, things, most in (("night", (LAMP, HIDDEN), 0.3), ("sky", (SKY,), 0.75)):
        scene = room(tmp_path / name, *things)
        images = {}
        for lights in (None, planned(scene)):
            copies, _ = joined(scene, VIEW, 5, 16, COPIES, 5, lights=lights)
            images[lights is None] = copies
        reference = (images[True].mean(axis=0) + images[False].mean(axis=0)) / 2
        errors = {
            uniform: np.quantile((copies - reference) ** 2, np.linspace(0, 0.999, 1000)).mean()
            for uniform, copies in images.items()
        }
        assert errors[False] < most * errors[True], name


def test_the_plan_samples_what_lights_the_view(tmp_path: Path) -> None:
    scene = room(tmp_path, LAMP, HIDDEN, SKY)
    plan = plan_lights(scene.mitsuba, VIEW, scene.scene.portals, 0)
    assert plan.emitters.sum() + plan.portals.sum() + plan.sun == pytest.approx(1)
    assert len(plan.portals) == 1 and 0.05 < plan.portals.sum() < 0.95
    shares = np.sort(plan.emitters)
    assert shares[0] == 0  # the environment's own sampling: window and sun are all there is
    alike = 0.05 / 11  # nine lamps, the window, the sun
    np.testing.assert_allclose(shares[1:9], alike, rtol=0.01)  # the hidden lamps
    assert plan.sun == pytest.approx(alike, rel=0.01)  # behind the house
    assert shares[9] > 0.02


@pytest.mark.parametrize(
    "turned", ["", '<transform name="to_world"><rotate z="1" angle="70"/></transform>']
)
def test_the_sun_is_found_where_it_stands_and_as_large_as_it_is(
    turned: str, tmp_path: Path
) -> None:
    sun = SUN.replace("</emitter>", turned + "</emitter>")
    scene = room(tmp_path, LAMP, sun)
    plan = plan_lights(scene.mitsuba, VIEW, (WINDOW,), 0)
    assert plan.sun_disc is not None
    if not turned:
        wanted = np.array([-0.3, 0.7, 0.5])
        np.testing.assert_allclose(
            plan.sun_disc.direction, wanted / np.linalg.norm(wanted), atol=1e-6
        )
    beyond = dr.zeros(mi.SurfaceInteraction3f, 2)
    aside = plan.sun_disc.direction + np.array([0.0, 0.0, 0.02])  # a degree higher
    directions = np.stack([plan.sun_disc.direction, aside / np.linalg.norm(aside)])
    beyond.wi = vector(mi.Vector3f, -directions)
    shown = np.array(scene.mitsuba.environment().eval(beyond))[1]
    assert shown[0] > 20 * shown[1]
    # Mitsuba's sun spans 0.5358 degrees; ours a little more.
    assert 0.2679 < np.degrees(np.arccos(plan.sun_disc.cosine)) < 0.29


def test_other_environments_keep_their_own_sampling_where_they_are_uneven(tmp_path: Path) -> None:
    """A constant sky is smooth; an environment map need not be."""
    constant = '<emitter type="constant"><rgb name="radiance" value="1"/></emitter>'
    plan = plan_lights(room(tmp_path / "a", LAMP, constant).mitsuba, VIEW, (WINDOW,), 0)
    assert plan.emitters.min() == 0 and plan.sun_disc is None and plan.sun == 0
    sky = picture(np.full((8, 16, 3), 200, dtype=np.uint8))
    envmap = '<emitter type="envmap"><string name="filename" value="sky.png"/></emitter>'
    under_map = room(tmp_path / "b", LAMP, envmap, files={"sky.png": sky})
    plan = plan_lights(under_map.mitsuba, VIEW, (WINDOW,), 0)
    assert plan.emitters.min() > 0 and plan.portals.sum() > 0


def test_the_plan_depends_on_no_colour_and_repeats(tmp_path: Path) -> None:
    plans = [
        plan_lights(room(tmp_path / wall, LAMP, SUN, wall=wall).mitsuba, VIEW, (WINDOW,), 3)
        for wall in ("0.9", "0.1,0.2,0.5", "0.1,0.2,0.5")
    ]
    for plan in plans[1:]:
        np.testing.assert_array_equal(plan.emitters, plans[0].emitters)
        np.testing.assert_array_equal(plan.portals, plans[0].portals)
        assert plan.sun == plans[0].sun


def test_densities_through_portals_integrate_to_one(tmp_path: Path) -> None:
    """Over all directions from a point before them; each portal counts by its probability."""
    scene = room(tmp_path, SUN)
    second = replace(WINDOW, polygon=((-2, -1, 0.5), (-2, 1, 0.5), (-2, 1, 2), (-2, -1, 2)))
    west = Portal("west", "window", second.polygon, (-1, 0, 0), True)
    rectangles = portal_rectangles((WINDOW, west))
    np.testing.assert_allclose(rectangles.area, [1.0, 3.0])
    plan = plan_lights(scene.mitsuba, VIEW, (WINDOW,), 0)
    plan = replace(plan, rectangles=rectangles, portals=np.array([0.3, 0.7]), strengths=None)
    outdoors = PlannedLights(scene.mitsuba, plan).outdoors
    assert outdoors is not None and outdoors.portals is not None
    sampler = outdoors.portals
    random = np.random.default_rng(0).normal(size=(1 << 20, 3))
    random /= np.linalg.norm(random, axis=1, keepdims=True)
    towards = vector(mi.Vector3f, random)
    density = np.array(sampler.density(mi.Point3f(0.4, -0.5, 1.2), towards, sampler.probabilities))
    assert 4 * np.pi * density.mean() == pytest.approx(1, rel=0.02)
    north = random[:, 1] * 2.5 > abs(random[:, 0]) * 2.5
    assert 4 * np.pi * (density * north).mean() == pytest.approx(0.3, rel=0.05)
    outside = np.array(sampler.density(mi.Point3f(0, 3, 1.5), towards, sampler.probabilities))
    assert outside[random[:, 1] > 0].max() == 0 or (outside > 0).mean() < 0.2


def probabilities_at(
    lights: PlannedLights, place: tuple[float, float, float], normal: tuple[float, float, float]
) -> np.ndarray:
    """Probabilities of each weighted lamp, all others together, each portal, the sun."""
    found = lights.choice(mi.Point3f(*map(float, place)), mi.Normal3f(*map(float, normal)))
    return np.array([float(np.array(chance).ravel()[0]) for chance in found])


def test_each_vertex_samples_what_is_near_and_faces_it(tmp_path: Path) -> None:
    east, west = (ball(name, (x, 0, 2.5), 0.05, glow(9)) for name, x in (("e", 1.5), ("w", -1.5)))
    lights = planned(room(tmp_path, east, west))
    assert (
        lights.outdoors is None and lights.emitters is not None and lights.emitters.slots > 2
    )  # some are empty
    below = [probabilities_at(lights, (x, 0, 0), (0, 0, 1)) for x in (1.5, -1.5)]
    for chances in below:
        assert chances.sum() == pytest.approx(1) and chances.min() >= 0
        # Alike strong: 1 to (2.5 / 3.9)^2 times the cosine 2.5 / 3.9 or a little more.
        assert 0.6 < max(chances) < 0.8
    assert np.argmax(below[0]) != np.argmax(below[1])


def test_the_sun_is_sampled_where_it_can_shine(tmp_path: Path) -> None:
    scene = room(tmp_path, LAMP, SUN)  # it stands at (-0.3, 0.7, 0.5), beyond the window in y = 2
    indoors = np.array([[-2.0, -2, 0], [2, 2, 3]])
    plan = plan_lights(scene.mitsuba, VIEW, (WINDOW,), 3, indoors)
    assert plan.strengths is not None and plan.strengths.sun > 0
    lights = PlannedLights(scene.mitsuba, plan)
    middle = np.mean(WINDOW.polygon, axis=0)
    down = middle - middle[2] / 0.5 * np.array([-0.3, 0.7, 0.5])  # where its rays meet the floor
    lit, dark = (
        probabilities_at(lights, (*place, 0.0), (0, 0, 1))[-1] for place in (down[:2], (1.8, 1.9))
    )
    assert dark <= 0.2 * plan.sun + 1e-6
    assert lit > 3 * dark
    outside = probabilities_at(lights, (0, 9.0, 0), (0, 0, 1))[-1]
    assert outside > 3 * dark, "nothing stands between"


@pytest.mark.slow
def test_without_strengths_the_views_probabilities_decide(tmp_path: Path) -> None:
    scene = room(tmp_path, LAMP, HIDDEN, SUN)
    plan = plan_lights(scene.mitsuba, VIEW, (WINDOW,), 3)
    lights = PlannedLights(scene.mitsuba, replace(plan, strengths=None))
    chances = probabilities_at(lights, (0, 0, 0), (0, 0, 1))
    assert chances[0] == pytest.approx(plan.emitters.sum())
    assert chances[-1] == pytest.approx(plan.sun)
    assert chances[1:-1].sum() == pytest.approx(plan.portals.sum())
    assert abs(off_by(scene, lights)).max() < 4.5


@pytest.mark.slow
def test_more_lamps_than_are_weighted_follow_the_views_probabilities(tmp_path: Path) -> None:
    row = [
        ball(f"b{i}", (-1.6 + 0.2 * i, 0.5, 2.6), 0.04, glow(9)) for i in range(MAX_WEIGHTED + 4)
    ]
    scene = room(tmp_path, *row, SUN)
    lights = planned(scene)
    assert lights.emitters is not None and lights.emitters.slots == MAX_WEIGHTED
    assert probabilities_at(lights, (0, 0, 0), (0, 0, 1)).sum() == pytest.approx(1)
    assert abs(off_by(scene, lights)).max() < 4.5


def test_the_parameter_switches_it_and_both_agree(tmp_path: Path) -> None:
    scene = room(tmp_path, LAMP, SUN)
    params = plain_truth(spp=256, block_spp=32)
    images = []
    for lights in ("planned", "uniform"):
        truths = render_both(scene, VIEW, replace(params, lights=lights), 0.5, 1)  # type: ignore[arg-type]
        images.append(np.stack([truths.shading[0][band] for band in "RGB"], axis=-1))
    assert (images[0] != images[1]).any()
    np.testing.assert_allclose(np.median(images[0]), np.median(images[1]), rtol=0.1)


def test_a_scene_without_rooms_is_lit_all_the_same(tmp_path: Path) -> None:
    scene = room(tmp_path, LAMP, SUN)
    bare = replace(scene, scene=replace(scene.scene, rooms=()))
    truths = render_both(bare, VIEW, plain_truth(spp=4, block_spp=2), 0.5, 1)
    assert truths.color[1]["black"] < 1


def test_a_scene_without_lights_is_black(tmp_path: Path) -> None:
    """Even if another open scene has emitters."""
    lit = room(tmp_path / "lit", LAMP)
    params = plain_truth(spp=4, block_spp=2)
    assert render_both(lit, VIEW, params, 0.5, 1).color[1]["black"] < 1
    truths = render_both(room(tmp_path), VIEW, params, 0.5, 1)
    assert truths.color[1]["black"] == 1


@pytest.mark.slow
@pytest.mark.parametrize("things", [(SUN, GROUND), (LAMP, SUN, GROUND), (LAMP, HIDDEN)])
def test_guided_paths_are_unbiased(things: tuple[str, ...], tmp_path: Path) -> None:
    scene = room(tmp_path, *things)
    assert abs(off_by(scene, guided(scene))).max() < 4.5


@pytest.mark.slow
@pytest.mark.parametrize(
    "materials",
    [
        pytest.param(FAITHFUL, id="faithful", marks=pytest.mark.check),
        pytest.param(PARTING, id="parting"),
    ],
)
def test_every_material_is_unbiased_when_paths_are_guided(
    tmp_path: Path, materials: dict[str, str]
) -> None:
    scene, view, regions = shelf(tmp_path, materials, more=GROUND)
    plan = plan_lights(scene.mitsuba, view, (WINDOW,), 3)
    lights = PlannedLights(scene.mitsuba, plan, plan_guiding(scene.mitsuba, plan, 3))
    assert lights.guide is not None
    pair = joined(scene, view, 3, SPP // 2, COPIES, 1, lights=lights)
    for seed, (images, albedo) in enumerate(zip(pair, (None, ALBEDO), strict=True)):
        theirs = plain(scene, view, albedo, 3, SPP // 2, COPIES, 2 + seed)
        off = abs(deviations(region_means(images, regions), region_means(theirs, regions)))
        assert off.max() < 4.5, albedo


class GuidingForgotten(PlannedLights):
    """Takes all directions for the material's own, though some of them were guided."""

    def guidance(self, si: Any, active: Any) -> Any:
        found = super().guidance(si, active)
        assert found is not None
        found.mixed = lambda pdf, guided: pdf  # type: ignore[method-assign]
        return found


@pytest.mark.slow
def test_a_forgotten_guiding_density_is_found(tmp_path: Path) -> None:
    scene = room(tmp_path, LAMP, SUN, GROUND)
    assert abs(off_by(scene, guided(scene, GuidingForgotten))).max() > 6


DARK_SKY = SUN.replace('value="0.02"', 'value="1"')


@pytest.mark.slow
@pytest.mark.parametrize(
    ("things", "most"),
    [
        ((DARK_SKY.replace('y="0.7"', 'y="-0.2"'), GROUND), 0.5),  # no sun comes in
        ((ball("bulb", (1.7, 1.2, 2.85), 0.02, glow(2000)),), 0.8),  # in a corner
    ],
    ids=["sunlit ground", "corner"],
)
def test_less_noise_by_guiding(things: tuple[str, ...], most: float, tmp_path: Path) -> None:
    scene = room(tmp_path, *things)
    lights = guided(scene)
    noise: dict[bool, list[float]] = {}
    for guide in (lights.guide, None):
        lights.guide = guide
        noise[guide is not None] = [
            float(np.quantile(image.var(axis=0), np.linspace(0, 0.99, 100)).mean())
            for image in joined(scene, VIEW, 5, 16, COPIES, 5, lights=lights)
        ]
    for with_guide, alone in zip(noise[True], noise[False], strict=True):
        assert with_guide < most * alone


def test_guiding_targets_are_where_the_light_falls(tmp_path: Path) -> None:
    scene = room(tmp_path, DARK_SKY, GROUND)  # the sun stands at (-0.3, 0.7, 0.5)
    plan = plan_lights(scene.mitsuba, VIEW, (WINDOW,), 3)
    found = plan_guiding(scene.mitsuba, plan, 3)
    assert found is not None and len(found.strengths) > 4
    targets = found.targets
    through = targets.normal @ [0, 1, 0] > 0.99
    np.testing.assert_allclose(
        targets.centre[through & (targets.area > 0.9)], [[0, 2, 1.5]], atol=1e-6
    )
    # Each point of the window, 1 to 2 m above the floor, is to be found on the floor.
    patch = targets.centre[
        (targets.normal @ [0, 0, -1] > 0.99) & (abs(targets.centre[:, 2]) < 0.01)
    ]
    height = (2 - patch[:, 1]) / 0.7 * 0.5
    aside = patch[:, 0] - height / 0.5 * 0.3
    assert len(patch) > 2 and (abs(height - 1.5) < 0.52).all() and (abs(aside) < 0.52).all()


def test_no_guiding_targets_without_sun_lamps_and_ground(tmp_path: Path) -> None:
    sky = '<emitter type="constant"><rgb name="radiance" value="1"/></emitter>'
    scene = room(tmp_path, sky)
    plan = plan_lights(scene.mitsuba, VIEW, (WINDOW,), 3)
    assert plan_guiding(scene.mitsuba, plan, 3) is None


def test_the_share_of_guided_paths(tmp_path: Path) -> None:
    lights = guided(room(tmp_path, SUN, GROUND))
    si = dr.zeros(mi.SurfaceInteraction3f, 3)
    si.p = mi.Point3f([0, 0, 0], [0, 1.0, 40], [0.01, 0.01, 1])  # two on the floor, one far away
    si.n, si.wi = mi.Normal3f(0, 0, 1), mi.Vector3f(0, 0, 1)
    guidance = lights.guidance(si, mi.Bool(True, True, True))
    assert guidance is not None
    share = np.array(guidance.share)
    assert (share[:2] > 0.05).all() and (share < 0.4).all() and share[2] < 0.02
    chances = np.array(sum(guidance.probabilities))
    np.testing.assert_allclose(chances[:2], 1, rtol=1e-5)


@pytest.mark.slow
def test_shading_depends_on_no_colour_when_paths_are_guided(tmp_path: Path) -> None:
    images = []
    for number, wall in enumerate(("0.6,0.5,0.4", "0.1,0.3,0.9")):
        scene = room(tmp_path / str(number), SUN, GROUND, wall=wall)
        truths = render_both(scene, VIEW, plain_truth(spp=8, block_spp=4), 0.5, 1)
        images.append(np.stack([truths.shading[0][band] for band in "RGB"]))
    np.testing.assert_array_equal(images[0], images[1])


def test_the_plan_of_a_panorama_hardly_depends_on_chance(tmp_path: Path) -> None:
    """Its pilot meets the sunlit ground outside often enough to know how much light it gives."""
    scene = room(tmp_path, SKY, GROUND)
    view = make_view((-1, -1, 1.5), (-1, -1, -0.1), size=(24, 18))
    box = ((-2, -2, 0), (2, 2, 3))
    suns = [plan_lights(scene.mitsuba, view, (WINDOW,), seed, box, SPHERE).sun for seed in range(6)]
    assert min(suns) > 0.02 and max(suns) < 1.5 * min(suns)


def test_the_sun_is_sampled_where_the_pilot_missed_its_patch(tmp_path: Path) -> None:
    """Through a window of 10 cm the sun lights a patch that hardly a pilot ray meets.

    Its strength is the irradiance of a surface that faces the sun: radiance times solid angle.
    """
    half, rim = 0.05, 0.225
    matt = diffuse("0.6,0.6,0.6")
    walls, _ = room_walls(matt, window=True)
    inwards = (0.0, -1.0, 0.0)
    walls += quad("left", (-half - rim, 2, 1.5), inwards, (rim, 0.5), matt)
    walls += quad("right", (half + rim, 2, 1.5), inwards, (rim, 0.5), matt)
    walls += quad("above", (0, 2, 1.5 + half + rim), inwards, (half, rim), matt)
    walls += quad("below", (0, 2, 1.5 - half - rim), inwards, (half, rim), matt)
    corners = ((-1, -1), (1, -1), (1, 1), (-1, 1))
    polygon = tuple((half * x, 2.0, 1.5 + half * z) for x, z in corners)
    small = replace(WINDOW, polygon=polygon)
    scene = open_scene(write_scene(tmp_path / "room", walls + SUN, portals=[small]))
    view = make_view((-1, -1.8, 1.5), (1.9, 1.7, -1.5), size=(24, 18))
    plans = [plan_lights(scene.mitsuba, view, (small,), seed) for seed in range(4)]
    sun = plans[0].sun_disc
    assert sun is not None
    outdoors = dr.zeros(mi.SurfaceInteraction3f, 1)
    outdoors.wi = vector(mi.Vector3f, -sun.direction[None])
    radiance = luminance(np.array(scene.mitsuba.environment().eval(outdoors)).T[0])
    for plan in plans:
        assert plan.strengths is not None
        assert plan.strengths.sun == pytest.approx(radiance / sun.density, rel=0.1)
