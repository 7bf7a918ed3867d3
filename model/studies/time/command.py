"""`pbrnet study time`: what every part takes, and what the renderer can do in that time."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from model.options import FOLDER, models_option, size_option
from model.studies.time.results import CLOCKS, TimeResult, part_rows, verdicts
from model.studies.time.study import Wish, study_time
from model.training.train import Folders
from pipeline.commands.options import common_options
from pipeline.params import Params


@click.command(
    "time",
    epilog="""\b
Examples:
  pbrnet study time                            4 views at the dataset's size
  pbrnet study time --size 480x360 --max-spp 256
  pbrnet study time --views 8 --repeats 7      surer
  pbrnet study time --clock cpu                where other programs run

Run it on a quiet machine, or by the processor's clock. Needs trained networks, and the scenes and
cameras that the dataset was made of. References lie in DATA/studies/time, are not made again, and
may be deleted.""",
)
@size_option("Of the pictures.  [default: dataset's]")
@click.option(
    "--views",
    type=click.IntRange(1),
    default=4,
    show_default=True,
    help="Views at most, spread evenly over the split.",
)
@click.option(
    "--repeats",
    type=click.IntRange(1, 1000),
    default=3,
    show_default=True,
    help="Turns that count, of each view.",
)
@click.option(
    "--max-spp",
    type=click.IntRange(1, 1 << 14),
    default=64,
    show_default=True,
    help="Most samples a pixel of the renderer: 1, 2, 4, … up to it.",
)
@click.option(
    "--reference-spp",
    type=click.IntRange(0, 1 << 20),
    default=0,
    help="Samples a pixel of the reference.  [default: 16 x --max-spp]",
)
@click.option(
    "--clock",
    type=click.Choice(list(CLOCKS)),
    default="wall",
    show_default=True,
    help="wall: as one waits; cpu: all threads together, for a busy machine.",
)
@click.option(
    "--raw-reference",
    is_flag=True,
    help="Do not denoise the reference: it favours no denoiser, but SSIM sees its noise.",
)
@click.option(
    "--renders",
    type=FOLDER,
    default=None,
    help="Where references are kept.  [default: DATA/studies/time]",
)
@models_option()
@common_options
def study_time_command(
    params: Params,
    data: Path,
    models: Path,
    renders: Path | None,
    **wishes: Any,
) -> None:
    """Time every part, and compare networks and renderer at equal time.

    Prints seconds a view beside the paper's, and whether the path tracer, denoised or not, gives a
    better picture in the time a network needs with its inputs and its panorama.
    """
    folders = Folders.beside(data, models, models)
    wish = Wish(**wishes)
    result, target = study_time(params, folders, wish, renders or data / "studies" / "time")
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
        beside = "" if paper is None else f"   the paper: {paper:g} s"
        around = f"({spent.low:.3f} to {spent.high:.3f})"
        lines.append(f"{row['name']:>14}: {spent.seconds:.3f} s {around}{beside}")
    return [*lines, *verdicts(result), f"{target}: all figures; the plot lies beside it"]
