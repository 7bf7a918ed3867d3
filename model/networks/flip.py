"""FLIP as a loss: LDR-FLIP in torch, with finite gradients everywhere.

Andersson, Nilsson, Akenine-Möller, Oskarsson, Åström, Fairchild: *FLIP: a difference evaluator for
alternating images*, HPG 2020. `pbrnet.model.evaluation.metrics.flip_map` measures with the authors'
own library, which has no gradient; a test compares both.
"""

from __future__ import annotations

import math

import numpy as np
import torch
from torch import nn

from pbrnet.scenes.arrays import AnyArray
from pbrnet.scenes.color import XYZ_TO_RGB, decode_srgb

PIXELS_PER_DEGREE = 67.0

# Of each channel of YCxCz: pairs of height and width of the Gaussians of the contrast sensitivity.
_SENSITIVITY = (
    ((1.0, 0.0047),),
    ((1.0, 0.0053),),
    ((34.1, 0.04), (13.5, 0.025)),
)
_COLOR_EXPONENT = 0.7
_KNEE = (0.4, 0.95)  # share of the largest colour difference, and the error that it maps to
_FEATURE_EXPONENT = 0.5
_FEATURE_WIDTH = 0.082  # degrees: of the edge and point detectors
_LEAST = 1e-3  # added below roots, of differences of about 1: keeps their gradients finite


class Flip(nn.Module):
    """Mean LDR-FLIP of display values (N, 3, H, W) against the truth: a scalar in [0, 1]."""

    to_xyz: torch.Tensor  # from linear RGB, relative to the white point
    to_opponent: torch.Tensor  # from linear RGB to YCxCz
    from_opponent: torch.Tensor
    spatial: torch.Tensor  # as `_spatial_filters` has them
    smooth: torch.Tensor  # the first of `_feature_filters`, and the others
    derivatives: torch.Tensor

    def __init__(self) -> None:
        super().__init__()
        rgb_to_xyz = np.linalg.inv(XYZ_TO_RGB)
        relative = rgb_to_xyz / rgb_to_xyz.sum(axis=1, keepdims=True)
        # Y = 116 y - 16, Cx = 500 (x - y), Cz = 200 (y - z)
        opponent = np.array([[0, 116, 0], [500, -500, 0], [0, 200, -200]])
        spatial, features = _spatial_filters(), _feature_filters()
        constants = {
            "to_xyz": relative,
            "to_opponent": opponent @ relative,
            "from_opponent": np.linalg.inv(opponent @ relative),
            "spatial": spatial,
            "smooth": features[:1],
            "derivatives": features[1:],
        }
        for name, values in constants.items():
            tensor = torch.tensor(values, dtype=torch.float32)
            self.register_buffer(name, tensor, persistent=False)
        green, blue = (self._lab(torch.eye(3)[None, :, k, None, None]) for k in (1, 2))
        self.largest = float(_distance(green, blue) ** _COLOR_EXPONENT)

    def forward(self, prediction: torch.Tensor, truth: torch.Tensor) -> torch.Tensor:
        """The mean over `errors`."""
        return self.errors(prediction, truth).mean()

    def errors(self, prediction: torch.Tensor, truth: torch.Tensor) -> torch.Tensor:
        """The error map (N, 1, H, W)."""
        with torch.autocast(prediction.device.type, enabled=False):
            opponents = [
                _mix(self.to_opponent, decode_srgb(image.float().clamp(0, 1)))
                for image in (prediction, truth)
            ]
            color = _distance(*(self._lab(self._seen(image)) for image in opponents))
            color = color**_COLOR_EXPONENT
            knee, height = _KNEE[0] * self.largest, _KNEE[1]
            far = height + (color - knee) / (self.largest - knee) * (1 - height)
            color = torch.where(color < knee, color * height / knee, far)
            # A constant difference of lightness moves no edge: the -16 of Y is left out.
            feature = self._features(*(image[:, :1] / 116 for image in opponents))
            return color ** (1 - feature)

    def _seen(self, opponent: torch.Tensor) -> torch.Tensor:
        """Linear RGB in [0, 1] of what the eye resolves of an image in YCxCz."""
        filtered = torch.zeros_like(opponent)
        for kernel in self.spatial:
            filtered = filtered + _separable(opponent, kernel, kernel)
        return _mix(self.from_opponent, filtered).clamp(0, 1)

    def _lab(self, linear: torch.Tensor) -> torch.Tensor:
        """CIELAB of linear RGB, with the Hunt effect: chroma counts as much as lightness has."""
        xyz = _mix(self.to_xyz, linear)
        delta = 6 / 29
        root = xyz.clamp(min=delta**3) ** (1 / 3)
        root = torch.where(xyz > delta**3, root, xyz / (3 * delta**2) + 4 / 29)
        x, y, z = root.split(1, dim=1)
        lightness = 116 * y - 16
        hunt = 0.01 * lightness
        return torch.cat([lightness, hunt * 500 * (x - y), hunt * 200 * (y - z)], dim=1)

    def _features(self, one: torch.Tensor, other: torch.Tensor) -> torch.Tensor:
        """Difference of edges and points, (N, 1, H, W) in [0, 1], of lightness (N, 1, H, W)."""
        differences = []
        for derivative in self.derivatives:
            sizes = [
                (
                    _separable(image, derivative[None], self.smooth) ** 2
                    + _separable(image, self.smooth, derivative[None]) ** 2
                    + _LEAST**2
                ).sqrt()
                for image in (one, other)
            ]
            differences.append((sizes[0] - sizes[1]).abs())
        most = torch.maximum(*differences) / math.sqrt(2)
        return ((most + _LEAST**2) ** _FEATURE_EXPONENT).clamp(0, 1)


