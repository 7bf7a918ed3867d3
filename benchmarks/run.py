"""`make bench`: every figure of docs/benchmarks.md, measured in one run on one machine.

Writes benchmarks/results.json and docs/benchmarks.md, after every row. About half an
hour on two quiet cores; Blender Cycles is installed into build/bench/ when it is missing, which
takes 370 MB from the package index once, and left out where that cannot be done.
"""

from __future__ import annotations

import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path

import click

from benchmarks.bench import FULL, ROOT, SMALL, Bench
from benchmarks.cycles import cycles_rows
from benchmarks.farm import farm_rows
from benchmarks.published import published_rows
from benchmarks.rendering import render_rows, variant_rows
from benchmarks.results import TITLES, Bystanders, Results, figure
from benchmarks.rows import Row
from benchmarks.shards import shard_rows
from benchmarks.strategies import strategy_rows
from pipeline.render.scene import set_variant

Topic = Callable[[Bench], Iterator[Row]]


@click.command(
    epilog="""\b
Examples:
  python -m benchmarks.run
  python -m benchmarks.run --only shards --only farm
  python -m benchmarks.run --resume"""
)
@click.option("--only", multiple=True, type=click.Choice(list(TITLES)), help="Only this topic.")
@click.option("--resume", is_flag=True, help="Keep complete topics of an earlier run.")
@click.option("--small", is_flag=True, help="Try the program: figures that mean nothing.")
@click.option(
    "--bpy",
    type=click.Path(path_type=Path, exists=True, dir_okay=False),
    help="A Python that has bpy, in place of an environment in build/bench.",
)
@click.option(
    "--out",
    type=click.Path(path_type=Path, file_okay=False),
    help="Folder for results.json and benchmarks.md, in place of the project's own.",
)
def main(
    only: tuple[str, ...], resume: bool, small: bool, bpy: Path | None, out: Path | None
) -> None:
    """Measure, print and write the benchmarks; exit 0 whether or not goals are met."""
    set_variant()
    paths = (ROOT / "benchmarks" / "results.json", ROOT / "docs" / "benchmarks.md")
    if out is not None:
        paths = (out / "results.json", out / "benchmarks.md")
    results = Results(*paths, sizes="small" if small else "full")
    if only or resume:
        results.resume()
    topics: dict[str, Topic] = {
        "render": render_rows,
        "variant": variant_rows,
        "strategies": strategy_rows,
        "farm": farm_rows,
        "shards": shard_rows,
        "cycles": partial(cycles_rows, given=bpy),
        "published": published_rows,
    }
    wanted = [
        name
        for name in topics
        if (not only or name in only) and not (resume and results.complete(name))
    ]
    with tempfile.TemporaryDirectory(prefix="pbrnet-bench-") as folder:
        bench = Bench(Path(folder), SMALL if small else FULL, ROOT / "build" / "bench")
        click.echo("making homes and cameras")
        count = sum(len(views) for views in bench.views.values())
        click.echo(f"{len(bench.views)} homes, {count} views")
        for name in wanted:
            measure(name, topics[name], bench, results)
    click.echo(f"written to {paths[0]} and {paths[1]}")


def measure(name: str, topic: Topic, bench: Bench, results: Results) -> None:
    """Measure a topic; a row is shown and saved as soon as it is there."""
    click.echo(f"\n{TITLES[name]}")
    started, bystanders = time.monotonic(), Bystanders()
    results.begin(name)
    for row in topic(bench):
        results.add(name, row)
        show(row)
    seconds = time.monotonic() - started
    results.end(name, seconds, bystanders.processors(seconds))
    click.echo(f"  {seconds:.0f} s")


def show(row: Row) -> None:
    """One line for the terminal."""
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
