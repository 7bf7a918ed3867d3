"""Illumination study: from scenes, dataset and networks to its result, and resuming."""

import json
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pbrnet.model.data.reader import Dataset, Example
from pbrnet.model.evaluation.inference import load_networks
from pbrnet.model.studies.illumination import study
from pbrnet.model.studies.illumination.compare import LitView, compare, direct_image, log_average
from pbrnet.model.studies.illumination.results import IlluminationResult
from pbrnet.model.training.train import Folders
from pbrnet.pipeline.frames import layout
from pbrnet.pipeline.images import png_facts, read_picture
from pbrnet.pipeline.views import CameraFile, load_cameras, save_cameras
from tests.fixtures.command import exit_code
from tests.fixtures.light import PARAMS, lit_workplace, room
from tests.fixtures.predictor import untrained_models
from tests.fixtures.study import report_in, result_in

pytestmark = pytest.mark.slow

CHANGES = {"added", "all", "exchanged", "lamps", "outdoors", "without"}


@pytest.fixture(scope="module")
def place(tmp_path_factory: pytest.TempPathFactory) -> Folders:
    """Two rooms with two test views each, and untrained networks."""
    return lit_workplace(tmp_path_factory.mktemp("light"))


@pytest.fixture
def examples(place: Folders) -> list[Example]:
    return list(Dataset(place.data / "dataset", "test").ordered())


def run(place: Folders, *more: str) -> int:
    """Run the command in the project with few samples; return the exit code."""
    root = place.data.parent
    words = ["study", "illumination", "--spp", "4", "--params", str(root / "params.yaml")]
    return exit_code(*words, "--data", place.data, "--models", place.models, *more)


