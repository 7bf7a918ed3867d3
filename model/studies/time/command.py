"""`pbrnet study time`."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from pbrnet.model.options import folders_options, renders_option
from pbrnet.model.studies.options import config_options
from pbrnet.model.studies.time.results import CLOCKS, TimeResult, part_rows, verdicts
from pbrnet.model.studies.time.study import TimeConfig, study_time
from pbrnet.model.training.train import Folders
from pbrnet.pipeline.commands.options import Request
from pbrnet.pipeline.terminal import say, views_of


@click.command(
    "time",
    epilog="""\b
Examples:
  pbrnet study time                            4 views at the dataset's size
  pbrnet study time --size 480x360 --max-spp 256
  pbrnet study time --views 8 --repeats 7      smaller uncertainty
  pbrnet study time --clock cpu                on a busy machine

Run it on an idle machine, or with --clock cpu. Requires trained networks, and the scenes and
cameras of the dataset. Reference images are kept in DATA/studies/time and may be deleted.
Writes metrics/studies/time.json and time.png.""",
)
@config_options(TimeConfig)
@renders_option("Folder of the reference images.  [default: DATA/studies/time]")
@folders_options()
def command(request: Request, folders: Folders, renders: Path | None, **options: Any) -> None:
    """Time every part, and compare networks and renderer at equal time.

    Prints seconds per view beside the paper's, and for each network whether the path tracer,
    denoised or not, has a lower error in the same time. A network's time includes all its inputs.
    """
    frames = renders or request.data / "studies" / "time"
    result, target = study_time(request.params, folders, TimeConfig(**options), frames)
    for line in _lines(result, target):
        say(line)


def _lines(result: TimeResult, target: Path) -> list[str]:
    width, height = result.size
    lines = [
        f"{views_of(result.views, result.scenes, result.split)} at {width}x{height}, "
        f"{result.repeats} turns; {result.machine['processor']}, {result.machine['threads']}, load "
        f"{result.machine['load']}; {CLOCKS[result.clock]}"
    ]
    for row in part_rows(result):
        spent, paper = row["spent"], row["paper"]
        beside = "" if paper is None else f"   in the paper: {paper:g} s"
        around = f"({spent.low:.3f} to {spent.high:.3f})"
        lines.append(f"{row['name']:>14}: {spent.seconds:.3f} s {around}{beside}")
    return [*lines, *verdicts(result), f"{target}: all figures; the plot is beside it"]
