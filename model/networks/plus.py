"""PBR-Net plus: the paper's two stages on top of analytic direct light and interreflection.

The shading network is given the direct light of the panorama (model/data/direct_light.py), its
colour taken out, and learns what that lacks: bounces, hidden lamps, and shadows where none came
with it. Then the colour is put back, or what it tells of that of the whole room; the paper's
panorama has none. The product of shading and reflectance is computed, not learned, and so is how
much more light of each band bounces hold in a room of these colours; a second network adds what is
lacking: colour that spills from one surface onto the next, gloss, glass. All are trained at once,
on the shading and on the colour.
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
    """Direct light to shading, shading and reflectance to colour; see the module."""

    def __init__(self, architecture: Architecture) -> None:
        super().__init__()
        width, levels = architecture.width, architecture.levels
        self.own_exposure = architecture.exposure == "own"
        self.shading = LitNet(width, levels, architecture.panorama)
        self.color = LightColor()
        self.correction = UNet(9, width, max(1, levels - 2))
        nn.init.zeros_(self.correction.out.bias)  # type: ignore[arg-type]

    def forward(self, inputs: Tensors) -> torch.Tensor:
        """`encode`'s tensors, direct light among them, to colour in display values."""
        return self.parts(inputs)[1]

    def parts(self, inputs: Tensors) -> tuple[torch.Tensor, torch.Tensor]:
        """Shading and colour, display values (N, 3, H, W), not clamped."""
        shading = tint_display(self.shading(inputs).float(), self.color(inputs["tint"]))
        given = inputs["reflectance"]
        valid = inputs["depth"][:, 1:]
        gain = 1 + valid * (inputs["gain"] - 1)  # light from outdoors does not bounce indoors
        if self.own_exposure:
            gain = gain / inputs["brightness"]
        base = multiplied(shading.clamp(0, 1), (given.float() + 1) / 2, gain.float())
        seen = torch.cat([centred(shading), given, centred(base)], dim=1)
        return shading, base + self.correction(seen)


class LitNet(GuidedNet):
    """The shading network, given direct light too; what it predicts is added to that."""

    def __init__(self, width: int, levels: int, panorama: Panorama) -> None:
        super().__init__(("depth", "normal"), width, levels, panorama)
        branch = max(1, width // 2)
        self.direct = Branch(DIRECT_LIGHT_CHANNELS, branch)
        self.unet = UNet(5 * branch, width, levels)
        nn.init.zeros_(self.unet.out.bias)  # type: ignore[arg-type]

    def forward(self, inputs: Tensors) -> torch.Tensor:
        """Shading in display values (N, 3, H, W), as white light would make it."""
        features = [self.branches[name](inputs[name]) for name in self.images]
        features += [self.panorama(inputs), self.direct(inputs["direct"])]
        return self.unet(torch.cat(features, dim=1)) + (inputs["direct"][:, :3] + 1) / 2


class LightColor(nn.Module):
    """The colour of all light in a room, from that of the sources that its panorama shows.

    They differ by day: a window shows blue sky, and lets in the sun and what sunlit ground
    returns. At first it is the sources' own colour.
    """

    def __init__(self, hidden: int = 16) -> None:
        super().__init__()
        self.hidden, self.out = nn.Linear(3, hidden), nn.Linear(hidden, 3)
        nn.init.zeros_(self.out.weight)
        nn.init.zeros_(self.out.bias)  # type: ignore[arg-type]

    def forward(self, tint: torch.Tensor) -> torch.Tensor:
        """Linear RGB of luminance 1 (N, 3, 1, 1) to the same."""
        logs = tint.flatten(1).log()
        color = (logs + self.out(functional.relu(self.hidden(logs)))).exp()[..., None, None]
        return color / luminance(color)


def multiplied(
    shading: torch.Tensor, reflectance: torch.Tensor, gain: torch.Tensor | float = 1.0
) -> torch.Tensor:
    """Reflectance x shading, all in display values (N, 3, H, W): `product`, white `DEFAULT_WHITE`.

    The linear product is multiplied by `gain`; with 1 both images have one exposure, as under the
    policy `shared`. Differentiable everywhere.
    """
    light = decode_srgb(shading)
    seen = luminance(light)
    half = 0.5 * (1 - seen)
    # Reinhard's operator, solved for the luminance that it was given
    scaled = seen / (half + torch.sqrt(half**2 + seen / DEFAULT_WHITE**2 + 1e-12))
    linear = light * (scaled / seen.clamp(min=1e-6)) * decode_srgb(reflectance) * (gain / NEUTRAL)
    return tonemap_exposed(linear, DEFAULT_WHITE)


class DecomposedLoss(SingleLoss):
    """The criterion on the shading and on the colour, both from one network."""

    def loss(self, batch: Batch) -> torch.Tensor:
        """The sum of both, a scalar with gradient."""
        assert isinstance(self.network, PlusNet) and batch.shading is not None
        with self.half():
            shading, color = self.network.parts(batch.inputs)
            return self.criterion(color.float(), batch.truth) + self.criterion(
                shading.float(), batch.shading
            )
