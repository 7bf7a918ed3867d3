"""What the commands of the studies that compare trainings share: options, and how they end."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import click

from model.studies.trials.compare import compare_trials
from model.studies.trials.plan import Study, Trial
from model.studies.trials.words import plan_lines, result_lines
from model.training.train import Folders
from pipeline.commands.options import common_options
from pipeline.params import Params

FOLDER = click.Path(path_type=Path, file_okay=False)
Command = Callable[..., Any]


def trial_options(seeds: int = 1) -> Callable[[Command], Command]:
    """The options of every such command, with so many trainings of each kind by default."""
    options = (
        click.option(
            "--models",
            type=FOLDER,
            default=Path("models"),
            show_default=True,
            help="Folder with the backbone; metrics go along if it is another.",
        ),
        click.option("--dry-run", is_flag=True, help="Only list the trials and what they cost."),
        click.option(
            "--steps",
            type=click.IntRange(1),
            default=None,
            help="Steps of each of the two networks.  [default: those of the parameters]",
        ),
        click.option(
            "--seeds",
            type=click.IntRange(1, 100),
            default=seeds,
            show_default=True,
            help="Repeat every training with so many seeds.",
        ),
    )

    def add(command: Command) -> Command:
        for option in options:
            command = option(command)
        return common_options(command)

    return add


def one_size(command: Command) -> Command:
    """`--views`: the number of training views, one for all trials."""
    return click.option(
        "--views",
        type=click.IntRange(1),
        default=None,
        help="Training views at least: whole floor plans, drawn by lot.  [default: all]",
    )(command)


def carry_out(
    study: Study,
    params: Params,
    folders: Folders,
    trials: Sequence[Trial],
    dry_run: bool,
    first: Sequence[str] = (),
    notes: Sequence[str] = (),
) -> None:
    """Run the study and print its table; or, in a dry run, list the trials.

    `first`: what has to be done before; `notes`: sentences that go along with the result.
    """
    if dry_run:
        for line in (*notes, *first, *plan_lines(study, trials, folders)):
            click.echo(line)
        return

    def say(line: str) -> None:
        click.echo(line, err=True)

    result, target = compare_trials(study, params, folders, trials, say, notes)
    for line in result_lines(result):
        click.echo(line)
    click.echo(f"{target}, {target.with_suffix('.png')}: show them with pbrnet report")
