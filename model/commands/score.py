"""`pbrnet score`: pictures of a list of views against the dataset's truth."""

from __future__ import annotations

from pathlib import Path

import click

from pbrnet.model.benchmark.pictures import Task
from pbrnet.model.benchmark.score import METRICS, ExposureRule, score_folder, table
from pbrnet.model.benchmark.views import load_views, pin_views, save_views
from pbrnet.pipeline.commands.options import FILE, FOLDER
from pbrnet.pipeline.export.rows import DatasetRows
from pbrnet.pipeline.splits import SPLITS
from pbrnet.pipeline.terminal import counted, say, views_of
from pbrnet.scenes.files import write_json


@click.command(
    epilog="""\b
Examples:
  pbrnet score pictures/mine                            colour, test split of data/dataset
  pbrnet score mine other --views recipes/views.json    two methods on a pinned list of views
  pbrnet score mine/albedo --task albedo                albedo estimated from an image
  pbrnet score mine/normals --task normal --out normals.json
  pbrnet score --pin recipes/views.json --count 100     pin a list of 100 test views
  pbrnet predict --all-views --exr --out mine data/scenes/home-0003     makes such images

Files are SCENE--VIEW.exr or .png. seconds.json or seconds.csv beside them gives CPU seconds, and
about.json describes the method. docs/benchmark.md has tasks, formats and rules."""
)
@click.argument("folders", type=FOLDER, nargs=-1, metavar="FOLDER...")
@click.option(
    "--task", type=click.Choice(list(METRICS)), default="color", help="Content of the images."
)
@click.option("--views", "list_file", type=FILE, help="Pinned list of views.")
@click.option(
    "--dataset",
    type=FOLDER,
    default=Path("data/dataset"),
    help="Folder of the dataset with the ground truth.",
)
@click.option(
    "--split",
    type=click.Choice(SPLITS),
    help="Split to score.  [default: test; with --views, the list]",
)
@click.option(
    "--exposure",
    type=click.Choice(["own", "truth"]),
    default="own",
    help="colour, EXR: tone-map each image with its own exposure, or with the ground truth's.",
)
@click.option("--out", type=FILE, help="JSON file of all scores.")
@click.option("--pin", type=FILE, help="Write a pinned list of views instead of scoring.")
@click.option(
    "--count",
    type=click.IntRange(0),
    default=0,
    help="Views to pin, spread evenly over the split; 0: all.",
)
@click.option("--seed", type=int, default=0, help="Seed of the intervals.")
def score(
    folders: tuple[Path, ...],
    task: Task,
    list_file: Path | None,
    dataset: Path,
    split: str | None,
    exposure: ExposureRule,
    out: Path | None,
    pin: Path | None,
    count: int,
    seed: int,
) -> None:
    """Score the images in each FOLDER against the ground truth of a dataset.

    colour: SSIM, PSNR, FLIP, and for linear images the error of the mean in stops; albedo:
    scale-invariant error, whole and in windows; normals: angles. Prints means over views with 95 %
    intervals over scenes, and CPU seconds per view if given.
    """
    if pin is not None:
        rows = DatasetRows(dataset, (split or "test",))
        views = pin_views(rows, count, pin.stem, "1")
        save_views(pin, views)
        say(f"{pin}: {counted(len(views.views), 'view')} of {split or 'test'}")
        return
    if not folders:
        raise click.UsageError("give a FOLDER of images")
    chosen = None if list_file is None else load_views(list_file)
    splits = (split,) if split else (() if chosen else ("test",))
    rows = DatasetRows(dataset, splits)
    scores = [score_folder(folder, rows, chosen, task, exposure) for folder in folders]
    first = scores[0]
    of = f" of the list {chosen.name} {chosen.version}" if chosen else ""
    scenes = len({view.scene_id for view in first.views})
    say(f"{task}: {views_of(len(first.views), scenes)}{of}")
    say(*table(scores, seed))
    if out is not None:
        about = None if chosen is None else {"name": chosen.name, "version": chosen.version}
        write_json(out, {"list": about, "scores": [score.summary(seed) for score in scores]})
        say(f"Written: {out}")
