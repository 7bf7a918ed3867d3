"""`pbrnet study generalisation`."""

from __future__ import annotations

from pathlib import Path

import click

from pbrnet.model.options import FOLDER
from pbrnet.model.studies.generalisation.study import (
    TUNING_VIEWS,
    OtherSource,
    generalisation_study,
    prepare,
)
from pbrnet.model.studies.trials.options import run_or_list, trial_options
from pbrnet.model.studies.trials.plan import TrialConfig
from pbrnet.model.training.train import Folders
from pbrnet.pipeline.params import Params


@click.command(
    "generalisation",
    epilog="""\b
Examples:
  pbrnet study generalisation --other better/data --dry-run
  pbrnet study generalisation --other better/data --views 128 --steps 4000
  pbrnet study generalisation --source 'villa-*' --seeds 3

Fine-tuning uses whole floor plans of the source, chosen at random, at most half of them; the others
are the test set. An interrupted study resumes when the command is run again. The source's views are
packed below DATA/studies/generalisation, also in a dry run. Writes
metrics/studies/generalisation.json and generalisation.png.""",
)
@click.option(
    "--other",
    type=FOLDER,
    default=None,
    help="Data folder of the other source.  [default: DATA, with --source]",
)
@click.option(
    "--source",
    "pattern",
    default=None,
    help="Floor plans or scenes of the source, as 'villa-*'; left out of the training on DATA.",
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
    help="Fine-tuning steps of each network.  [default: a quarter of the training steps]",
)
@trial_options()
def command(
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
    """Test on another source, then fine-tune on it (Figures 14, 15).

    Specular and matte pixels are measured separately, too.
    """
    if other is None and pattern is None:
        raise click.UsageError("name the other source: --other FOLDER, --source PATTERN, or both")
    if other is not None and pattern is None and other.resolve() == data.resolve():
        raise click.UsageError(
            f"--other {other} is DATA itself; select floor plans of it with --source"
        )
    source = OtherSource(other or data, pattern or "*")
    folders = Folders.beside(data, models, models)
    packs = data / "studies" / "generalisation"
    made = prepare(params, folders, source, TrialConfig(seeds, steps), views, tuning_steps, packs)
    study = generalisation_study()
    run_or_list(study, params, made.folders, made.trials, dry_run, notes=made.notes)
