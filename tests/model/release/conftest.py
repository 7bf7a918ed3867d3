"""Views and exported files that the tests of ONNX export share."""

import subprocess
import sys
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pbrnet.model.data.encoding import Policy
from pbrnet.model.data.reader import Dataset, Example
from pbrnet.model.evaluation.inference import Networks, load_networks
from pbrnet.model.methods import METHODS, Panorama
from pbrnet.model.release.onnx_export import export_onnx
from tests.fixtures.model import box_dataset
from tests.fixtures.paths import ROOT
from tests.fixtures.predictor import untrained_models

SIZES = ((37, 23, 40), (64, 48, 64), (9, 7, 128))  # width, height, panorama width


@dataclass(frozen=True)
class ExportedFile:
    """Networks and the ONNX file made of them."""

    networks: Networks
    path: Path
    session: Any  # onnxruntime's


def run_example(script: str, folder: Path, *words: Path | str) -> None:
    """Run a program of `examples/` in this folder; torch and our packages cannot be imported."""
    guard = "import sys; sys.modules.update(dict.fromkeys(('torch', 'pbrnet'))); "
    guard += "sys.argv = sys.argv[1:]; import runpy; runpy.run_path(sys.argv[0])"
    command = [sys.executable, "-c", guard, str(ROOT / "examples" / script), *map(str, words)]
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, done.stderr


def untrained(
    models: Path,
    method: str,
    panorama: Panorama = "normal",
    exposure: Policy = "shared",
    materials: bool = False,
) -> Networks:
    """The method's networks with random weights, saved in `models`."""
    names = ("shading", "composition") if method == "pbrnet" else (method,)
    settings = {"panorama": panorama, "exposure": exposure, "materials": materials}
    untrained_models(models, names, levels=2, **settings)  # type: ignore[arg-type]
    return load_networks(models, [method])


@pytest.fixture(scope="session")
def views(tmp_path_factory: pytest.TempPathFactory) -> list[Example]:
    """Views of `SIZES`: each with sky, a lamp in view, materials, and three samples a pixel."""
    folder = tmp_path_factory.mktemp("views")
    found = []
    for width, height, panorama in SIZES:
        size = {"width": width, "height": height, "panorama": panorama}
        data = box_dataset(folder / str(width), 0, 0, 2, noisy=True, **size)
        example = next(Dataset(data / "dataset", "test", METHODS["hybrid"].columns).ordered())
        sky = np.zeros_like(example["valid"])
        sky[:3, : width // 2] = True
        random = np.random.default_rng(width)
        rough, metal = random.random((2, *sky.shape), dtype=np.float32)
        found.append(
            example.having(
                valid=~sky,
                depth=np.where(sky, 0, example["depth"]).astype(np.float32),
                normal=np.where(sky[..., None], 0, example["normal"]).astype(np.float32),
                reflectance=np.where(sky[..., None], 0, example["reflectance"]).astype(np.float32),
                roughness=rough,
                metalness=metal,
                material_known=np.ones_like(rough),
                visibility=rough,
                noisy_spp=np.array(3),
            )
        )
    return found


@pytest.fixture(scope="session")
def exported(tmp_path_factory: pytest.TempPathFactory) -> Callable[..., ExportedFile]:
    """Export a method's networks, each once a session.

    `plus` is given materials; the two networks with shadows have colour in its own exposure.
    """
    runtime = pytest.importorskip("onnxruntime", reason="the extra pbrnet[onnx] is not installed")
    pytest.importorskip("onnxscript", reason="the extra pbrnet[onnx] is not installed")

    @cache
    def make(method: str, panorama: Panorama) -> ExportedFile:
        folder = tmp_path_factory.mktemp("exported")
        exposure: Policy = "own" if panorama == "shadows" else "shared"
        networks = untrained(folder / "models", method, panorama, exposure, method == "plus")
        path = folder / "file" / "model.onnx"
        path.parent.mkdir()
        export_onnx(networks, path)
        session = runtime.InferenceSession(str(path), providers=["CPUExecutionProvider"])
        return ExportedFile(networks, path, session)

    return lambda method, panorama="normal": make(method, panorama)
