"""Trained networks for other programs: one ONNX file from plain images to a picture.

Whoever opens the file needs neither torch nor this package: encoding of the inputs is part of the
graph, so it takes the dataset's columns as they are.
"""

from __future__ import annotations

import importlib.util
import json
import logging
import warnings
from pathlib import Path
from typing import Any

import torch
from torch import nn

from model.data.display import decoded, log_average, luminance
from model.data.encoding import FAR, GREY, MIDDLE, NEAR, RETURNED, Tensors, centred
from model.evaluation.inference import Networks, needed
from model.networks.pbrnet import GRID
from model.networks.plus import PlusNet
from model.release.onnx_light import direct_light, encoded_light, light_color
from scenes.checked import plain
from scenes.errors import MachineError
from scenes.files import atomic_file

OPSET = 20
INPUTS = ("depth", "valid", "normal", "reflectance", "intensity", "distance")
OUTPUTS = ("shading", "color")


class Chain(nn.Module):
    """Both networks behind one another, from the dataset's columns to display values."""

    def __init__(self, networks: Networks) -> None:
        super().__init__()
        self.shading, self.composition = (networks.modules[n] for n in needed("pbrnet"))
        self.averaged = networks.cards["shading"].architecture.panorama == "normal"

    def forward(
        self,
        depth: torch.Tensor,
        valid: torch.Tensor,
        normal: torch.Tensor,
        reflectance: torch.Tensor,
        intensity: torch.Tensor,
        distance: torch.Tensor,
    ) -> tuple[torch.Tensor, torch.Tensor]:
        """Float32 (H, W) or (H, W, 3), panorama (h, w), as `model.data.reader.Example` has them.

        Returns shading and colour, display values (H, W, 3) in [0, 1].
        """
        inputs = encoded(depth, valid, normal, reflectance, intensity, distance, self.averaged)
        shading = self.shading(inputs).clamp(0, 1)
        color = self.composition(shading, inputs["reflectance"]).clamp(0, 1)
        return shading[0].permute(1, 2, 0), color[0].permute(1, 2, 0)


class PlusChain(nn.Module):
    """PBR-Net plus with its direct light; as `Chain`, and `tint` (h, w, 3) and `K` (3, 3).

    Where the lights' colours are not known, a tint of ones is white light. A network that was
    trained with shadows takes `visibility` (H, W), too.
    """

    def __init__(self, networks: Networks) -> None:
        super().__init__()
        self.network = networks.modules["plus"]
        self.averaged = networks.cards["plus"].architecture.panorama == "normal"

    def forward(
        self,
        depth: torch.Tensor,
        valid: torch.Tensor,
        normal: torch.Tensor,
        reflectance: torch.Tensor,
        intensity: torch.Tensor,
        distance: torch.Tensor,
        tint: torch.Tensor,
        K: torch.Tensor,
        visibility: torch.Tensor | None = None,
    ) -> tuple[torch.Tensor, torch.Tensor]:
        """Shading and colour, display values (H, W, 3) in [0, 1]."""
        inputs = encoded(depth, valid, normal, reflectance, intensity, distance, self.averaged)
        lit, seen = direct_light(depth, valid, normal, intensity[..., None] * tint, distance, K)
        arrives = torch.ones_like(valid) if visibility is None else visibility
        lit = lit * arrives[..., None]
        assert isinstance(self.network, PlusNet)
        color, gain = light_color(lit), interreflection(valid, reflectance)
        shown = decoded((inputs["reflectance"] + 1) / 2) * (1 + valid * (color * gain - 1))
        known = {
            "direct": encoded_light(lit + seen, color, arrives),
            "tint": color,
            "gain": gain,
            "brightness": log_average(luminance(shown)) / GREY,
        }
        shading, color = self.network.parts({**inputs, **known})
        return shading[0].clamp(0, 1).permute(1, 2, 0), color[0].clamp(0, 1).permute(1, 2, 0)


def interreflection(valid: torch.Tensor, reflectance: torch.Tensor) -> torch.Tensor:
    """`model.data.encoding.interreflection` of (H, W) and (H, W, 3), as (1, 3, 1, 1)."""
    seen = valid.sum()
    mean = (reflectance * valid[..., None]).sum(dim=(0, 1)) / seen.clamp(min=1)
    gain = (1 - RETURNED * GREY) / (1 - RETURNED * mean)
    return torch.where(seen > 0, gain, torch.ones_like(gain)).reshape(1, 3, 1, 1)


