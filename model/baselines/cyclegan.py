"""CycleGAN: two generators and two discriminators, trained without pairs.

J.-Y. Zhu, T. Park, P. Isola, A. A. Efros: *Unpaired Image-to-Image Translation using
Cycle-Consistent Adversarial Networks*, ICCV 2017, and its appendix. Generator after Johnson et
al.: c7s1-64, d128, d256, R256 six times (nine at 256 pixels and more), u128, u64, c7s1-3, tanh;
instance norm, reflection padding. Discriminators: pix2pix's 70x70 patches, without the inputs.
The own loss: least squares for the game, 10 times L1 around each cycle, 5 times L1 of
identity; the discriminators see a history of 50 generated images. `width` is the 64, `levels` the
number of R blocks.

Here one domain is not a photograph but our stack of inputs, so the way back gives a stack,
without tanh. Identity needs a picture that a generator of the other domain's could take: a colour
picture stands in the stack as reflectance, of nothing else known (docs/networks.md).
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import torch
from torch import nn
from torch.nn import functional

from model.baselines.layers import IMAGES, STACKED, InstanceNorm, display, gaussian, padded, stacked
from model.baselines.pix2pix import PatchDiscriminator
from model.data.encoding import CHANNELS, Tensors, centred
from model.networks.objective import Batch, Objective, Setting
from model.networks.pbrnet import Architecture

CYCLE, IDENTITY = 10.0, 5.0
HISTORY = 50  # images
_FIRST = sum(CHANNELS[name] for name in IMAGES[: IMAGES.index("reflectance")])
REFLECTANCE = slice(_FIRST, _FIRST + CHANNELS["reflectance"])  # its channels in the stack


class Generator(nn.Module):
    """c7s1-w, d2w, d4w, `blocks` times R4w, u2w, uw, c7s1-`outputs`: at full size again."""

    def __init__(self, inputs: int, outputs: int, width: int, blocks: int) -> None:
        super().__init__()
        self.layers = nn.Sequential(
            nn.ReflectionPad2d(3),
            *normalised(nn.Conv2d(inputs, width, 7)),
            *normalised(nn.Conv2d(width, 2 * width, 3, stride=2, padding=1)),
            *normalised(nn.Conv2d(2 * width, 4 * width, 3, stride=2, padding=1)),
            *(Residual(4 * width) for _ in range(blocks)),
            *normalised(doubling(4 * width, 2 * width)),
            *normalised(doubling(2 * width, width)),
            nn.ReflectionPad2d(3),
            nn.Conv2d(width, outputs, 7),
        )
        self.apply(gaussian)

    def forward(self, image: torch.Tensor) -> torch.Tensor:
        """(N, inputs, H, W) to (N, outputs, H, W); padded to fours inside and cropped back."""
        height, width = image.shape[-2:]
        return self.layers(padded(image, 4, 8))[..., :height, :width]


class Residual(nn.Module):
    """R: two 3x3 convolutions, reflected at the edges, added to what came in."""

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
        """(N, width, H, W)."""
        return x + self.layers(x)


class ForwardGenerator(nn.Module):
    """Inputs to colour: what is kept after training."""

    def __init__(self, architecture: Architecture) -> None:
        super().__init__()
        self.generator = Generator(STACKED, 3, architecture.width, architecture.levels)

    def forward(self, inputs: Tensors) -> torch.Tensor:
        """`encode`'s tensors to display values (N, 3, H, W)."""
        return self.from_stack(stacked(inputs))

    def from_stack(self, stack: torch.Tensor) -> torch.Tensor:
        """(N, `STACKED`, H, W), given or generated, to display values (N, 3, H, W)."""
        return display(torch.tanh(self.generator(stack)))


