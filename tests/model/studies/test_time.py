"""Time study: parts add up, the reference is better than the methods it is compared with."""

import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from pbrnet.model.studies.frame_store import with_samples
from pbrnet.model.studies.time import study
from pbrnet.model.studies.time.plot import time_figure
from pbrnet.model.studies.time.results import (
    HYBRID_SAMPLES,
    PAPER,
    TRANSPORT_SAMPLES,
    MethodPoint,
    TimeResult,
    fastest_better,
    part_rows,
)
from pbrnet.model.studies.time.study import ViewMeasurement, _parts_of
from pbrnet.model.titles import METHOD_TITLES
from pbrnet.model.training.train import Folders
from pbrnet.pipeline.images import read_picture
from pbrnet.scenes.errors import InputError
from tests.fixtures.command import exit_code
from tests.fixtures.light import PARAMS, lit_workplace
from tests.fixtures.study import report_in, result_in


@pytest.fixture(scope="module")
def place(tmp_path_factory: pytest.TempPathFactory) -> Folders:
    """Two rooms with two test views each, and untrained networks."""
    return lit_workplace(tmp_path_factory.mktemp("time"))


def run(place: Folders, *more: str) -> int:
    """Run the command in the project; return the exit code."""
    root = place.data.parent
    words = ("study", "time", "--params", root / "params.yaml", "--data", place.data)
    return exit_code(*words, "--models", place.models, *more)


def test_what_a_method_takes_is_in_its_time() -> None:
    assert _parts_of("plus", None, False) == ("inputs", "transport", "plus")
    assert _parts_of("plus", None, True) == ("surfaces", "transport", "plus")
    assert _parts_of("unet", None, True) == ("inputs", "illumination", "unet")
    assert _parts_of("hybrid", 2, False) == ("inputs", "transport", "samples_2", "hybrid")
    assert _parts_of("radiosity", None, True) == ("transport",)
    assert _parts_of("radiosity", 2, True) == ("transport_2",)
    assert _parts_of("plus", 2, False) == ("inputs", "transport_2", "plus")


