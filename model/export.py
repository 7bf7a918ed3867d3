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

from model.encoding import FAR, MIDDLE, NEAR, centred
from model.inference import Networks
from model.networks import GRID
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
        self.shading, self.composition = networks.shading, networks.composition
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
        """Float32 (H, W) or (H, W, 3), panorama (h, w), as `model.data.Example` has them.

        Returns shading and colour, display values (H, W, 3) in [0, 1].
        """
        log = torch.log(depth.clamp(NEAR, FAR) / MIDDLE)
        relative, metres = relative_intensity(intensity), distance.clamp(max=FAR)
        if self.averaged:
            mean = on_grid(relative)
            relative, metres = mean, on_grid(relative * metres) / mean.clamp(min=1e-12)
        inputs = {
            "depth": torch.stack([log * valid, valid])[None],
            "normal": normal.permute(2, 0, 1)[None],
            "reflectance": centred(encode_srgb(reflectance)).permute(2, 0, 1)[None],
            "intensity": relative[None, None],
            "distance": metres[None, None],
        }
        shading = self.shading(inputs).clamp(0, 1)
        color = self.composition(shading, inputs["reflectance"]).clamp(0, 1)
        return shading[0].permute(1, 2, 0), color[0].permute(1, 2, 0)


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
    """Write both networks as one ONNX file, any image and panorama size, by rename.

    Its metadata holds the cards, as JSON under `shading` and `composition`. Raises
    `MachineError` without the packages of the extra `onnx`.
    """
    missing = [name for name in ("onnx", "onnxscript") if importlib.util.find_spec(name) is None]
    if missing:
        raise MachineError(
            f"the Python package {missing[0]} is missing; install with: pip install 'pbrnet[onnx]'"
        )
    image = {0: torch.export.Dim.DYNAMIC, 1: torch.export.Dim.DYNAMIC}
    example = tuple(
        torch.rand(*size)
        for size in ((45, 61), (45, 61), (45, 61, 3), (45, 61, 3), (40, 80), (40, 80))
    )
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        logging.getLogger("torch.onnx").setLevel(logging.ERROR)
        program: Any = torch.onnx.export(
            Chain(networks).eval(),
            example,
            input_names=list(INPUTS),
            output_names=list(OUTPUTS),
            dynamic_shapes=[image] * len(INPUTS),
            opset_version=OPSET,
            dynamo=True,
            verbose=False,
        )
    for name in ("shading", "composition"):
        program.model.metadata_props[name] = json.dumps(plain(networks.cards[name]))
    with atomic_file(path) as partial:
        program.save(str(partial))
