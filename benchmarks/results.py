"""Benchmark results: `results.json`, written after every row, and the page made from it.

An interrupted run leaves the rows it has; both files name the incomplete topics. Topics that a run
does not measure keep the rows of earlier runs. Each topic records the machine, the versions and
the code that it was measured with, and the page states them where they differ between topics.
"""

from __future__ import annotations

import contextlib
import os
import platform
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import psutil

from benchmarks.rows import Row
from benchmarks.timing import now
from pbrnet.pipeline.commands.release import processor
from pbrnet.pipeline.farm.versions import code_version
from pbrnet.pipeline.render.scene import renderer_version
from pbrnet.scenes.errors import InputError
from pbrnet.scenes.files import read_json, write_json, write_text

TITLES = {
    "render": "One view",
    "previews": "Light transport, and pictures of one sample",
    "sets": "Sets of channels",
    "variant": "LLVM against scalar",
    "strategies": "Equal-time error, by scene and strategy",
    "farm": "The ground truth stage",
    "shards": "Shards",
    "formats": "Formats of the dataset's images",
    "cycles": "Against Blender Cycles",
    "budgets": "Every time budget",
    "published": "Beside published figures",
}
_CLOCKS = {"cpu": "processor", "wall": "wall", "": ""}
_HEADER = """# Benchmarks

Written by `make bench`; do not edit this page. Every figure is the median of several repeats, with
the lowest and the highest beside it; the candidates of a comparison run alternately. **Processor**
is the user and system time of all processes and threads, **wall** is elapsed time. Figures without
a unit are ratios. Goals that are missed are listed like the others.
"""


@dataclass
class Results:
    """Rows by topic; `sizes` is "full", or "small" for a trial run."""

    path: Path
    page: Path
    sizes: str
    topics: dict[str, dict[str, Any]] = field(default_factory=dict)

    def load(self) -> None:
        """Read the topics of earlier runs.

        Raises `InputError` if the file is damaged, so that a partial run never replaces it.
        """
        if not self.path.is_file():
            return
        earlier = read_json(self.path)
        if not isinstance(earlier, dict) or not isinstance(earlier.get("topics"), dict):
            raise InputError(f"{self.path}: not a file of benchmark results; remove it")
        before = earlier.get("measured_on")
        self.topics = {
            name: {"measured_on": before, **topic} for name, topic in earlier["topics"].items()
        }

    def complete(self, name: str) -> bool:
        """Return whether a topic has all its rows."""
        return bool(self.topics.get(name, {}).get("complete"))

    def current(self, name: str) -> bool:
        """Return whether a topic is complete and was measured with this machine and code."""
        return self.complete(name) and self.topics[name]["measured_on"] == measured_on(self.sizes)

    def begin(self, name: str) -> None:
        """Start a topic without rows."""
        self.topics[name] = {
            "complete": False,
            "measured_on": measured_on(self.sizes),
            "rows": [],
        }

    def add(self, name: str, row: Row) -> None:
        """Add a row to a topic and write both files."""
        self.topics[name]["rows"].append(row.plain())
        self.save()

    def end(self, name: str, seconds: float, others: float) -> None:
        """Mark a topic complete; `others` is the mean number of processors in use by others."""
        self.topics[name] |= {
            "complete": True,
            "seconds": round(seconds, 1),
            "others_busy": round(others, 2),
        }
        self.save()

    def save(self) -> None:
        """Write the results file and the page."""
        ordered = {name: self.topics[name] for name in TITLES if name in self.topics}
        unfinished = [name for name in TITLES if not self.complete(name)]
        record = {
            "measured_on": measured_on(self.sizes),
            "unfinished": unfinished,
            "topics": ordered,
        }
        write_json(self.path, record)
        write_text(self.page, page_of(record))


def measured_on(sizes: str) -> dict[str, Any]:
    """Return machine, versions and code; results with equal values are comparable."""
    return {
        "cpus": len(os.sched_getaffinity(0)),
        "processor": processor(),
        "memory_gib": round(psutil.virtual_memory().total / 2**30),
        "system": f"{platform.system()} {platform.machine()}",
        "python": platform.python_version(),
        "renderer": renderer_version(),
        "code": code_version(),
        "sizes": sizes,
    }


