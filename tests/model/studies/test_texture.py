"""Texture metrics of synthetic blur and grid patterns."""

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter

from pbrnet.model.studies.trials.texture import TILE, detail, grid
from pbrnet.scenes.seeds import generator


def noise(height: int = 192, width: int = 256, spread: float = 0.05) -> np.ndarray:
    """White noise around mid-grey, float32 (H, W, 3)."""
    rng = generator(0, "a test of patterns")
    return (0.5 + spread * rng.standard_normal((height, width, 3))).astype(np.float32)


def room(height: int = 120, width: int = 160) -> np.ndarray:
    """Smooth walls with a slanted and a vertical edge, a soft highlight, a little grain."""
    row, column = np.mgrid[:height, :width].astype(np.float64)
    wall = np.where(column < width * 0.4, 0.3, 0.6) + 0.2 * (row + 0.4 * column > height)
    glow = 0.15 * np.exp(-((row - 40) ** 2 + (column - 100) ** 2) / 800)
    grain = 0.01 * (noise(height, width)[..., 0] - 0.5) / 0.05
    return np.repeat((wall + glow + grain)[..., None], 3, axis=-1).astype(np.float32)


def lines(period: int, height: float, shape: tuple[int, ...]) -> np.ndarray:
    """A brighter row and column every `period` pixels."""
    row, column = np.mgrid[: shape[0], : shape[1]]
    on = (row % period == 0) | (column % period == 0)
    return np.repeat((height * on)[..., None], 3, axis=-1)


@pytest.mark.parametrize("sigma", [0.4, 0.6, 0.8])
def test_a_blur_costs_the_power_that_its_filter_takes(sigma: float) -> None:
    """White noise has the same power everywhere, so the ratio is the filter's own response."""
    truth = noise()
    blurred = gaussian_filter(truth, (sigma, sigma, 0), truncate=6)
    line = np.fft.fftfreq(TILE)
    # the sampled filter's own response along one axis
    place = np.arange(-8, 9)
    kernel = np.exp(-(place**2) / (2 * sigma**2))
    kernel[np.abs(place) > int(6 * sigma + 0.5)] = 0
    response = (kernel[:, None] * np.cos(2 * np.pi * place[:, None] * line)).sum(0) / kernel.sum()
    power = np.outer(response, response) ** 2
    halfway = np.arange(TILE) % 4 == 2
    chosen = (halfway[:, None] | halfway[None]) & (np.hypot(line[:, None], line[None]) >= 0.25)
    assert detail(truth, blurred) == pytest.approx(10 * np.log10(power[chosen].mean()), abs=0.15)


def test_detail_is_zero_for_the_truth_and_rises_with_noise() -> None:
    truth = room()
    assert detail(truth, truth) == 0
    assert detail(truth, truth + noise(120, 160) - 0.5) > 6
    assert detail(noise(), 0.5 + 2 * (noise() - 0.5)) == pytest.approx(20 * np.log10(2), abs=0.02)


def test_what_eight_bits_cannot_show_is_no_detail() -> None:
    flat = np.full((64, 64, 3), 0.5, np.float32)
    rng = generator(0, "specks")
    faint = flat + 1e-5 * rng.standard_normal(flat.shape)
    assert abs(detail(flat, faint)) < 0.1 and abs(detail(faint, flat)) < 0.1


@pytest.mark.parametrize("period", [2, 4, 8])
@pytest.mark.parametrize("levels", [1.0, 4.0])
def test_a_known_grid_is_found_in_its_own_strength(period: int, levels: float) -> None:
    flat = np.full((96, 128, 3), 0.5)
    pattern = lines(period, levels / 255, flat.shape)
    truth = levels * np.std(pattern[..., 0] > 0)
    assert grid(flat + pattern) == pytest.approx(truth, rel=0.02)
    row, column = np.mgrid[:96, :128]
    checks = ((row // (period // 2) + column // (period // 2)) % 2 - 0.5) * 2 * levels / 255
    assert grid(flat + checks[..., None]) == pytest.approx(levels, rel=0.02)


@pytest.mark.parametrize("period", [2, 4, 8])
def test_a_grid_shows_in_a_picture_and_is_no_detail(period: int) -> None:
    picture = room()
    pattern = lines(period, 6 / 255, picture.shape)
    found = np.sqrt(grid(picture + pattern) ** 2 - grid(picture) ** 2)
    assert found == pytest.approx(6 * np.std(pattern[..., 0] > 0), rel=0.15)
    assert abs(detail(picture, picture + pattern)) < 0.3


def test_a_grid_that_changes_its_sign_is_still_one() -> None:
    """The grid is darker on one wall and brighter on the other."""
    flat = np.full((96, 128, 3), 0.5)
    pattern = lines(8, 4 / 255, flat.shape)
    pattern[:, 64:] *= -1
    whole = 4 * np.std(lines(8, 1, flat.shape)[..., 0])
    assert grid(flat + pattern) == pytest.approx(whole, rel=0.2)


@pytest.mark.parametrize("period", [3, 5, 6, 11])
def test_other_patterns_edges_and_noise_are_no_grid(period: int) -> None:
    flat = np.full((96, 128, 3), 0.5)
    known = grid(flat + lines(8, 6 / 255, flat.shape))
    assert grid(room()) < 0.25 * known
    assert grid(noise(spread=2 / 255)) < 0.2 * known
    row = np.mgrid[:96, :128][0]
    wave = 6 / 255 * np.sin(2 * np.pi * row / period)
    # tiles of 32 pixels part 11 from 8 not altogether: 3 % of its power
    assert grid(flat + wave[..., None]) < 0.2 * 6 / np.sqrt(2)
    assert grid(gaussian_filter(room(), (2, 2, 0))) < 0.25 * known


def test_pictures_smaller_than_a_tile_are_not_measured() -> None:
    small = np.zeros((TILE - 1, 80, 3), np.float32)
    assert grid(small) is None and detail(small, small) is None
    assert grid(np.zeros((TILE, TILE, 3))) == 0