class CycleObjective(Objective):
    """CycleGAN's own loss. Stacks are of this step's views, pictures of the step before's.

    So no pair is ever seen together, though each is drawn as often as the other.
    """

    def __init__(self, setting: Setting) -> None:
        self.network, self.half = setting.network, setting.half
        blocks = sum(isinstance(part, Residual) for part in self.network.modules())
        self.back = Generator(3, STACKED, setting.width, blocks)
        self.judges = nn.ModuleDict(
            {
                name: PatchDiscriminator(channels, setting.width, lambda _: InstanceNorm())
                for name, channels in (("color", 3), ("stack", STACKED))
            }
        )
        self.players = {
            "network": nn.ModuleList([self.network, self.back]),
            "discriminators": self.judges,
        }
        self.histories = {name: History() for name in self.judges}
        self.last: torch.Tensor | None = None  # the picture of the step before, centred

    def losses(self, batch: Batch) -> Iterator[tuple[str, torch.Tensor]]:
        """Both generators', then both discriminators', by generated images old and new."""
        stack, here = stacked(batch.inputs), centred(batch.truth)
        color = here if self.last is None else self.last.to(here.device)
        loss, made = self._generators(stack, color)
        yield "network", loss
        old = {name: self.histories[name].exchange(image.detach()) for name, image in made.items()}
        with self.half():
            total = sum(
                0.5 * (squares(self.judges[name](real), 1) + squares(self.judges[name](fake), 0))
                for name, real, fake in (
                    ("color", color, old["color"]),
                    ("stack", stack, old["stack"]),
                )
            )
        assert isinstance(total, torch.Tensor)
        yield "discriminators", total
        self.last = here

    def loss(self, batch: Batch) -> torch.Tensor:
        """Both generators' on these views, without the histories."""
        return self._generators(stacked(batch.inputs), centred(batch.truth))[0]

    def memory(self) -> dict[str, Any]:
        """The histories and the last picture."""
        images = {name: history.images for name, history in self.histories.items()}
        return {"histories": images, "last": self.last}

    def remember(self, memory: dict[str, Any]) -> None:
        """Take up what `memory` gave."""
        self.last = memory["last"]
        for name, images in memory["histories"].items():
            self.histories[name].images = list(images)

    def _generators(
        self, stack: torch.Tensor, color: torch.Tensor
    ) -> tuple[torch.Tensor, dict[str, torch.Tensor]]:
        """Loss of the two generators, and what they made; images centred, about [-1, 1]."""
        with self.half():
            made = {"color": self._forth(stack), "stack": self.back(color).float()}
            game = sum(squares(self.judges[name](image), 1) for name, image in made.items())
            around = functional.l1_loss(self.back(made["color"]).float(), stack)
            around = around + functional.l1_loss(self._forth(made["stack"]), color)
            same = functional.l1_loss(self._forth(as_stack(color)), color)
            reflectance = stack[:, REFLECTANCE]
            kept = self.back(reflectance).float()[:, REFLECTANCE]
            same = same + functional.l1_loss(kept, reflectance)
        return game + CYCLE * around + IDENTITY * same, made

    def _forth(self, stack: torch.Tensor) -> torch.Tensor:
        network = self.network
        assert isinstance(network, ForwardGenerator)
        return centred(network.from_stack(stack).float())


class History:
    """The last images that were generated (Shrivastava et al. 2017), at most `HISTORY`."""

    def __init__(self) -> None:
        self.images: list[torch.Tensor] = []

    def exchange(self, batch: torch.Tensor) -> torch.Tensor:
        """Each of (N, C, H, W) itself, or, once full and half the time, an old one for it.

        An old one that is given out makes room for the new one. Draws from torch's random state.
        """
        given = []
        for image in batch.split(1):
            if len(self.images) < HISTORY:
                self.images.append(image)
            elif torch.rand(()) < 0.5:
                index = int(torch.randint(HISTORY, ()))
                if self.images[index].shape == image.shape:
                    image, self.images[index] = self.images[index].to(image.device), image
            given.append(image)
        return torch.cat(given)


def squares(verdict: torch.Tensor, wanted: int) -> torch.Tensor:
    """Mean square of the difference between verdicts and what they should be: the LSGAN's."""
    return (verdict.float() - wanted).square().mean()


def as_stack(color: torch.Tensor) -> torch.Tensor:
    """A centred picture (N, 3, H, W) as reflectance in a stack that says nothing else."""
    stack = color.new_zeros(color.shape[0], STACKED, *color.shape[-2:])
    stack[:, REFLECTANCE] = color
    return stack


def normalised(convolution: nn.Module) -> tuple[nn.Module, nn.Module, nn.Module]:
    """A convolution, instance norm, ReLU."""
    return convolution, InstanceNorm(), nn.ReLU()


def doubling(inputs: int, outputs: int) -> nn.ConvTranspose2d:
    """u: a 3x3 convolution of stride 1/2."""
    return nn.ConvTranspose2d(inputs, outputs, 3, stride=2, padding=1, output_padding=1)
