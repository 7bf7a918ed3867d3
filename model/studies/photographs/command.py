"""`pbrnet study photographs`."""

from __future__ import annotations

from functools import partial
from pathlib import Path

import click

from pbrnet.model.studies.photographs.results import FILE, lines
from pbrnet.model.studies.photographs.rows import check_rows, parse_row, read_rows
from pbrnet.model.studies.photographs.study import PhotographConfig, PhotographStudy
from pbrnet.pipeline.commands.options import FILE as A_FILE
from pbrnet.pipeline.commands.options import FOLDER, PATH
from pbrnet.pipeline.terminal import say


@click.command(
    "photographs",
    epilog="""\b
Examples:
  pbrnet study photographs nyu_depth_v2_labeled.mat --row ours=data
  pbrnet study photographs photos --row real=photos --row ours=data --seeds 3
  pbrnet study photographs photos --row "ours, then real=data:photos"
  pbrnet study photographs photos --row "50 views=data@50" --row "both=data,photos"
  pbrnet study photographs photos --rows rows.yaml --dry-run

PHOTOGRAPHS and SET are nyu_depth_v2_labeled.mat with splits.mat beside it, a folder with rgb,
depth (PNG, millimetres) and intrinsics.json, Hypersim's folder, or a packed dataset; see
docs/photographs.md. Sets after a comma are mixed, those after a colon follow. Finished trainings
are kept. Writes metrics/photographs.json and its plots; the best, median and worst photographs
are in the working folder.""",
)
@click.argument("photographs", type=PATH)
@click.option(
    "--row",
    "texts",
    multiple=True,
    metavar="NAME=SET[,SET][:SET]",
    help="Train on these sets, or with SET@N on N of its pictures (repeatable).",
)
@click.option("--rows", "file", type=A_FILE, help="YAML list of rows: name, train, varied.")
@click.option(
    "--steps", type=click.IntRange(1), default=1500, show_default=True, help="Steps of each row."
)
@click.option(
    "--seeds",
    type=click.IntRange(1, 100),
    default=3,
    show_default=True,
    help="Trainings of each row.",
)
@click.option("--reference", metavar="NAME", help="Row to compare with.  [default: the first]")
@click.option(
    "--work",
    type=FOLDER,
    default=Path("data/studies/photographs"),
    show_default=True,
    help="Folder of trainings.",
)
@click.option("--metrics", type=FOLDER, default=Path("metrics"), help="Folder of the results.")
@click.option("--dry-run", is_flag=True, help="Only describe the sets and list the trainings.")
@click.option("--seed", type=int, default=0, show_default=True, help="Root seed.")
def command(
    photographs: Path,
    texts: tuple[str, ...],
    file: Path | None,
    steps: int,
    seeds: int,
    reference: str | None,
    work: Path,
    metrics: Path,
    dry_run: bool,
    seed: int,
) -> None:
    """Train the same network on different sets, and test it on real photographs.

    The network predicts depth in metres, normals and classes of NYU40. All rows have the same
    steps, schedule and focal length, and differ only in their training data.
    """
    rows = (*map(parse_row, texts), *(read_rows(file) if file else ()))
    config = PhotographConfig(
        rows=rows,
        photographs=photographs,
        work=work,
        metrics=metrics,
        steps=steps,
        seeds=seeds,
        root=seed,
        reference=check_rows(rows, reference),
    )
    study = PhotographStudy(config, log=partial(say, err=True))
    if dry_run:
        for line in study.survey():
            say(line)
        return
    for line in lines(study.run()):
        say(line)
    say(f"{metrics / FILE}: all figures; pictures are in {config.work}")
