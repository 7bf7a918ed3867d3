"""`pbrnet study generalisation`: scenes of another source, before and after fine-tuning."""

from __future__ import annotations

from pathlib import Path

import click

from model.studies.generalisation.study import TUNING_VIEWS, Other, generalisation_study, prepare
from model.studies.trials.options import FOLDER, carry_out, trial_options
from model.studies.trials.plan import Wish
from model.training.train import Folders
from pipeline.params import Params


@click.command(
    epilog="""\b
Examples:
  pbrnet study generalisation --other better/data --dry-run
  pbrnet study generalisation --other better/data --views 128 --steps 4000
  pbrnet study generalisation --source 'villa-*' --seeds 3

Tuning takes whole floor plans of the source, drawn by lot, at most half of them; the others are
tested on. Stopped, the same command goes on where it was. Packs the source's views below
DATA/studies/generalisation, also in a dry run. Writes metrics/studies/generalisation.json and
.png."""
)
@click.option(
    "--other",
    type=FOLDER,
    default=None,
    help="Data folder whose dataset is the other source.  [default: DATA, with --source]",
)
@click.option(
    "--source",
    "pattern",
    default=None,
    help="Its floor plans, or scenes of them, as 'villa-*'; those of DATA are not trained on.",
)
@click.option(
    "--views",
    type=click.IntRange(1),
    default=TUNING_VIEWS,
    show_default=True,
    help="Views of the source to fine-tune on.",
)
@click.option(
    "--tuning-steps",
    type=click.IntRange(1),
    default=None,
    help="Steps of the fine-tuning of each network.  [default: a quarter of the training's]",
)
@trial_options()
def generalisation(
    params: Params,
    data: Path,
    models: Path,
    other: Path | None,
    pattern: str | None,
    views: int,
    tuning_steps: int | None,
    dry_run: bool,
    seeds: int,
    steps: int | None,
) -> None:
    """Meet another source, then tune on it (Figures 14, 15).

    What is glossy is measured apart from the rest.
    """
    if other is None and pattern is None:
        raise click.UsageError("say which source: --other FOLDER, --source PATTERN, or both")
    if other is not None and pattern is None and other.resolve() == data.resolve():
        raise click.UsageError(f"--other {other} is DATA itself; name plans of it with --source")
    source = Other(other or data, pattern or "*")
    folders = Folders.beside(data, models, models)
    packs = data / "studies" / "generalisation"
    made = prepare(params, folders, source, Wish(seeds, steps), views, tuning_steps, packs)
    study = generalisation_study()
    carry_out(study, params, made.folders, made.trials, dry_run, notes=made.notes)
