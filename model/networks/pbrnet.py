"""The paper's networks, shading and composition. The baselines are in model/baselines.

The layout follows the paper's Fig. 2 and section III-B. The paper does not say how features of the
panorama join those of the image, which has another shape and frame: see docs/networks.md.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from itertools import pairwise

import torch
from torch import nn
from torch.nn import functional

from pbrnet.model.data.direct_light import look_up
from pbrnet.model.data.display import displayed_product
from pbrnet.model.data.encoding import NEUTRAL, Policy, Tensors, centred, input_named
from pbrnet.model.methods import Panorama, join_of
from pbrnet.scenes.checked import within

GRID = (32, 64)  # cells that a panorama of any size is averaged to before the `normal` join
WIDEST = 8  # levels double their width up to this many times the first level's


@dataclass(frozen=True)
class Architecture:
    """Hyperparameters of a network; part of its model card."""

    kind: str  # `Method.kind` of `pbrnet.model.methods.METHODS`
    width: int = field(metadata=within(1, 1024))  # channels of the first level
    levels: int = field(
        metadata=within(1, 32)
    )  # resolutions of a U-Net, or the depth that the network's own file defines
    panorama: Panorama = "normal"
    exposure: Policy = "shared"  # exposure policy of the predicted colour
    revision: int = field(default=1, metadata=within(1))  # `revision_of`


def shading_network(architecture: Architecture) -> GuidedNet:
    """Build the first stage: shading from depth, normal and panorama."""
    images = ("depth", "normal")
    return GuidedNet(images, architecture.width, architecture.levels, architecture.panorama)


def composition_network(architecture: Architecture) -> CompositionNet:
    """Build the second stage: colour from shading and reflectance."""
    own = architecture.exposure == "own"
    return CompositionNet(architecture.width, architecture.levels, own)


class GuidedNet(nn.Module):
    """A convolution for each input, concatenation of the features, then a U-Net.

    With the images depth and normal this is the paper's shading network. With reflectance as a
    third image it predicts colour directly: the baseline `unet`. Some joins of the panorama add
    another image. Where that shows what the network predicts, direct light for shading and the
    product for colour, the U-Net corrects it.
    """

    def __init__(
        self, images: tuple[str, ...], width: int, levels: int, panorama: Panorama
    ) -> None:
        super().__init__()
        branch = max(1, width // 2)
        colour = "reflectance" in images
        join = join_of(panorama, "color" if colour else "shading")
        self.corrected = join.direct if join.product or not colour else ""
        self.shown = slice(-3, None) if colour else slice(join.bands)  # its channels of display
        images = (*images, *join.inputs)
        self.images = images
        self.branches = nn.ModuleDict(
            {name: Branch(input_named(name).channels, branch) for name in images}
        )
        self.panorama: nn.Module = (
            ResizedPanorama(branch) if join.resized else NormalPanorama(branch)
        )
        start = 0.0 if self.corrected else 0.5
        self.unet = UNet((len(images) + 2) * branch, width, levels, start=start)

    def forward(self, inputs: Tensors) -> torch.Tensor:
        """Tensors of `encode` to display values (N, 3, H, W), not clamped."""
        features = [self.branches[name](inputs[name]) for name in self.images]
        features.append(self.panorama(inputs))
        found = self.unet(torch.cat(features, dim=1))
        if self.corrected:
            found = found + (inputs[self.corrected][:, self.shown] + 1) / 2
        return found


class CompositionNet(nn.Module):
    """U-Net from concatenated shading and reflectance to colour.

    Colour in its `own` exposure depends on averages over the image, which convolutions do not
    compute: then `displayed_product` of both images is a third one, which the U-Net corrects.
    """

    def __init__(self, width: int, levels: int, own: bool) -> None:
        super().__init__()
        self.own = own
        self.unet = UNet(9 if own else 6, width, levels, start=0.0 if own else 0.5)

    def images(self, shading: torch.Tensor, reflectance: torch.Tensor) -> Tensors:
        """The network's images by name, of display values of shading and `encode`'s reflectance.

        All are (N, 3, H, W). The product is that of whole images: tiles have other averages.
        """
        images = {"shading": centred(shading), "reflectance": reflectance}
        if self.own:
            images["product"] = centred(displayed_product(shading, reflectance, NEUTRAL))
        return images

    def forward(self, images: Tensors) -> torch.Tensor:
        """The tensors of `images` to display values of colour (N, 3, H, W), not clamped."""
        names = ("shading", "reflectance", "product")
        found = self.unet(torch.cat([images[name] for name in names if name in images], dim=1))
        return found + (images["product"] + 1) / 2 if self.own else found


class Branch(nn.Sequential):
    """Convolution layer of one input: 3x3, ReLU."""

    def __init__(self, inputs: int, outputs: int) -> None:
        super().__init__(convolution(inputs, outputs, padding=1), nn.ReLU())


class ResizedPanorama(nn.Module):
    """Panorama join of the paper's figure: convolve each panorama, resize it to the image.

    A feature and the pixel it is joined to have different directions. Only the deepest level of the
    U-Net has a receptive field that is large enough to relate them.
    """

    def __init__(self, branch: int) -> None:
        super().__init__()
        self.intensity = Branch(1, branch)
        self.distance = Branch(1, branch)

    def forward(self, inputs: Tensors) -> torch.Tensor:
        """Features (N, 2 branch, H, W).

        The optional input `place` holds the position of each pixel of a tile in the whole image:
        (N, H, W, 2), x and y, [-1, 1] from edge to edge.
        """
        intensity, distance = log_panorama(inputs["intensity"], inputs["distance"])
        features = torch.cat([self.intensity(intensity), self.distance(distance)], dim=1)
        if "place" in inputs:  # a tile: sample the panorama resized to the whole image
            places = inputs["place"].to(features.dtype)
            return functional.grid_sample(
                features, places, padding_mode="border", align_corners=False
            )
        size = inputs["normal"].shape[-2:]
        return functional.interpolate(features, size, mode="bilinear", align_corners=False)


class NormalPanorama(nn.Module):
    """Panorama join by normals: encode the panorama, look its features up in normals' directions.

    A matte surface receives light from the hemisphere around its normal. Each feature therefore
    has a receptive field of a hemisphere, and the lookup resembles that of an irradiance map.
    Convolutions wrap in azimuth. A panorama of any size is first averaged to `GRID`, which
    conserves energy.
    """

    def __init__(self, branch: int) -> None:
        super().__init__()
        hidden = 2 * branch
        self.intensity = RoundConv(1, branch)
        self.distance = RoundConv(1, branch)
        # 32x64 to 4x8 cells of 45 degrees: the last 3x3 kernels span a hemisphere.
        self.down = nn.Sequential(
            RoundConv(hidden, hidden, 2), RoundConv(hidden, hidden, 2), RoundConv(hidden, hidden, 2)
        )
        self.around = RoundConv(hidden, hidden)

    def forward(self, inputs: Tensors) -> torch.Tensor:
        """Features (N, 2 branch, H, W)."""
        intensity, distance = log_panorama(*averaged(inputs["intensity"], inputs["distance"]))
        features = torch.cat([self.intensity(intensity), self.distance(distance)], dim=1)
        normal = inputs["normal"]
        found = look_up(self.around(self.down(features)), normal)
        # In the memory format of the images: joined to one in another format, all are copied.
        last = normal.is_contiguous(memory_format=torch.channels_last)
        return found.contiguous(memory_format=torch.channels_last) if last else found


def averaged(intensity: torch.Tensor, distance: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
    """Linear panoramas (N, 1, h, w) on `GRID`: mean intensity, intensity-weighted distance."""
    mean = functional.adaptive_avg_pool2d(intensity, GRID)
    weighted = functional.adaptive_avg_pool2d(intensity * distance, GRID)
    return mean, weighted / mean.clamp(min=1e-12)


def log_panorama(
    intensity: torch.Tensor, distance: torch.Tensor
) -> tuple[torch.Tensor, torch.Tensor]:
    """ln(1 + relative intensity) / 4 and ln(1 + metres) / 2.

    The logarithm compresses the range between a bulb and a dim sky.
    """
    return torch.log1p(intensity) / 4, torch.log1p(distance) / 2


class RoundConv(nn.Module):
    """3x3 convolution on an equirectangular image: wraps in azimuth, repeats at the poles."""

    def __init__(self, inputs: int, outputs: int, stride: int = 1) -> None:
        super().__init__()
        self.conv = convolution(inputs, outputs, stride=stride)

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        """(N, inputs, h, w) to (N, outputs, h / stride, w / stride)."""
        x = functional.pad(
            functional.pad(x, (1, 1, 0, 0), mode="circular"), (0, 0, 1, 1), "replicate"
        )
        return functional.relu(self.conv(x))


class UNet(nn.Module):
    """U-Net (Ronneberger et al. 2015) with skip connections, for images of any size.

    Each level has two 3x3 convolutions with ReLU in the encoder and two in the decoder. The encoder
    halves by 2x2 max pooling. The decoder doubles by a 1x1 convolution and bilinear upsampling. A
    1x1 convolution makes the outputs; its bias starts at `start`, by default mid-grey. There is no
    normalisation: with batch 1 it would remove the brightness of each image.
    """

    def __init__(
        self, inputs: int, width: int, levels: int, outputs: int = 3, start: float = 0.5
    ) -> None:
        super().__init__()
        widths = [width * min(2**level, WIDEST) for level in range(levels)]
        self.levels = levels
        self.down = nn.ModuleList(
            DoubleConv(before, after)
            for before, after in zip([inputs, *widths], widths, strict=False)
        )
        self.shrink = nn.ModuleList(
            convolution(deep, shallow, 1) for shallow, deep in pairwise(widths)
        )
        self.up = nn.ModuleList(DoubleConv(2 * wide, wide) for wide in widths[:-1])
        self.out = nn.Conv2d(width, outputs, 1)
        nn.init.normal_(self.out.weight, std=0.01)
        nn.init.constant_(self.out.bias, start)  # type: ignore[arg-type]

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        """(N, inputs, H, W) to (N, outputs, H, W); pads by repeating the edge, then crops."""
        height, width = x.shape[-2:]
        step = 2 ** (self.levels - 1)
        x = functional.pad(x, (0, -width % step, 0, -height % step), mode="replicate")
        skips = []
        for level, convolve in enumerate(self.down):
            x = convolve(x if level == 0 else functional.max_pool2d(x, 2))
            skips.append(x)
        for level in reversed(range(self.levels - 1)):
            x = self.shrink[level](x)
            x = functional.interpolate(x, scale_factor=2, mode="bilinear", align_corners=False)
            x = self.up[level](torch.cat([skips[level], x], dim=1))
        return self.out(x)[..., :height, :width]


class DoubleConv(nn.Sequential):
    """Two 3x3 convolutions, each with ReLU."""

    def __init__(self, inputs: int, outputs: int) -> None:
        super().__init__(
            convolution(inputs, outputs, padding=1),
            nn.ReLU(),
            convolution(outputs, outputs, padding=1),
            nn.ReLU(),
        )


def convolution(inputs: int, outputs: int, kernel: int = 3, **options: int) -> nn.Conv2d:
    """Convolution with He initialisation (2015) and a bias of 0."""
    layer = nn.Conv2d(inputs, outputs, kernel, **options)  # type: ignore[arg-type]
    nn.init.kaiming_normal_(layer.weight, nonlinearity="relu")
    nn.init.zeros_(layer.bias)  # type: ignore[arg-type]
    return layer


def channels_last(network: nn.Module) -> nn.Module:
    """The same network with its weights in the memory format channels last, which is faster."""
    return network.to(memory_format=torch.channels_last)  # type: ignore[call-overload,no-any-return]
