"""Summary of an evaluation: flat figures, and pictures from the best to the worst."""

import json
from functools import partial
from pathlib import Path

import pytest
from PIL import Image

from pbrnet.model.evaluation.evaluate import evaluate
from pbrnet.model.evaluation.reference import SHOWN
from pbrnet.model.settings import EvaluateParams, TrainParams
from pbrnet.model.training.train import Folders
from pbrnet.pipeline.params import Params
from tests.fixtures.command import printed, refused
from tests.fixtures.model import box_dataset
from tests.fixtures.predictor import untrained_models

PARAMS = Params(train=TrainParams(baselines=("plus",)), evaluate=EvaluateParams(timing_views=1))


@pytest.fixture
def project(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Networks that nobody trained, measured on four views of two rooms."""
    monkeypatch.chdir(tmp_path)
    Path("params.yaml").write_text("seed: 0\n")
    box_dataset(Path("data"), 0, 0, 4, transport=True, width=32, height=24)
    untrained_models(Path("models"), ("shading", "composition", "plus"), levels=2)
    for name in ("shading", "composition", "plus"):
        card = Path(f"models/{name}.json")
        card.write_text(json.dumps(json.loads(card.read_text()) | {"training": {"steps": 7}}))
    evaluate(PARAMS, Folders())
    return tmp_path


run = partial(printed, "reference")


@pytest.mark.slow
def test_figures_are_those_of_the_evaluation(project: Path) -> None:
    run()
    found = json.loads(Path("metrics/reference.json").read_text())
    measured = json.loads(Path("metrics/evaluation.json").read_text())["methods"]
    assert set(found["methods"]) == set(measured) == {
        "pbrnet", "product", "product_linear", "plus", "radiosity", "ceiling",
    }  # fmt: skip
    for method, values in found["methods"].items():
        assert set(values) == {"ssim", "psnr", "flip", "lpips", "seconds"}
        for name in ("ssim", "psnr", "flip"):
            assert values[name] == measured[method][name]["mean"]
            low, high = found["intervals"][method][name]
            assert low <= values[name] <= high
    assert found["methods"]["ceiling"]["seconds"] is None
    pair = found["differences"]["plus - pbrnet"]
    for name in ("ssim", "psnr", "flip"):
        apart = measured["plus"][name]["mean"] - measured["pbrnet"][name]["mean"]
        assert pair[name]["mean"] == pytest.approx(apart, abs=1e-4 if name == "psnr" else 1e-5)
        assert pair[name]["low"] <= pair[name]["mean"] <= pair[name]["high"]
    assert 0 <= pair["better"] <= 4 and "hybrid - denoised" not in found["differences"]
    assert (found["views"], found["scenes"], found["networks"]["plus"]["steps"]) == (4, 2, 7)


@pytest.mark.slow
def test_the_sheet_goes_from_the_best_to_the_worst(project: Path) -> None:
    run("--sheet", "sheet.png", "--method", "plus", "--method", "ceiling", "--views", "3")
    with Image.open("sheet.png") as image:
        assert 3 * SHOWN <= image.width < 3.1 * SHOWN and image.height > 3 * SHOWN * 24 / 32
    run("--sheet", "more.png", "--views", "50")
    assert Path("more.png").stat().st_size > 1000


@pytest.mark.slow
def test_what_is_missing_is_named(project: Path) -> None:
    for file, words in (("evaluation.csv", "evaluation.csv: no such file"),
                        ("evaluation.json", "evaluation.json: no such file")):  # fmt: skip
        Path("metrics", file).unlink()
        assert words in refused("reference", "--sheet", "sheet.png")
    assert not Path("sheet.png").exists()
