"""`pbrnet study`: the paper's studies, each a command."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from model.evaluation.evaluate import METHODS
from model.options import FILE, models_option
from model.studies.comparisons.command import composition, decomposition, loss, table
from model.studies.flicker.command import flicker
from model.studies.generalisation.command import generalisation
from model.studies.illumination import command
from model.studies.noise.command import noise
from model.studies.pairs.answers import MAX_PAIRS, read_all, read_key, score
from model.studies.pairs.page import Made, Wish, key_beside, make_pairs
from model.studies.pairs.results import PairsResult, interval, percent
from model.studies.time import command as time_command
from model.training.train import Folders
from pipeline.commands.options import common_options
from pipeline.params import Params
from scenes.checked import plain
from scenes.files import write_json


@click.group(
    epilog="""\b
Examples:
  pbrnet study pairs                       a page of blind pairs to give to people
  pbrnet study pairs --score answers/*.json    what they answered
  pbrnet study loss --dry-run              trainings that differ in the loss
  pbrnet study flicker SCENE --view VIEW   how steady pictures are while the camera moves

Results go to metrics/studies/; `pbrnet report` shows them."""
)
def study() -> None:
    """Repeat one of the paper's studies on your own networks."""


study.add_command(command.illumination)
study.add_command(time_command.study_time_command)
for comparison in (loss, decomposition, composition, table, noise, generalisation, flicker):
    study.add_command(comparison)


@study.command(
    epilog="""\b
Examples:
  pbrnet study pairs                            50 pairs, 3 seconds each
  pbrnet study pairs --method pbrnet --method unet --pairs 40 --seed 7 --out other.html
  pbrnet study pairs --score answers/*.json

Give people the page alone: the key beside it, NAME-key.json, says which pictures are the
renderer's. Keep it, for nobody can score the answers without it.""",
)
@click.argument("files", nargs=-1, type=FILE, metavar="[FILE]...")
@click.option("--score", "scoring", is_flag=True, help="Score the answer files FILE.")
@click.option(
    "--pairs",
    type=click.IntRange(2, MAX_PAIRS),
    default=50,
    show_default=True,
    help="Pairs at most; every method gets equally many, and no view comes twice.",
)
@click.option(
    "--seconds",
    type=click.FloatRange(0.1, 60),
    default=3.0,
    show_default=True,
    help="How long a pair is shown.",
)
@click.option(
    "--answer-seconds",
    type=click.FloatRange(0.1, 600),
    default=5.0,
    show_default=True,
    help="How long an answer is awaited after that.",
)
@click.option(
    "--method",
    "methods",
    type=click.Choice(METHODS),
    multiple=True,
    help="A method to show, again for each.  [default: pbrnet, product, trained baselines]",
)
@click.option(
    "--out",
    type=FILE,
    default=None,
    help="The page; its key lies beside it.  [default: metrics/studies/pairs.html]",
)
@click.option("--replace", is_flag=True, help="Overwrite a page of other pairs and its key.")
@models_option()
@common_options
def pairs(
    params: Params,
    data: Path,
    models: Path,
    out: Path | None,
    files: tuple[Path, ...],
    scoring: bool,
    replace: bool,
    methods: tuple[str, ...],
    **wishes: Any,
) -> None:
    """Ask people which of two pictures is the photo-real rendering (the paper's Table II).

    Makes one page that needs no network, to be opened in any browser; people answer, save a file
    and send it. With --score, reads such files against the key: how often each method's
    picture was taken for the renderer's.
    """
    folder = Folders.beside(data, models, models).metrics / "studies"
    page = out or folder / "pairs.html"
    if page.suffix != ".html":
        raise click.BadParameter(f"{page} is no page; let it end in .html", param_hint="--out")
    if scoring != bool(files):
        raise click.UsageError(
            "--score needs the answer files, and they need --score: "
            "pbrnet study pairs --score FILE..."
        )
    if scoring:
        key = read_key(key_beside(page))
        result = score(key, read_all(files, key))
        target = folder / "pairs.json"
        write_json(target, plain(result))
        for line in _result_lines(result, target):
            click.echo(line)
        return
    wish = Wish(methods=tuple(dict.fromkeys(methods)), **wishes)
    made = make_pairs(params, Folders.beside(data, models, models), wish, page, replace)
    for line in _made_lines(made, wish, page):
        click.echo(line)


def _made_lines(made: Made, wish: Wish, page: Path) -> list[str]:
    names = list(dict.fromkeys(pair.method for pair in sorted(made.key.pairs, key=_by_method)))
    count = len(made.key.pairs)
    lines = [
        f"{page}: {count} pairs, {made.each} each of {', '.join(names)}; "
        f"{made.practice} more for practice ({page.stat().st_size / 1e6:.1f} MB, "
        f"page {made.key.page})"
    ]
    if count < wish.pairs:
        lines.append(
            f"{count} pairs, not {wish.pairs}: no view is shown twice (the {made.key.split} split "
            f"has {made.views}), and every method gets the same even number"
        )
    if not made.practice:
        lines.append("no practice: all views are in the study")
    lines.append(f"{made.key_path}: the key, which is not for those who answer")
    return lines


def _by_method(pair: Any) -> int:
    return METHODS.index(pair.method)


def _result_lines(result: PairsResult, target: Path) -> list[str]:
    people = "1 person" if result.people == 1 else f"{result.people} people"
    lines = [f"{people}, {result.pairs} pairs each, shown {result.seconds:g} s"]
    for method in METHODS:
        if method not in result.methods:
            continue
        figure = result.methods[method]
        around = f" ({interval(figure)})" if figure.answers else ""
        late = f", {figure.timeouts} without an answer in time" if figure.timeouts else ""
        lines.append(
            f"{method:>14}: {percent(figure.rate)}{around} taken for the rendering, "
            f"{figure.answers} answers{late}"
        )
    lines.append(f"{target}: 50 % would be indistinguishable")
    return lines
