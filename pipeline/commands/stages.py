"""Commands of the stages from assets to ground truth."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path

import click

from pbrnet.pipeline.commands.options import Request, common_options, farm_options, stage_options
from pbrnet.pipeline.commands.start import say_plans, say_start
from pbrnet.pipeline.params import Params
from pbrnet.pipeline.stages.assets import run_assets
from pbrnet.pipeline.stages.cameras import run_cameras
from pbrnet.pipeline.stages.frame_stage import FRAME_STAGES, run_frames
from pbrnet.pipeline.stages.runner import Summary
from pbrnet.pipeline.stages.scenes import run_scenes
from pbrnet.pipeline.terminal import say


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
    say(*str(run_assets(request.data, request.params, request.scheduler)).split("\n"))


@click.command(
    epilog="""\b
Examples:
  pbrnet scenes                            the scenes of params.yaml
  pbrnet scenes --seed 7 --data /tmp/seven"""
)
@stage_options
@common_options
def scenes(request: Request) -> None:
    """Generate procedural homes and import the scenes listed in scenes.imports.

    Keeps scenes that are up to date, and scenes that 'pbrnet import' wrote to DATA/scenes.
    """
    _run(request, "scenes", run_scenes)


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
    say_start(request, ("cameras",))
    _run(request, "cameras", run_cameras)


def _frame_command(stage: str, epilog: str, text: str) -> click.Command:
    """Return the command that renders the frames of a stage; `text` is its help."""

    @click.command(stage, help=text, epilog=epilog)
    @stage_options
    @common_options
    def command(request: Request) -> None:
        say_start(request, FRAME_STAGES[stage])
        _run(request, stage, partial(run_frames, stage))

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


def _run(request: Request, name: str, stage: Callable[[Path, Params, str | None], Summary]) -> None:
    """Run a stage and print its summary, or print its plan."""
    if request.dry_run:
        say_plans(request, [name])
    else:
        say(*str(stage(request.data, request.params, request.scheduler)).split("\n"))
