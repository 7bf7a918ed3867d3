"""Commands of the stages from assets to the dataset, one by one and all together."""

from __future__ import annotations

import time
from collections.abc import Callable
from contextlib import nullcontext
from functools import partial
from pathlib import Path
from typing import Any

import click

from pbrnet.pipeline.commands.options import (
    FOLDER,
    Request,
    common_options,
    farm_options,
    stage_options,
)
from pbrnet.pipeline.commands.start import say_plans, start_lines
from pbrnet.pipeline.dataset.description.card import DatasetSummary
from pbrnet.pipeline.dataset.pack import pack_dataset
from pbrnet.pipeline.params import Params
from pbrnet.pipeline.records import Trash, run_lock
from pbrnet.pipeline.stages.cameras import run_cameras
from pbrnet.pipeline.stages.frame_stage import FRAME_STAGES, run_frame_stages, run_frames
from pbrnet.pipeline.stages.runner import StageError, stages_together
from pbrnet.pipeline.terminal import counted, lines_of, say
from pbrnet.scenes.checked import imported
from pbrnet.scenes.errors import PbrnetError


def _run_late(name: str, *given: Any) -> object:
    """Run the function "module:name": generators and importers are not loaded to render."""
    return imported(name)(*given)


def run_dataset(data: Path, params: Params, scheduler: str | None = None) -> str:
    """Pack the dataset; return what it holds, or say that and raise for broken walks."""
    summary = pack_dataset(data, params)
    lines = summary_lines(summary, data / "dataset")
    if summary.walks:
        say(*lines)
        require_whole_walks(summary)
    return lines_of(lines)


STAGES: dict[str, Callable[[Path, Params, str | None], object]] = {
    "assets": partial(_run_late, "pbrnet.pipeline.stages.assets:run_assets"),
    "scenes": partial(_run_late, "pbrnet.pipeline.stages.scenes:run_scenes"),
    "cameras": run_cameras,
    "inputs": partial(run_frames, "inputs"),
    "illumination": partial(run_frames, "illumination"),
    "groundtruth": partial(run_frames, "groundtruth"),
    "dataset": run_dataset,
}


@click.command(
    epilog="""\b
Examples:
  pbrnet assets                 with assets.enabled: true in params.yaml
  pbrnet inspect data/assets    show the pieces"""
)
@farm_options
@common_options
def assets(request: Request) -> None:
    """Fetch furniture catalogues and convert their pieces into DATA/assets.

    Off by default (assets.enabled), since procedural homes have their own furniture. Catalogues are
    the .sh3f files in assets.folder, or those of the Debian packages in assets.debian.
    """
    _run(request, "assets")


@click.command(
    epilog="""\b
Examples:
  pbrnet scenes                            the scenes of params.yaml
  pbrnet scenes --seed 7 --data /tmp/seven
  pbrnet scenes --describe layouts         the homes of params.yaml as layouts
  pbrnet scenes --describe layouts data/scenes/studio"""
)
@click.argument("described", metavar="[SCENE]...", nargs=-1, type=FOLDER)
@click.option(
    "--describe",
    type=FOLDER,
    help="Write the procedural homes, or the scene folders SCENE, to this folder as layouts "
    "(docs/layouts.md); make no scene.",
)
@stage_options
@common_options
def scenes(request: Request, describe: Path | None, described: tuple[Path, ...]) -> None:
    """Generate procedural homes and import the scenes listed in scenes.imports.

    Keeps scenes that are up to date, and scenes that 'pbrnet import' wrote to DATA/scenes.
    """
    if describe is None:
        if described:
            raise click.UsageError("SCENE needs --describe")
        _run(request, "scenes")
        return
    from pbrnet.pipeline.stages.scenes import homes_of
    from pbrnet.scenes.layout.describe import describe_homes
    from pbrnet.scenes.layout.from_scene import describe_scenes

    if described:
        written = describe_scenes(described, describe)
    else:
        assets = request.data.resolve() / "assets"
        homes = homes_of(request.params.scenes, request.params.seed, assets)
        written = list(describe_homes(homes, assets, describe))
    layouts = counted(len(written), "layout")
    say(f"{layouts} in {describe}; change one and read it with: pbrnet import")


@click.command(
    epilog="""\b
Examples:
  pbrnet cameras
  pbrnet cameras --workers 1 --data /tmp/seven"""
)
@stage_options
@common_options
def cameras(request: Request) -> None:
    """Sample views that see much furniture, and report why other candidates were rejected."""
    say(*start_lines(request, ("cameras",)), err=True)
    _run(request, "cameras")


def _frame_command(stage: str, epilog: str, text: str) -> click.Command:
    """Return the command that renders the frames of a stage; `text` is its help."""

    @click.command(stage, help=text, epilog=epilog)
    @stage_options
    @common_options
    def command(request: Request) -> None:
        say(*start_lines(request, FRAME_STAGES[stage]), err=True)
        _run(request, stage)

    return command


