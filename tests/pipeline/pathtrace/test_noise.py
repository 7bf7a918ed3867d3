"""Noise estimate against true errors, and views that stop at a noise target."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.ndimage import uniform_filter

from pbrnet.pipeline.frames import Channels
from pbrnet.pipeline.params import load_params
from pbrnet.pipeline.passes.groundtruth import render_blocks, render_both, render_truth
from pbrnet.pipeline.pathtrace.noise import BlockStatistics, firefly_light, residual_noise
from pbrnet.pipeline.render.scene import RenderScene, open_scene, set_variant
from pbrnet.scenes.errors import ParameterError
from tests.fixtures.params import plain_truth
from tests.fixtures.render import ball, diffuse, glow, make_view, quad, room_walls, write_scene

pytestmark = pytest.mark.usefixtures("variant")

WALLS, _ = room_walls(diffuse(0.5))
LAMP = quad("lamp", (0, 0, 2.95), (0, 0, -1), (0.5, 0.5), glow(3), (0, 1, 0))
# The lamp shines up into a box that is open by a slit: nearly all of the room is dark.
SHADE = quad("shade", (0, 0, 2.7), (0, 0, -1), (1.99, 1.9), diffuse(0.5), (0, 1, 0))
SLIT = quad("lamp", (0, 0, 2.75), (0, 0, 1), (0.2, 0.2), glow(30), (0, 1, 0))
GLASS = ball("glass", (0, 0.8, 0.6), 0.5, '<bsdf type="dielectric"/>')
BULB = ball("bulb", (0.9, 0.3, 2.2), 0.04, glow(400))
ROOMS = {"lit": WALLS + LAMP, "dark": WALLS + SHADE + SLIT, "fireflies": WALLS + GLASS + BULB}
VIEW = make_view((0, -1.5, 1.5), size=(48, 36))


def room(folder: Path, body: str) -> RenderScene:
    return open_scene(write_scene(folder / "scene", body))


def rendered(scene: RenderScene, seed: int, **params: Any) -> tuple[dict[str, Any], np.ndarray]:
    settings = plain_truth(**{"block_spp": 4, **params})
    channels, stats = render_truth(scene, VIEW, settings, seed)
    return stats, channels["G"].astype(np.float64)  # the rooms are grey


def true_error(image: np.ndarray, reference: np.ndarray) -> float:
    """Rms relative error, at most 1 per pixel, as in the estimate."""
    scale = np.maximum(image, reference) + 0.01 * reference.mean()
    return float(np.sqrt(((image - reference) ** 2 / scale**2).mean()))


@pytest.mark.slow
@pytest.mark.parametrize(
    "kind",
    ["lit", *(pytest.param(kind, marks=pytest.mark.check) for kind in ("dark", "fireflies"))],
)
def test_the_estimate_is_the_error_against_a_reference(kind: str, tmp_path: Path) -> None:
    scene = room(tmp_path, ROOMS[kind])
    _, reference = rendered(scene, 9, spp=4096, block_spp=256)  # adds 2 % to the error at 128
    for spp in (32, 128):
        pairs = []
        for seed in range(3):
            stats, image = rendered(scene, seed, spp=spp)
            pairs.append((stats["noise"], true_error(image, reference)))
        estimate, error = np.mean(pairs, axis=0)
        assert estimate == pytest.approx(error, rel=0.27), (kind, spp)


def test_brightness_does_not_change_the_estimate(tmp_path: Path) -> None:
    bright, _ = rendered(room(tmp_path, ROOMS["lit"]), 1, spp=16)
    dim, _ = rendered(room(tmp_path / "dim", WALLS + LAMP.replace('"3"', '"0.003"')), 1, spp=16)
    assert dim["noise"] == pytest.approx(bright["noise"], rel=1e-3)


@pytest.mark.slow
def test_a_view_stops_when_its_noise_is_low_enough(tmp_path: Path) -> None:
    scene = room(tmp_path, ROOMS["lit"])
    _, reference = rendered(scene, 9, spp=2048, block_spp=256)
    noisy, _ = rendered(scene, 0, spp=8)
    target = noisy["noise"] / 2.5
    stats, image = rendered(scene, 0, spp=256, noise=target, min_spp=8)
    assert 8 < stats["spp"] < 256 and stats["noise"] <= target
    assert true_error(image, reference) < 1.2 * target
    # One block less would not have done; the same samples without a target are the same image.
    before, _ = rendered(scene, 0, spp=256, noise=1e-6, min_spp=8)
    assert before["spp"] == 256
    again, other = rendered(scene, 0, spp=256, noise=target, min_spp=8)
    assert again == stats
    np.testing.assert_array_equal(image, other)
    least, _ = rendered(scene, 0, spp=256, noise=1.0, min_spp=64)
    assert least["spp"] == 64
    most, _ = rendered(scene, 0, spp=16, noise=1e-3, min_spp=8)
    assert most["spp"] == 16 and most["noise"] > 1e-3


@pytest.mark.parametrize(
    ("spp", "least", "launches"),
    [(80, 32, [2, 2, 1]), (1024, 80, [5] * 12 + [4])],  # of blocks of 16 samples
)
def test_a_view_that_never_reaches_its_target_takes_all_samples(
    spp: int, least: int, launches: list[int]
) -> None:
    """Though the blocks of one launch do not divide all blocks."""
    view, random, sizes = make_view(size=(160, 120)), np.random.default_rng(0), []

    def launch(copies: int, samples: int, seed: int) -> np.ndarray:
        assert samples == 16
        sizes.append(copies)
        return random.random((120, copies * 160, 3), dtype=np.float32)

    params = plain_truth(spp=spp, block_spp=16, noise=1e-6, min_spp=least)
    _, statistics = render_blocks(launch, view, params, 0)
    assert statistics["spp"] == spp and statistics["blocks"] == spp // 16
    assert sizes == launches


def test_both_truths_of_a_view_reach_the_target(tmp_path: Path) -> None:
    if set_variant() == "scalar_rgb":
        pytest.skip("this variant does not trace both at once")
    scene = room(tmp_path, ROOMS["lit"])
    params = plain_truth(spp=512, block_spp=8, noise=0.1, min_spp=16)
    truths = render_both(scene, VIEW, params, 0.9, 0)
    color, shading = truths.color[1], truths.shading[1]
    assert max(color["noise"], shading["noise"]) <= 0.1
    assert color["spp"] == shading["spp"] < 512


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("{noise: -0.1}", "groundtruth.noise"),
        ("{noise: 2}", "groundtruth.noise"),
        ("{spp: 32, noise: 0.1, min_spp: 64}", "groundtruth.min_spp: 64 is more than spp"),
    ],
)
def test_impossible_targets_are_refused(text: str, words: str, tmp_path: Path) -> None:
    path = tmp_path / "params.yaml"
    path.write_text(f"groundtruth: {text}")
    with pytest.raises(ParameterError, match=words):
        load_params(path)


def statistics_of(blocks: np.ndarray) -> BlockStatistics:
    """Grey blocks (B, H, W)."""
    made = BlockStatistics(*blocks.shape[1:])
    for block in blocks:
        made.add(np.repeat(block[..., None], 3, axis=-1))
    return made


def test_relative_error_is_bounded_and_ignores_what_is_not_finite() -> None:
    blocks = np.ones((4, 8, 8))
    assert statistics_of(blocks).relative_error().max() == 0
    blocks[0, 2, 3] = 1e6  # a firefly in one of four blocks
    assert 0.9 < statistics_of(blocks).relative_error()[2, 3] <= 1
    blocks[0, 2, 3] = np.nan
    assert statistics_of(blocks).relative_error().max() < 1e-12
    assert statistics_of(np.zeros((4, 8, 8))).relative_error().max() == 0
    assert 0.2 < statistics_of(np.random.default_rng(0).random((1, 32, 32))).noise() < 1


def test_the_running_sums_are_the_textbook_s_standard_error() -> None:
    blocks = np.random.default_rng(3).gamma(0.5, 2.0, (7, 12, 16))
    mean = blocks.mean(axis=0)
    wanted = blocks.std(axis=0, ddof=1) / np.sqrt(7) / (mean + 0.01 * mean.mean())
    np.testing.assert_allclose(statistics_of(blocks).relative_error(), wanted, rtol=1e-10)


def test_grain_is_no_glare() -> None:
    """One firefly that outshines the room counts; a thousand that make up the room do not."""
    grain = np.random.default_rng(1).gamma(0.1, 10.0, (120, 160))
    fireflies = grain > 4
    assert grain[fireflies].sum() > 0.5 * grain.sum()
    assert firefly_light(grain, fireflies) < 0.05
    grain[60, 80] = 10 * grain.sum()
    fireflies[60, 80] = True
    assert firefly_light(grain, fireflies) > 0.9


def test_the_noise_that_a_linear_filter_leaves_is_estimated() -> None:
    """Of a blur of even grey with known noise: that of the mean, over the filter's width."""
    random = np.random.default_rng(0)
    noisy = 1 + 0.4 * random.standard_normal((6, 96, 128))
    made = statistics_of(noisy)

    def blurred(image: Channels) -> Channels:
        return {name: uniform_filter(values, 5, mode="wrap") for name, values in image.items()}

    half = made.half_image()
    assert half is not None
    estimate = residual_noise(blurred(made.image()), blurred(half), 6)
    assert estimate == pytest.approx(0.4 / np.sqrt(6) / 5 / 1.01, rel=0.05)
    assert statistics_of(noisy[:1]).half_image() is None
