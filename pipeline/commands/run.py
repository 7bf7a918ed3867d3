"""`pbrnet run`: all stages from assets to the dataset, one after the other."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path

import click

from pbrnet.pipeline.commands.data import require_whole_walks, summary_lines
from pbrnet.pipeline.commands.options import Request, common_options, stage_options
from pbrnet.pipeline.commands.start import say_plans, say_start
from pbrnet.pipeline.dataset.pack import pack_dataset
from pbrnet.pipeline.params import Params
from pbrnet.pipeline.stages.assets import run_assets
from pbrnet.pipeline.stages.cameras import run_cameras
from pbrnet.pipeline.stages.frame_stage import FRAME_STAGES, run_frames
from pbrnet.pipeline.stages.runner import StageError
from pbrnet.pipeline.stages.scenes import run_scenes
from pbrnet.pipeline.terminal import lines_of, say
from pbrnet.scenes.errors import PbrnetError


def _dataset(data: Path, params: Params, scheduler: str | None) -> str:
    summary = pack_dataset(data, params)
    lines = summary_lines(summary, data / "dataset")
    if summary.walks:
        say(*lines)
        require_whole_walks(summary)
    return lines_of(lines)


STAGES: dict[str, Callable[[Path, Params, str | None], object]] = {
    "assets": run_assets,
    "scenes": run_scenes,
    "cameras": run_cameras,
    "inputs": partial(run_frames, "inputs"),
    "illumination": partial(run_frames, "illumination"),
    "groundtruth": partial(run_frames, "groundtruth"),
    "dataset": _dataset,
}


@click.command(
    epilog="""\b
Examples:
  pbrnet run --params params/paper.yaml --data /mnt/big/paper
  pbrnet run --data /tmp/seven --seed 7 --until cameras
  pbrnet run --dry-run        what would be made, kept and removed, and how long it takes

Outputs that the parameters no longer require are moved to DATA/trash and restored when required
again; they are deleted after farm.trash_days, or with --remove-orphans.
Exit code 1 if some scenes or views failed; the dataset contains the others, and its rejected.csv
lists the failed views. Running the command again keeps what is up to date and retries the rest."""
)
@click.option(
    "--until", type=click.Choice(list(STAGES)), default="dataset", help="Last stage to run."
)
@stage_options
@common_options
def run(request: Request, until: str) -> None:
    """Run all stages from assets to the dataset once, for one parameter file and data folder.

    Prints to stderr the main settings, what it will make, keep and remove, and how long that may
    take, then a summary of each stage. `dvc repro` does the same in the project's own data folder,
    and also trains and evaluates the networks.
    """
    names = list(STAGES)[: list(STAGES).index(until) + 1]
    kinds = {kind for name in names for kind in FRAME_STAGES.get(name, (name,))}
    say_start(request, kinds)
    say_plans(request, names)
    if request.dry_run:
        return
    failed: list[str] = []
    for number, (name, stage) in enumerate(STAGES.items(), 1):
        say(f"[{number}/{len(STAGES)}] {name}")
        try:
            say(*str(stage(request.data, request.params, request.scheduler)).split("\n"))
        except PbrnetError as error:
            if error.exit_code != StageError.exit_code:
                raise
            failed.append(name)
            say(*error.args, err=True)
        if name == until:
            break
    if failed:
        raise StageError(f"failures in {', '.join(failed)}, listed above; everything else is done")