inputs = _frame_command(
    "inputs",
    "Example:  pbrnet inputs --workers 4",
    """Render depth, normals, reflectance, valid mask and object ids of every view.

    Depending on channels, also renders materials (roughness, metalness and so on) and labels.
    """,
)
illumination = _frame_command(
    "illumination",
    "Example:  pbrnet illumination --workers 4",
    """Render a panorama of the lamps and openings to the outdoors visible from each camera.

    With illumination.shadow_rays, also renders the fraction of their light that reaches each pixel.
    """,
)
groundtruth = _frame_command(
    "groundtruth",
    """\b
Examples:
  pbrnet groundtruth
  pbrnet groundtruth --scheduler tcp://head:8786""",
    """Path-trace textureless shading and full colour of every view, both from one trace.

    Depending on channels, also renders components of the light and a panorama of everything visible
    from the camera position. Keeps frames that are up to date, so an interrupted run resumes.
    """,
)
shading = _frame_command(
    "shading",
    "Example:  pbrnet shading --workers 4",
    """Path-trace only the textureless shading of every view.

    'pbrnet groundtruth' renders shading and colour from one trace, at the cost of one of them.
    """,
)
color = _frame_command(
    "color",
    "Example:  pbrnet color --workers 4",
    """Path-trace only the full colour of every view.

    'pbrnet groundtruth' renders shading and colour from one trace, at the cost of one of them.
    """,
)


@click.command(
    epilog="""\b
Examples:
  pbrnet dataset                       pack the frames in data/
  pbrnet dataset --data /mnt/big/data  pack the frames of another data folder

Views that fail a check are listed with the reason in data/dataset/rejected.csv. Exit code 1 if a
walk has rejected frames."""
)
@common_options
def dataset(request: Request) -> None:
    """Check the frames of every view and pack them into Parquet shards with a dataset card."""
    _run(request, "dataset")


@click.command(
    epilog="""\b
Examples:
  pbrnet run --params params/paper.yaml --data /mnt/big/paper
  pbrnet run --data /tmp/seven --seed 7 --until cameras
  pbrnet run --dry-run        what would be made, kept and removed, and how long it takes

Outputs that the parameters no longer require, or that are replaced, are moved to DATA/trash and
restored when required again; they are deleted after farm.trash_days, or with --remove-orphans.
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
    say(*start_lines(request, kinds), err=True)
    with nullcontext() if request.dry_run else run_lock(request.data, "run"):
        known = say_plans(request, names)
        if not request.dry_run:
            trash = Trash(request.data.resolve(), request.params.farm.trash_days)
            with stages_together(trash) if known else nullcontext():
                _run_all(request, names)


def _run_all(request: Request, names: list[str]) -> None:
    """Run stages, also after failures of scenes or views, which are named in the end."""
    frames = [name for name in names if name in FRAME_STAGES]
    before = names[: names.index(frames[0])] if frames else names
    failed = [name for name in before if not _done(request, name)]
    if frames:
        numbers = [list(STAGES).index(name) + 1 for name in (frames[0], frames[-1])]
        say(f"[{numbers[0]}-{numbers[1]}/{len(STAGES)}] {', '.join(frames)}")
        given, started = (request.data, request.params, request.scheduler), time.monotonic()
        for name, outcome in zip(frames, run_frame_stages(frames, *given), strict=True):
            failed += [name] * _failed(outcome)
        say(f"together {time.monotonic() - started:.1f} s")
    failed += [name for name in names[len(before) + len(frames) :] if not _done(request, name)]
    if failed:
        raise StageError(f"failures in {', '.join(failed)}, listed above; everything else is done")


def _done(request: Request, name: str) -> bool:
    """Run a stage and print its summary; return False for failures of scenes or views."""
    say(f"[{list(STAGES).index(name) + 1}/{len(STAGES)}] {name}")
    try:
        outcome: object = STAGES[name](request.data, request.params, request.scheduler)
    except PbrnetError as error:
        if error.exit_code != StageError.exit_code:
            raise
        outcome = error
    return not _failed(outcome)


def _failed(outcome: object) -> bool:
    """Print what a stage did, or its failures; return whether there are any."""
    if isinstance(outcome, PbrnetError):
        say(*outcome.args, err=True)
        return True
    say(*str(outcome).split("\n"))
    return False


def _run(request: Request, name: str) -> None:
    """Run a stage and print its summary, or print its plan."""
    if request.dry_run:
        say_plans(request, [name])
        return
    stage = STAGES.get(name) or partial(run_frames, name)
    say(*str(stage(request.data, request.params, request.scheduler)).split("\n"))


def require_whole_walks(summary: DatasetSummary) -> None:
    """Raise `StageError` with the names of walks that have rejected frames."""
    if summary.walks:
        named = ", ".join(
            f"{scene}/{walk} ({counted(count, 'frame')})"
            for (scene, walk), count in summary.walks.items()
        )
        raise StageError(
            f"dataset: rejected frames in {counted(len(summary.walks), 'walk')}: {named}; "
            "the rest is packed. dataset.checks has the limits; whole_walks rejects such walks as "
            "a whole"
        )


def summary_lines(summary: DatasetSummary, folder: Path) -> list[str]:
    """Return rows, splits, size and rejections of a packed dataset as lines of text."""
    splits = ", ".join(
        f"{split} {rows} of {counted(summary.scenes[split], 'scene')}"
        for split, rows in summary.rows.items()
    )
    lines = [
        f"{counted(summary.sampled, 'view')} sampled, {counted(summary.total, 'row')} ({splits})",
        f"{counted(len(summary.files), 'shard')}, {summary.bytes / 1e6:.1f} MB in {folder}",
    ]
    if not summary.packed:
        lines.append("up to date: kept as it was packed before")
    if summary.rejected:
        reasons = ", ".join(f"{reason} {count}" for reason, count in summary.rejected.items())
        lines.append(f"rejected: {reasons}; see {folder / 'rejected.csv'}")
    return lines
