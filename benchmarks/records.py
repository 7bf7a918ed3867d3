"""Records that depend on the pixels of the renderer: `make records`, after a change of them.

Makes the releases of `recipes/` and records their checksums and costs, renews the sample of
`examples/sample`, pins the views of the open benchmark and scores this project's methods on them,
and forecasts the release `indoor-75k` from the cost of views in two sizes, for which the machine
should be quiet. The smallest release is deleted and made again, which must give the recorded
checksums. Releases whose frames are still right are not rendered again. Afterwards
`python docs/generate.py` writes the tables.
"""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
import time
from collections.abc import Sequence
from pathlib import Path

import click

from benchmarks.submissions import submissions
from pbrnet.model.benchmark.pictures import Task
from pbrnet.model.benchmark.score import METRICS, score_folder, table
from pbrnet.model.benchmark.views import pin_views, save_views
from pbrnet.pipeline.export.rows import DatasetRows
from pbrnet.pipeline.farm.versions import processor
from pbrnet.pipeline.release.recipe import load_recipe, load_record
from pbrnet.scenes.files import write_json
from pbrnet.scenes.installation import IMPORT_FOLDER as ROOT

TOPICS = ("tiny", "quick", "sample", "benchmark", "plan")
PLANNED = "indoor-75k"
_PLAN = ("plan-small", "plan-large")
_AGAIN = "tiny"


@click.command(
    epilog="""\b
Examples:
  python -m benchmarks.records
  python -m benchmarks.records --only tiny --only benchmark"""
)
@click.option(
    "--only", multiple=True, type=click.Choice(TOPICS), help="Only this topic; repeatable."
)
@click.option(
    "--recipes",
    type=click.Path(path_type=Path, exists=True, file_okay=False),
    default=Path("recipes"),
    show_default=True,
    help="Folder of the recipes, for trials of others of the same names.",
)
@click.option(
    "--out",
    type=click.Path(path_type=Path, file_okay=False),
    default=Path("data/releases"),
    show_default=True,
    help="Folder of the releases.",
)
@click.option("--workers", type=int, help="Worker processes.")
def main(only: tuple[str, ...], recipes: Path, out: Path, workers: int | None) -> None:
    """Renew checksums of releases, the sample, the benchmark's views and rows, and the plan."""
    own = recipes.resolve() == (ROOT / "recipes").resolve()
    tables = ROOT / "docs" / "data" if own else out
    spent, done = {}, []
    for topic in only or TOPICS:
        start = time.monotonic()
        for name in _PLAN if topic == "plan" else (topic,):
            _release(name, out / name, recipes, workers, "--record")
            done.append(name)
        folder = out / topic
        if topic == _AGAIN:
            shutil.rmtree(folder)
            _release(topic, folder, recipes, workers)
        if topic == "sample" and own:
            _renew(ROOT / "examples" / "sample", folder / "dataset")
        if topic == "benchmark":
            _score(folder, recipes, tables / "benchmark.json")
        if topic == "plan":
            _forecast([out / name for name in _PLAN], tables / "plan.json")
        spent[topic] = time.monotonic() - start
    for topic, seconds in spent.items():
        click.echo(f"{topic:10} {seconds:6.0f} s")
    for name in done:
        record = load_record(name, recipes)
        assert record is not None
        click.echo(
            f"{name:10} {60 * record.core_hours:5.1f} core-minutes of stages, "
            f"{record.rows} rows, {record.bytes / 1e6:.1f} MB"
        )


def _release(name: str, folder: Path, recipes: Path, workers: int | None, *options: str) -> None:
    """Make a release in a process of its own; its failure ends this one."""
    command = [sys.executable, "-m", "pbrnet.pipeline.cli", "release", name, *options]
    command += ["--out", str(folder), "--recipes", str(recipes)]
    command += [] if workers is None else ["--workers", str(workers)]
    if subprocess.run(command).returncode:
        raise click.ClickException(f"release {name} failed")


def _renew(sample: Path, dataset: Path) -> None:
    """Replace the files of the sample."""
    for path in sample.iterdir():
        path.unlink()
    for path in sorted(dataset.iterdir()):
        shutil.copyfile(path, sample / path.name)


def _forecast(measured: Sequence[Path], out: Path) -> None:
    """Write what the planned release would cost, from the ledgers of these folders."""
    first, *others = map(str, measured)
    command = [sys.executable, "-m", "pbrnet.pipeline.cli", "cost", "--json", "--recipe", PLANNED]
    command += ["--data", first, *(word for other in others for word in ("--also", other))]
    found = json.loads(subprocess.run(command, check=True, capture_output=True, text=True).stdout)
    write_json(out, {"recipe": PLANNED, "machine": processor(), **found})
    click.echo(f"{PLANNED}: {found['core_hours']:,.0f} core-hours")


def _score(folder: Path, recipes: Path, out: Path) -> None:
    """Pin all views of the release, and score the methods on them."""
    dataset, recipe = folder / "dataset", load_recipe("benchmark", recipes)
    rows = DatasetRows(dataset, ("test",))
    views = pin_views(rows, 0, "benchmark", recipe.version)
    save_views(recipes / "views.json", views)
    found: dict[Task, list[dict[str, object]]] = {}
    for task, folders in submissions(dataset, folder, views, folder / "submissions").items():
        scores = [score_folder(one, rows, views, task) for one in folders]
        click.echo(f"{task}\n{chr(10).join(table(scores))}")
        for score in scores:
            summary = score.summary()
            kept = ("name", "about", "task", "metrics", "seconds")
            found.setdefault(task, []).append({key: summary[key] for key in kept})
    scenes = len({view.scene_id for view in views.views})
    head = {"version": views.version, "views": len(views.views), "scenes": scenes}
    write_json(out, {**head, "tasks": {task: found[task] for task in METRICS}})


if __name__ == "__main__":
    main()
