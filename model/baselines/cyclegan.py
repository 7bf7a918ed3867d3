"""CycleGAN: two generators and two discriminators, trained on unpaired images.

J.-Y. Zhu, T. Park, P. Isola, A. A. Efros: *Unpaired Image-to-Image Translation using
Cycle-Consistent Adversarial Networks*, ICCV 2017, and its appendix.

* Generator, after Johnson et al.: c7s1-64, d128, d256, R256 six times (nine times from 256 pixels
  on), u128, u64, c7s1-3, tanh; instance norm and reflection padding.
* Discriminators: the 70x70 PatchGAN of pix2pix, not conditioned on the inputs. They are trained on
  a buffer of the last 50 generated images.
* Its own loss: least-squares adversarial loss, plus 10 times the L1 cycle consistency loss, plus 5
  times the L1 identity loss.

`width` is the number of filters in the first layer (64 in the paper), `levels` the number of R
blocks.

One of the two domains is here the stack of inputs (`pbrnet.model.baselines.layers.stacked`). The
generator of this domain has no tanh. The identity loss needs images of one domain as input for the
generator from the other: a colour image becomes a stack with this colour as reflectance and all
other channels 0 (docs/networks.md).
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import torch
from torch import nn
from torch.nn import functional

from pbrnet.model.baselines.layers import (
    InstanceNorm,
    display,
    gaussian,
    padded,
    stack_channels,
    stacked,
)
from pbrnet.model.baselines.pix2pix import PatchDiscriminator
from pbrnet.model.data.encoding import Tensors, centred
from pbrnet.model.networks.objective import Batch, Objective, Setting
from pbrnet.model.networks.pbrnet import Architecture

CYCLE, IDENTITY = 10.0, 5.0  # weights of the cycle consistency and identity losses
BUFFER_SIZE = 50  # images
REFLECTANCE = slice(5, 8)  # channels of the stack, after depth and normal


class Generator(nn.Module):
    """Generator: c7s1-w, d2w, d4w, `blocks` times R4w, u2w, uw, c7s1-`outputs`."""

    def __init__(self, inputs: int, outputs: int, width: int, blocks: int) -> None:
        super().__init__()
        self.layers = nn.Sequential(
            nn.ReflectionPad2d(3),
            *normalised(nn.Conv2d(inputs, width, 7)),
            *normalised(nn.Conv2d(width, 2 * width, 3, stride=2, padding=1)),
            *normalised(nn.Conv2d(2 * width, 4 * width, 3, stride=2, padding=1)),
            *(Residual(4 * width) for _ in range(blocks)),
            *normalised(upsampling(4 * width, 2 * width)),
            *normalised(upsampling(2 * width, width)),
            nn.ReflectionPad2d(3),
            nn.Conv2d(width, outputs, 7),
        )
        self.apply(gaussian)

    def forward(self, image: torch.Tensor) -> torch.Tensor:
        """(N, inputs, H, W) to (N, outputs, H, W); pads to multiples of 4 and crops back."""
        height, width = image.shape[-2:]
        return self.layers(padded(image, 4, 8))[..., :height, :width]


class Residual(nn.Module):
    """R: residual block of two 3x3 convolutions with reflection padding."""

    def __init__(self, width: int) -> None:
        super().__init__()
        self.layers = nn.Sequential(
            nn.ReflectionPad2d(1),
            *normalised(nn.Conv2d(width, width, 3)),
            nn.ReflectionPad2d(1),
            nn.Conv2d(width, width, 3),
            InstanceNorm(),
        )

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        """(N, width, H, W) to the same shape."""
        return x + self.layers(x)


class ForwardGenerator(nn.Module):
    """Generator from the inputs to colour, the network that is saved after training."""

    def __init__(self, architecture: Architecture) -> None:
        super().__init__()
        self.channels = stack_channels(architecture.panorama)
        self.generator = Generator(self.channels, 3, architecture.width, architecture.levels)

    def forward(self, inputs: Tensors) -> torch.Tensor:
        """Tensors of `encode` to display values (N, 3, H, W)."""
        return self.from_stack(stacked(inputs))

    def from_stack(self, stack: torch.Tensor) -> torch.Tensor:
        """Real or generated stack (N, `channels`, H, W) to display values (N, 3, H, W)."""
        return display(torch.tanh(self.generator(stack)))


class CycleObjective(Objective):
    """Adversarial objective of CycleGAN with cycle consistency and identity losses.

    A step takes the stacks of its own views and the colour images of the previous step. No stack is
    therefore seen together with its colour image, and both domains are sampled equally often.
    """

    description = "least squares of 70x70 patches + 10 cycle + 5 identity, unpaired"

    def __init__(self, setting: Setting) -> None:
        assert isinstance(setting.network, ForwardGenerator)
        self.network, self.autocast = setting.network, setting.autocast
        blocks = sum(isinstance(part, Residual) for part in self.network.modules())
        stack = self.network.channels
        self.inverse = Generator(3, stack, setting.width, blocks)  # from colour to the stack
        self.discriminators = nn.ModuleDict(
            {
                name: PatchDiscriminator(channels, setting.width, lambda _: InstanceNorm())
                for name, channels in (("color", 3), ("stack", stack))
            }
        )
        self.modules = {
            "network": nn.ModuleList([self.network, self.inverse]),
            "discriminators": self.discriminators,
        }
        self.buffers = {name: ImageBuffer() for name in self.discriminators}
        self.previous: torch.Tensor | None = None  # colour of the previous step, centred

    def losses(self, batch: Batch) -> Iterator[tuple[str, torch.Tensor]]:
        """The loss of both generators, then that of both discriminators on buffered images."""
        stack, current = stacked(batch.inputs), centred(batch.truth)
        color = current if self.previous is None else self.previous.to(current.device)
        loss, generated = self._generator_loss(stack, color)
        yield "network", loss
        fakes = {
            name: self.buffers[name].exchange(each.detach()) for name, each in generated.items()
        }
        with self.autocast():
            total = sum(
                0.5
                * (self._least_squares(name, real, 1) + self._least_squares(name, fakes[name], 0))
                for name, real in (("color", color), ("stack", stack))
            )
        assert isinstance(total, torch.Tensor)
        yield "discriminators", total
        self.previous = current

    def loss(self, batch: Batch) -> torch.Tensor:
        """The loss of both generators on these views, without the buffers."""
        return self._generator_loss(stacked(batch.inputs), centred(batch.truth))[0]

    def state_dict(self) -> dict[str, Any]:
        """The image buffers and the colour of the previous step."""
        images = {name: buffer.images for name, buffer in self.buffers.items()}
        return {"histories": images, "last": self.previous}

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Restore the state that `state_dict` returned."""
        self.previous = state["last"]
        for name, images in state["histories"].items():
            self.buffers[name].images = list(images)

    def _generator_loss(
        self, stack: torch.Tensor, color: torch.Tensor
    ) -> tuple[torch.Tensor, dict[str, torch.Tensor]]:
        """Loss of the two generators, and the images they generate, centred, about [-1, 1]."""
        with self.autocast():
            generated = {"color": self._to_color(stack), "stack": self._to_stack(color)}
            adversarial = sum(
                self._least_squares(name, image, 1) for name, image in generated.items()
            )
            cycle = functional.l1_loss(self._to_stack(generated["color"]), stack)
            cycle = cycle + functional.l1_loss(self._to_color(generated["stack"]), color)
            identity = functional.l1_loss(
                self._to_color(as_stack(color, self.network.channels)), color
            )
            reflectance = stack[:, REFLECTANCE]
            restored = self._to_stack(reflectance)[:, REFLECTANCE]
            identity = identity + functional.l1_loss(restored, reflectance)
        return adversarial + CYCLE * cycle + IDENTITY * identity, generated

    def _to_color(self, stack: torch.Tensor) -> torch.Tensor:
        return centred(self.network.from_stack(stack).float())

    def _to_stack(self, color: torch.Tensor) -> torch.Tensor:
        return self.inverse(color).float()

    def _least_squares(self, name: str, image: torch.Tensor, label: int) -> torch.Tensor:
        return least_squares(self.discriminators[name](image), label)


