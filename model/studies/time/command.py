"""`pbrnet study time`."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from pbrnet.model.options import FOLDER, models_option, size_option
from pbrnet.model.studies.time.results import CLOCKS, TimeResult, part_rows, verdicts
from pbrnet.model.studies.time.study import TimeConfig, study_time
from pbrnet.model.training.train import Folders
from pbrnet.pipeline.commands.options import common_options
from pbrnet.pipeline.params import Params


@click.command(
    "time",
    epilog="""\b
Examples:
  pbrnet study time                            4 views at the dataset's size
  pbrnet study time --size 480x360 --max-spp 256
  pbrnet study time --views 8 --repeats 7      smaller uncertainty
  pbrnet study time --clock cpu                on a busy machine

Run it on a quiet machine, or with --clock cpu. Needs trained networks, and the scenes and cameras
that the dataset was made from. Reference images are kept in DATA/studies/time and may be deleted.
Writes metrics/studies/time.json and time.png.""",
)
@size_option("Image size.  [default: as in the dataset]")
@click.option(
    "--views",
    type=click.IntRange(1),
    default=4,
    show_default=True,
    help="Maximum number of views, spread evenly over the split.",
)
@click.option(
    "--repeats",
    type=click.IntRange(1, 1000),
    default=3,
    show_default=True,
    help="Timed turns of each view.",
)
@click.option(
    "--max-spp",
    type=click.IntRange(1, 1 << 14),
    default=64,
    show_default=True,
    help="Largest number of samples per pixel of the renderer: 1, 2, 4, … up to it.",
)
@click.option(
    "--reference-spp",
    type=click.IntRange(0, 1 << 20),
    default=0,
    help="Samples per pixel of the reference.  [default: 16 x --max-spp]",
)
@click.option(
    "--clock",
    type=click.Choice(list(CLOCKS)),
    default="wall",
    show_default=True,
    help="wall: elapsed time; cpu: processor time of all threads, for a busy machine.",
)
@click.option(
    "--raw-reference",
    is_flag=True,
    help="Do not denoise the reference; its noise then lowers SSIM.",
)
@click.option(
    "--renders",
    type=FOLDER,
    default=None,
    help="Folder of the reference images.  [default: DATA/studies/time]",
)
@models_option()
@common_options
def command(
    params: Params,
    data: Path,
    models: Path,
    renders: Path | None,
    **options: Any,
) -> None:
    """Time every part, and compare networks and renderer at equal time.

    Prints seconds per view beside the paper's, and for each network whether the path tracer,
    denoised or not, is better in the same time. A network's time includes all its inputs.
    """
    folders = Folders.beside(data, models, models)
    config = TimeConfig(**options)
    result, target = study_time(params, folders, config, renders or data / "studies" / "time")
    for line in _lines(result, target):
        click.echo(line)


def _lines(result: TimeResult, target: Path) -> list[str]:
    width, height = result.size
    lines = [
        f"{result.views} views of {result.scenes} {result.split} scenes at {width}x{height}, "
        f"{result.repeats} turns; {result.machine['processor']}, {result.machine['threads']}, load "
        f"{result.machine['load']}; {CLOCKS[result.clock]}"
    ]
    for row in part_rows(result):
        spent, paper = row["spent"], row["paper"]
        beside = "" if paper is None else f"   in the paper: {paper:g} s"
        around = f"({spent.low:.3f} to {spent.high:.3f})"
        lines.append(f"{row['name']:>14}: {spent.seconds:.3f} s {around}{beside}")
    return [*lines, *verdicts(result), f"{target}: all figures; the plot is beside it"]
