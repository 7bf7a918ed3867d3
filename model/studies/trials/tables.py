"""Console output of the training studies: the list of trials and the table of results."""

from __future__ import annotations

from collections.abc import Sequence

from pbrnet.model.figures.estimates import with_interval
from pbrnet.model.studies.trials.plan import Trial, TrialStudy
from pbrnet.model.studies.trials.results import MEASURES, MetricEstimate, TrialsResult
from pbrnet.model.studies.trials.runs import expected_seconds, states
from pbrnet.model.studies.trials.words import COMPARISONS
from pbrnet.model.training.train import Folders
from pbrnet.pipeline.terminal import counted, views_of


def plan_lines(study: TrialStudy, trials: Sequence[Trial], folders: Folders) -> list[str]:
    """Return a line for each trial, and the expected time of all."""
    lines, total, unknown = [], 0.0, False
    width = max(len(trial.name) for trial in trials)
    for trial, state in zip(trials, states(study, trials, folders), strict=True):
        seconds = expected_seconds(trial, study, folders)
        if state in ("train", "resume"):
            unknown |= seconds is None
            total += seconds or 0.0
        steps = ", ".join(f"{name} {count}" for name, count in trial.steps.items())
        time = "time unknown" if seconds is None else f"about {_format_time(seconds)}"
        lines.append(
            f"{trial.name:<{width}}  {state:<7}  {counted(trial.views, 'view')}, {steps}, {time}"
        )
    least = "at least " if unknown else "about "
    lines.append(f"{counted(len(trials), 'trial')}, {least}{_format_time(total)} of training left")
    if unknown:
        lines.append("the time of a network is known once one of its kind has been trained")
    return lines


def result_lines(result: TrialsResult) -> list[str]:
    """Return a table with a row a label and a column a metric.

    A cell has the mean, its 95 % interval over scenes in brackets and, with several trainings, the
    standard deviation of their means after ±.
    """
    columns = [(name, MEASURES[name][0], MEASURES[name][2]) for name in result.measured]
    rows = [["", *(title for _, title, _ in columns)]]
    rows.extend(
        [row.label, *(_cell(row.metrics.get(one), digits) for one, _, digits in columns)]
        for row in result.rows
    )
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    lines = [*result.notes, views_of(result.views, result.scenes, result.split)]
    group = ""
    for cells, of in zip(rows, ("", *(row.group for row in result.rows)), strict=True):
        if of and of != group:
            lines.append(f"{of}:")
        group = of
        padded = (cell.ljust(width) for cell, width in zip(cells, widths, strict=True))
        lines.append(("  " + "  ".join(padded)).rstrip())
    spread = (
        "; one training each, so the spread of trainings is unknown"
        if result.repeats < 2
        else f"; after ±: standard deviation over {result.repeats} trainings"
    )
    lines.append("in brackets: 95 % intervals over scenes" + spread)
    titles = COMPARISONS[result.study].titles
    lines.append(f"{result.reference}: {titles.get(result.reference, result.reference)}")
    return lines


def _cell(figure: MetricEstimate | None, digits: int) -> str:
    if figure is None:
        return "–"
    text = with_interval(figure.mean, figure.low, figure.high, digits)
    return text + ("" if figure.spread is None else f" ±{figure.spread:.{digits}f}")


def _format_time(seconds: float) -> str:
    if seconds < 90:
        return f"{seconds:.0f} s"
    return f"{seconds / 60:.0f} min" if seconds < 5400 else f"{seconds / 3600:.1f} h"
