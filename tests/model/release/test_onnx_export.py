"""The exported networks and their encoding give what the package gives, at any size."""

import json
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import pytest
import torch

from pbrnet.model.data.display import DEFAULT_WHITE
from pbrnet.model.data.encoding import Policy
from pbrnet.model.data.reader import Example
from pbrnet.model.evaluation.inference import Prediction
from pbrnet.model.methods import JOINS, Panorama
from pbrnet.model.release.onnx_export import (
    GRID,
    ExportedMethod,
    export_onnx,
    exported_inputs,
    on_grid,
)
from pbrnet.pipeline.tonemap import Exposure, ToneParams, exposure_of, tonemap
from pbrnet.scenes.arrays import AnyArray
from pbrnet.scenes.errors import MachineError
from tests.fixtures.paths import ROOT
from tests.model.release.conftest import ExportedFile, untrained


def columns(example: Example, names: Sequence[str]) -> list[torch.Tensor]:
    """The inputs of an exported file, float32."""
    given = {name: np.atleast_1d(example[name]) for name in names}
    return [torch.from_numpy(given[name].astype(np.float32)) for name in names]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("method", "panorama", "exposure", "materials"),
    [
        *(("pbrnet", panorama, "shared", False) for panorama in JOINS),
        ("pbrnet", "normal", "own", False),
        ("plus", "normal", "shared", False),
        ("plus", "normal", "shared", True),
        ("hybrid", "normal", "shared", True),
    ],
)
def test_the_exported_module_draws_what_the_method_draws(
    method: str,
    panorama: Panorama,
    exposure: Policy,
    materials: bool,
    views: list[Example],
    tmp_path: Path,
) -> None:
    """Sky included: there the networks are shown a grey, not the dataset's black."""
    networks = untrained(tmp_path, method, panorama, exposure, materials)
    names = exported_inputs(networks)
    assert ("intensity" in names, "roughness" in names) == (method == "pbrnet", materials)
    assert ("noisy_spp" in names) == (method == "hybrid")
    chain = ExportedMethod(networks).eval()
    dark = views[0].having(intensity=0 * views[0]["intensity"], distance=0 * views[0]["distance"])
    for example in (*views, dark):
        made = networks.predict(method, example)
        with torch.no_grad():
            found = chain(*columns(example, names))
        assert made.color.std() > 0.02
        check_pictures(method, example, made, *(image.numpy() for image in found))


def check_pictures(
    method: str, example: Example, made: Prediction, first: AnyArray, color: AnyArray
) -> None:
    """Compare the images of an exported file with a prediction of the package."""
    if method == "pbrnet":
        assert np.abs(first - made.shading).max() < 1e-3
        assert np.abs(color - made.color).max() < 1e-3
        return
    assert made.linear is not None
    np.testing.assert_allclose(first, made.linear, rtol=2e-3, atol=1e-4)
    exposure = Exposure(exposure_of(made.linear, ToneParams()).scale, DEFAULT_WHITE)
    assert np.abs(color - tonemap(made.linear, exposure)).max() < 2e-3


@pytest.mark.parametrize("size", [(16, 32), (32, 64), (33, 66), (80, 160), (100, 200)])
def test_averaging_on_the_grid_is_adaptive_pooling(size: tuple[int, int]) -> None:
    panorama = torch.rand(*size, generator=torch.Generator().manual_seed(0))
    pooled = torch.nn.functional.adaptive_avg_pool2d(panorama[None], GRID)[0]
    assert torch.allclose(on_grid(panorama), pooled, atol=1e-5)


def test_without_the_packages_it_says_how_to_get_them(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    networks = untrained(tmp_path / "models", "pbrnet")
    monkeypatch.setattr(
        "pbrnet.model.release.onnx_export.importlib.util.find_spec", lambda _name: None
    )
    (tmp_path / "out").mkdir()
    with pytest.raises(MachineError, match=r"pip install 'pbrnet\[onnx\]'"):
        export_onnx(networks, tmp_path / "out" / "model.onnx")
    assert list((tmp_path / "out").iterdir()) == []


@pytest.mark.slow
@pytest.mark.parametrize(
    ("method", "panorama"),
    [
        *(pytest.param("pbrnet", panorama, marks=pytest.mark.check) for panorama in JOINS),
        ("plus", "normal"),
        pytest.param("hybrid", "normal", marks=pytest.mark.check),
    ],
)
def test_the_file_draws_the_same_pictures_of_any_size(
    method: str, panorama: Panorama, views: list[Example], exported: Callable[..., ExportedFile]
) -> None:
    made = exported(method, panorama)
    assert [file.name for file in made.path.parent.iterdir()] == ["model.onnx"]  # weights inside
    weights = sum(4 * card.parameters for card in made.networks.cards.values())
    graph = 350_000 if JOINS[panorama].inputs else 250_000
    assert made.path.stat().st_size < weights + graph
    assert str(ROOT).encode() not in made.path.read_bytes()
    facts = made.session.get_modelmeta().custom_metadata_map
    for name, card in made.networks.cards.items():
        assert json.loads(facts[name])["sha256"] == card.sha256
    names = [given.name for given in made.session.get_inputs()]
    assert names == exported_inputs(made.networks)
    for example in views:
        given = [value.numpy() for value in columns(example, names)]
        found = made.session.run(None, dict(zip(names, given, strict=True)))
        assert found[1].shape == example["color"].shape
        check_pictures(method, example, made.networks.predict(method, example), *found)
