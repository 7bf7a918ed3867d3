"""Benchmarks of docs/benchmarks.md: `make bench`, or `python -m benchmarks.run`.

Writes benchmarks/results.json and docs/benchmarks.md after every row; the topic `budgets` also
docs/data/budgets.json and two pictures, for docs/results.md. All topics but `budgets`, which takes
hours, take about an hour on two idle cores. Blender Cycles is installed into build/bench/ if it is
missing (a download of 370 MB); its topics are skipped where that fails.
"""

from __future__ import annotations

import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import click

from benchmarks.bench import FULL, ROOT, SMALL, Bench
from benchmarks.budgets import budget_rows
from benchmarks.cycles import cycles_rows
from benchmarks.farm import farm_rows
from benchmarks.formats import format_rows
from benchmarks.previews import preview_rows
from benchmarks.published import published_rows
from benchmarks.rendering import render_rows, variant_rows
from benchmarks.results import TITLES, OtherLoad, Results, figure
from benchmarks.rows import Row, missing
from benchmarks.sets import set_rows
from benchmarks.shards import shard_rows
from benchmarks.startup import startup_rows
from benchmarks.strategies import strategy_rows
from pbrnet.pipeline.pathtrace import integrator
from pbrnet.pipeline.render.scene import set_variant


@dataclass(frozen=True)
class Topic:
    """A topic: what yields its rows, and whether these need traces of colour and shading at once.

    Joint traces are not in scalar variants.
    """

    rows: Callable[[Bench], Iterator[Row]]
    joint: bool = True


TOPICS = {
    "render": Topic(render_rows),
    "previews": Topic(preview_rows),
    "sets": Topic(set_rows),
    "variant": Topic(variant_rows, joint=False),
    "strategies": Topic(strategy_rows),
    "farm": Topic(farm_rows, joint=False),
    "startup": Topic(startup_rows),
    "shards": Topic(shard_rows, joint=False),
    "formats": Topic(format_rows, joint=False),
    "cycles": Topic(cycles_rows),
    "budgets": Topic(budget_rows),
    "published": Topic(published_rows),
}


@click.command(
    epilog="""\b
Examples:
  python -m benchmarks.run
  python -m benchmarks.run --only shards --only farm
  python -m benchmarks.run --resume"""
)
@click.option(
    "--only",
    multiple=True,
    type=click.Choice(list(TITLES)),
    help="Measure only this topic and keep the rows of the others; may be repeated.",
)
@click.option(
    "--resume", is_flag=True, help="Skip topics that are complete for this code and machine."
)
@click.option("--small", is_flag=True, help="Trial run at small sizes; its figures mean nothing.")
@click.option(
    "--bpy",
    type=click.Path(path_type=Path, exists=True, dir_okay=False),
    help="Python interpreter with bpy, instead of an environment in build/bench.",
)
@click.option(
    "--out",
    type=click.Path(path_type=Path, file_okay=False),
    help="Folder for what is written, instead of benchmarks/ and docs/.",
)
def main(
    only: tuple[str, ...], resume: bool, small: bool, bpy: Path | None, out: Path | None
) -> None:
    """Measure the benchmarks, print them and write results.json and the page.

    The exit code is 0 whether or not goals are met.
    """
    set_variant()
    paths = (ROOT / "benchmarks" / "results.json", ROOT / "docs" / "benchmarks.md")
    docs = ROOT / "docs"
    if out is not None:
        paths, docs = (out / "results.json", out / "benchmarks.md"), out
    results = Results(*paths, sizes="small" if small else "full")
    if only or resume:
        results.load()
    wanted = [
        name
        for name in TOPICS
        if (not only or name in only) and not (resume and results.current(name))
    ]
    with tempfile.TemporaryDirectory(prefix="pbrnet-bench-") as folder:
        sizes = SMALL if small else FULL
        bench = Bench(Path(folder), sizes, ROOT / "build" / "bench", bpy, docs)
        click.echo("Making homes and cameras")
        count = sum(len(views) for views in bench.views.values())
        click.echo(f"{len(bench.views)} homes, {count} views")
        for name in wanted:
            measure(name, TOPICS[name], bench, results)
    click.echo(f"\nWritten: {paths[0]}, {paths[1]}")


def measure(name: str, topic: Topic, bench: Bench, results: Results) -> None:
    """Measure a topic; print and save each row as soon as it is measured."""
    click.echo(f"\n{TITLES[name]}")
    started, others = time.monotonic(), OtherLoad()
    results.begin(name)
    known = not topic.joint or integrator.available()
    why = "joint traces are not in scalar variants"
    for row in topic.rows(bench) if known else (missing(TITLES[name], "all rows", why),):
        results.add(name, row)
        show(row)
    seconds = time.monotonic() - started
    results.end(name, seconds, others.processors(seconds))
    click.echo(f"  {seconds:.0f} s")


def show(row: Row) -> None:
    """Print a row as one line."""
    if row.spread is None:
        click.echo(f"  {row.name:44} not measured: {row.missing}")
        return
    value, low, high = (
        figure(each, row.unit) for each in (row.spread.value, row.spread.low, row.spread.high)
    )
    click.echo(f"  {row.name:44} {value:>10}  ({low} to {high})  {row.verdict}")
    sys.stdout.flush()


if __name__ == "__main__":
    main()
