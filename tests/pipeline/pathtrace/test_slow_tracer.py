"""Joint path tracer against a NumPy path tracer that shares no code with it or with Mitsuba."""

import numpy as np
import pytest

from pbrnet.pipeline.pathtrace.integrator import available
from pbrnet.pipeline.pathtrace.light_plan import plan_lights
from pbrnet.pipeline.pathtrace.light_sampling import PlannedLights, UniformLights
from pbrnet.pipeline.render.scene import RenderScene, open_scene, set_variant
from tests.fixtures.joint import ALBEDO, MAX_DEPTH, blocks, deviations, joined, region_means
from tests.fixtures.render import make_view, write_scene
from tests.fixtures.slow_tracer import Ball, Material, Rectangle, Surface, picture

COPIES, SPP = 12, 256
VIEW = make_view((0, -1.8, 1.5), (0.1, 1, -0.1), size=(16, 12))
FLAT = (0.0, 1.0, 0.0)
LAMP = Material("diffuse", (0, 0, 0), (6, 5, 3))
REGIONS = blocks(16, 12, 3, 4)


def walls(*colours: tuple[float, float, float], light: float = 0) -> list[Surface]:
    """A closed room, x and y in [-2, 2], z in [0, 3]."""
    paints = [Material("diffuse", colour, (light,) * 3) for colour in colours]
    return [
        Rectangle((0, 0, 0), (0, 0, 1), (2, 2), paints[0], FLAT),
        Rectangle((0, 0, 3), (0, 0, -1), (2, 2), paints[1 % len(paints)], FLAT),
        Rectangle((-2, 0, 1.5), (1, 0, 0), (2, 1.5), paints[2 % len(paints)]),
        Rectangle((2, 0, 1.5), (-1, 0, 0), (2, 1.5), paints[3 % len(paints)]),
        Rectangle((0, -2, 1.5), (0, 1, 0), (2, 1.5), paints[0]),
        Rectangle((0, 2, 1.5), (0, -1, 0), (2, 1.5), paints[1 % len(paints)]),
    ]


THINGS: list[Surface] = [
    *walls((0.5, 0.4, 0.3), (0.8, 0.8, 0.8), (0.7, 0.1, 0.1), (0.1, 0.3, 0.7)),
    Rectangle((0.3, 0, 2.95), (0, 0, -1), (1.2, 0.8), LAMP, FLAT),
    Ball((0, 1.7, 1.9), 0.15, Material("diffuse", (0, 0, 0), (2, 4, 8))),
    Rectangle((1.9, 0.6, 1.4), (-1, 0, 0), (0.7, 0.9), Material("mirror", (0.9, 0.7, 0.5))),
    Ball((-0.7, 0.6, 0.6), 0.5, Material("glass", (0.9, 0.6, 0.8))),
    Ball((0.6, 0.9, 0.4), 0.4, Material("diffuse", (0.2, 0.7, 0.3))),
]


def twins(things: list[Surface]) -> list[Surface]:
    return [
        type(thing)(**{**vars(thing), "material": thing.material.twin(ALBEDO)}) for thing in things
    ]


@pytest.fixture(scope="module")
def slow() -> tuple[np.ndarray, np.ndarray]:
    """Means of regions in pictures of the room and of its grey twin, (copies, regions, 3) each."""
    rng = np.random.default_rng(7)
    found = [
        np.stack([picture(things, VIEW, MAX_DEPTH, SPP, rng) for _ in range(COPIES)])
        for things in (THINGS, twins(THINGS))
    ]
    return region_means(found[0], REGIONS), region_means(found[1], REGIONS)


@pytest.fixture(scope="module")
def scene(tmp_path_factory: pytest.TempPathFactory) -> RenderScene:
    set_variant()
    if not available():
        pytest.skip("the scalar variant traces colour and shading apart")
    body = "".join(thing.xml(f"thing{number}") for number, thing in enumerate(THINGS))
    return open_scene(write_scene(tmp_path_factory.mktemp("slow") / "room", body))


def test_the_slow_tracer_knows_the_geometric_series() -> None:
    reflected = np.array([0.2, 0.5, 0.9])
    room = walls((0.2, 0.5, 0.9), light=0.5)
    for depth in (1, 2, 6):
        got = picture(room, VIEW, depth, 1, np.random.default_rng(0))
        wanted = 0.5 * (1 - reflected**depth) / (1 - reflected)
        np.testing.assert_allclose(got, np.broadcast_to(wanted, got.shape), rtol=1e-9)


def test_the_slow_tracers_glass_and_mirrors_lose_what_they_should() -> None:
    """In a white furnace, colourless glass is invisible, and a mirror shows its reflectance."""
    room = walls((0, 0, 0), light=1.0)
    glass = [*room, Ball((0, 0, 1.5), 0.5, Material("glass", (1, 1, 1)))]
    got = picture(glass, VIEW, 40, 4, np.random.default_rng(0))
    np.testing.assert_allclose(got, 1, atol=1e-9)
    mirror = [*room, Ball((0, 0, 1.5), 0.5, Material("mirror", (0.9, 0.7, 0.5)))]
    got = picture(mirror, VIEW, 40, 4, np.random.default_rng(0))
    np.testing.assert_allclose(got[6, 8], (0.9, 0.7, 0.5), atol=1e-9)


@pytest.mark.slow
@pytest.mark.parametrize("lights", ["uniform", "planned"])
@pytest.mark.parametrize("roulette", [2, MAX_DEPTH + 1])
def test_both_images_are_those_of_the_slow_tracer(
    scene: RenderScene, slow: tuple[np.ndarray, np.ndarray], lights: str, roulette: int
) -> None:
    choice: UniformLights | PlannedLights = UniformLights()
    if lights == "planned":
        choice = PlannedLights(scene.mitsuba, plan_lights(scene.mitsuba, VIEW, (), 3))
    pair = joined(scene, VIEW, roulette, SPP, COPIES, 5, lights=choice)
    for images, theirs in zip(pair, slow, strict=True):
        ours = region_means(images, REGIONS)
        assert abs(deviations(ours, theirs)).max() < 4.5
        # With 1.4 % standard error, a bias above 4.5 x 1.4 % = 6 % in a region is detected.
        error = theirs.std(axis=0, ddof=1) / np.sqrt(COPIES) / theirs.mean(axis=0)
        assert np.median(error) < 0.014
