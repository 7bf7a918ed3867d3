"""Rows about the start of a process: a first picture, with and without kernels on disk."""

from __future__ import annotations

import os
from collections.abc import Iterator
from functools import partial
from tempfile import TemporaryDirectory

from benchmarks.bench import Bench, python
from benchmarks.rows import Row, at_most
from benchmarks.timing import Spent, spend, spread


def startup_rows(bench: Bench) -> Iterator[Row]:
    """Yield what one picture by `predict --method radiosity` takes in a process of its own."""
    cold, warm = list[Spent](), list[Spent]()
    for _ in range(bench.sizes.processes):
        with TemporaryDirectory(prefix="pbrnet-bench-home-") as home:
            cold.append(spend(partial(_picture, bench, home)))
            warm.append(spend(partial(_picture, bench, home)))
    what = "one view of a home by `predict --method radiosity`, 160x120, in a process of its own"
    for name, words, spent, goal in (
        ("first picture, kernels on disk", f"{what}, after another", warm, 6.0),
        ("first picture", f"{what}, that compiles all kernels", cold, 20.0),
    ):
        seconds = spread([each.cpu for each in spent])
        yield Row(name, words, seconds, "s", "cpu", goal=at_most(goal))


def _picture(bench: Bench, home: str) -> None:
    """Predict a view with Dr.Jit's kernels below the folder `home`."""
    view = bench.views[bench.home][0]
    before = os.environ.get("HOME", "")
    os.environ["HOME"] = home  # Dr.Jit keeps kernels in ~/.drjit
    try:
        python(
            *("-m", "pbrnet.pipeline.cli", "predict", str(bench.data / "scenes" / bench.home)),
            *("--view", view.view_id, "--method", "radiosity", "--data", str(bench.data)),
            *("--params", str(bench.parameters), "--out", f"{home}/picture.png"),
        )
    finally:
        os.environ["HOME"] = before
