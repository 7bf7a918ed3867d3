"""PBR-Net plus: the paper's two stages on top of analytic direct light and interreflection.

1. The shading network takes the direct light of the panorama (model/data/direct_light.py), divided
   by the light's colour. It learns the rest: indirect light, hidden lamps, and shadows if the
   dataset has none.
2. A small network predicts the colour of all light in the room from the colour of the visible
   sources. Shading is multiplied by it. (The paper's panorama has no colour.)
3. Reflectance x shading and the gain by interreflection in each band are computed, not learned.
4. A correction network adds what the product lacks: colour bleeding, gloss, glass.

All parts are trained at once, on the shading and on the colour.
"""

from __future__ import annotations

import torch
from torch import nn
from torch.nn import functional

from model.data.display import luminance, tint_display, tonemap_exposed
from model.data.encoding import DEFAULT_WHITE, DIRECT_LIGHT_CHANNELS, NEUTRAL, Tensors, centred
from model.networks.objective import Batch, SingleLoss
from model.networks.pbrnet import Architecture, Branch, GuidedNet, Panorama, UNet
from scenes.color import decode_srgb


class PlusNet(nn.Module):
    """Network from direct light to shading, and on to colour; see the module."""

    def __init__(self, architecture: Architecture) -> None:
        super().__init__()
        width, levels = architecture.width, architecture.levels
        self.own_exposure = architecture.exposure == "own"
        self.shading = DirectLightNet(width, levels, architecture.panorama)
        self.color = LightColor()
        self.correction = UNet(9, width, max(1, levels - 2))
        nn.init.zeros_(self.correction.out.bias)  # type: ignore[arg-type]

    def forward(self, inputs: Tensors) -> torch.Tensor:
        """Tensors of `encode` with direct light to display values of colour (N, 3, H, W)."""
        return self.parts(inputs)[1]

    def parts(self, inputs: Tensors) -> tuple[torch.Tensor, torch.Tensor]:
        """Shading and colour, display values (N, 3, H, W), not clamped."""
        shading = tint_display(self.shading(inputs).float(), self.color(inputs["tint"]))
        reflectance = inputs["reflectance"]
        valid = inputs["depth"][:, 1:]
        gain = 1 + valid * (inputs["gain"] - 1)  # light from outdoors does not bounce indoors
        if self.own_exposure:
            gain = gain / inputs["brightness"]
        base = multiplied(shading.clamp(0, 1), (reflectance.float() + 1) / 2, gain.float())
        seen = torch.cat([centred(shading), reflectance, centred(base)], dim=1)
        return shading, base + self.correction(seen)


class DirectLightNet(GuidedNet):
    """Shading network with direct light as a further input; predicts a residual to it."""

    def __init__(self, width: int, levels: int, panorama: Panorama) -> None:
        super().__init__(("depth", "normal"), width, levels, panorama)
        branch = max(1, width // 2)
        self.direct = Branch(DIRECT_LIGHT_CHANNELS, branch)
        self.unet = UNet(5 * branch, width, levels)
        nn.init.zeros_(self.unet.out.bias)  # type: ignore[arg-type]

    def forward(self, inputs: Tensors) -> torch.Tensor:
        """Display values of the shading under white light (N, 3, H, W)."""
        features = [self.branches[name](inputs[name]) for name in self.images]
        features += [self.panorama(inputs), self.direct(inputs["direct"])]
        return self.unet(torch.cat(features, dim=1)) + (inputs["direct"][:, :3] + 1) / 2


class LightColor(nn.Module):
    """Network from the colour of the visible light sources to that of all light in the room.

    The two differ in daylight: the panorama shows blue sky in a window, but sunlight and light from
    the sunlit ground come in too. The initial weights return the sources' colour.
    """

    def __init__(self, hidden: int = 16) -> None:
        super().__init__()
        self.hidden, self.out = nn.Linear(3, hidden), nn.Linear(hidden, 3)
        nn.init.zeros_(self.out.weight)
        nn.init.zeros_(self.out.bias)  # type: ignore[arg-type]

    def forward(self, tint: torch.Tensor) -> torch.Tensor:
        """Linear RGB of luminance 1, (N, 3, 1, 1), to linear RGB of luminance 1."""
        logs = tint.flatten(1).log()
        color = (logs + self.out(functional.relu(self.hidden(logs)))).exp()[..., None, None]
        return color / luminance(color)


def multiplied(
    shading: torch.Tensor, reflectance: torch.Tensor, gain: torch.Tensor | float = 1.0
) -> torch.Tensor:
    """Reflectance x shading, all in display values (N, 3, H, W), differentiable everywhere.

    The counterpart of `model.evaluation.product.product` with the white point `DEFAULT_WHITE`. The
    linear product is multiplied by `gain`; with 1 both images have the same exposure, as under the
    policy `shared`.
    """
    light = decode_srgb(shading)
    seen = luminance(light)
    half = 0.5 * (1 - seen)
    # Inverse of Reinhard's operator
    scaled = seen / (half + torch.sqrt(half**2 + seen / DEFAULT_WHITE**2 + 1e-12))
    linear = light * (scaled / seen.clamp(min=1e-6)) * decode_srgb(reflectance) * (gain / NEUTRAL)
    return tonemap_exposed(linear, DEFAULT_WHITE)


class DecomposedLoss(SingleLoss):
    """The criterion on the shading plus the criterion on the colour of one network."""

    def loss(self, batch: Batch) -> torch.Tensor:
        """The sum of the two terms, a scalar with gradient."""
        assert isinstance(self.network, PlusNet) and batch.shading is not None
        with self.autocast():
            shading, color = self.network.parts(batch.inputs)
            return self.criterion(color.float(), batch.truth) + self.criterion(
                shading.float(), batch.shading
            )