def _mix(matrix: torch.Tensor, image: torch.Tensor) -> torch.Tensor:
    return torch.einsum("ij,njhw->nihw", matrix, image)


def _distance(one: torch.Tensor, other: torch.Tensor) -> torch.Tensor:
    """HyAB: difference of lightness plus distance of chroma, (N, 1, H, W)."""
    difference = one - other
    lightness = (difference[:, :1] ** 2 + _LEAST**2).sqrt()
    chroma = ((difference[:, 1:] ** 2).sum(1, keepdim=True) + _LEAST**2).sqrt()
    return lightness + chroma


def _separable(image: torch.Tensor, across: torch.Tensor, down: torch.Tensor) -> torch.Tensor:
    """Filter an image (N, C, H, W) by two kernels (C, K) each; edges are repeated."""
    height, width = image.shape[-2:]
    return _banded(down, height) @ (image @ _banded(across, width).mT)


def _banded(kernels: torch.Tensor, size: int) -> torch.Tensor:
    """Filters (C, K) of rows of `size` pixels as matrices (C, size, size).

    Such products take less time than convolutions of so many taps and few channels.
    """
    channels, taps = kernels.shape
    pixel = torch.arange(size, device=kernels.device)[:, None]
    source = (pixel + torch.arange(taps, device=kernels.device) - taps // 2).clamp(0, size - 1)
    matrices = kernels.new_zeros(channels, size, size)
    return matrices.scatter_add_(
        2, source.expand(channels, -1, -1), kernels[:, None].expand(-1, size, -1)
    )


def _spatial_filters() -> AnyArray:
    """Separable terms of the contrast sensitivity, (terms, 3, K); all together have the sum 1."""
    widest = max(width for terms in _SENSITIVITY for _, width in terms)
    radius = math.ceil(3 * math.sqrt(widest / (2 * math.pi**2)) * PIXELS_PER_DEGREE)
    degrees = np.arange(-radius, radius + 1) / PIXELS_PER_DEGREE
    kernels = np.zeros((2, 3, len(degrees)))
    for channel, terms in enumerate(_SENSITIVITY):
        for term, (height, width) in enumerate(terms):
            profile = np.exp(-(math.pi**2) * degrees**2 / width)
            # A product of two profiles is the Gaussian in the plane.
            kernels[term, channel] = math.sqrt(height * math.sqrt(math.pi / width)) * profile
        total = (kernels[:, channel].sum(axis=1) ** 2).sum()
        kernels[:, channel] /= math.sqrt(total)
    return kernels


def _feature_filters() -> AnyArray:
    """Gaussian, its first and its second derivative, (3, K); each sign of these has sum 1."""
    deviation = 0.5 * _FEATURE_WIDTH * PIXELS_PER_DEGREE
    radius = math.ceil(3 * deviation)
    x = np.arange(-radius, radius + 1)
    gauss = np.exp(-(x**2) / (2 * deviation**2))
    kernels = [gauss / gauss.sum()]
    for kernel in (-x * gauss, (x**2 / deviation**2 - 1) * gauss):
        positive = np.maximum(kernel, 0) / np.maximum(kernel, 0).sum()
        negative = np.minimum(kernel, 0) / -np.minimum(kernel, 0).sum()
        kernels.append(positive + negative)
    return np.stack(kernels)