def page_of(record: dict[str, Any]) -> str:
    """Return `docs/benchmarks.md` as Markdown, from the content of `results.json`."""
    machine = record["measured_on"]
    parts = [_HEADER]
    if record["unfinished"]:
        parts.append(f"**Not complete**: not measured yet: {', '.join(record['unfinished'])}.\n")
    if machine["sizes"] != "full":
        parts.append("**A trial run at small sizes**: its figures mean nothing.\n")
    parts.append(f"{_machine_line(machine)}\n")
    for name, topic in record["topics"].items():
        parts.append(_section(name, topic, machine))
    return "\n".join(parts)


def _machine_line(machine: dict[str, Any]) -> str:
    trial = "" if machine["sizes"] == "full" else " Small sizes."
    return (
        f"Machine: {machine['cpus']} of {machine['processor']}, {machine['memory_gib']} GiB, "
        f"{machine['system']}. Python {machine['python']}; {machine['renderer']}; pbrnet "
        f"{machine['code']}.{trial}"
    )


def _section(name: str, topic: dict[str, Any], machine: dict[str, Any]) -> str:
    lines = [f"## {TITLES[name]}", ""]
    measured = topic.get("measured_on") or machine
    if measured != machine:
        lines += [f"Measured by another run. {_machine_line(measured)}", ""]
    if topic["complete"]:
        lines.append(
            f"Took {topic['seconds']:.0f} s; other programs used {topic['others_busy']:.1f} "
            "processors meanwhile."
        )
    else:
        lines.append("Not complete.")
    lines += ["", "| row | figure | range | clock | goal |", "|---|---:|---:|---|---|"]
    lines += [_line(row) for row in topic["rows"]]
    lines.append("")
    lines += [f"- **{row['name']}**: {row['meaning']}." for row in _by_meaning(topic["rows"])]
    return "\n".join([*lines, ""])


def _line(row: dict[str, Any]) -> str:
    goal = row.get("goal", "")
    if "missing" in row:
        return f"| {row['name']} | not measured: {row['missing']} | | | {goal} |"
    if goal:
        goal = f"{goal}, {'met' if row['met'] else '**missed**'}"
    value, low, high = (figure(row[key], row["unit"]) for key in ("value", "low", "high"))
    between = f"{low} to {high}" if row["repeats"] > 1 else ""
    return f"| {row['name']} | {value} | {between} | {_CLOCKS[row.get('clock', '')]} | {goal} |"


def _by_meaning(rows: Sequence[dict[str, Any]]) -> list[dict[str, Any]]:
    """Return the first row of each meaning."""
    first: dict[str, dict[str, Any]] = {}
    for row in rows:
        first.setdefault(row["meaning"], row)
    return list(first.values())


def figure(value: float, unit: str) -> str:
    """Format a figure with three significant digits and its unit."""
    digits = f"{value:.3g}" if abs(value) < 1000 else f"{value:,.0f}"
    return digits if unit == "x" else f"{digits} {unit}".replace(" /", "/")


class OtherLoad:
    """Processor time that other programs use from the creation of this object on.

    Not this process, its children and their children, ended or not.
    """

    def __init__(self) -> None:
        self.busy, self.own = self._read()

    def processors(self, wall: float) -> float:
        """Return their mean number of busy processors over the `wall` seconds since then."""
        busy, own = self._read()
        return max(0.0, (busy - self.busy) - (own - self.own)) / max(wall, 1e-9)

    @staticmethod
    def _read() -> tuple[float, float]:
        times = psutil.cpu_times()
        busy = sum(
            getattr(times, name, 0.0) for name in ("user", "nice", "system", "irq", "softirq")
        )
        running = 0.0
        for child in psutil.Process().children(recursive=True):
            with contextlib.suppress(psutil.Error):  # ended meanwhile
                running += sum(child.cpu_times()[:4])
        return busy, now().cpu + running
