"""The pretrained network for depth, normals and classes of photographs: packing and loading.

It is a training of `pbrnet study photographs`, packed in half precision beside a card.
"""

from __future__ import annotations

import json
import logging
import warnings
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import torch
from safetensors.torch import load_file
from torch import nn

from pbrnet.model.release.pretrained import DEPTH, DEPTH_FILES
from pbrnet.model.studies.photographs.network import PhotographNetwork, new_network
from pbrnet.model.studies.photographs.results import FILE, HEADINGS, PhotographsResult
from pbrnet.model.studies.photographs.rows import row_folder
from pbrnet.model.studies.photographs.samples import FOCAL
from pbrnet.model.training.weights import write_weights
from pbrnet.pipeline.farm.versions import PACKED
from pbrnet.scenes.checked import build, plain
from pbrnet.scenes.errors import InputError
from pbrnet.scenes.files import atomic_file, digest_file, read_json, write_json

OUTPUTS = (DEPTH, "normal", "classes")
_UNUSED = ("encoder._conv_head", "encoder._bn1", "encoder._fc")  # layers behind the last feature
SIDES = (160, 192)  # height and width of the exported model's pictures


@dataclass(frozen=True)
class DepthCard:
    """Contract of `depth.json`: what the network was trained on, and its test on photographs.

    `results`: mean of each measure of `docs/photographs.md` on the test set.
    """

    sha256: str  # of the weights
    row: str  # of the study
    sets: tuple[tuple[str, ...], ...]  # names, by stage
    pictures: int  # trained on
    steps: int
    test: str  # name of the test set
    test_pictures: int
    results: dict[str, float]
    focal: float = FOCAL  # pixels, that pictures are resampled to
    licence: str = "MIT; the encoder started from ImageNet's EfficientNet-Lite0 (Apache-2.0)"


def pack_depth(training: Path, metrics: Path, out: Path) -> DepthCard:
    """Write the network of a training of the study to `out`, in half precision, with its card.

    `training` is a folder ROW/SEED of the study's working folder, `metrics` the folder of its
    results. Raises `InputError` if either lacks the training.
    """
    path = metrics / FILE
    result = build(PhotographsResult, read_json(path), str(path), InputError)
    folder = training.resolve().parent.name
    row = next((name for name in result.order if row_folder(name) == folder), None)
    if row is None:
        raise InputError(f"{training}: not a training of a row of {path}, such as ROW/0")
    network = _loaded(training / "weights.safetensors")
    state = {
        name: (value.half() if value.is_floating_point() else value).contiguous()
        for name, value in network.state_dict().items()
        if not name.startswith(_UNUSED)
    }
    weights, card_file = (out / name for name in DEPTH_FILES)
    write_weights(weights, state)
    found = result.rows[row]
    figures = {name: getattr(found, name) for name in HEADINGS}
    card = DepthCard(
        sha256=digest_file(weights),
        row=row,
        sets=found.stages,
        pictures=found.views,
        steps=result.steps,
        test=result.test,
        test_pictures=result.pictures,
        results={name: round(each.mean, 4) for name, each in figures.items() if each is not None},
    )
    write_json(card_file, plain(card))
    return card


def load_depth(weights: Path | None) -> PhotographNetwork:
    """Return the network in a file, by default the pretrained one.

    Raises `InputError` if the file is missing, damaged or of another network.
    """
    return _loaded(weights or PACKED / DEPTH_FILES[0])


def _loaded(path: Path) -> PhotographNetwork:
    if not path.is_file():
        raise InputError(f"{path}: no such file; train it with: pbrnet study photographs")
    network = new_network(0)
    try:
        found = network.load_state_dict(
            {name: value.float() for name, value in load_file(path).items()}, strict=False
        )
    except Exception as error:  # safetensors and torch raise various types
        raise InputError(f"{path}: not weights of this network ({error})") from None
    missing = [name for name in found.missing_keys if not name.startswith(_UNUSED)]
    if missing or found.unexpected_keys:
        raise InputError(f"{path}: not weights of this network; see pbrnet study photographs")
    if not all(bool(torch.isfinite(value).all()) for value in network.state_dict().values()):
        raise InputError(f"{path}: weights that are not finite")
    return network.eval()


class _Exported(nn.Module):
    """The network with outputs (H, W) and (H, W, 3) at half the size of the picture."""

    def __init__(self, network: PhotographNetwork) -> None:
        super().__init__()
        self.network = network

    def forward(self, image: torch.Tensor, rays: torch.Tensor) -> tuple[torch.Tensor, ...]:
        output = self.network(image, rays)
        return output.log_depth[0].exp(), output.normal[0].permute(1, 2, 0), output.classes[0]


def export_depth(network: PhotographNetwork, path: Path) -> None:
    """Write the network as ONNX, by rename.

    Inputs: `image` (1, 3, H, W), sRGB in [0, 1], and `rays` (1, 2, H, W), x and y of the rays with
    z = 1, at a focal length of `FOCAL` pixels. H and W are `SIDES`, since graphs of any size take
    minutes to export. Outputs at half the size: `depth` (h, w) in metres, `normal` (h, w, 3),
    `classes` (40, h, w), logarithms of probabilities.
    """
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        logging.getLogger("torch.onnx").setLevel(logging.ERROR)
        program: Any = torch.onnx.export(
            _Exported(network).eval(),
            (torch.rand(1, 3, *SIDES), torch.rand(1, 2, *SIDES)),
            input_names=["image", "rays"],
            output_names=list(OUTPUTS),
            dynamo=True,
            verbose=False,
        )
    program.model.metadata_props[DEPTH] = json.dumps({"focal": FOCAL})
    with atomic_file(path) as partial:
        program.save(str(partial))
