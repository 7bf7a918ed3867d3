"""Options and execution that the commands of the training studies share."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import click

from pbrnet.model.options import FOLDER
from pbrnet.model.studies.trials.plan import Trial, TrialConfig, TrialStudy, plan
from pbrnet.model.studies.trials.summary import run_and_summarise
from pbrnet.model.studies.trials.tables import plan_lines, result_lines
from pbrnet.model.training.train import Folders
from pbrnet.pipeline.commands.options import common_options
from pbrnet.pipeline.params import Params

Command = Callable[..., Any]


def trial_options(seeds: int = 1) -> Callable[[Command], Command]:
    """Add the options of every training study; `seeds` is the default of `--seeds`."""
    options = (
        click.option(
            "--models",
            type=FOLDER,
            default=Path("models"),
            show_default=True,
            help="Folder of the backbone; another folder than the default holds metrics, too.",
        ),
        click.option("--dry-run", is_flag=True, help="Only list the trials and their cost."),
        click.option(
            "--steps",
            type=click.IntRange(1),
            default=None,
            help="Steps of each of the two networks.  [default: as in the parameters]",
        ),
        click.option(
            "--seeds",
            type=click.IntRange(1, 100),
            default=seeds,
            show_default=True,
            help="Number of seeds; every variant is trained once with each.",
        ),
    )

    def add(command: Command) -> Command:
        for option in options:
            command = option(command)
        return common_options(command)

    return add


def views_option(command: Command) -> Command:
    """Add `--views`, one number of training views for all trials, passed as a tuple."""
    return click.option(
        "--views",
        type=click.IntRange(1),
        default=None,
        callback=lambda _context, _option, value: () if value is None else (value,),
        help="Minimum of training views: whole floor plans in random order.  [default: all]",
    )(command)


def run_study(
    study: TrialStudy, params: Params, data: Path, models: Path, dry_run: bool, **config: Any
) -> None:
    """Plan the study with `TrialConfig(**config)` and run it, see `run_or_list`."""
    folders = Folders.beside(data, models, models)
    trials = plan(study, params, folders, TrialConfig(**config))
    run_or_list(study, params, folders, trials, dry_run)


def run_or_list(
    study: TrialStudy,
    params: Params,
    folders: Folders,
    trials: Sequence[Trial],
    dry_run: bool,
    preparations: Sequence[str] = (),
    notes: Sequence[str] = (),
) -> None:
    """Run the trials and print their table; in a dry run, only list them.

    `preparations`: lines of the dry run about work before the trainings; `notes`: sentences that
    are stored with the result.
    """
    if dry_run:
        for line in (*notes, *preparations, *plan_lines(study, trials, folders)):
            click.echo(line)
        return

    def log(line: str) -> None:
        click.echo(line, err=True)

    result, target = run_and_summarise(study, params, folders, trials, log, notes)
    for line in result_lines(result, study.labels):
        click.echo(line)
    click.echo(f"{target}, {target.with_suffix('.png')}: shown by pbrnet report")
