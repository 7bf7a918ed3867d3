"""PBR-Net plus: the paper's two steps with the physics that needs no ray left in.

The shading network is given the direct light of the panorama (model/irradiance.py) and learns what
that lacks: shadows, bounces, hidden lamps. The product of shading and reflectance is computed, not
learned, and so is how much more light of each band bounces hold in a room of these colours; a
second network adds what is lacking: colour that spills from one surface onto the next, gloss,
glass. Both are trained at once, on the shading and on the colour.
"""

from __future__ import annotations

import torch
from torch import nn

from model.encoding import DIRECT, GREY, WHITE, Tensors, centred
from model.networks import Architecture, Branch, GuidedNet, Panorama, UNet
from model.objective import Alone, Batch

_LUMINANCE = (0.2126, 0.7152, 0.0722)


class PlusNet(nn.Module):
    """Direct light to shading, shading and reflectance to colour; see the module."""

    def __init__(self, architecture: Architecture) -> None:
        super().__init__()
        width, levels = architecture.width, architecture.levels
        self.own_exposure = architecture.exposure == "own"
        self.shading = LitNet(width, levels, architecture.panorama)
        self.correction = UNet(9, width, max(1, levels - 2))
        nn.init.zeros_(self.correction.out.bias)  # type: ignore[arg-type]

    def forward(self, inputs: Tensors) -> torch.Tensor:
        """`encode`'s tensors, direct light among them, to colour in display values."""
        return self.parts(inputs)[1]

    def parts(self, inputs: Tensors) -> tuple[torch.Tensor, torch.Tensor]:
        """Shading and colour, display values (N, 3, H, W), not clamped."""
        shading = self.shading(inputs)
        given = inputs["reflectance"]
        valid = inputs["depth"][:, 1:]
        gain = 1 + valid * (inputs["gain"] - 1)  # light from outdoors does not bounce indoors
        if self.own_exposure:
            gain = gain / inputs["brightness"]
        base = multiplied(shading.float().clamp(0, 1), (given.float() + 1) / 2, gain.float())
        seen = torch.cat([centred(shading), given, centred(base).to(given.dtype)], dim=1)
        return shading, base + self.correction(seen)


class LitNet(GuidedNet):
    """The shading network, given direct light too; what it predicts is added to that."""

    def __init__(self, width: int, levels: int, panorama: Panorama) -> None:
        super().__init__(("depth", "normal"), width, levels, panorama)
        branch = max(1, width // 2)
        self.direct = Branch(DIRECT, branch)
        self.unet = UNet(5 * branch, width, levels)
        nn.init.zeros_(self.unet.out.bias)  # type: ignore[arg-type]

    def forward(self, inputs: Tensors) -> torch.Tensor:
        """Shading in display values (N, 3, H, W)."""
        features = [self.branches[name](inputs[name]) for name in self.images]
        features += [self.panorama(inputs), self.direct(inputs["direct"])]
        return self.unet(torch.cat(features, dim=1)) + (inputs["direct"][:, :1] + 1) / 2


def multiplied(
    shading: torch.Tensor, reflectance: torch.Tensor, gain: torch.Tensor | float = 1.0
) -> torch.Tensor:
    """Reflectance x shading, all in display values (N, 3, H, W): `product` with white at `WHITE`.

    The linear product is multiplied by `gain`; with 1 both images have one exposure, as under the
    policy `shared`. Differentiable everywhere.
    """
    light = decoded(shading)
    seen = luminance(light)
    half = 0.5 * (1 - seen)
    # Reinhard's operator, solved for the luminance that it was given
    scaled = seen / (half + torch.sqrt(half**2 + seen / WHITE**2 + 1e-12))
    linear = light * (scaled / seen.clamp(min=1e-6)) * decoded(reflectance) * (gain / GREY)
    bright = luminance(linear)
    mapped = linear * (1 + bright / WHITE**2) / (1 + bright)
    return encoded(mapped.clamp(0, 1))


class Decomposed(Alone):
    """The criterion on the shading and on the colour, both from one network."""

    def loss(self, batch: Batch) -> torch.Tensor:
        """The sum of both, a scalar with gradient."""
        assert isinstance(self.network, PlusNet) and batch.shading is not None
        with self.half():
            shading, color = self.network.parts(batch.inputs)
            return self.criterion(color.float(), batch.truth) + self.criterion(
                shading.float(), batch.shading
            )


def luminance(image: torch.Tensor) -> torch.Tensor:
    """Rec. 709 luminance (N, 1, H, W) of linear RGB (N, 3, H, W)."""
    return sum(weight * image[:, k : k + 1] for k, weight in enumerate(_LUMINANCE))  # type: ignore[return-value]


def decoded(display: torch.Tensor) -> torch.Tensor:
    """sRGB to linear, with a gradient everywhere."""
    high = ((display.clamp(min=0.04045) + 0.055) / 1.055) ** 2.4
    return torch.where(display <= 0.04045, display / 12.92, high)


def encoded(linear: torch.Tensor) -> torch.Tensor:
    """Linear to sRGB, with a gradient everywhere."""
    high = 1.055 * linear.clamp(min=0.0031308) ** (1 / 2.4) - 0.055
    return torch.where(linear <= 0.0031308, 12.92 * linear, high)
