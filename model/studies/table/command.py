"""`pbrnet study table`."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from pbrnet.model.methods import BASELINES
from pbrnet.model.studies.table.study import table_study
from pbrnet.model.studies.trials.options import run_study, trial_options, views_option
from pbrnet.pipeline.params import Params


@click.command(
    "table",
    epilog="""\b
Examples:
  pbrnet study table --dry-run
  pbrnet study table --steps 2000 --views 200       train.baselines, three trainings of each
  pbrnet study table --method unet --method can_own --method plus

An interrupted study resumes when the command is run again. Writes metrics/studies/table.json and
table.png.""",
)
@click.option(
    "--method",
    "methods",
    type=click.Choice(BASELINES),
    multiple=True,
    help="A method to compare with; repeatable.  [default: train.baselines]",
)
@views_option
@trial_options(seeds=3)
def command(
    params: Params,
    data: Path,
    models: Path,
    methods: tuple[str, ...],
    **options: Any,
) -> None:
    """Train all methods alike and compare them (Table I).

    All methods get the same views and steps, and are trained several times. Intervals tell how much
    other test scenes would change a mean, the spread how much another training would.
    """
    run_study(table_study(methods or params.train.baselines), params, data, models, **options)
