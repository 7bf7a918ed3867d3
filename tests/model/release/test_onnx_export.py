"""The exported networks and their encoding give what the package gives, at any size."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from model.data.encoding import Policy, Tensors, encode, encode_inputs
from model.data.reader import Example, ViewInputs
from model.networks.pbrnet import Panorama
from model.release.onnx_export import (
    GRID,
    PLUS_INPUTS,
    ExportedMethod,
    export_onnx,
    exported_inputs,
    on_grid,
)
from scenes.errors import MachineError
from tests.fixtures.paths import ROOT
from tests.model.release.conftest import ExportedFile, untrained


def columns(example: Example) -> dict[str, torch.Tensor]:
    """All inputs that an exported file may take, float32."""
    given = {name: getattr(example, name) for name in PLUS_INPUTS if name != "K"}
    given |= {"K": example.intrinsics, "visibility": example.visibility}
    return {
        name: torch.from_numpy(value.astype(np.float32))
        for name, value in given.items()
        if value is not None
    }


def traced_encoding(example: Example) -> Tensors:
    """The encoder's inputs for `plus`, computed with tensors as in the exported graph."""
    given = columns(example)
    given["intrinsics"] = given.pop("K")
    view = ViewInputs(**{**given, "valid": given["valid"] > 0})
    return encode_inputs([view], direct_light=True)


@pytest.mark.slow
def test_the_encoder_gives_the_same_for_tensors_and_for_arrays(views: list[Example]) -> None:
    unlit = replace(views[0], intensity=0 * views[0].intensity, distance=0 * views[0].distance)
    sky = replace(views[0], valid=np.zeros_like(views[0].valid))
    for example in (*views, replace(views[0], visibility=None), unlit, sky):
        ours, theirs = traced_encoding(example), encode([example], direct_light=True)
        assert ours.keys() == theirs.keys()
        for name, value in theirs.items():
            assert ours[name].shape == value.shape and ours[name].dtype == torch.float32
            assert ours[name].numpy() == pytest.approx(value.numpy(), rel=1e-3, abs=2e-3), name


def test_without_light_all_inputs_stay_dark(views: list[Example]) -> None:
    dark = replace(views[0], intensity=0 * views[0].intensity, distance=0 * views[0].distance)
    for given in (traced_encoding(dark), encode([dark], direct_light=True)):
        assert not given["intensity"].any()
        assert (given["direct"][:, :3] == -1).all(), "black, centred"
        assert given["tint"].flatten().tolist() == [1, 1, 1]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("method", "panorama", "exposure", "shadows"),
    [
        ("pbrnet", "normal", "shared", False),
        ("pbrnet", "resize", "shared", False),
        ("plus", "normal", "shared", False),
        ("plus", "normal", "own", False),
        ("plus", "normal", "own", True),
    ],
)
def test_the_exported_module_draws_what_the_method_draws(
    method: str,
    panorama: Panorama,
    exposure: Policy,
    shadows: bool,
    views: list[Example],
    tmp_path: Path,
) -> None:
    """Sky included: there the networks are shown a grey, not the dataset's black."""
    networks = untrained(tmp_path, method, panorama, exposure, shadows)
    names = exported_inputs(networks)
    assert ("K" in names, "visibility" in names) == (method == "plus", shadows)
    chain = ExportedMethod(networks).eval()
    dark = replace(views[0], intensity=0 * views[0].intensity, distance=0 * views[0].distance)
    for example in (*views, dark):
        given = columns(example)
        made = networks.predict(method, example)
        with torch.no_grad():
            shading, color = chain(**{name: given[name] for name in names})
        assert made.shading is not None and made.color.std() > 0.02
        assert np.abs(shading.numpy() - made.shading).max() < 1e-3
        assert np.abs(color.numpy() - made.color).max() < 1e-3


@pytest.mark.parametrize("size", [(16, 32), (32, 64), (33, 66), (80, 160), (100, 200)])
def test_averaging_on_the_grid_is_adaptive_pooling(size: tuple[int, int]) -> None:
    panorama = torch.rand(*size, generator=torch.Generator().manual_seed(0))
    pooled = torch.nn.functional.adaptive_avg_pool2d(panorama[None], GRID)[0]
    assert torch.allclose(on_grid(panorama), pooled, atol=1e-5)


def test_without_the_packages_it_says_how_to_get_them(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    networks = untrained(tmp_path / "models", "pbrnet")
    monkeypatch.setattr("model.release.onnx_export.importlib.util.find_spec", lambda _name: None)
    (tmp_path / "out").mkdir()
    with pytest.raises(MachineError, match=r"pip install 'pbrnet\[onnx\]'"):
        export_onnx(networks, tmp_path / "out" / "model.onnx")
    assert list((tmp_path / "out").iterdir()) == []


@pytest.mark.slow
@pytest.mark.parametrize(
    ("method", "panorama"),
    [
        ("pbrnet", "normal"),
        ("pbrnet", "resize"),
        pytest.param("plus", "normal", marks=pytest.mark.check),
    ],
)
def test_the_file_draws_the_same_pictures_of_any_size(
    method: str, panorama: Panorama, views: list[Example], exported: Callable[..., ExportedFile]
) -> None:
    made = exported(method, panorama)
    assert [file.name for file in made.path.parent.iterdir()] == ["model.onnx"]  # weights inside
    weights = sum(4 * card.parameters for card in made.networks.cards.values())
    assert made.path.stat().st_size < weights + 250_000
    assert str(ROOT).encode() not in made.path.read_bytes()
    facts = made.session.get_modelmeta().custom_metadata_map
    for name, card in made.networks.cards.items():
        assert json.loads(facts[name])["sha256"] == card.sha256
    names = [given.name for given in made.session.get_inputs()]
    assert names == exported_inputs(made.networks)
    for example in views:
        given = columns(example)
        expected = made.networks.predict(method, example)
        shading, color = made.session.run(None, {name: given[name].numpy() for name in names})
        assert color.shape == example.color.shape
        assert np.abs(color - expected.color).max() < 1e-3
        assert np.abs(shading - expected.shading).max() < 1e-3
