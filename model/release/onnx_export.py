"""ONNX export of trained networks: one model from the images of a view to its picture.

Programs that run the model need neither torch nor this package. The graph includes the encoding of
the inputs, traced from `pbrnet.model.data.encoding`, so its inputs are columns of the dataset.
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

from pbrnet.model.data.display import DEFAULT_WHITE, log_average, luminance, tonemap_exposed
from pbrnet.model.data.encoding import Tensors, encode, input_named
from pbrnet.model.data.reader import NOISY_SPP
from pbrnet.model.evaluation.inference import Networks, needed
from pbrnet.model.methods import JOINS, METHODS
from pbrnet.model.networks.pbrnet import GRID, CompositionNet
from pbrnet.pipeline.channels import column_channel
from pbrnet.scenes.checked import plain
from pbrnet.scenes.errors import MachineError
from pbrnet.scenes.files import atomic_file

OPSET = 20
EXPORTABLE = ("pbrnet", "plus", "hybrid")
INPUTS = ("depth", "valid", "normal", "reflectance")
PANORAMA = ("intensity", "distance")
OUTPUTS = {"pbrnet": ("shading", "color"), "plus": ("radiance", "color")}
OUTPUTS["hybrid"] = OUTPUTS["plus"]
# Input sizes for the exporter's trace; the graph does not depend on them.
_IMAGE, _PANORAMA = (45, 61), (40, 80)
_FIXED = {NOISY_SPP: (1,), "K": (3, 3)}  # sizes of inputs that are no image


class ExportedMethod(nn.Module):
    """A method and the encoding of its inputs, from columns of the dataset to display values.

    The inputs are those that `exported_inputs` names, in its order.
    """

    def __init__(self, networks: Networks) -> None:
        super().__init__()
        self.method = networks.methods[0]
        self.names = exported_inputs(networks)
        self.networks = nn.ModuleDict(
            {name: networks.modules[name] for name in needed(self.method)}
        )
        first = networks.cards[needed(self.method)[0]]
        self.panorama = first.architecture.panorama
        self.key = float(networks.card.tone["key"])

    def forward(self, *images: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        """The images of `OUTPUTS`, (H, W, 3): display values in [0, 1], radiance linear.

        The inputs are columns of the dataset, all as float32: images (H, W) or (H, W, 3), panoramas
        (h, w), `K` (3, 3) and `noisy_spp` (1,). Radiance is in the unit of the inputs; its display
        values have their own exposure.
        """
        given = dict(zip(self.names, images, strict=True))
        view = {**given, "valid": given["valid"] > 0}
        if self.method == "pbrnet":
            names = METHODS["shading"].inputs_with(self.panorama)
            return _pictures(*self._two_stages(encode([view], names)))
        found = self.networks[self.method](encode([view], METHODS[self.method].inputs))
        scale = self.key / log_average(luminance(found))
        return found[0].permute(1, 2, 0), _picture(tonemap_exposed(scale * found, DEFAULT_WHITE))

    def _two_stages(self, inputs: Tensors) -> tuple[torch.Tensor, torch.Tensor]:
        if not JOINS[self.panorama].resized:
            inputs = averaged_panorama(inputs)
        shading = self.networks["shading"](inputs).clamp(0, 1)
        composition = self.networks["composition"]
        assert isinstance(composition, CompositionNet)
        return shading, composition(composition.images(shading, inputs["reflectance"]))


def _pictures(*images: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
    first, second = map(_picture, images)
    return first, second


def _picture(image: torch.Tensor) -> torch.Tensor:
    """The image of a batch (1, 3, H, W) as display values (H, W, 3)."""
    return image[0].clamp(0, 1).permute(1, 2, 0)


def averaged_panorama(inputs: Tensors) -> Tensors:
    """The inputs with the panorama averaged to `GRID`, as in
    `pbrnet.model.networks.pbrnet.averaged`.

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
    dynamic = dict.fromkeys((0, 1), torch.export.Dim.DYNAMIC)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        logging.getLogger("torch.onnx").setLevel(logging.ERROR)
        program: Any = torch.onnx.export(
            ExportedMethod(networks).eval(),
            tuple(torch.rand(*_traced_size(name)) for name in names),
            input_names=names,
            output_names=list(OUTPUTS[networks.methods[0]]),
            dynamic_shapes=[tuple({} if name in _FIXED else dynamic for name in names)],
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
    name = networks.methods[0]
    if name == "pbrnet":
        names = METHODS["shading"].inputs_with(networks.cards["shading"].architecture.panorama)
        further = [one for name in names for one in input_named(name).columns]
        return list(dict.fromkeys((*INPUTS, *PANORAMA, *further)))
    method = METHODS[name]
    known = (one for one in method.optional_inputs if networks.card.training.get(one))
    optional = [column for one in known for column in input_named(one).columns]
    return [*INPUTS, *optional, *method.columns]


def _traced_size(name: str) -> tuple[int, ...]:
    """Size of an input for the exporter's trace."""
    if name in _FIXED:
        return _FIXED[name]
    channel = column_channel(name)
    return (*(_PANORAMA if channel.is_panorama else _IMAGE), *channel.shape)
