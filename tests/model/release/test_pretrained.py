"""Networks to pass on: small, the same pictures, and a card that says what they are."""

import json
from pathlib import Path

import numpy as np
import pytest
import torch
from safetensors.torch import load_file

from pbrnet.model.data.reader import Dataset
from pbrnet.model.evaluation.inference import load_networks
from pbrnet.model.release import pretrained
from pbrnet.model.release.pretrained import MEAN, WORST, find_models, half_type, pack
from pbrnet.scenes.errors import InputError
from tests.fixtures.command import printed
from tests.fixtures.model import box_dataset
from tests.fixtures.predictor import untrained_models

INTERVAL = {"mean": 0.5, "low": 0.4, "high": 0.6}
FIGURES = dict.fromkeys(("ssim", "psnr", "flip"), INTERVAL)
CEILING = {**FIGURES, "psnr": {"mean": 33.25, "low": None, "high": None}}
EVALUATION = {
    "split": "test", "views": 2, "scenes": 1,
    "kept_back": {"views": 7, "scenes": 3, "methods": {"pbrnet": FIGURES}},
    "methods": {"pbrnet": FIGURES, "ceiling": CEILING},
}  # fmt: skip


@pytest.fixture()
def project(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Networks, data and figures in the working folder; no weights come with the package."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(pretrained, "PACKED", tmp_path / "weights")
    torch.set_num_threads(1)
    Path("params.yaml").write_text("seed: 0\n")
    box_dataset(Path("data"), 0, 0, 4, width=40, height=30)
    untrained_models(Path("models"), levels=3)
    Path("metrics").mkdir()
    Path("metrics/evaluation.json").write_text(json.dumps(EVALUATION))
    return tmp_path


def packed(**changes: object) -> list[pretrained.Difference]:
    given = {"source": Path("models"), "target": Path("weights"), "methods": ["pbrnet"],
             "data": Path("data"), "metrics": Path("metrics"), **changes}  # fmt: skip
    return pack(**given)  # type: ignore[arg-type]


def test_packed_networks_are_half_as_large_and_give_the_same_pictures(project: Path) -> None:
    (said,) = packed()
    assert sorted(file.name for file in Path("weights").iterdir()) == [
        "README.md", "composition.json", "composition.safetensors",
        "shading.json", "shading.safetensors",
    ]  # fmt: skip
    for name in ("shading", "composition"):
        stored = load_file(f"weights/{name}.safetensors")
        assert {value.dtype for value in stored.values()} == {torch.float16}
        assert Path(f"weights/{name}.safetensors").stat().st_mode & 0o777 == 0o644
        before = Path(f"models/{name}.safetensors").stat().st_size
        assert Path(f"weights/{name}.safetensors").stat().st_size < 0.6 * before
    original, small = (load_networks(Path(at)) for at in ("models", "weights"))
    assert small.cards["shading"].packed_from == original.cards["shading"].sha256
    for example in Dataset(Path("data/dataset"), "test").ordered():
        error = np.abs(
            original.predict("pbrnet", example).color - small.predict("pbrnet", example).color
        )
        assert 0 < error.max() <= said.worst <= WORST and error.mean() <= MEAN
    assert said.views == 4


def test_the_card_lists_training_data_licences_and_results(project: Path) -> None:
    packed()
    card = Path("weights/README.md").read_text()
    for words in ("3 views of 1 scenes of 1 floor", "CC-BY-4.0, ", "CC0-1.0", "- a room by a test",
                  "float16", "0.500 (0.400 to 0.600)", "33.250 |", "MIT",
                  "All scenes: 2 views of 1 scenes", "training: 7 views of 3 scenes"):  # fmt: skip
        assert words.strip(", ") in card, words
    assert "{{" not in card and "{%" not in card


def test_packing_again_replaces_and_gives_the_same_bytes(project: Path) -> None:
    packed()
    before = {file.name: file.read_bytes() for file in Path("weights").iterdir()}
    packed()
    assert {file.name: file.read_bytes() for file in Path("weights").iterdir()} == before


def test_nothing_else_is_overwritten(project: Path) -> None:
    Path("weights").mkdir()
    Path("weights/thesis.txt").write_text("years of work")
    with pytest.raises(InputError, match=r"thesis\.txt.*not a packed network"):
        packed()
    with pytest.raises(InputError, match="give another folder"):
        packed(target=Path("models"))
    assert Path("weights/thesis.txt").read_text() == "years of work"


def test_too_large_or_too_different_is_refused_and_leaves_nothing(
    project: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with monkeypatch.context() as patch:
        patch.setattr(pretrained, "LIMIT", 1000)
        with pytest.raises(InputError, match=r"MB of weights.*smaller width"):
            packed()
    with monkeypatch.context() as patch:
        patch.setattr(pretrained, "WORST", 1e-9)
        with pytest.raises(InputError, match="half precision does not suit these weights"):
            packed()
    with pytest.raises(InputError, match=r"evaluation\.json: no such file.*pbrnet evaluate"):
        packed(metrics=Path("nowhere"))
    Path("broken").mkdir()
    Path("broken/evaluation.json").write_text("{}")
    with pytest.raises(InputError, match=r"broken/evaluation\.json: .views. is missing"):
        packed(metrics=Path("broken"))
    Path("broken/evaluation.json").unlink()
    Path("broken").rmdir()
    with pytest.raises(InputError, match="packing requires a dataset"):
        packed(data=Path("nowhere"))
    assert sorted(path.name for path in project.iterdir()) == [
        "data", "metrics", "models", "params.yaml",
    ]  # fmt: skip


def test_weights_too_large_for_float16_become_bfloat16() -> None:
    assert half_type({"w": torch.tensor([1.0, -3000.0])}) is torch.float16
    large = {"w": torch.tensor([1.0, -70000.0])}
    assert half_type(large) is torch.bfloat16
    assert large["w"].to(half_type(large)).isfinite().all()


def test_own_networks_come_first_and_what_is_used_is_said(project: Path) -> None:
    packed()
    own = find_models(None, None)
    assert (own.folder, own.method, own.description) == (Path("models"), "pbrnet", "models")
    assert find_models(Path("weights"), "product").description == "weights"
    Path("models/shading.safetensors").unlink()
    found = find_models(None, None)
    assert found.folder == pretrained.PACKED and "pretrained" in found.description
    with pytest.raises(InputError, match=r"plus\.safetensors: no such model \(looked in models or"):
        find_models(None, "plus")
    with pytest.raises(InputError, match=r"--method .*pbrnet.*pbrnet train unet"):
        find_models(Path("weights"), "unet")


def test_one_network_is_enough_for_plus(project: Path) -> None:
    untrained_models(Path("single"), ("plus",), levels=3)
    with pytest.raises(InputError, match=r"compare predictions: .*add 'transport' to channels"):
        packed(source=Path("single"), methods=["plus"])
    box_dataset(Path("data"), 0, 0, 4, transport=True, width=40, height=30)
    packed(source=Path("single"), methods=["plus"])
    assert find_models(Path("weights"), None).method == "plus"
    assert "no figures of `plus`" in Path("weights/README.md").read_text()


def test_several_methods_share_a_folder_and_a_card(project: Path) -> None:
    box_dataset(Path("data"), 0, 0, 4, noisy=True, width=40, height=30)
    untrained_models(Path("models"), ("plus", "hybrid"), levels=3)
    said = packed(methods=["plus", "hybrid"])
    assert [difference.method for difference in said] == ["plus", "hybrid"]
    assert all(0 < difference.worst <= WORST for difference in said)
    assert sorted(file.name for file in Path("weights").glob("*.safetensors")) == [
        "hybrid.safetensors", "plus.safetensors",
    ]  # fmt: skip
    card = Path("weights/README.md").read_text()
    assert "--method plus --method hybrid" in card and "no figures of `hybrid`" in card
    Path("models/hybrid.safetensors").unlink()
    assert find_models(None, "hybrid").folder == pretrained.PACKED


def test_the_command_packs_and_says_how_much(project: Path) -> None:
    said = printed("pretrained", "--out", "small")
    assert "shading, composition: on 4 views" in said and "small: 0.1 MB" in said
