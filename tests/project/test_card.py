"""The comparison of a card with LLVM: its statistics tell, its results resume, its page says so."""

import json
import time
from pathlib import Path

import numpy as np
import pytest

from benchmarks import card
from benchmarks.card import SMALL, OutOfTimeError, Trial, agreement, run
from benchmarks.results import _card_section, page_of
from benchmarks.rows import Row
from benchmarks.timing import Spread
from tests.fixtures.paths import ROOT

RESULTS = ROOT / "benchmarks" / "results.json"


def renders(seed: int, scale: float = 1.0, noise: float = 0.3) -> np.ndarray:
    """Independent renders (16, 12, 16, 3) of one image, gamma-distributed around its pixels."""
    image = 0.5 + np.arange(12 * 16).reshape(12, 16, 1) / 200
    rng = np.random.default_rng(seed)
    shape = 1 / noise**2
    return scale * image * rng.gamma(shape, 1 / shape, (16, 12, 16, 3))


@pytest.mark.parametrize(
    ("changes", "mean_differs", "noise_differs"),
    [({}, False, False), ({"scale": 1.3}, True, True), ({"noise": 0.4}, False, True)],
)
def test_agreement_tells_other_means_and_other_noise(
    changes: dict[str, float], mean_differs: bool, noise_differs: bool
) -> None:
    mean, noise = agreement(renders(1), renders(2, **changes))
    assert (abs(mean) > 3, abs(noise) > 3) == (mean_differs, noise_differs)
    assert agreement(renders(1), renders(1)) == (0, 0)


def test_steps_are_written_as_they_end_and_a_second_run_goes_on(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, variant: str
) -> None:
    done: list[str] = []
    late = True

    def step(name: str, trial: Trial):
        done.append(name)
        yield Row(name, "a figure", Spread(1, 1, 1, 1))
        if name == "light" and late:
            raise OutOfTimeError

    steps = {name: lambda trial, name=name: step(name, trial) for name in ("surfaces", "light")}
    monkeypatch.setattr(card, "STEPS", steps)
    trial = Trial(tmp_path, "llvm_ad_rgb", SMALL, time.monotonic() + 60)
    file = tmp_path / "card.json"
    run(trial, file, list(steps))
    assert list(json.loads(file.read_text())["steps"]) == ["surfaces"]
    late = False
    assert set(run(trial, file, list(steps))["steps"]) == set(steps)
    assert done == ["surfaces", "light", "light"]
    monkeypatch.setattr("benchmarks.results.code_version", lambda: "other code")
    run(trial, file, ["surfaces"])
    assert done[-1] == "surfaces" and "light" not in json.loads(file.read_text())["steps"]


def test_a_child_out_of_time_is_stopped(tmp_path: Path) -> None:
    trial = Trial(tmp_path, "llvm_ad_rgb", SMALL, time.monotonic() + 0.2)
    with pytest.raises(OutOfTimeError):
        trial.python("-c", "import time; time.sleep(60)")


def test_the_page_has_a_place_that_says_not_measured() -> None:
    record = json.loads(RESULTS.read_text())
    page = (ROOT / "docs" / "benchmarks.md").read_text()
    assert page_of(record) == page
    if not card.CARD.is_file():
        assert "## A graphics card against LLVM\n\nNot measured" in page
    row = Row("card / LLVM", "views an hour", Spread(9, 9, 9, 1)).plain()
    steps = {"speed": {"rows": [row], "seconds": 1}}
    measured = {"card": "H200", "measured_on": record["measured_on"], "steps": steps}
    assert "| card / LLVM | 9 |" in _card_section(measured) and "H200" in _card_section(measured)


@pytest.mark.check
@pytest.mark.timeout(900)
def test_the_whole_comparison_runs_with_llvm_in_the_place_of_a_card(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, wavefront: None, variant: str
) -> None:
    trial = Trial(tmp_path, "llvm_ad_rgb", SMALL, time.monotonic() + 800)
    steps = run(trial, tmp_path / "card.json", list(card.STEPS))["steps"]
    assert list(steps) == list(card.STEPS)
    rows = {row["name"]: row for step in steps.values() for row in step["rows"]}
    assert all(rows[f"{kind}: pixels that differ"]["value"] == 0 for kind in ("inputs", "labels"))
    assert rows["light: mean, standard errors apart"]["value"] < 4
    assert rows["training steps a second"]["value"] > 0
