"""pix2pix: a conditional GAN whose generator is a U-Net with skip connections.

P. Isola, J.-Y. Zhu, T. Zhou, A. A. Efros: *Image-to-Image Translation with Conditional
Adversarial Networks*, CVPR 2017, and its appendix. Ck is a layer of convolution, batch norm and
ReLU with k filters. CDk also has dropout of 50 %. All convolutions are 4x4 with stride 2.

* Encoder (leaky ReLU 0.2): C64-C128-C256-C512-C512-C512-C512-C512, no norm in the first layer.
* Decoder: CD512-CD512-CD512-C512-C256-C128-C64, then a convolution to three channels and tanh.
  Skip connections join layers i and n - i.
* Discriminator (70x70 patches): C64-C128-C256-C512, then a convolution to one channel. Its input is
  the inputs and the real or generated image.
* Its own loss: the adversarial log loss, plus 100 times L1 of images on the scale [-1, 1].

`width` is the number of filters in the first layer (64 in the paper), `levels` the number of
encoder layers (8). With 8 levels an image of 256x256 pixels shrinks to one pixel.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator

import torch
from torch import nn
from torch.nn import functional

from pbrnet.model.baselines.layers import (
    BatchNorm,
    Stack,
    display,
    gaussian,
    padded,
    stacked,
)
from pbrnet.model.data.encoding import Tensors, centred
from pbrnet.model.networks.objective import Batch, Objective, Setting
from pbrnet.model.networks.pbrnet import Architecture

WIDEST = 8  # maximum number of filters, as a multiple of the first layer's
DROPOUT_LAYERS = 3  # number of decoder layers with dropout, from the bottleneck on
LEAK = 0.2
L1 = 100.0
MIN_SIDE = 32  # least side in pixels that gives the discriminator a patch


class Generator(nn.Module):
    """U-Net that halves the image `levels` times (8 in the paper)."""

    def __init__(self, architecture: Architecture) -> None:
        super().__init__()
        self.levels = architecture.levels
        self.stack = Stack(architecture.panorama, architecture.width)
        widths = [architecture.width * min(2**level, WIDEST) for level in range(self.levels)]
        ends = (0, self.levels - 1)  # no norm in the first layer and at the bottleneck
        self.down = nn.ModuleList(
            Down(before, after, norm=level not in ends)
            for level, (before, after) in enumerate(
                zip([self.stack.channels, *widths], widths, strict=False)
            )
        )
        up_outputs = list(reversed(widths[:-1]))
        up_inputs = [widths[-1], *(2 * width for width in up_outputs[:-1])]  # with the skip
        self.up = nn.ModuleList(
            Up(before, after, drop=layer < min(DROPOUT_LAYERS, self.levels - 1))
            for layer, (before, after) in enumerate(zip(up_inputs, up_outputs, strict=True))
        )
        self.out = nn.ConvTranspose2d(2 * widths[0], 3, 4, stride=2, padding=1)
        for part in (self.down, self.up, self.out):
            part.apply(gaussian)

    def forward(self, inputs: Tensors) -> torch.Tensor:
        """Tensors of `encode` to display values (N, 3, H, W); padded inside and cropped back."""
        x = self.stack(inputs)
        height, width = x.shape[-2:]
        x = padded(x, 2**self.levels)
        skips = []
        for down in self.down:
            x = down(x)
            skips.append(x)
        skips.pop()
        for up in self.up:
            x = torch.cat([up(x), skips.pop()], dim=1)
        image = torch.tanh(self.out(functional.relu(x)))
        return display(image)[..., :height, :width]


class Down(nn.Module):
    """Encoder layer: convolution, norm, leaky ReLU. (The decoder applies ReLU to its skip.)"""

    def __init__(self, inputs: int, outputs: int, norm: bool) -> None:
        super().__init__()
        self.conv = nn.Conv2d(inputs, outputs, 4, stride=2, padding=1)
        self.norm = BatchNorm(outputs) if norm else nn.Identity()

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        """(N, inputs, H, W) to (N, outputs, H / 2, W / 2)."""
        return functional.leaky_relu(self.norm(self.conv(x)), LEAK)


class Up(nn.Module):
    """Decoder layer: ReLU, transposed convolution, norm, and dropout if `drop`."""

    def __init__(self, inputs: int, outputs: int, drop: bool) -> None:
        super().__init__()
        self.conv = nn.ConvTranspose2d(inputs, outputs, 4, stride=2, padding=1)
        self.norm = BatchNorm(outputs)
        self.drop = nn.Dropout(0.5) if drop else nn.Identity()

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        """(N, inputs, H, W) to (N, outputs, 2H, 2W)."""
        return self.drop(self.norm(self.conv(functional.relu(x))))


class PatchDiscriminator(nn.Module):
    """PatchGAN discriminator: C64-C128-C256-C512, then one logit for each 70x70 patch.

    4x4 convolutions with leaky ReLU 0.2. The first three have stride 2, the first has no norm.
    `norm` returns the normalisation layer for a number of channels.
    """

    def __init__(self, inputs: int, width: int, norm: Callable[[int], nn.Module]) -> None:
        super().__init__()
        layers: list[nn.Module] = []
        for level, stride in enumerate((2, 2, 2, 1)):
            outputs = width * 2**level
            layers += [nn.Conv2d(inputs, outputs, 4, stride=stride, padding=1)]
            layers += [norm(outputs)] if level else []
            layers += [nn.LeakyReLU(LEAK)]
            inputs = outputs
        self.layers = nn.Sequential(*layers, nn.Conv2d(inputs, 1, 4, padding=1))
        self.apply(gaussian)

    def forward(self, image: torch.Tensor) -> torch.Tensor:
        """(N, inputs, H, W) to logits (N, 1, about H / 8, about W / 8); pads small images."""
        return self.layers(padded(image, 1, MIN_SIDE))


class AdversarialObjective(Objective):
    """Adversarial objective of pix2pix, with a discriminator conditioned on the inputs, and L1."""

    description = "log loss of 70x70 patches + 100 L1"

    def __init__(self, setting: Setting) -> None:
        assert isinstance(setting.network, Generator)
        self.network, self.autocast = setting.network, setting.autocast
        channels = self.network.stack.inputs + 3  # the inputs' and the picture's
        self.discriminator = PatchDiscriminator(channels, setting.width, BatchNorm)
        self.modules = {"discriminator": self.discriminator, "network": self.network}

    def losses(self, batch: Batch) -> Iterator[tuple[str, torch.Tensor]]:
        """The loss of the discriminator, halved, then that of the generator after its update."""
        with self.autocast():
            generated = self.network(batch.inputs)
            on_real = self._discriminate(batch.inputs, batch.truth)
            on_generated = self._discriminate(batch.inputs, generated.detach())
        yield "discriminator", 0.5 * (log_loss(on_real, True) + log_loss(on_generated, False))
        yield "network", self._generator_loss(batch, generated)

    def loss(self, batch: Batch) -> torch.Tensor:
        """The loss of the generator: adversarial log loss plus `L1` times the mean difference."""
        with self.autocast():
            generated = self.network(batch.inputs)
        return self._generator_loss(batch, generated)

    def _generator_loss(self, batch: Batch, generated: torch.Tensor) -> torch.Tensor:
        with self.autocast():
            logits = self._discriminate(batch.inputs, generated)
        difference = functional.l1_loss(centred(generated.float()), centred(batch.truth))
        return log_loss(logits, True) + L1 * difference

    def _discriminate(self, inputs: Tensors, image: torch.Tensor) -> torch.Tensor:
        return self.discriminator(torch.cat([stacked(inputs), centred(image)], dim=1)).float()


def log_loss(logits: torch.Tensor, real: bool) -> torch.Tensor:
    """Mean binary cross entropy of the logits of images that are all `real`, or all not."""
    target = torch.full_like(logits, float(real))
    return functional.binary_cross_entropy_with_logits(logits, target)
