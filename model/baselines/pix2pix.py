"""pix2pix: a conditional GAN on a U-Net with skips.

P. Isola, J.-Y. Zhu, T. Zhou, A. A. Efros: *Image-to-Image Translation with Conditional
Adversarial Networks*, CVPR 2017, and its appendix. Ck is convolution, batch norm, ReLU with k
filters; CDk has dropout of 50 % too; all 4x4, stride 2.
Encoder (leaky 0.2): C64-C128-C256-C512-C512-C512-C512-C512, no norm in the first. Decoder:
CD512-CD512-CD512-C512-C256-C128-C64, then to three channels and tanh; skips join i and n - i.
Discriminator, 70x70 pixels a patch: C64-C128-C256-C512, then to one channel; it sees the inputs
beside the picture. The own loss: log loss of the game, and 100 times L1 on the scale [-1, 1].
`width` is the 64, `levels` the 8. At 256x256, 8 levels end in one pixel.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator

import torch
from torch import nn
from torch.nn import functional

from model.baselines.layers import STACKED, BatchNorm, Stack, display, gaussian, padded, stacked
from model.data.encoding import Tensors, centred
from model.networks.objective import Batch, Objective, Setting
from model.networks.pbrnet import Architecture

WIDEST = 8  # filters double up to so many times the first layer's
DROPPING = 3  # of the decoder's layers, from the bottleneck on
LEAK = 0.2
L1 = 100.0
SMALLEST = 32  # pixels a side below which the discriminator would have no patch


class Generator(nn.Module):
    """The U-Net of `levels` halvings (8: the paper's)."""

    def __init__(self, architecture: Architecture) -> None:
        super().__init__()
        self.levels = architecture.levels
        self.stack = Stack(architecture.panorama, architecture.width)
        widths = [architecture.width * min(2**level, WIDEST) for level in range(self.levels)]
        ends = (0, self.levels - 1)  # neither the first layer nor the single pixel is normalised
        self.down = nn.ModuleList(
            Down(before, after, norm=level not in ends)
            for level, (before, after) in enumerate(
                zip([self.stack.channels, *widths], widths, strict=False)
            )
        )
        ways = list(reversed(widths[:-1]))  # what the decoder's layers put out
        givens = [widths[-1], *(2 * width for width in ways[:-1])]
        self.up = nn.ModuleList(
            Up(given, width, drop=layer < min(DROPPING, self.levels - 1))
            for layer, (given, width) in enumerate(zip(givens, ways, strict=True))
        )
        self.out = nn.ConvTranspose2d(2 * widths[0], 3, 4, stride=2, padding=1)
        for part in (self.down, self.up, self.out):
            part.apply(gaussian)

    def forward(self, inputs: Tensors) -> torch.Tensor:
        """`encode`'s tensors to display values (N, 3, H, W); padded inside and cropped back."""
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
        picture = torch.tanh(self.out(functional.relu(x)))
        return display(picture)[..., :height, :width]


class Down(nn.Module):
    """Convolution, norm, leaky ReLU. (The ReLU that follows a skip makes the leak undone.)"""

    def __init__(self, inputs: int, outputs: int, norm: bool) -> None:
        super().__init__()
        self.conv = nn.Conv2d(inputs, outputs, 4, stride=2, padding=1)
        self.norm = BatchNorm(outputs) if norm else nn.Identity()

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        """(N, inputs, H, W) to (N, outputs, H / 2, W / 2)."""
        return functional.leaky_relu(self.norm(self.conv(x)), LEAK)


class Up(nn.Module):
    """ReLU, transposed convolution, norm, and dropout in the layers next to the bottleneck."""

    def __init__(self, inputs: int, outputs: int, drop: bool) -> None:
        super().__init__()
        self.conv = nn.ConvTranspose2d(inputs, outputs, 4, stride=2, padding=1)
        self.norm = BatchNorm(outputs)
        self.drop = nn.Dropout(0.5) if drop else nn.Identity()

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        """(N, inputs, H, W) to (N, outputs, 2H, 2W)."""
        return self.drop(self.norm(self.conv(functional.relu(x))))


class PatchDiscriminator(nn.Module):
    """C64-C128-C256-C512, then to one channel: a verdict for every patch of 70x70 pixels.

    4x4 convolutions, leaky ReLU 0.2; the first three halve, the first is not normalised.
    `norm` makes the normalisation of so many channels.
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
        """(N, inputs, H, W) to verdicts (N, 1, about H / 8, about W / 8); small ones are padded."""
        return self.layers(padded(image, 1, SMALLEST))


class AdversarialObjective(Objective):
    """pix2pix's own loss: fool a discriminator that sees the inputs, and be near the truth."""

    def __init__(self, setting: Setting) -> None:
        self.network, self.half = setting.network, setting.half
        self.discriminator = PatchDiscriminator(STACKED + 3, setting.width, BatchNorm)
        self.players = {"discriminator": self.discriminator, "network": self.network}

    def losses(self, batch: Batch) -> Iterator[tuple[str, torch.Tensor]]:
        """The discriminator's half of the log loss, then the generator's against its update."""
        with self.half():
            picture = self.network(batch.inputs)
            seen = self._verdict(batch.inputs, batch.truth)
            made = self._verdict(batch.inputs, picture.detach())
        yield "discriminator", 0.5 * (log_loss(seen, True) + log_loss(made, False))
        yield "network", self._generator(batch, picture)

    def loss(self, batch: Batch) -> torch.Tensor:
        """The generator's: log loss of the game, and `L1` times the mean difference."""
        with self.half():
            picture = self.network(batch.inputs)
        return self._generator(batch, picture)

    def _generator(self, batch: Batch, picture: torch.Tensor) -> torch.Tensor:
        with self.half():
            fooled = self._verdict(batch.inputs, picture)
        near = functional.l1_loss(centred(picture.float()), centred(batch.truth))
        return log_loss(fooled, True) + L1 * near

    def _verdict(self, inputs: Tensors, picture: torch.Tensor) -> torch.Tensor:
        return self.discriminator(torch.cat([stacked(inputs), centred(picture)], dim=1)).float()


def log_loss(verdict: torch.Tensor, real: bool) -> torch.Tensor:
    """Mean cross entropy of verdicts (logits) that should all be `real`."""
    wanted = torch.full_like(verdict, float(real))
    return functional.binary_cross_entropy_with_logits(verdict, wanted)
