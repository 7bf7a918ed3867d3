"""Commands of the stages that fill the data folder."""

from __future__ import annotations

from pathlib import Path

import click

from pipeline.commands.options import common_options, farm_options
from pipeline.params import Params
from pipeline.stages.assets import run_assets
from pipeline.stages.cameras import run_cameras
from pipeline.stages.groundtruth import run_groundtruth
from pipeline.stages.illumination import run_illumination
from pipeline.stages.inputs import run_inputs
from pipeline.stages.runner import Summary
from pipeline.stages.scenes import run_scenes


@click.command(
    epilog="""\b
Examples:
  pbrnet assets --params params.yaml    with assets.enabled: true
  pbrnet inspect data/assets            what is in them, as a sheet of pictures"""
)
@farm_options
@common_options
def assets(params: Params, data: Path, scheduler: str | None) -> None:
    """Fetch optional furniture catalogues and convert their pieces into DATA/assets.

    Off by default (assets.enabled): procedural homes bring their own furniture. Catalogues are
    the .sh3f files of assets.folder, or else of the Debian packages in assets.debian.
    """
    click.echo(str(run_assets(data, params, scheduler)))


@click.command(
    epilog="""\b
Examples:
  pbrnet scenes                      what params.yaml asks for
  pbrnet scenes --seed 7 --data /tmp/seven"""
)
@farm_options
@common_options
def scenes(params: Params, data: Path, scheduler: str | None) -> None:
    """Make procedural homes from seeds, and bring in the scenes of scenes.imports.

    Keeps the scenes that are up to date, and those that 'pbrnet import' put into DATA/scenes.
    """
    _say(run_scenes(data, params, scheduler))


@click.command(
    epilog="""\b
Examples:
  pbrnet cameras
  pbrnet cameras --workers 1 --data /tmp/seven"""
)
@farm_options
@common_options
def cameras(params: Params, data: Path, scheduler: str | None) -> None:
    """Sample views that see much furniture; says why the other candidates were not taken."""
    _say(run_cameras(data, params, scheduler))


@click.command(epilog="Example:  pbrnet inputs --workers 4")
@farm_options
@common_options
def inputs(params: Params, data: Path, scheduler: str | None) -> None:
    """Render depth, normal, reflectance, valid mask and object ids of every view."""
    _say(run_inputs(data, params, scheduler))


@click.command(epilog="Example:  pbrnet illumination --workers 4")
@farm_options
@common_options
def illumination(params: Params, data: Path, scheduler: str | None) -> None:
    """Render panoramas of every light source that the camera position can see."""
    _say(run_illumination(data, params, scheduler))


@click.command(
    epilog="""\b
Examples:
  pbrnet groundtruth
  pbrnet groundtruth --scheduler tcp://head:8786"""
)
@farm_options
@common_options
def groundtruth(params: Params, data: Path, scheduler: str | None) -> None:
    """Path-trace textureless shading and full colour of every view, both from one trace.

    Frames that are up to date are kept, so an interrupted run goes on where it stopped.
    """
    _say(run_groundtruth(data, params, scheduler))


@click.command(epilog="Example:  pbrnet shading --workers 4")
@farm_options
@common_options
def shading(params: Params, data: Path, scheduler: str | None) -> None:
    """Path-trace only the textureless shading of every view.

    Where both come from one trace, one of them costs as much as both: see pbrnet groundtruth.
    """
    _say(run_groundtruth(data, params, scheduler, truths=("shading",)))


@click.command(epilog="Example:  pbrnet color --workers 4")
@farm_options
@common_options
def color(params: Params, data: Path, scheduler: str | None) -> None:
    """Path-trace only the full colour of every view.

    Where both come from one trace, one of them costs as much as both: see pbrnet groundtruth.
    """
    _say(run_groundtruth(data, params, scheduler, truths=("color",)))


def _say(summary: Summary) -> None:
    click.echo(str(summary))
