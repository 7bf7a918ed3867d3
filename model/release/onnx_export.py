"""ONNX export of trained networks: one model from the images of a view to shading and colour.

Programs that run the model need neither torch nor this package. The graph includes the encoding of
the inputs, traced from `model.data.encoding`, so its inputs are columns of the dataset.
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

from model.data.encoding import Tensors, encode_inputs
from model.data.reader import ViewInputs
from model.evaluation.inference import Networks, needed
from model.networks.pbrnet import GRID
from model.networks.plus import PlusNet
from scenes.checked import plain
from scenes.errors import MachineError
from scenes.files import atomic_file

OPSET = 20
EXPORTABLE = ("pbrnet", "plus")
INPUTS = ("depth", "valid", "normal", "reflectance", "intensity", "distance")
PLUS_INPUTS = (*INPUTS, "tint", "K")
OUTPUTS = ("shading", "color")
# Input sizes for the exporter's trace; the graph does not depend on them.
_TRACED_SIZES = {
    "depth": (45, 61),
    "valid": (45, 61),
    "normal": (45, 61, 3),
    "reflectance": (45, 61, 3),
    "intensity": (40, 80),
    "distance": (40, 80),
    "tint": (40, 80, 3),
    "K": (3, 3),
    "visibility": (45, 61),
}


class ExportedMethod(nn.Module):
    """A method and the encoding of its inputs, from columns of the dataset to display values.

    `pbrnet` takes `INPUTS`. `plus` takes `PLUS_INPUTS`, and `visibility` if it was trained with it.
    If the colours of the lights are unknown, pass a `tint` of ones for white light.
    """

    def __init__(self, networks: Networks) -> None:
        super().__init__()
        self.method = networks.methods[0]
        self.networks = nn.ModuleDict(
            {name: networks.modules[name] for name in needed(self.method)}
        )
        first = networks.cards[needed(self.method)[0]]
        self.averages_panorama = first.architecture.panorama == "normal"

    def forward(
        self,
        depth: torch.Tensor,
        valid: torch.Tensor,
        normal: torch.Tensor,
        reflectance: torch.Tensor,
        intensity: torch.Tensor,
        distance: torch.Tensor,
        tint: torch.Tensor | None = None,
        K: torch.Tensor | None = None,
        visibility: torch.Tensor | None = None,
    ) -> tuple[torch.Tensor, torch.Tensor]:
        """Shading and colour, display values (H, W, 3) in [0, 1].

        The inputs are the fields of `ViewInputs`, all as float32: images (H, W) or (H, W, 3),
        panoramas (h, w) or (h, w, 3), and `K`, the intrinsics (3, 3).
        """
        view = ViewInputs(
            depth=depth,
            valid=valid > 0,
            normal=normal,
            reflectance=reflectance,
            intensity=intensity,
            distance=distance,
            intrinsics=K,
            tint=tint,
            visibility=visibility,
        )
        inputs = encode_inputs([view], direct_light=self.method == "plus")
        if self.averages_panorama:
            inputs = averaged_panorama(inputs)
        shading, color = self._predict(inputs)
        return tuple(image[0].clamp(0, 1).permute(1, 2, 0) for image in (shading, color))  # type: ignore[return-value]

    def _predict(self, inputs: Tensors) -> tuple[torch.Tensor, torch.Tensor]:
        if self.method == "plus":
            plus = self.networks["plus"]
            assert isinstance(plus, PlusNet)
            return plus.parts(inputs)
        shading = self.networks["shading"](inputs).clamp(0, 1)
        return shading, self.networks["composition"](shading, inputs["reflectance"])


def averaged_panorama(inputs: Tensors) -> Tensors:
    """The inputs with the panorama averaged to `GRID`, as in `model.networks.pbrnet.averaged`.

    That function uses adaptive pooling of any size, which ONNX lacks. For a panorama of the size
    `GRID` it is the identity.
    """
    intensity, distance = inputs["intensity"][0, 0], inputs["distance"][0, 0]
    mean = on_grid(intensity)
    weighted = on_grid(intensity * distance) / mean.clamp(min=1e-12)
    return {**inputs, "intensity": mean[None, None], "distance": weighted[None, None]}


def on_grid(panorama: torch.Tensor) -> torch.Tensor:
    """Adaptive average pooling of a panorama (h, w) to `GRID`, as matrix products."""
    rows, columns = (
        _pooling_weights(size, cells) for size, cells in zip(panorama.shape, GRID, strict=True)
    )
    return rows @ panorama @ columns.T


def _pooling_weights(size: int, cells: int) -> torch.Tensor:
    """Pooling weights (cells, size): cell i is the mean of the pixels that it overlaps."""
    start, cell = torch.arange(size), torch.arange(cells)[:, None]
    inside = ((start + 1) * cells > cell * size) & (start * cells < (cell + 1) * size)
    return inside.float() / inside.sum(dim=1, keepdim=True)


def export_onnx(networks: Networks, path: Path) -> None:
    """Write the networks of the first method as one ONNX model, by rename.

    The method must be in `EXPORTABLE`. The model takes images and panoramas of any size. Its
    metadata contain the card of each network as JSON under the network's name. Raises
    `MachineError` without the packages of the extra `onnx`.
    """
    missing = [name for name in ("onnx", "onnxscript") if importlib.util.find_spec(name) is None]
    if missing:
        raise MachineError(
            f"the Python package {missing[0]} is missing; install with: pip install 'pbrnet[onnx]'"
        )
    names = exported_inputs(networks)
    sizes = [_TRACED_SIZES[name] for name in names]
    dynamic = dict.fromkeys((0, 1), torch.export.Dim.DYNAMIC)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        logging.getLogger("torch.onnx").setLevel(logging.ERROR)
        program: Any = torch.onnx.export(
            ExportedMethod(networks).eval(),
            tuple(torch.rand(*size) for size in sizes),
            input_names=names,
            output_names=list(OUTPUTS),
            dynamic_shapes=[{} if name == "K" else dynamic for name in names],
            opset_version=OPSET,
            dynamo=True,
            verbose=False,
        )
    for node in program.model.graph.all_nodes():
        node.metadata_props.clear()  # stack traces with paths of this machine
    for name in needed(networks.methods[0]):
        program.model.metadata_props[name] = json.dumps(plain(networks.cards[name]))
    with atomic_file(path) as partial:
        program.save(str(partial))


def exported_inputs(networks: Networks) -> list[str]:
    """Names of the inputs of the exported model, in order."""
    if networks.methods[0] != "plus":
        return list(INPUTS)
    shadows = bool(networks.card.training.get("shadows"))
    return [*PLUS_INPUTS, *(["visibility"] if shadows else [])]