@pytest.fixture
def traced(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Names of the changes that are path traced, in order."""
    names: list[str] = []
    real = study._render

    def counted(opened: Any, case: Any, *more: Any) -> None:
        names.append(case.name)
        real(opened, case, *more)

    monkeypatch.setattr(study, "_render", counted)
    return names


def test_the_study_from_end_to_end_and_again(
    place: Folders, traced: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(place, "--views", "2") == 0
    assert sorted(traced) == sorted(2 * ["", "added", "lamps", "outdoors", "without"])
    said = capsys.readouterr().out
    assert "2 views of 2 test scenes" in said and "illumination.json: all figures" in said
    result = result_in(place.models / "metrics", "illumination", IlluminationResult)
    assert set(result.changes) == CHANGES
    for name, change in result.changes.items():
        assert change.views == (8 if name == "all" else 2) and not change.skipped
        assert set(change.methods) == {"shading", "pbrnet", "product"} | (
            set() if name == "exchanged" else {"direct"}
        )
    # Lamps are only part of the light, so a factor of 4 changes less than ln 4.
    for method, found in result.changes["lamps"].methods.items():
        assert found.true is not None and 0 < found.true.value < np.log(4), method
        assert found.predicted is not None and found.predicted.value > 0, method
        assert found.sign is not None and found.sign.value == 1, method
    png = (place.models / "metrics" / "studies" / "illumination.png").read_bytes()
    assert png_facts(png)["credits"] == ["test scene by pbrnet, CC0-1.0"]  # type: ignore[index]
    assert read_picture(png).shape[1] > 6 * 48

    before = (place.models / "metrics" / "studies" / "illumination.json").read_bytes()
    traced.clear()
    assert run(place, "--views", "2") == 0
    assert traced == [] and "10 of 10 cases are already rendered" in capsys.readouterr().err
    assert (place.models / "metrics" / "studies" / "illumination.json").read_bytes() == before

    traced.clear()
    assert run(place, "--views", "1", "--factor", "3") == 0
    assert set(traced) == {"lamps", "outdoors"}, "what the factor does not change is kept"


def test_a_killed_study_goes_on(
    tmp_path: Path, place: Folders, traced: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    renders = str(tmp_path / "renders")
    counted = study._render

    def killed(opened: Any, case: Any, *more: Any) -> None:
        if len(traced) == 3:
            raise KeyboardInterrupt
        counted(opened, case, *more)

    monkeypatch.setattr(study, "_render", killed)
    assert run(place, "--views", "1", "--renders", renders) == 130
    first = list(traced)
    traced.clear()
    left = [
        folder / ".partial-x.exr"
        for folder in (place.models / "metrics" / "studies", Path(renders) / "added")
    ]
    for half in left:
        half.parent.mkdir(parents=True, exist_ok=True)
        half.write_bytes(b"half")
    monkeypatch.setattr(study, "_render", counted)
    assert run(place, "--views", "1", "--renders", renders) == 0
    assert len(first) == 3 and len(traced) == 2 and not set(first) & set(traced)
    assert not any(half.exists() for half in left)
    assert result_in(place.models / "metrics", "illumination", IlluminationResult).changes[
        "exchanged"
    ].skipped == {"no other view": 1}


@pytest.mark.check
def test_light_transport_follows_the_changed_light(tmp_path: Path) -> None:
    """Computed for each light, it knows better than the panorama where it gets brighter."""
    place = lit_workplace(tmp_path, scenes=1, transport=True)
    assert run(place, "--views", "2", "--spp", "64") == 0
    changes = result_in(place.models / "metrics", "illumination", IlluminationResult).changes
    for name in ("added", "lamps", "outdoors"):
        found = changes[name].methods["radiosity"]
        assert found.pattern is not None and found.pattern.value > 0.9, name
        assert found.gain is not None and found.gain.value == pytest.approx(1, abs=0.1), name
    assert "radiosity" not in changes["exchanged"].methods, "no scene has that light"


def as_it_is(example: Example) -> LitView:
    return LitView(
        example,
        example["intensity"],
        example["distance"],
        example.images.get("tint"),
        example.images.get("visibility"),
        example["shading"],
        example["color"],
    )


def test_twice_the_light_is_predicted_as_twice_the_light(
    place: Folders, examples: list[Example], tmp_path: Path
) -> None:
    models = shutil.copytree(place.models, tmp_path / "models")
    untrained_models(models, ("plus",), levels=2)
    networks = load_networks(models, ["pbrnet", "plus"])
    example = examples[0]
    light = dict.fromkeys(layout("transport"), example["shading"][..., 0])
    before = replace(as_it_is(example), transport=light)
    after = replace(
        before,
        transport={name: 2 * image for name, image in light.items()},
        intensity=2 * example["intensity"],
        shading=2 * example["shading"],
        color=2 * example["color"],
    )
    levels = [log_average(direct_image(lit.example)) for lit in (before, after)]
    assert levels[1] == pytest.approx(2 * levels[0])
    (found,) = compare(networks, before, {"lamps": after})
    assert found.reference == "rendered" and {"plus", "radiosity"} < found.predicted.keys()
    for change in (*found.true.values(), *found.predicted.values()):
        assert np.isfinite(change).mean() > 0.9
        np.testing.assert_allclose(change[np.isfinite(change)], np.log(2), atol=1e-3)


def test_without_any_light_nothing_is_said(place: Folders, examples: list[Example]) -> None:
    example = examples[0]
    before = as_it_is(example)
    dark = replace(before, intensity=0 * example["intensity"], distance=0 * example["distance"])
    (found,) = compare(load_networks(place.models), before, {"without": dark})
    assert all(np.isnan(change).all() for change in found.predicted.values())


def other_light(data: Path) -> None:
    room(data / "scenes" / "room-1", lamp=9.0)


def other_cameras(data: Path) -> None:
    path = data / "cameras" / "room-1.json"
    views = [replace(view, view_id=f"{view.view_id}x") for view in load_cameras(path).views]
    save_cameras(path, CameraFile("room-1", tuple(views)))


BREAKS: dict[str, tuple[Callable[[Path], object], str]] = {
    "no scenes": (
        lambda data: shutil.rmtree(data / "scenes"),
        "no such scene. The study renders views of the dataset again",
    ),
    "no cameras": (lambda data: shutil.rmtree(data / "cameras"), "no such camera file"),
    "no test views": (
        lambda data: (data / "dataset" / "test-00000-of-00001.parquet").rename(
            data / "dataset" / "train-00000-of-00001.parquet"
        ),
        "the test split is empty",
    ),
    "another scene": (other_light, "not the scene that the dataset was made from"),
    "other cameras": (other_cameras, "not the cameras that the dataset was made with"),
    "no models": (
        lambda data: shutil.rmtree(data.parent / "models"),
        "no such model; make it with: pbrnet train shading",
    ),
}


@pytest.mark.parametrize("case", BREAKS)
def test_what_is_missing_is_named(
    place: Folders, tmp_path: Path, case: str, capsys: pytest.CaptureFixture[str]
) -> None:
    root = tmp_path / "copy"
    shutil.copytree(place.data.parent, root)
    folders = Folders(root / "data", root / "models")
    shutil.rmtree(folders.models / "metrics", ignore_errors=True)
    spoil, words = BREAKS[case]
    spoil(folders.data)
    assert run(folders) == 3
    error = capsys.readouterr().err
    assert words in error and "Traceback" not in error
    assert not (folders.models / "metrics").exists()


def test_another_width_of_panoramas_is_named(
    place: Folders, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    text = (place.data.parent / "params.yaml").read_text().replace("width: 32", "width: 64")
    (tmp_path / "other.yaml").write_text(text)
    assert run(place, "--params", str(tmp_path / "other.yaml")) == 3
    assert "illumination.width: 64, but the dataset's panoramas are 32" in capsys.readouterr().err


def test_the_report_shows_it_and_notes_a_damaged_one(place: Folders, tmp_path: Path) -> None:
    assert run(place, "--views", "1") == 0
    metrics = tmp_path / "metrics"
    shutil.copytree(place.models / "metrics", metrics)
    page, _ = report_in(tmp_path, PARAMS)
    assert 'id="study-illumination"' in page and "lamp added at the left rear" in page
    path = metrics / "studies" / "illumination.json"
    content = json.loads(path.read_text())
    content["factor"] = "much"
    path.write_text(json.dumps(content))
    page, notes = report_in(tmp_path, PARAMS)
    assert any("illumination.json.factor" in note for note in notes)
    assert 'id="study-illumination"' not in page