class ImageBuffer:
    """Buffer of the last `BUFFER_SIZE` generated images (Shrivastava et al. 2017)."""

    def __init__(self) -> None:
        self.images: list[torch.Tensor] = []

    def exchange(self, batch: torch.Tensor) -> torch.Tensor:
        """Images (N, C, H, W) for the discriminator in place of the generated `batch`.

        Each image is stored and returned until the buffer is full. Then, with probability 0.5, a
        stored image of the same size is returned and replaced by the new one. Draws from torch's
        random state.
        """
        returned = []
        for image in batch.split(1):
            if len(self.images) < BUFFER_SIZE:
                self.images.append(image)
            elif torch.rand(()) < 0.5:
                index = int(torch.randint(BUFFER_SIZE, ()))
                if self.images[index].shape == image.shape:
                    image, self.images[index] = self.images[index].to(image.device), image
            returned.append(image)
        return torch.cat(returned)


def least_squares(output: torch.Tensor, label: int) -> torch.Tensor:
    """Mean squared difference between a discriminator's output and its label (LSGAN)."""
    return (output.float() - label).square().mean()


def as_stack(color: torch.Tensor, channels: int) -> torch.Tensor:
    """A stack (N, `channels`, H, W) with colour (N, 3, H, W) as reflectance, all else 0."""
    stack = color.new_zeros(color.shape[0], channels, *color.shape[-2:])
    stack[:, REFLECTANCE] = color
    return stack


def normalised(convolution: nn.Module) -> tuple[nn.Module, nn.Module, nn.Module]:
    """Layers of a block: the convolution, instance norm, ReLU."""
    return convolution, InstanceNorm(), nn.ReLU()


def upsampling(inputs: int, outputs: int) -> nn.ConvTranspose2d:
    """u: transposed 3x3 convolution that doubles the size (stride 1/2)."""
    return nn.ConvTranspose2d(inputs, outputs, 3, stride=2, padding=1, output_padding=1)
