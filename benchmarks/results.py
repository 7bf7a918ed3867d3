"""The results: `results.json`, written after every row, and the page made from it.

A run that is interrupted leaves what it has; topics that are not complete are named as such in
both files. Topics that were measured on another machine, with other versions or other code than
this run's are not kept beside its own.
"""

from __future__ import annotations

import os
import platform
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import psutil

from benchmarks.rows import Row
from benchmarks.timing import now
from pipeline.render.scene import renderer_version
from pipeline.versions import code_version
from scenes.errors import InputError
from scenes.files import read_json, write_json, write_text

TITLES = {
    "render": "One view",
    "variant": "LLVM against scalar",
    "strategies": "Equal-time error, by scene and strategy",
    "farm": "The ground truth stage",
    "shards": "Shards",
    "cycles": "Against Blender Cycles",
    "published": "Beside published figures",
}
_CLOCKS = {"cpu": "processor", "wall": "wall", "": ""}
_HEADER = """# Benchmarks

Written by `make bench`, which measures everything on this page in one run; edit nothing here.
Every figure is the median of repeats by turns (what is compared runs one after the other, again and
again), with the lowest and the highest beside it. **Processor** is user and system time of all
processes and threads, **wall** is what a waiting person feels. Ratios (x) are better or worse
than 1 as their goals say; a goal that is missed stands as it is.
"""


@dataclass
class Results:
    """What is measured so far; `sizes` says how much work a row was."""

    path: Path
    page: Path
    sizes: str
    topics: dict[str, dict[str, Any]] = field(default_factory=dict)

    def resume(self) -> None:
        """Take over the topics of an earlier run of the same kind."""
        if not self.path.is_file():
            return
        try:
            earlier = read_json(self.path)
        except InputError:
            return  # unreadable: measured anew
        if isinstance(earlier, dict) and earlier.get("measured_on") == measured_on(self.sizes):
            self.topics = dict(earlier["topics"])

    def complete(self, name: str) -> bool:
        """Whether a topic has all its rows."""
        return bool(self.topics.get(name, {}).get("complete"))

    def begin(self, name: str) -> None:
        """Start a topic anew."""
        self.topics[name] = {"complete": False, "rows": []}

    def add(self, name: str, row: Row) -> None:
        """A further row of a topic."""
        self.topics[name]["rows"].append(row.plain())
        self.save()

    def end(self, name: str, seconds: float, others: float) -> None:
        """A topic is complete; `others` is how many processors other programs kept busy."""
        self.topics[name] |= {
            "complete": True,
            "seconds": round(seconds, 1),
            "others_busy": round(others, 2),
        }
        self.save()

    def save(self) -> None:
        """Write both files."""
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
    """The machine, the versions and the code: results are comparable where these are equal."""
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


def processor() -> str:
    """The processor's name where the system tells it."""
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        return platform.machine()
    names = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return names[0] if names else platform.machine()


def page_of(record: dict[str, Any]) -> str:
    """`docs/benchmarks.md`, from what is in `results.json`."""
    machine = record["measured_on"]
    parts = [_HEADER]
    if record["unfinished"]:
        parts.append(f"**Not complete**: {', '.join(record['unfinished'])} still to be measured.\n")
    if machine["sizes"] != "full":
        parts.append("**A trial run at small sizes**: its figures mean nothing.\n")
    parts.append(
        f"Machine: {machine['cpus']} of {machine['processor']}, {machine['memory_gib']} GiB, "
        f"{machine['system']}. Python {machine['python']}; {machine['renderer']}; pbrnet "
        f"{machine['code']}.\n"
    )
    for name, topic in record["topics"].items():
        parts.append(_section(name, topic))
    return "\n".join(parts)


def _section(name: str, topic: dict[str, Any]) -> str:
    lines = [f"## {TITLES[name]}", ""]
    if topic["complete"]:
        lines.append(
            f"{topic['seconds']:.0f} s; other programs kept {topic['others_busy']:.1f} processors "
            "busy meanwhile."
        )
    else:
        lines.append("Not complete.")
    lines += ["", "| row | figure | range | clock | goal |", "|---|---:|---:|---|---|"]
    lines += [_line(row) for row in topic["rows"]]
    lines.append("")
    lines += [f"- **{row['name']}**: {row['meaning']}." for row in _told_once(topic["rows"])]
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


def _told_once(rows: Sequence[dict[str, Any]]) -> list[dict[str, Any]]:
    """The first row of each meaning."""
    first: dict[str, dict[str, Any]] = {}
    for row in rows:
        first.setdefault(row["meaning"], row)
    return list(first.values())


def figure(value: float, unit: str) -> str:
    """A figure to three digits, with its unit."""
    digits = f"{value:.3g}" if abs(value) < 1000 else f"{value:,.0f}"
    return digits if unit == "x" else f"{digits} {unit}".replace(" /", "/")


class Bystanders:
    """How many processors other programs keep busy, from here on."""

    def __init__(self) -> None:
        self.busy, self.ours = self._read()

    def processors(self, wall: float) -> float:
        """Their mean over the `wall` seconds since."""
        busy, ours = self._read()
        return max(0.0, (busy - self.busy) - (ours - self.ours)) / max(wall, 1e-9)

    @staticmethod
    def _read() -> tuple[float, float]:
        times = psutil.cpu_times()
        busy = sum(
            getattr(times, name, 0.0) for name in ("user", "nice", "system", "irq", "softirq")
        )
        return busy, now().cpu
