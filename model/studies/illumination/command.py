"""`pbrnet study illumination`: does a prediction follow a change of light?"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from model.figures.results import known_first
from model.options import FOLDER, models_option
from model.studies.illumination.results import CHANGES, SHOWN, Agreement, LightResult, in_words
from model.studies.illumination.study import Wish, study_illumination
from model.training.train import Folders
from pipeline.commands.options import common_options
from pipeline.params import Params


@click.command(
    epilog="""\b
Examples:
  pbrnet study illumination                        12 views of the evaluate split
  pbrnet study illumination --views 40 --spp 256   surer, and much longer
  pbrnet study illumination --factor 2             lamps twice as bright, outdoors half

Needs trained networks, and the scenes and cameras that the dataset was made of. Stopped, it goes
on from the last finished frame when started again; the frames lie in DATA/studies/illumination
and may be deleted.""",
)
@click.option(
    "--views",
    type=click.IntRange(1),
    default=12,
    show_default=True,
    help="Views at most, spread evenly over the split.",
)
@click.option(
    "--spp",
    type=click.IntRange(2, 1 << 16),
    default=64,
    show_default=True,
    help="Samples a pixel of what is rendered; it is denoised.",
)
@click.option(
    "--factor",
    type=click.FloatRange(1.01, 1000),
    default=4.0,
    show_default=True,
    help="How many times brighter lamps get, and darker sky and sun.",
)
@click.option(
    "--strength",
    type=click.FloatRange(0.01, 1000),
    default=1.0,
    show_default=True,
    help="Light of the added lamp 2 m away, as times the view's average.",
)
@click.option(
    "--renders",
    type=FOLDER,
    default=None,
    help="Where rendered frames are kept.  [default: DATA/studies/illumination]",
)
@models_option()
@common_options
def illumination(
    params: Params, data: Path, models: Path, renders: Path | None, **wishes: Any
) -> None:
    """Change the light of test views and see whether the prediction follows (the paper's Fig. 10).

    A lamp is added at the left rear of the camera, lamps get brighter, sky and sun darker, a lamp
    is put out, panoramas are exchanged; the renderer gets the same change, but for the last.
    """
    folders = Folders.beside(data, models, models)
    kept = renders or data / "studies" / "illumination"
    result, target = study_illumination(params, folders, Wish(**wishes), kept)
    for line in _lines(result, target):
        click.echo(line)


def _lines(result: LightResult, target: Path) -> list[str]:
    lines = [
        f"{result.views} views of {result.scenes} {result.split} scenes, {result.spp} samples a "
        "pixel, denoised; changes are ln of luminance after / before"
    ]
    for name in known_first(result.changes, CHANGES):
        change = result.changes[name]
        lines.append(f"{CHANGES[name]} ({change.views} views):")
        lines += [
            f"{method:>14}: {_words(change.methods[method], change.reference)}"
            for method in known_first(change.methods, SHOWN)
        ]
        lines += [f"  not in {count}: {why}" for why, count in sorted(change.skipped.items())]
    return [*lines, f"{target}: all figures; the picture lies beside it"]


def _words(found: Agreement, reference: str) -> str:
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
    value, interval = in_words(getattr(found, name))
    return f"{value} ({interval})" if interval else value
