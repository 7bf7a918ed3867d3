"""Processor seconds of tests: a pytest plugin that prints where the time of a run went.

Each test's user and system time, its setup and its finished child processes included, is kept
with its report: `--junitxml` writes it as the property `cpu_seconds`. At the end of a run the
plugin prints the most expensive tests, the most expensive files and the total. The same for a run
in the past, and the record of its costly tests:

    python -m tests.costs build/tests.xml [--record]

A run of all tests takes a random sample of the costly ones, another at each commit; the others are
marked `check`. `PBRNET_TEST_SEED` chooses a sample; tests that are named always run.
"""

import argparse
import json
import multiprocessing.forkserver
import os
import random
import subprocess
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import defusedxml.ElementTree
import psutil
import pytest

SHOWN = 20
COSTLY = 3.0  # seconds
SAMPLE = 180.0  # seconds of costly tests in a run of all
FILE = Path(__file__).with_name("costly.json")
# Run whatever they cost.
ALWAYS = ("tests/project/", "tests/hostile/", "tests/pipeline/passes/test_recorded.py")
_STARTED = pytest.StashKey[float]()


def _now() -> float:
    """User and system time of this process and its finished children, workers of a farm included.

    Those are children of multiprocessing's server, which goes on after them.
    """
    own = sum(os.times()[:4])
    server = multiprocessing.forkserver._forkserver._forkserver_pid  # type: ignore[attr-defined]
    if server is None:
        return own
    try:
        return own + sum(psutil.Process(server).cpu_times()[:4])
    except psutil.Error:
        return own


def pytest_report_header() -> str:
    return f"sample of costly tests: PBRNET_TEST_SEED={seed()}; all of them: make check"


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Mark costly tests `slow`, and `check` those that are not in the sample of this run."""
    if set(config.args) - set(config.getini("testpaths")):
        return
    costs: dict[str, float] = json.loads(FILE.read_text())
    taken = set() if config.option.markexpr == "check" else set(sample(costs, seed()))
    for item in items:
        if item.nodeid in costs:
            item.add_marker("slow" if item.nodeid in taken else "check")


def seed() -> str:
    """The seed of the sample: that of the environment, else the commit."""
    git = ["git", "rev-parse", "--short=12", "HEAD"]
    found = subprocess.run(git, cwd=FILE.parent, capture_output=True, text=True)
    return os.environ.get("PBRNET_TEST_SEED") or found.stdout.strip() or "0"


def sample(costs: dict[str, float], seed: str, most: float = SAMPLE) -> Iterator[str]:
    """Yield tests in random order, as many as take `most` seconds together."""
    names = sorted(costs)
    random.Random(seed).shuffle(names)
    for name in names:
        most -= costs[name]
        if most < 0:
            return
        yield name


@pytest.hookimpl(wrapper=True)
def pytest_runtest_protocol(item: pytest.Item) -> Iterator[Any]:
    """Note the time before a test's setup."""
    item.stash[_STARTED] = _now()
    return (yield)


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(item: pytest.Item, call: pytest.CallInfo[None]) -> Iterator[Any]:
    """Add the processor seconds to the report of a test's teardown."""
    report = yield
    if call.when == "teardown":
        report.user_properties.append(("cpu_seconds", round(_now() - item.stash[_STARTED], 2)))
    return report


def pytest_terminal_summary(terminalreporter: Any) -> None:
    """Print the most expensive tests and files, and the total."""
    costs = [
        (tuple(report.nodeid.split("::", 1)), dict(report.user_properties)["cpu_seconds"])
        for report in terminalreporter.stats.get("", ())
        if getattr(report, "when", "") == "teardown"
        and "cpu_seconds" in dict(report.user_properties)
    ]
    if costs:
        terminalreporter.section("processor time")
        for line in summary(costs):
            terminalreporter.write_line(line)


def summary(costs: list[tuple[tuple[str, str], float]], shown: int = SHOWN) -> Iterator[str]:
    """Yield lines on the most expensive tests and files, from (file, test), CPU seconds."""
    files: Counter[str] = Counter()
    tests: Counter[str] = Counter()
    for (file, test), seconds in costs:
        files[file] += seconds  # type: ignore[assignment]
        tests[f"{file}::{test}"] += seconds  # type: ignore[assignment]
    for counter in (tests, files):
        for name, seconds in counter.most_common(shown):
            if seconds >= 0.1:
                yield f"{seconds:8.1f} s  {name}"
        yield ""
    yield f"{sum(files.values()) / 60:8.1f} core-minutes in {len(costs):,} tests"


def kept(file: Path) -> list[tuple[tuple[str, str], float]]:
    """Return (file, test), CPU seconds of the tests in a JUnit XML file."""
    return [
        (_place(case.get("classname", ""), case.get("name", "")), float(one.get("value", 0)))
        for case in defusedxml.ElementTree.parse(file).iter("testcase")
        for one in case.iter("property")
        if one.get("name") == "cpu_seconds"
    ]


def record(costs: list[tuple[tuple[str, str], float]]) -> None:
    """Write the costly tests of a run; those that it left out stay as they were."""
    known: dict[str, float] = json.loads(FILE.read_text()) if FILE.exists() else {}
    known |= {
        "::".join(place): seconds for place, seconds in costs if not place[0].startswith(ALWAYS)
    }
    kept = {name: round(known[name], 1) for name in sorted(known) if known[name] >= COSTLY}
    FILE.write_text(json.dumps(kept, indent=0) + "\n")


def _place(classname: str, name: str) -> tuple[str, str]:
    """Return file and test of a dotted module, a class in it included, and a test's name."""
    *parts, last = classname.split(".")
    if last.startswith("test_"):
        return "/".join([*parts, f"{last}.py"]), name
    return "/".join(parts) + ".py", f"{last}::{name}"


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description="Processor time of tests in the past.")
    parser.add_argument("file", type=Path, help="what pytest --junitxml wrote")
    parser.add_argument("--shown", type=int, default=SHOWN, help="number of tests and of files")
    parser.add_argument("--record", action="store_true", help=f"write {FILE.name}")
    options = parser.parse_args()
    if options.record:
        record(kept(options.file))
    print("\n".join(summary(kept(options.file), options.shown)))
