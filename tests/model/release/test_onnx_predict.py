"""What leaves this package as ONNX draws what the package draws: both methods, any size, sky."""

from __future__ import annotations

import json
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from PIL import Image

from model.data.direct_light import direct_shading, panorama_radiance
from model.data.display import log_average, luminance
from model.data.encoding import GREY, Policy, encode
from model.data.reader import Dataset, Example
from model.evaluation.inference import Networks, load_networks
from model.evaluation.predict import from_frames
from model.release.onnx_export import INPUTS, Chain, PlusChain, export_onnx
from model.release.onnx_light import direct_light, encoded_light, light_color
from pipeline.images import read_picture
from pipeline.params import ToneParams
from pipeline.tonemap import exposure_of
from tests.fixtures.model import box_dataset
from tests.fixtures.paths import ROOT
from tests.fixtures.predict import box_frames
from tests.fixtures.predictor import untrained_models

EXAMPLE = ROOT / "examples" / "onnx_predict.py"
SIZES = ((37, 23, 40), (64, 48, 64), (9, 7, 128))  # width, height, panorama


def views(folder: Path) -> list[Example]:
    """Views of several sizes, each with a piece of sky and, in a corner, a lamp seen directly.

    Their lamps have many colours.
    """
    found = []
    for width, height, panorama in SIZES:
        data = box_dataset(folder / str(width), 0, 0, 2, width=width, height=height,
                           panorama=panorama)  # fmt: skip
        example = next(Dataset(data / "dataset", "test").ordered())
        sky = np.zeros_like(example.valid)
        sky[:3, : width // 2] = True
        random = np.random.default_rng(width)
        colors = random.uniform(0.3, 2, (panorama // 2, panorama, 3))
        found.append(
            replace(
                example,
                valid=~sky,
                depth=np.where(sky, 0, example.depth).astype(np.float32),
                normal=np.where(sky[..., None], 0, example.normal).astype(np.float32),
                reflectance=np.where(sky[..., None], 0, example.reflectance).astype(np.float32),
                tint=colors.astype(np.float32),
                visibility=random.integers(0, 9, sky.shape).astype(np.float32) / 8,
            )
        )
    return found


def tensors(example: Example) -> dict[str, torch.Tensor]:
    given = {name: getattr(example, name) for name in (*INPUTS, "tint", "visibility")}
    given |= {"K": example.intrinsics}
    return {
        name: torch.from_numpy(value.astype(np.float32))
        for name, value in given.items()
        if value is not None
    }


def lights(example: Example) -> tuple[torch.Tensor, torch.Tensor]:
    """What surfaces return of the panorama's light, and what is seen of it, by the graph."""
    given = tensors(example)
    radiance = torch.from_numpy(panorama_radiance(example))
    rest = given["distance"], given["K"]
    return direct_light(given["depth"], given["valid"], given["normal"], radiance, *rest)


def test_the_direct_light_of_the_graph_is_the_direct_light(tmp_path: Path) -> None:
    for example in views(tmp_path):
        example = replace(example, visibility=None)
        lit, seen = lights(example)
        light, color = lit + seen, light_color(lit)
        expected = direct_shading(example, GREY)
        assert light.numpy() == pytest.approx(expected, rel=1e-3, abs=1e-4 * float(expected.max()))
        encoded = encode([example], direct=True)
        assert torch.allclose(color, encoded["tint"], rtol=1e-4)
        assert torch.allclose(
            encoded_light(light, color, torch.ones(light.shape[:2])), encoded["direct"], atol=2e-3
        )
        scale = exposure_of(expected, ToneParams()).scale
        average = log_average(luminance(light.permute(2, 0, 1)[None]))
        assert float(average) * scale == pytest.approx(ToneParams().key, rel=1e-3)


@pytest.mark.parametrize(
    ("method", "exposure", "shadows"),
    [
        ("pbrnet", "shared", False),
        ("plus", "shared", False),
        ("plus", "own", False),
        ("plus", "own", True),
    ],
)
def test_the_chain_draws_what_the_method_draws(
    method: str, exposure: Policy, shadows: bool, tmp_path: Path
) -> None:
    """Sky included: there the networks are shown a grey, not the dataset's black."""
    networks = loaded(tmp_path / "models", method, exposure, shadows)
    chain = (PlusChain if method == "plus" else Chain)(networks).eval()
    for example in views(tmp_path):
        given = tensors(example)
        if method == "pbrnet":
            del given["K"], given["tint"]
        if not shadows:
            del given["visibility"]
        made = networks.predict(method, example)
        with torch.no_grad():
            shading, color = chain(**given)
        assert made.shading is not None and made.color.std() > 0.02
        assert np.abs(shading.numpy() - made.shading).max() < 1e-3
        assert np.abs(color.numpy() - made.color).max() < 1e-3


def test_darkness_stays_dark(tmp_path: Path) -> None:
    example = replace(views(tmp_path)[0], visibility=None)
    dark = replace(example, intensity=0 * example.intensity, distance=0 * example.distance)
    lit, seen = lights(dark)
    assert not lit.any() and not seen.any()
    direct = encode([dark], direct=True)["direct"]
    assert torch.allclose(
        encoded_light(lit, light_color(lit), torch.ones(lit.shape[:2])), direct, atol=1e-5
    )


@pytest.mark.slow
@pytest.mark.parametrize(
    ("method", "shadows"), [("pbrnet", False), ("plus", False), ("plus", True)]
)
def test_the_file_and_the_example_draw_the_same_picture(
    method: str, shadows: bool, tmp_path: Path
) -> None:
    runtime = pytest.importorskip("onnxruntime", reason="the extra pbrnet[onnx] is not installed")
    pytest.importorskip("onnxscript", reason="the extra pbrnet[onnx] is not installed")
    networks = loaded(tmp_path / "models", method, shadows=shadows)
    path = tmp_path / "model.onnx"
    export_onnx(networks, path)
    session = runtime.InferenceSession(str(path), providers=["CPUExecutionProvider"])
    facts = session.get_modelmeta().custom_metadata_map
    for name, card in networks.cards.items():
        assert json.loads(facts[name])["sha256"] == card.sha256
    names = [given.name for given in session.get_inputs()]
    for example in views(tmp_path):
        given = {name: value.numpy() for name, value in tensors(example).items() if name in names}
        made = networks.predict(method, example)
        shading, color = session.run(None, given)
        assert color.shape == example.color.shape
        assert np.abs(color - made.color).max() < 1e-3
        assert np.abs(shading - made.shading).max() < 1e-3

    box_frames(tmp_path / "data", width=37, height=23, panorama=20)
    kinds = ("inputs", "illumination", "visibility")
    frames = [tmp_path / "data" / kind / "box" / "v0.exr" for kind in kinds]
    guard = "import sys; sys.modules.update(dict.fromkeys(('torch', 'model', 'pipeline'))); "
    guard += "sys.argv = sys.argv[1:]; import runpy; runpy.run_path(sys.argv[0])"
    done = subprocess.run(
        [sys.executable, "-c", guard, *map(str, (EXAMPLE, path, "p.png", *frames))],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        timeout=120,
    )
    assert done.returncode == 0, done.stderr
    wanted = from_frames(frames[0], frames[1], visibility=frames[2])
    ours = networks.predict(method, wanted.make(networks.card)).color
    drawn = read_picture((tmp_path / "p.png").read_bytes()) / 255
    assert np.abs(drawn - ours).max() < 1 / 255 + 1e-3
    with Image.open(tmp_path / "p.png") as image:
        assert image.size == (37, 23)


def loaded(
    models: Path, method: str, exposure: Policy = "shared", shadows: bool = False
) -> Networks:
    """The method's networks, untrained."""
    names = ("plus",) if method == "plus" else ("shading", "composition")
    made = untrained_models(models, names, levels=3, exposure=exposure, shadows=shadows)
    return load_networks(made, [method])
