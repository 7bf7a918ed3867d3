"""Time budgets: order and seconds of methods are those of the published study, probes are few."""

import json
import subprocess
import sys
from itertools import pairwise
from pathlib import Path

import pytest

from pbrnet.model.evaluation.budget import Choice, Effort, choose, efforts_for
from pbrnet.model.evaluation.speeds import (
    expected_seconds,
    keep_seconds,
    known_seconds,
    scaled,
    speeds_file,
)
from pbrnet.pipeline.passes.transport import samples_for
from tests.fixtures.paths import ROOT

TOLERANCE = 0.001  # of FLIP: neighbours this close may be in either order


@pytest.mark.parametrize("size", [(160, 120), (480, 360)])
def test_each_step_errs_less_in_the_published_study(size: tuple[int, int]) -> None:
    width, height = size
    study = json.loads((ROOT / "docs" / "data" / f"time-{width}x{height}.json").read_text())
    known: dict[Effort, float] = {}
    for point in study["points"]:
        spp = point["spp"] or samples_for(width * height)
        name = {"planned_denoised": "denoised"}.get(point["method"], point["method"])
        known[Effort(name, spp)] = point["flip"]
    efforts = efforts_for(width * height, ("radiosity", "hybrid", "denoised"))
    measured = [known[effort] for effort in efforts if effort in known]
    assert len(measured) >= 8
    for before, after in pairwise(measured):
        assert after <= before + TOLERANCE


@pytest.mark.parametrize("size", [(160, 120), (480, 360)])
def test_expected_seconds_are_those_of_the_published_study(size: tuple[int, int]) -> None:
    pixels = size[0] * size[1]
    study = json.loads((ROOT / "docs" / "data" / f"time-{size[0]}x{size[1]}.json").read_text())
    compared = 0
    for point in study["points"]:
        name = {"planned_denoised": "denoised"}.get(point["method"], point["method"])
        if name in ("radiosity", "hybrid", "denoised"):
            spp = point["spp"] or samples_for(pixels)
            expected = expected_seconds(name, spp, "high", pixels)
            assert expected == pytest.approx(point["seconds"], rel=0.25), point
            compared += 1
    assert compared >= 10


class Machine:
    """A machine of so many times the expected seconds, whose time is counted, not spent."""

    def __init__(self, factor: float, pixels: int, compiling: float = 0.0) -> None:
        self.factor, self.pixels, self.compiling = factor, pixels, compiling
        self.now, self.measured = 0.0, list[Effort]()
        self.efforts = efforts_for(pixels, ("radiosity", "denoised", "hybrid"))

    def cost(self, effort: Effort) -> float:
        """Seconds of a picture."""
        return self.factor * expected_seconds(
            effort.method, effort.spp, effort.quality, self.pixels
        )

    def seconds(self, effort: Effort) -> float:
        """Measure an effort: by rendering twice, the first time with compilation."""
        cost = self.cost(effort)
        self.measured.append(effort)
        self.now += self.compiling + 2 * cost
        return cost

    def choose(self, budget: float, known: dict[str, float]) -> Choice:
        """Choose among all efforts."""
        return choose(budget, self.efforts, self.seconds, self.pixels, known, lambda: self.now)


@pytest.mark.parametrize("factor", [0.3, 1.0, 4.0])
@pytest.mark.parametrize("pixels", [160 * 120, 480 * 360])
def test_a_budget_is_kept_after_few_measurements(factor: float, pixels: int) -> None:
    for budget in (0.11, 0.5, 2.0, 20.0):
        machine = Machine(factor, pixels)
        choice = machine.choose(budget, {})
        fitting = [effort for effort in machine.efforts if machine.cost(effort) <= budget]
        fastest = min(machine.efforts, key=machine.cost)
        assert choice.effort == (fitting[-1] if fitting else fastest)
        assert len(machine.measured) <= 3
        first = machine.measured[0]
        start = Machine(factor, pixels)
        start.seconds(first)  # the one that any choice takes
        assert machine.now <= max(start.now, 5 * budget)


def test_compiling_ends_the_search_after_one_measurement_and_is_not_repeated(
    tmp_path: Path,
) -> None:
    machine = Machine(2.0, 160 * 120, compiling=10.0)
    choice = machine.choose(0.5, {})
    assert len(machine.measured) == 1 and not choice.is_measured
    assert choice.seconds <= 0.5, "by the measurement of another one"
    assert choice.effort not in machine.measured

    file = tmp_path / "cache" / "seconds.json"
    keep_seconds(file, "here", dict(choice.measured))
    known = known_seconds(file, "here")
    assert known == choice.measured and not known_seconds(file, "elsewhere")
    machine.measured.clear()
    again = machine.choose(0.5, known)
    assert again.effort == choice.effort and len(machine.measured) == 1
    keep_seconds(file, "here", {**known, **again.measured})
    machine.measured.clear()
    last = machine.choose(0.5, known_seconds(file, "here"))
    assert last.effort == choice.effort and last.is_measured and not machine.measured


@pytest.mark.parametrize("text", ["", "[", "[1]", '{"here": 3}', '{"here": {"a": "b", "c": -1}}'])
def test_a_damaged_memory_holds_nothing_and_is_replaced(tmp_path: Path, text: str) -> None:
    file = tmp_path / "seconds.json"
    file.write_text(text)
    assert known_seconds(file, "here") == {}
    keep_seconds(file, "here", {"a": 1.0})
    assert known_seconds(file, "here") == {"a": 1.0}


def test_a_memory_that_cannot_be_written_is_no_error(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "file").write_text("")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "file"))
    keep_seconds(speeds_file(), "here", {"a": 1.0})
    assert known_seconds(speeds_file(), "here") == {}


def test_unmeasured_efforts_are_scaled_by_those_measured() -> None:
    assert scaled({"a": 1.0, "b": 2.0}, {"a": 3.0}) == {"a": 3.0, "b": 6.0}
    assert scaled({"a": 1.0}, {}) == {"a": 1.0}


def test_pictures_without_a_network_start_without_torch() -> None:
    heavy = {"torch", "skimage", "matplotlib"}
    code = f"import sys, pbrnet.model.commands.predict; print(sys.modules.keys() & {heavy})"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "set()"
