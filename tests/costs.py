"""Processor seconds of tests: a pytest plugin that prints where the time of a run went.

Each test's user and system time, its setup and its finished child processes included, is kept
with its report: `--junitxml` writes it as the property `cpu_seconds`. At the end of a run the
twenty most expensive tests and the total are printed.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from typing import Any

import pytest

SHOWN = 20
_STARTED = pytest.StashKey[float]()


def _now() -> float:
    return sum(os.times()[:4])  # user and system, of this process and its finished children


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
    """Print the most expensive tests and the total."""
    costs = [
        (dict(report.user_properties)["cpu_seconds"], report.nodeid)
        for report in terminalreporter.stats.get("", ())
        if getattr(report, "when", "") == "teardown"
        and "cpu_seconds" in dict(report.user_properties)
    ]
    if not costs:
        return
    total = sum(seconds for seconds, _ in costs)
    terminalreporter.section(f"{total / 60:.1f} core-minutes in {len(costs):,} tests; the most")
    for seconds, name in sorted(costs, reverse=True)[:SHOWN]:
        terminalreporter.write_line(f"{seconds:8.1f} s  {name}")