@pytest.mark.slow
def test_the_study_from_end_to_end_and_again(
    place: Folders,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    asked = ("--views", "1", "--repeats", "1", "--max-spp", "9", "--reference-spp", "256")
    assert run(place, *asked) == 0
    said = capsys.readouterr().out
    assert "in the paper: 10.2 s" in said and "time.json: all figures" in said
    result = result_in(place.models / "metrics", "time", TimeResult)
    assert (result.views, result.size, result.dataset_spp) == (1, (48, 40), 4)
    points = {(point.method, point.spp): point for point in result.points}
    ladder = {spp for method, spp in points if method == "mitsuba"}
    assert ladder == {1, 2, 4, 8}, "powers of two up to 9"
    assert {method for method, spp in points if spp is None} == {"pbrnet", "product", "unet"}
    # With one view and one turn, the time of a method is the sum of its parts.
    parts = {name: spent.seconds for name, spent in result.parts.items()}
    inputs = parts["inputs"] + parts["illumination"]
    for method, own in {
        "pbrnet": parts["shading"] + parts["composition"],
        "product": parts["shading"] + parts["product"],
        "unet": parts["unet"],
    }.items():
        assert points[method, None].seconds == pytest.approx(inputs + own)
    # Error falls with samples, and denoising helps most for the fewest samples.
    assert points["mitsuba", 8].flip < points["mitsuba", 1].flip
    assert points["mitsuba", 8].ssim > points["mitsuba", 1].ssim
    assert points["mitsuba_denoised", 1].flip < points["mitsuba", 1].flip
    assert points["mitsuba_denoised", 1].seconds > points["mitsuba", 1].seconds
    assert 0 < result.reference_noise < 0.2
    png = (place.models / "metrics" / "studies" / "time.png").read_bytes()
    assert read_picture(png).shape[:2] == (520, 1200)
    every = tuple(replace(points["unet", None], method=name) for name in METHOD_TITLES)
    figure = time_figure(replace(result, points=result.points + every))
    figure.draw_without_rendering()
    (legend,) = figure.legends
    low, high = legend.get_window_extent().get_points()
    assert (low > 0).all() and (high < figure.bbox.size).all(), "every method's name is readable"

    def refuse(*_: Any, **__: Any) -> None:
        raise AssertionError("the reference was there")

    monkeypatch.setattr(study.FrameStore, "render", refuse)
    assert run(place, *asked) == 0

    metrics = tmp_path / "metrics"
    shutil.copytree(place.models / "metrics", metrics)
    page, _ = report_in(tmp_path, PARAMS)
    assert "Equal time" in page and "10.2 s" in page and "its relative standard error" in page
    (metrics / "studies" / "time.json").write_text('{"seed": 0}')
    _, notes = report_in(tmp_path, PARAMS)
    assert any("time.json" in note and "pbrnet study time" in note for note in notes)


@pytest.mark.check
def test_transport_and_samples_are_timed_at_any_number(tmp_path: Path) -> None:
    place = lit_workplace(tmp_path, scenes=1, transport=True)
    asked = ("--views", "1", "--repeats", "1", "--max-spp", "2", "--reference-spp", "64")
    assert run(place, *asked) == 0
    result = result_in(place.models / "metrics", "time", TimeResult)
    points = {(point.method, point.spp): point for point in result.points}
    assert {spp for method, spp in points if method == "hybrid"} == set(HYBRID_SAMPLES)
    parts = {name: spent.seconds for name, spent in result.parts.items()}
    plus = parts["inputs"] + parts["transport"] + parts["plus"]
    assert points["plus", None].seconds == pytest.approx(plus)
    assert points["radiosity", None].seconds == pytest.approx(parts["transport"])
    assert result.better.keys() == {"hybrid 1", "hybrid 2"}
    for spp in (1, 2):
        flips = points["hybrid", spp].flip, points["planned_denoised", spp].flip
        assert result.better[f"hybrid {spp}"] == (flips[0] < flips[1]), "one view"
    assert points["radiosity", None].flip < 0.3, "a picture, without a network"
    for method in ("radiosity", "plus"):
        assert {spp for name, spp in points if name == method} == {None, *TRANSPORT_SAMPLES}
        flips = [points[method, spp].flip for spp in (1, 8)]
        assert flips[1] < flips[0], "more samples of light transport, less error"
    assert points["plus", 2].seconds == pytest.approx(
        parts["inputs"] + parts["transport_2"] + parts["plus"]
    )


@pytest.mark.slow
def test_another_size_is_rendered_and_predicted(place: Folders) -> None:
    asked = ("--size", "64x40", "--views", "1", "--repeats", "1", "--max-spp", "1")
    assert run(place, *asked) == 0
    result = result_in(place.models / "metrics", "time", TimeResult)
    assert result.size == (64, 40) and result.reference_spp == 16
    assert (place.data / "studies" / "time" / "64x40" / "color").is_dir()


@pytest.mark.slow
def test_an_interrupted_study_goes_on_after_the_last_view(
    place: Folders, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    asked = ("--size", "32x24", "--views", "2", "--repeats", "1", "--max-spp", "1")
    measured: list[str] = []
    most = 1
    real = study.ViewBenchmark.run

    def counted(benchmark: Any, *words: Any, **options: Any) -> ViewMeasurement:
        if len(measured) == most:
            raise InputError("cut off")
        measured.append(benchmark.view.view_id)
        return real(benchmark, *words, **options)

    monkeypatch.setattr(study.ViewBenchmark, "run", counted)
    assert run(place, *asked) == 3 and len(measured) == 1
    most = 3
    assert run(place, *asked) == 0
    assert len(measured) == 2 and result_in(place.models / "metrics", "time", TimeResult).views == 2
    assert not list((place.data / "studies" / "time" / "32x24").glob("*/*/*.json")), "removed"
    assert run(place, *asked) == 3, "a finished study measures again"
    assert len(measured) == 3


def test_what_cannot_be_is_refused(
    place: Folders, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(place, "--reference-spp", "100") == 2
    assert "--reference-spp: 100 is not allowed" in capsys.readouterr().err
    assert run(place, "--size", "large") == 2
    assert "--size" in capsys.readouterr().err
    assert run(place, "--size", "640x8") == 2
    assert "at least 16 pixels" in capsys.readouterr().err
    nowhere = Folders(place.data, tmp_path)
    assert run(nowhere) == 3
    assert "pbrnet train shading" in capsys.readouterr().err


def test_a_point_is_beaten_only_by_what_is_better_in_no_more_time() -> None:
    ours = MethodPoint("pbrnet", None, 1.0, 0.4, 0.8)
    rivals = (
        MethodPoint("mitsuba", 1, 0.5, 0.5, 0.5),
        MethodPoint("mitsuba", 8, 2.0, 0.1, 0.9),
        MethodPoint("unet", None, 0.1, 0.1, 0.9),
    )
    assert fastest_better(ours, (ours, *rivals)) is None
    better = MethodPoint("mitsuba_denoised", 2, 0.9, 0.2, 0.9)
    faster = MethodPoint("mitsuba_denoised", 1, 0.6, 0.3, 0.9)
    assert fastest_better(ours, (ours, *rivals, better, faster)) == faster


def test_medians_of_turns_and_means_of_views() -> None:
    measurements = [
        ViewMeasurement({"shading": (1.0, 9.0, 2.0), "composition": (1.0, 1.0, 1.0)}, {}, 0.1),
        ViewMeasurement({"shading": (4.0, 4.0, 7.0), "composition": (3.0, 3.0, 3.0)}, {}, 0.1),
    ]
    spent = study._parts(measurements)["shading"]
    assert (spent.seconds, spent.low, spent.high) == (3.0, 2.5, 8.0)


def test_samples_of_a_rung_fit_into_blocks() -> None:
    for spp in (1, 2, 3, 7, 16, 24, 1024):
        truth = with_samples(PARAMS.groundtruth, spp, denoise=False)
        assert truth.spp == spp and spp % truth.block_spp == 0 and truth.noise == 0


@pytest.mark.slow
def test_both_networks_stand_beside_the_papers_figure(place: Folders) -> None:
    assert run(place, "--views", "1", "--repeats", "1", "--max-spp", "1", "--clock", "cpu") == 0
    result = result_in(place.models / "metrics", "time", TimeResult)
    assert result.clock == "cpu"
    rows = {row["name"]: row for row in part_rows(result)}
    assert rows["networks"]["paper"] == PAPER["networks"] == 0.145
    parts = result.parts
    assert rows["networks"]["spent"].seconds == pytest.approx(
        parts["shading"].seconds + parts["composition"].seconds
    )
