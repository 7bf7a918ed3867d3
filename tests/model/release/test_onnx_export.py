"""The exported networks say the same as the networks, to whoever opens the file."""

from __future__ import annotations

import json
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from PIL import Image

from model.data.encoding import encode
from model.data.reader import Dataset, Example
from model.evaluation.inference import Networks, load_networks
from model.release.onnx_export import GRID, INPUTS, Chain, export_onnx, on_grid
from model.training import train as training
from model.training.backbone import make_backbone
from model.training.train import Folders, train_network
from pipeline.params import BackboneParams, Params, StageTrainParams, TrainParams
from scenes.errors import MachineError
from tests.fixtures.model import box_dataset
from tests.fixtures.paths import ROOT

SMALL = StageTrainParams(epochs=1, width=4, levels=3)


@pytest.fixture(scope="module", params=["normal", "resize"])
def trained(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Folders:
    """Both networks, barely trained, beside their dataset."""
    root = tmp_path_factory.mktemp("export")
    folders = Folders(*(root / part for part in ("data", "models", "metrics", "plots", "models")))
    box_dataset(folders.data, 4, 0, 2, width=37, height=23, panorama=40)
    make_backbone(BackboneParams(network="efficientnet_lite0"), folders.models)
    train = TrainParams(panorama=request.param, shading=SMALL, composition=SMALL)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(training.os, "sched_getaffinity", lambda _process: {0})
        for name in ("shading", "composition"):
            train_network(name, Params(train=train), folders)
    return folders


def columns(example: Example) -> dict[str, Any]:
    return {name: getattr(example, name).astype(np.float32) for name in INPUTS}


def predicted(networks: Networks, example: Example) -> tuple[Any, Any]:
    made = networks.predict("pbrnet", example)
    return made.shading, made.color


def test_the_chain_is_the_two_networks_with_their_encoding(trained: Folders) -> None:
    networks = load_networks(trained.models)
    for example in Dataset(trained.data / "dataset", "test").ordered():
        given = {name: torch.from_numpy(value) for name, value in columns(example).items()}
        with torch.no_grad():
            made = Chain(networks)(**given)
        for ours, theirs in zip(made, predicted(networks, example), strict=True):
            assert np.abs(ours.numpy() - theirs).max() < 1e-4


@pytest.mark.parametrize("size", [(16, 32), (32, 64), (33, 66), (80, 160), (100, 200)])
def test_averaging_on_the_grid_is_adaptive_pooling(size: tuple[int, int]) -> None:
    panorama = torch.rand(*size, generator=torch.Generator().manual_seed(0))
    pooled = torch.nn.functional.adaptive_avg_pool2d(panorama[None], GRID)[0]
    assert torch.allclose(on_grid(panorama), pooled, atol=1e-5)


def test_a_dark_panorama_stays_dark(trained: Folders) -> None:
    networks = load_networks(trained.models)
    example = next(Dataset(trained.data / "dataset", "test").ordered())
    dark = replace(example, intensity=example.intensity * 0, distance=example.distance * 0)
    assert float(encode([dark])["intensity"].abs().sum()) == 0
    given = {name: torch.from_numpy(value) for name, value in columns(dark).items()}
    with torch.no_grad():
        shading, _ = Chain(networks)(**given)
    assert np.abs(shading.numpy() - networks.shading(dark)).max() < 1e-4


def test_without_the_packages_it_says_how_to_get_them(
    trained: Folders, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("model.release.onnx_export.importlib.util.find_spec", lambda _name: None)
    with pytest.raises(MachineError, match=r"pip install 'pbrnet\[onnx\]'"):
        export_onnx(load_networks(trained.models), tmp_path / "model.onnx")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.slow
def test_the_file_draws_the_same_pictures_of_any_size(trained: Folders, tmp_path: Path) -> None:
    runtime = pytest.importorskip("onnxruntime", reason="the extra pbrnet[onnx] is not installed")
    pytest.importorskip("onnxscript", reason="the extra pbrnet[onnx] is not installed")
    networks = load_networks(trained.models)
    path = tmp_path / "model.onnx"
    export_onnx(networks, path)
    assert [file.name for file in tmp_path.iterdir()] == ["model.onnx"]  # weights inside
    session = runtime.InferenceSession(str(path), providers=["CPUExecutionProvider"])
    facts = session.get_modelmeta().custom_metadata_map
    assert json.loads(facts["shading"])["sha256"] == networks.cards["shading"].sha256
    for index, (width, height, panorama) in enumerate(((37, 23, 40), (64, 48, 64), (9, 7, 128))):
        box_dataset(tmp_path / str(index), 0, 0, 2, width=width, height=height, panorama=panorama)
        folder = tmp_path / str(index) / "dataset"
        example = next(Dataset(folder, "test").ordered())
        made = session.run(None, columns(example))
        for ours, theirs in zip(made, predicted(networks, example), strict=True):
            assert ours.shape == (height, width, 3)
            assert np.abs(ours - theirs).max() < 1e-3

    example_script = ROOT / "examples" / "consume" / "with_onnx.py"
    guard = "import sys; sys.modules['torch'] = None; sys.argv = sys.argv[1:]; import runpy; "
    guard += "runpy.run_path(sys.argv[0])"
    words = [str(example_script), str(path), str(tmp_path / "1" / "dataset")]
    done = subprocess.run(
        [sys.executable, "-c", guard, *words],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        timeout=120,
    )
    assert done.returncode == 0, done.stderr
    with Image.open(tmp_path / "picture.png") as image:
        assert image.size == (128, 48)
