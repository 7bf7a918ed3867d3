"""Image metrics: SSIM, PSNR, FLIP, and LPIPS if its weights are installed.

All take display values (H, W, 3) in [0, 1]. LPIPS is None if AlexNet's ImageNet weights or the
learned heads are missing.
"""

from __future__ import annotations

import importlib.util
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import flip_evaluator
import numpy as np
import torch
from skimage.metrics import structural_similarity
from torch import nn

from pbrnet.model.training.backbone import hub_folder
from pbrnet.scenes.arrays import AnyArray
from pbrnet.scenes.errors import InputError
from pbrnet.scenes.seeds import generator

ALEXNET_FILE = "alexnet-owt-7be5be79.pth"
HEADS_FILE = "weights/v0.1/alex.pth"  # within the package `lpips`
RESAMPLES = 2000
NAMES = ("ssim", "psnr", "flip", "lpips")


@dataclass(frozen=True)
class Interval:
    """A mean and its 95 % confidence interval, whose bounds are None for a single scene."""

    mean: float
    low: float | None
    high: float | None


def ssim(truth: AnyArray, image: AnyArray) -> float:
    """Structural similarity (Wang et al. 2004): Gaussian window, sigma 1.5, mean over RGB.

    Raises `ValueError` for images below 11x11 pixels.
    """
    if min(truth.shape[:2]) < 11:
        raise ValueError(f"SSIM needs at least 11x11 pixels, got {truth.shape[1]}x{truth.shape[0]}")
    return float(
        structural_similarity(
            truth.astype(np.float64),
            image.astype(np.float64),
            channel_axis=-1,
            data_range=1.0,
            gaussian_weights=True,
            sigma=1.5,
            use_sample_covariance=False,
        )
    )


def psnr(truth: AnyArray, image: AnyArray) -> float:
    """Peak signal-to-noise ratio in decibels for a peak of 1, at most 100."""
    error = float(np.mean((truth.astype(np.float64) - image.astype(np.float64)) ** 2))
    return 10 * float(np.log10(1 / max(error, 1e-10)))


def flip_map(truth: AnyArray, image: AnyArray) -> AnyArray:
    """Error map of LDR-FLIP (Andersson et al. 2020) at 67 pixels a degree, float32 (H, W)."""
    errors, _, _ = flip_evaluator.evaluate(
        np.ascontiguousarray(truth, np.float32),
        np.ascontiguousarray(image, np.float32),
        "LDR",
        applyMagma=False,
    )
    return np.asarray(errors, np.float32).reshape(truth.shape[:2])


def measure(
    truth: AnyArray, image: AnyArray, lpips: Lpips | None = None
) -> dict[str, float | None]:
    """All metrics by name, in the order of `NAMES`; LPIPS is None if `lpips` is None."""
    return {
        "ssim": ssim(truth, image),
        "psnr": psnr(truth, image),
        "flip": float(flip_map(truth, image).mean()),
        "lpips": lpips(truth, image) if lpips else None,
    }


def bootstrap(values: Mapping[str, Sequence[float]], seed: int) -> Interval:
    """Mean over all views and its 95 % bootstrap interval over scenes.

    `values`: scene -> the metric of each of its views. Views of a scene are not independent, so
    the bootstrap resamples whole scenes.
    """
    scenes = sorted(values)
    sums = np.array([sum(values[scene]) for scene in scenes])
    counts = np.array([len(values[scene]) for scene in scenes])
    mean = float(sums.sum() / counts.sum())
    if len(scenes) < 2:
        return Interval(mean, None, None)
    drawn = generator(seed, "bootstrap").integers(len(scenes), size=(RESAMPLES, len(scenes)))
    means = sums[drawn].sum(axis=1) / counts[drawn].sum(axis=1)
    low, high = np.quantile(means, [0.025, 0.975])
    return Interval(mean, float(low), float(high))


class Lpips:
    """LPIPS 0.1 with AlexNet (Zhang et al. 2018), in plain torch layers."""

    taps = (1, 4, 7, 9, 11)  # indices of AlexNet's five ReLUs
    shift = (-0.030, -0.088, -0.188)
    scale = (0.458, 0.448, 0.450)

    def __init__(self, features: nn.Sequential, heads: Sequence[torch.Tensor]) -> None:
        self.features, self.heads = features.eval(), heads
        self.centre = torch.tensor(self.shift).view(1, 3, 1, 1)
        self.spread = torch.tensor(self.scale).view(1, 3, 1, 1)

    @torch.no_grad()
    def __call__(self, truth: AnyArray, image: AnyArray) -> float:
        """Distance between two images of display values; 0 if they are equal."""
        total = 0.0
        pairs = zip(self._unit_maps(truth), self._unit_maps(image), self.heads, strict=True)
        for one, other, head in pairs:
            total += float(((one - other) ** 2 * head.view(1, -1, 1, 1)).sum(dim=1).mean())
        return total

    def _unit_maps(self, image: AnyArray) -> list[torch.Tensor]:
        x = torch.from_numpy(np.ascontiguousarray(image, np.float32)).permute(2, 0, 1)[None]
        x = (2 * x - 1 - self.centre) / self.spread
        maps = []
        for index, layer in enumerate(self.features):
            x = layer(x)
            if index in self.taps:
                maps.append(x / (x.norm(dim=1, keepdim=True) + 1e-10))
        return maps


def alexnet_features() -> nn.Sequential:
    """AlexNet's convolutions, in the order of torchvision's `features`."""
    return nn.Sequential(
        *(nn.Conv2d(3, 64, 11, 4, 2), nn.ReLU(), nn.MaxPool2d(3, 2)),
        *(nn.Conv2d(64, 192, 5, padding=2), nn.ReLU(), nn.MaxPool2d(3, 2)),
        *(nn.Conv2d(192, 384, 3, padding=1), nn.ReLU()),
        *(nn.Conv2d(384, 256, 3, padding=1), nn.ReLU()),
        *(nn.Conv2d(256, 256, 3, padding=1), nn.ReLU()),
    )


def find_lpips() -> Lpips | None:
    """LPIPS if torch's cache holds AlexNet's weights and the package `lpips` is installed.

    Otherwise None. Raises `InputError` for weights that do not load.
    """
    weights = hub_folder() / ALEXNET_FILE
    package = importlib.util.find_spec("lpips")
    if not weights.is_file() or package is None or package.origin is None:
        return None
    heads_file = Path(package.origin).parent / HEADS_FILE
    try:
        state = torch.load(weights, map_location="cpu", weights_only=True)
        heads = torch.load(heads_file, map_location="cpu", weights_only=True)
        features = alexnet_features()
        features.load_state_dict(
            {
                name.removeprefix("features."): value
                for name, value in state.items()
                if name.startswith("features.")
            }
        )
        return Lpips(features, [heads[f"lin{index}.model.1.weight"] for index in range(5)])
    except Exception as error:
        reason = (str(error) or type(error).__name__).splitlines()[0]
        raise InputError(f"{weights} or {heads_file}: not usable for LPIPS ({reason})") from None
