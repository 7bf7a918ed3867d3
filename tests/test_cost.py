"""The cost model against ledgers whose costs are known."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from pipeline.cli import cli
from pipeline.cost import fit_costs, samples_of
from pipeline.ledger import Ledger, read_ledger
from pipeline.params import GroundTruthParams, ImageParams, Params
from scenes.errors import InputError

OPEN, FIXED, RATE = 4.0, 0.6, 2e-6  # seconds a scene, a view, a sample


def measured(
    data: Path, scenes: int, sizes: tuple[tuple[int, int, int], ...], spread: float = 0.0
) -> None:
    """A ledger of eight views a scene; scenes differ by a lognormal factor."""
    random = np.random.default_rng(5)
    ledger = Ledger(data)
    for scene in range(scenes):
        name, factor = f"s{scene:03}", float(np.exp(random.normal(0, spread)))
        ledger.add(("scenes", name, ""), seconds=3.0, threads=1)
        for view in range(8):
            width, height, spp = sizes[view % len(sizes)]
            samples = width * height * spp
            seconds = factor * (FIXED + RATE * samples) + OPEN * (view == 0)
            for stage in ("shading", "color"):
                ledger.add(
                    (stage, name, f"{view:03}"),
                    seconds=seconds / 4,
                    first=view == 0,
                    threads=2,
                    width=width,
                    height=height,
                    spp=spp,
                )
    ledger.save()


def test_known_costs_are_found_again_and_scale(tmp_path: Path) -> None:
    measured(tmp_path, 6, ((160, 120, 16), (320, 240, 16), (160, 120, 64)))
    costs = {cost.stage: cost for cost in fit_costs(read_ledger(tmp_path))}
    truth = costs["truth"]
    assert truth.measured == 48 and truth.error < 1e-9
    assert (truth.scene, truth.view, truth.sample) == pytest.approx((OPEN, FIXED, RATE))
    assert costs["scenes"].total(10, 80, 0) == pytest.approx(30)
    params = Params(image=ImageParams(480, 360), groundtruth=GroundTruthParams(spp=256))
    samples = samples_of("truth", params)
    assert truth.total(5, 40, samples) == pytest.approx(
        5 * OPEN + 40 * (FIXED + RATE * 480 * 360 * 256)
    )


def test_one_size_grows_in_proportion(tmp_path: Path) -> None:
    measured(tmp_path, 6, ((160, 120, 16),))
    truth = next(cost for cost in fit_costs(read_ledger(tmp_path)) if cost.stage == "truth")
    assert truth.view == 0
    assert truth.sample * 160 * 120 * 16 == pytest.approx(FIXED + RATE * 160 * 120 * 16)


def test_scenes_that_differ_are_predicted_within_a_fifth(tmp_path: Path) -> None:
    """Scenes whose rates differ by a third: the total of unseen ones, and what is said of it."""
    measured(tmp_path, 60, ((160, 120, 16), (160, 120, 64)), spread=0.33)
    truth = next(cost for cost in fit_costs(read_ledger(tmp_path)) if cost.stage == "truth")
    assert 0.005 < truth.error < 0.2
    half = read_ledger(tmp_path).filter(
        np.array([int(row["scene_id"][1:]) % 2 == 0 for row in read_ledger(tmp_path).to_pylist()])
    )
    fit = next(cost for cost in fit_costs(half) if cost.stage == "truth")
    rest = [row for row in read_ledger(tmp_path).to_pylist() if int(row["scene_id"][1:]) % 2]
    actual = sum(2 * row["seconds"] for row in rest if row["stage"] != "scenes")
    sizes = (160 * 120 * 16, 160 * 120 * 64)
    predicted = sum(fit.total(0, 120, size) for size in sizes) + 30 * fit.scene
    assert predicted == pytest.approx(actual, rel=0.2)


def test_the_command_says_core_hours(tmp_path: Path) -> None:
    measured(tmp_path / "data", 6, ((160, 120, 16), (320, 240, 16)))
    (tmp_path / "params.yaml").write_text(
        "image: {width: 160, height: 120}\n"
        "scenes: {homes: 10}\ncameras: {views_per_scene: 5}\n"
        "groundtruth: {spp: 64}\n"
    )
    words = ["cost", "--data", str(tmp_path / "data"), "--params", str(tmp_path / "params.yaml")]
    run = CliRunner().invoke(cli, [*words, "--json"])
    assert run.exit_code == 0, run.output
    facts = json.loads(run.output)
    assert (facts["scenes"], facts["views"]) == (10, 50)
    truth = 10 * OPEN + 50 * (FIXED + RATE * 160 * 120 * 64)
    assert facts["core_hours"] * 3600 == pytest.approx(truth + 10 * 3.0)
    assert facts["relative_error"] < 1e-6
    run = CliRunner().invoke(cli, [*words, "--views", "500000", "--cores", "1000"])
    assert "500,000 views of 100,000 scenes, 160x120" in run.output
    assert "on 1,000 cores: " in run.output


def test_without_measured_views_there_is_no_estimate(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="render a few views first"):
        fit_costs(read_ledger(tmp_path))
    measured(tmp_path, 2, ((160, 120, 16),))
    assert all(np.isnan(cost.error) for cost in fit_costs(read_ledger(tmp_path)))
