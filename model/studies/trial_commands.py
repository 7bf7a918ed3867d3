"""`pbrnet study loss`, `decomposition` and `composition`: trainings side by side."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import click

from model.studies.comparisons import (
    compare,
    composition_study,
    decomposition_study,
    loss_study,
)
from model.studies.trials import Study, Trial, Wish, expected_seconds, plan, states
from model.training import Folders
from pipeline.options import common_options
from pipeline.params import Params
from pipeline.report_trials import MEASURES, WORDS, TrialsResult, TrialsRow

_FOLDER = click.Path(path_type=Path, file_okay=False)


def register(group: click.Group) -> None:
    """Add the commands to `pbrnet study`."""
    for command in (loss, decomposition, composition):
        group.add_command(command)


def _options(command: Callable[..., Any]) -> Callable[..., Any]:
    for option in (
        click.option(
            "--models",
            type=_FOLDER,
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
            default=1,
            show_default=True,
            help="Repeat every training with so many seeds.",
        ),
    ):
        command = option(command)
    return common_options(command)


@click.command(
    epilog="""\b
Examples:
  pbrnet study loss --dry-run             what would be trained, and for how long
  pbrnet study loss --steps 2000          both networks, 2000 steps each, with each of four losses
  pbrnet study loss --seeds 3 --params params/reference.yaml

Stopped, the same command goes on where it was. Writes metrics/studies/loss.json and .png."""
)
@_options
def loss(params: Params, data: Path, models: Path, **wishes: Any) -> None:
    """Compare four losses (Figure 7).

    L1, the fifth layer, all layers, and the part-perceptual loss, for both networks.
    """
    _study(loss_study(params), params, data, models, **wishes)


@click.command(
    epilog="""\b
Examples:
  pbrnet study decomposition --dry-run
  pbrnet study decomposition --steps 2000                 a quarter, half, and all of the views
  pbrnet study decomposition --views 20 --views 80 --seeds 3

Views are taken by whole floor plans, drawn by lot, until there are as many as asked for. Stopped,
the same command goes on where it was. Writes metrics/studies/decomposition.json and .png."""
)
@click.option(
    "--views",
    type=click.IntRange(1),
    multiple=True,
    help="Training views, again for each size.  [default: a quarter, half, all]",
)
@_options
def decomposition(params: Params, data: Path, models: Path, **wishes: Any) -> None:
    """Compare two stages with one (Figure 8).

    Shading supervised, the same layers on colour alone, and one U-Net, by the number of views.
    """
    _study(decomposition_study(params), params, data, models, **wishes)


@click.command(
    epilog="""\b
Examples:
  pbrnet study composition --dry-run
  pbrnet study composition --steps 2000 --seeds 2

Stopped, the same command goes on where it was. Writes metrics/studies/composition.json and .png."""
)
@_options
def composition(params: Params, data: Path, models: Path, **wishes: Any) -> None:
    """Compare composition by network and by product (Figure 9).

    Under both exposure policies: as shading was exposed, and each image by itself.
    """
    _study(composition_study(params), params, data, models, **wishes)


def _study(
    study: Study, params: Params, data: Path, models: Path, dry_run: bool, **wishes: Any
) -> None:
    folders = Folders.beside(data, models, models)
    wish = Wish(**wishes)
    if dry_run:
        for line in _plan_lines(study, plan(study, params, folders, wish), folders):
            click.echo(line)
        return
    result, target = compare(study, params, folders, wish, lambda line: click.echo(line, err=True))
    for line in _result_lines(result):
        click.echo(line)
    click.echo(f"{target}, {target.with_suffix('.png')}: show them with pbrnet report")


def _plan_lines(study: Study, trials: list[Trial], folders: Folders) -> list[str]:
    lines, total, unknown = [], 0.0, False
    width = max(len(trial.name) for trial in trials)
    for trial, state in zip(trials, states(study, trials, folders), strict=True):
        seconds = expected_seconds(trial, study, folders)
        if state in ("train", "go on"):
            unknown |= seconds is None
            total += seconds or 0.0
        steps = ", ".join(f"{name} {count}" for name, count in trial.steps.items())
        time = "time unknown" if seconds is None else f"about {_time(seconds)}"
        lines.append(f"{trial.name:<{width}}  {state:<7}  {trial.views} views, {steps}, {time}")
    least = "at least " if unknown else "about "
    lines.append(f"{len(trials)} trials, {least}{_time(total)} of training left")
    if unknown:
        lines.append("the pace of a network is known once one of its kind has been trained")
    return lines


def _result_lines(result: TrialsResult) -> list[str]:
    lines = [f"{result.views} views of {result.scenes} {result.split} scenes"]
    width = max(len(row.label) for row in result.rows)
    group = ""
    for row in result.rows:
        if row.group != group:
            group = row.group
            lines.append(f"{group}:")
        lines.append(f"  {row.label:<{width}}  {_figures(row)}")
    lines.append(f"{result.reference}: {WORDS.get(result.reference, result.reference)}")
    return lines


def _figures(row: TrialsRow) -> str:
    parts = []
    for name, (label, _, digits) in MEASURES.items():
        figure = row.metrics.get(name)
        if figure is not None:
            around = (
                ""
                if figure.low is None
                else f" ({figure.low:.{digits}f} to {figure.high:.{digits}f})"
            )
            parts.append(f"{label} {figure.mean:.{digits}f}{around}")
    return ", ".join(parts)


def _time(seconds: float) -> str:
    if seconds < 90:
        return f"{seconds:.0f} s"
    return f"{seconds / 60:.0f} min" if seconds < 5400 else f"{seconds / 3600:.1f} h"
