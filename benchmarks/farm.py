"""Rows about the ground truth stage as a whole: workers, files and start-up included.

Complete processes are compared, including scene loading and compilation. The baseline is a plain
loop over the views in one process with all threads.
"""

from __future__ import annotations

import os
import shutil
from collections.abc import Iterator
from functools import partial

from benchmarks.bench import Bench, python
from benchmarks.rows import Row, at_least, at_most
from benchmarks.timing import by_turns, ratio
from pbrnet.pipeline.pathtrace import integrator


def farm_rows(bench: Bench) -> Iterator[Row]:
    """Yield the overhead over the plain loops and the speed-up with a second worker."""
    count = sum(len(views) for views in bench.views.values())
    truth = bench.params.groundtruth
    size = f"{count} views of {len(bench.views)} homes, 160x120, {truth.spp} spp"
    loop = ("-m", "benchmarks.plain_loop", str(bench.data), str(bench.parameters))
    ways = {
        "plain": partial(python, *loop),
        "two": partial(_stage, bench, 2),
        "one": partial(_stage, bench, 1),
    }
    if integrator.available():
        ways["joint"] = partial(python, *loop, "--joint")
    spent = by_turns(ways, bench.sizes.processes, warm=False)
    yield Row(
        "ground truth stage / plain loop",
        f"the stage with two workers against `mi.render` over the views, colour and then shading; "
        f"{size}",
        ratio(spent["two"], spent["plain"], "wall"),
        clock="wall",
        goal=at_most(1.05),
    )
    if "joint" in spent:
        for clock in ("wall", "cpu"):
            yield Row(
                f"ground truth stage / joint loop ({clock})",
                "the stage's own overhead: against a loop that renders the same joint traces and "
                "keeps nothing",
                ratio(spent["two"], spent["joint"], clock),
                clock=clock,
                goal=at_most(1.05) if clock == "wall" else None,
            )
    yield Row(
        "two workers / one",
        "how many times as fast the stage is with two workers on two processors as with one on "
        f"one; {size}",
        ratio(spent["one"], spent["two"], "wall"),
        clock="wall",
        goal=at_least(1.9),
    )


def _stage(bench: Bench, workers: int) -> None:
    """Run the stage from scratch with a number of one-thread workers on as many processors."""
    for kind in ("shading", "color"):
        shutil.rmtree(bench.data / kind, ignore_errors=True)
    where = ("--params", str(bench.parameters), "--data", str(bench.data))
    allowed = os.sched_getaffinity(0)
    os.sched_setaffinity(0, sorted(allowed)[:workers])  # children inherit it
    try:
        python("-m", "pbrnet.pipeline.cli", "groundtruth", "--workers", str(workers), *where)
    finally:
        os.sched_setaffinity(0, allowed)
