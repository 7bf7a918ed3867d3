"""`pbrnet study illumination`."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from pbrnet.model.figures.results import known_first
from pbrnet.model.options import folders_options, renders_option
from pbrnet.model.studies.illumination.results import (
    CHANGES,
    TITLES,
    Agreement,
    IlluminationResult,
    format_estimate,
)
from pbrnet.model.studies.illumination.study import IlluminationConfig, study_illumination
from pbrnet.model.studies.options import config_options
from pbrnet.model.training.train import Folders
from pbrnet.pipeline.commands.options import Request
from pbrnet.pipeline.terminal import counted, say, views_of


@click.command(
    "illumination",
    epilog="""\b
Examples:
  pbrnet study illumination                        12 views of the evaluate split
  pbrnet study illumination --views 40 --spp 256   smaller uncertainty, much longer
  pbrnet study illumination --factor 2             lamps twice as bright, outdoors half

Requires trained networks, and the scenes and cameras of the dataset. An interrupted study resumes
when the command is run again. The frames in DATA/studies/illumination may be deleted.
Writes metrics/studies/illumination.json and illumination.png.""",
)
@config_options(IlluminationConfig)
@renders_option("Folder of the rendered frames.  [default: DATA/studies/illumination]")
@folders_options()
def command(request: Request, folders: Folders, renders: Path | None, **options: Any) -> None:
    """Compare predicted with rendered changes of light (Figure 10).

    A lamp is added at the left rear of the camera, lamps get brighter, sky and sun darker, a lamp
    is removed, panoramas are exchanged. All but the last are also rendered.
    """
    frames = renders or request.data / "studies" / "illumination"
    config = IlluminationConfig(**options)
    result, target = study_illumination(request.params, folders, config, frames)
    for line in _lines(result, target):
        say(line)


def _lines(result: IlluminationResult, target: Path) -> list[str]:
    lines = [
        f"{views_of(result.views, result.scenes, result.split)}, {result.spp} samples per "
        "pixel, denoised; changes are ln(luminance after / before)"
    ]
    for name in known_first(result.changes, CHANGES):
        change = result.changes[name]
        lines.append(f"{CHANGES[name]} ({counted(change.views, 'view')}):")
        lines += [
            f"{method:>14}: {_measures(change.methods[method], change.reference)}"
            for method in known_first(change.methods, TITLES)
        ]
        lines += [
            f"  left out in {count}: {reason}" for reason, count in sorted(change.skipped.items())
        ]
    return [*lines, f"{target}: all figures; the image is beside it"]


def _measures(found: Agreement, reference: str) -> str:
    if reference != "rendered":
        return f"pattern {_figure(found, 'pattern')} against the panorama's direct light alone"
    predicted, rendered = (
        "–" if figure is None else f"{figure.value:+.2f}"
        for figure in (found.predicted, found.true)
    )
    names = ("pattern", "correlation", "sign", "gain")
    figures = ", ".join(f"{name} {_figure(found, name)}" for name in names)
    return f"{figures}; mean change {predicted}, rendered {rendered}"


def _figure(found: Agreement, name: str) -> str:
    value, interval = format_estimate(getattr(found, name))
    return f"{value} ({interval})" if interval else value