def encoded(
    depth: torch.Tensor,
    valid: torch.Tensor,
    normal: torch.Tensor,
    reflectance: torch.Tensor,
    intensity: torch.Tensor,
    distance: torch.Tensor,
    averaged: bool,
) -> Tensors:
    """What `model.data.encoding.encode` makes of a view; the panorama on `GRID` if `averaged`."""
    log = torch.log(depth.clamp(NEAR, FAR) / MIDDLE)
    relative, metres = relative_intensity(intensity), distance.clamp(max=FAR)
    if averaged:
        mean = on_grid(relative)
        relative, metres = mean, on_grid(relative * metres) / mean.clamp(min=1e-12)
    # Nothing is seen where nothing is: the grey that `see_through` puts there.
    shown = torch.where(valid[..., None] > 0, reflectance, torch.full_like(reflectance, GREY))
    return {
        "depth": torch.stack([log * valid, valid])[None],
        "normal": normal.permute(2, 0, 1)[None],
        "reflectance": centred(encode_srgb(shown)).permute(2, 0, 1)[None],
        "intensity": relative[None, None],
        "distance": metres[None, None],
    }


def relative_intensity(intensity: torch.Tensor) -> torch.Tensor:
    """An equirectangular (h, w) relative to its mean over the sphere; 0 where no light shows."""
    # Shapes as tensors: the exporter cannot multiply by a number that is only known later.
    rows = torch.ones_like(intensity[:, 0])
    angle = torch.cumsum(rows, 0) * (torch.pi / rows.sum())  # of each row's lower edge
    strips = torch.cos(angle - angle[0]) - torch.cos(angle)
    mean = (intensity.mean(dim=1) * strips).sum() / 2
    return intensity / torch.where(mean > 0, mean, torch.ones_like(mean))


def on_grid(panorama: torch.Tensor) -> torch.Tensor:
    """(h, w) of any size averaged to `GRID`, as adaptive pooling does, which ONNX has not."""
    rows, columns = _shares(panorama[:, 0], GRID[0]), _shares(panorama[0], GRID[1])
    return rows @ panorama @ columns.T


def _shares(line: torch.Tensor, cells: int) -> torch.Tensor:
    """(cells, size): row i shares evenly in the pixels of `line` that its stretch touches."""
    after = torch.cumsum(torch.ones_like(line), 0)  # exact: whole numbers
    size, cell = after[-1], torch.arange(cells, dtype=line.dtype)[:, None]
    inside = (after * cells > cell * size) & ((after - 1) * cells < (cell + 1) * size)
    return inside.to(line.dtype) / inside.sum(dim=1, keepdim=True)


def encode_srgb(linear: torch.Tensor) -> torch.Tensor:
    """Linear [0, 1] to sRGB [0, 1] (IEC 61966-2-1), as `pipeline.tonemap` does."""
    high = 1.055 * linear.clamp(min=0.0031308) ** (1 / 2.4) - 0.055
    return torch.where(linear <= 0.0031308, 12.92 * linear, high)


def export_onnx(networks: Networks, path: Path) -> None:
    """Write the first method's networks as one ONNX file, any image and panorama size, by rename.

    The methods are `pbrnet` and `plus`. Metadata holds the cards as JSON, under the networks'
    names. Raises `MachineError` without the packages of the extra `onnx`.
    """
    missing = [name for name in ("onnx", "onnxscript") if importlib.util.find_spec(name) is None]
    if missing:
        raise MachineError(
            f"the Python package {missing[0]} is missing; install with: pip install 'pbrnet[onnx]'"
        )
    plus = networks.methods[0] == "plus"
    image: dict[int, Any] = {0: torch.export.Dim.DYNAMIC, 1: torch.export.Dim.DYNAMIC}
    shapes = [image] * len(INPUTS)
    sizes = [(45, 61), (45, 61), (45, 61, 3), (45, 61, 3), (40, 80), (40, 80)]
    names = list(INPUTS)
    if plus:
        names += ["tint", "K"]
        sizes, shapes = [*sizes, (40, 80, 3), (3, 3)], [*shapes, image, {}]
        if networks.card.training.get("shadows"):
            names, sizes, shapes = [*names, "visibility"], [*sizes, (45, 61)], [*shapes, image]
    chain = PlusChain(networks) if plus else Chain(networks)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        logging.getLogger("torch.onnx").setLevel(logging.ERROR)
        program: Any = torch.onnx.export(
            chain.eval(),
            tuple(torch.rand(*size) for size in sizes),
            input_names=names,
            output_names=list(OUTPUTS),
            dynamic_shapes=shapes,
            opset_version=OPSET,
            dynamo=True,
            verbose=False,
        )
    for name in needed(networks.methods[0]):
        program.model.metadata_props[name] = json.dumps(plain(networks.cards[name]))
    with atomic_file(path) as partial:
        program.save(str(partial))
