"""Command of a study that compares trainings: options, dry run, execution and printed table."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import click

from pbrnet.model.options import folders_options
from pbrnet.model.studies.trials.plan import Trial, TrialConfig, TrialStudy, plan
from pbrnet.model.studies.trials.summary import run_and_summarise
from pbrnet.model.studies.trials.tables import plan_lines, result_lines
from pbrnet.model.training.train import Folders
from pbrnet.pipeline.commands.options import Decorator, Request
from pbrnet.pipeline.params import Params
from pbrnet.pipeline.terminal import say

_EPILOG = """\b
Examples:
{examples}

{notes}An interrupted study resumes when the command is run again. Commands that
run at the same time share the trials. Writes metrics/studies/{name}.json and
{name}.png."""


@dataclass(frozen=True)
class TrialRequest:
    """Request of the command line to a study that compares trainings."""

    params: Params
    folders: Folders
    config: TrialConfig
    dry_run: bool

    def run(
        self,
        study: TrialStudy,
        trials: Sequence[Trial] | None = None,
        preparations: Sequence[str] = (),
        notes: Sequence[str] = (),
    ) -> None:
        """Run the trials and print their table; in a dry run, only list them.

        `trials`: by default those of `plan`. `preparations`: lines of the dry run about work
        before the trainings. `notes`: sentences that are stored with the result.
        """
        if trials is None:
            trials = plan(study, self.params, self.folders, self.config)
        if self.dry_run:
            for line in (*notes, *preparations, *plan_lines(study, trials, self.folders)):
                say(line)
            return

        def log(line: str) -> None:
            say(line, err=True)

        seed = self.params.seed
        result, target = run_and_summarise(study, seed, self.folders, trials, log, notes)
        for line in result_lines(result):
            say(line)
        say(f"{target}, {target.with_suffix('.png')}: shown by pbrnet report")


def trial_command(
    name: str, examples: str, *options: Decorator, notes: str = "", seeds: int = 1
) -> Callable[[Callable[..., None]], click.Command]:
    """Make a function of a `TrialRequest` the command `pbrnet study NAME`.

    The function's docstring is the help. `options`: further options, which it gets by keyword,
    but for `views`, which belong to the request. `seeds`: default of `--seeds`.
    """

    def make(function: Callable[..., None]) -> click.Command:
        def command(
            request: Request,
            folders: Folders,
            views: tuple[int, ...] = (),
            **given: Any,
        ) -> None:
            config = TrialConfig(given.pop("seeds"), given.pop("steps"), views)
            function(TrialRequest(request.params, folders, config, request.dry_run), **given)

        command.__doc__ = function.__doc__
        where = (
            "Folder of the backbone; if it is not the default, metrics are stored there as well."
        )
        callback: Any = folders_options(where)(command)
        for option in (*_trial_options(seeds), *reversed(options)):
            callback = option(callback)
        words = f"{notes}\n" if notes else ""
        epilog = _EPILOG.format(examples=examples.strip("\n"), notes=words, name=name)
        return click.command(name, epilog=epilog)(callback)

    return make


def _trial_options(seeds: int) -> tuple[Decorator, ...]:
    return (
        click.option("--dry-run", is_flag=True, help="Only list the trials and their cost."),
        click.option(
            "--steps",
            type=click.IntRange(1),
            help="Steps of each of the two networks.  [default: as in the parameters]",
        ),
        click.option(
            "--seeds",
            type=click.IntRange(1, 100),
            default=seeds,
            help="Number of seeds; every variant is trained once with each.",
        ),
    )


# One number of training views for all trials, passed as a tuple.
views_option = click.option(
    "--views",
    type=click.IntRange(1),
    callback=lambda _context, _option, value: () if value is None else (value,),
    help="Minimum of training views: whole floor plans in random order.  [default: all]",
)
