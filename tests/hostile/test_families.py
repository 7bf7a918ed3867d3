"""Every hostile input ends in time, within its folder, with a message and without a traceback."""

import json
import os
import subprocess
import sys
import tempfile
from pathlib import Path

import pytest

from tests.fixtures.paths import ROOT
from tests.hostile.families import FAMILIES
from tests.hostile.runner import Outcome, _Watch

CASES = 3500


def outcomes(*arguments: str) -> list[Outcome]:
    """Run `python -m tests.hostile` in a process of its own, which can be forked.

    Its folder has a short path, in which worker processes can have sockets.
    """
    with tempfile.TemporaryDirectory(prefix="hostile-") as folder:
        made = Path(folder, "outcomes.json")
        # -B: a cached module would be a file outside of the folder.
        command = [
            sys.executable,
            "-B",
            "-m",
            "tests.hostile",
            "--work",
            folder,
            "--json",
            str(made),
        ]
        done = subprocess.run([*command, *arguments], cwd=ROOT, capture_output=True, text=True)
        print(done.stdout[-4000:])
        assert made.is_file(), done.stderr[-4000:]
        return [Outcome(**one) for one in json.loads(made.read_text(encoding="utf-8"))]


def test_there_are_thousands_of_cases_and_each_family_has_its_own() -> None:
    assert sum(family.cases for family in FAMILIES) >= CASES
    assert len({family.name for family in FAMILIES}) == len(FAMILIES)
    assert all(len(family.made) < family.cases for family in FAMILIES)


@pytest.mark.slow
def test_thirty_cases_of_all_cheap_families() -> None:
    found = outcomes("--sample", "30", "--processes", "1")
    assert len(found) == 30
    assert not [(one.name, one.faults, one.message) for one in found if one.faults]


@pytest.mark.check
@pytest.mark.timeout(3600)
@pytest.mark.parametrize("family", [family.name for family in FAMILIES])
def test_all_cases_of_a_family(family: str) -> None:
    found = outcomes("--only", family)
    assert not [(one.name, one.faults, one.message) for one in found if one.faults]


@pytest.mark.check
@pytest.mark.timeout(3600)
@pytest.mark.parametrize("family", [family.name for family in FAMILIES if family.sound])
def test_undamaged_files_of_a_family_are_read(family: str) -> None:
    found = outcomes("--only", family, "--sound")
    assert found
    assert not [(one.arguments, one.message) for one in found if one.code != 0]


def test_reading_around_a_case_is_reported_and_elsewhere_is_not(tmp_path: Path) -> None:
    case = tmp_path / "root" / "case"
    with (tmp_path / "report").open("w+") as report:
        watch = _Watch(case, tmp_path / "root", report.fileno())
        for path in (case / "a.png", case / "../x.png", "/etc/passwd", sys.executable):
            watch("open", (path, "r", 0))
        report.seek(0)
        root = os.path.realpath(tmp_path / "root")
        assert report.read().splitlines() == [f"reads {root}/x.png", "reads /etc/passwd"]
