"""Rows about what comes before the samples: the start of a process, and that of a home in a run."""

from __future__ import annotations

import json
import shutil
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory

from benchmarks.bench import Bench, kernels_below, python
from benchmarks.rows import Row, at_most
from benchmarks.timing import Spent, Spread, spend, spread
from pbrnet.pipeline.views import load_cameras


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
    fixed = _home_in_a_run(bench)
    yield Row(
        "a home in a run",
        "what a home takes in `pbrnet run` beside its views: cameras, opening, recording, first "
        "launches; from runs with one view and with up to five per home, kernels on disk, the "
        "start of processes included",
        Spread(fixed, fixed, fixed, 1),
        "s",
        "cpu",
        goal=at_most(5),
    )


def _home_in_a_run(bench: Bench) -> float:
    """Return the CPU seconds of a run that grow with its homes and not with its views, per home."""
    counts, seconds = list[int](), list[float]()
    homes = 2 * bench.sizes.homes
    with TemporaryDirectory(prefix="pbrnet-bench-run-") as folder:
        made = Path(folder, "scenes")
        for repeat, most in (("a", 1), ("a", 5), ("b", 1), ("b", 5)):  # the first two compile
            data, params = Path(folder, f"{repeat}{most}"), Path(folder, f"{most}.yaml")
            words = {"scenes": {"homes": homes}, "cameras": {"views_per_scene": most}}
            params.write_text(json.dumps(words))
            command = ("-m", "pbrnet.pipeline.cli")
            options = ("--params", str(params), "--data", str(data), "--workers", "1")
            if not made.exists():
                python(*command, "scenes", *options)
                (data / "scenes").rename(made)
            shutil.copytree(made, data / "scenes")
            spent = spend(partial(python, *command, "run", *options))
            if repeat == "b":
                files = (data / "cameras").glob("*.json")
                counts.append(sum(len(load_cameras(file).views) for file in files))
                seconds.append(spent.cpu)
    view = (seconds[1] - seconds[0]) / (counts[1] - counts[0])
    return (seconds[0] - counts[0] * view) / homes


def _picture(bench: Bench, home: str) -> None:
    """Predict a view with Dr.Jit's kernels below the folder `home`."""
    view = bench.views[bench.home][0]
    with kernels_below(home):
        python(
            *("-m", "pbrnet.pipeline.cli", "predict", str(bench.data / "scenes" / bench.home)),
            *("--view", view.view_id, "--method", "radiosity", "--data", str(bench.data)),
            *("--params", str(bench.parameters), "--out", f"{home}/picture.png"),
        )
