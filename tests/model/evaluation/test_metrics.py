"""Metrics of pairs whose answer is known."""

from pathlib import Path

import numpy as np
import pytest
import torch
from scipy.ndimage import gaussian_filter
from skimage import data

from pbrnet.model.evaluation.metrics import (
    Lpips,
    alexnet_features,
    bootstrap,
    find_lpips,
    flip_map,
    measure,
    psnr,
    ssim,
)

PHOTO = data.coffee()[100:200, 100:240].astype(np.float32) / 255


def ssim_by_the_book(truth: np.ndarray, image: np.ndarray) -> float:
    """Wang et al. 2004, equation 13, with an 11x11 Gaussian window of sigma 1.5, per channel."""
    scores = []
    for x, y in zip(truth.astype(float).T, image.astype(float).T, strict=True):

        def mean(values: np.ndarray) -> np.ndarray:
            return gaussian_filter(values, 1.5, truncate=3.5)[5:-5, 5:-5]

        mx, my = mean(x), mean(y)
        vx, vy, cov = mean(x * x) - mx**2, mean(y * y) - my**2, mean(x * y) - mx * my
        c1, c2 = 0.01**2, 0.03**2
        numerator = (2 * mx * my + c1) * (2 * cov + c2)
        scores.append((numerator / ((mx**2 + my**2 + c1) * (vx + vy + c2))).mean())
    return float(np.mean(scores))


def test_equal_images_are_perfect() -> None:
    values = measure(PHOTO, PHOTO.copy())
    assert values == {"ssim": pytest.approx(1), "psnr": 100, "flip": 0, "lpips": None}


def test_ssim_is_the_published_formula() -> None:
    noisy = np.clip(PHOTO + np.random.default_rng(0).normal(0, 0.1, PHOTO.shape), 0, 1)
    assert ssim(PHOTO, noisy) == pytest.approx(ssim_by_the_book(PHOTO, noisy), abs=1e-6)
    # Constant images: only the luminance term is left.
    dark, light = np.full((20, 20, 3), 0.2), np.full((20, 20, 3), 0.6)
    expected = (2 * 0.2 * 0.6 + 1e-4) / (0.2**2 + 0.6**2 + 1e-4)
    assert ssim(dark, light) == pytest.approx(expected, rel=1e-6)


def test_psnr_of_a_constant_error() -> None:
    assert psnr(np.zeros((4, 4, 3)), np.full((4, 4, 3), 0.1)) == pytest.approx(20)
    assert psnr(np.zeros((4, 4, 3)), np.ones((4, 4, 3))) == pytest.approx(0)


def test_flip_of_black_and_white_is_one() -> None:
    black, white = np.zeros((64, 64, 3), np.float32), np.ones((64, 64, 3), np.float32)
    errors = flip_map(black, white)
    assert errors.shape == (64, 64)
    assert errors[16:-16, 16:-16].mean() == pytest.approx(0.967, abs=0.02)
    assert flip_map(PHOTO, PHOTO).max() == 0


def test_flip_points_at_the_error() -> None:
    wrong = PHOTO.copy()
    wrong[40:60, 60:80] = (0, 1, 0)
    errors = flip_map(PHOTO, wrong)
    assert errors[40:60, 60:80].mean() > 0.4
    assert errors[:20, :30].max() < 0.01


def test_tiny_images_have_no_ssim() -> None:
    with pytest.raises(ValueError, match="11x11"):
        ssim(np.zeros((8, 20, 3)), np.zeros((8, 20, 3)))


def test_the_interval_comes_from_scenes_not_from_views() -> None:
    few = bootstrap({"a": [0.2] * 50, "b": [0.8] * 50}, seed=0)
    assert few.mean == pytest.approx(0.5)
    assert (few.low, few.high) == (pytest.approx(0.2), pytest.approx(0.8))
    uneven = bootstrap({"a": [0.2] * 9, "b": [0.8]}, seed=0)
    assert (uneven.mean, uneven.low, uneven.high) == pytest.approx((0.26, 0.2, 0.8))
    rng = np.random.default_rng(0)
    many = bootstrap({str(i): [value] for i, value in enumerate(rng.normal(0, 1, 400))}, seed=0)
    assert many.low is not None and many.high is not None
    assert many.high - many.low == pytest.approx(2 * 1.96 / 20, rel=0.15)
    assert bootstrap({"a": [0.2, 0.4]}, seed=0).low is None


def test_the_interval_is_the_same_every_time() -> None:
    values = {"a": [0.1, 0.4], "b": [0.5], "c": [0.9]}
    backwards = dict(reversed(values.items()))
    assert bootstrap(values, 3) == bootstrap(backwards, 3)


def test_lpips_is_left_out_without_its_weights(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("TORCH_HOME", str(tmp_path))
    assert find_lpips() is None


def test_lpips_by_hand_for_a_one_layer_network() -> None:
    torch.manual_seed(0)
    features = alexnet_features()
    shapes = [tuple(conv.weight.shape) for conv in features if isinstance(conv, torch.nn.Conv2d)]
    assert shapes == [
        *((64, 3, 11, 11), (192, 64, 5, 5)),
        *((384, 192, 3, 3), (256, 384, 3, 3), (256, 256, 3, 3)),
    ]
    heads = [torch.zeros(width) for width in (64, 192, 384, 256, 256)]
    heads[0][5] = 2.0
    lpips = Lpips(features, heads)
    assert lpips(PHOTO, PHOTO) == 0
    other = PHOTO[::-1].copy()

    def first(image: np.ndarray) -> torch.Tensor:
        x = torch.from_numpy(image).permute(2, 0, 1)[None] * 2 - 1
        shift = torch.tensor([-0.030, -0.088, -0.188]).view(1, 3, 1, 1)
        scale = torch.tensor([0.458, 0.448, 0.450]).view(1, 3, 1, 1)
        y = features[0]((x - shift) / scale).relu()
        return y[:, 5] / y.square().sum(dim=1).sqrt()

    with torch.no_grad():
        expected = 2 * (first(PHOTO) - first(other)).square().nan_to_num().mean()
    assert lpips(PHOTO, other) == pytest.approx(expected.item(), rel=1e-4)
