"""`pbrnet study pairs`."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from model.evaluation.evaluate import EVALUATED_METHODS
from model.options import FILE, models_option
from model.studies.pairs.answers import MAX_PAIRS, Pair, read_all, read_key, score
from model.studies.pairs.results import PairsResult, interval, percent
from model.studies.pairs.study import PairsConfig, WrittenPage, key_path_of, write_pairs_page
from model.training.train import Folders
from pipeline.commands.options import common_options
from pipeline.params import Params
from scenes.checked import plain
from scenes.files import write_json


@click.command(
    "pairs",
    epilog="""\b
Examples:
  pbrnet study pairs                            50 pairs, 3 seconds each
  pbrnet study pairs --method pbrnet --method unet --pairs 40 --seed 7 --out other.html
  pbrnet study pairs --score answers/*.json

Give observers only the page. The key beside it, NAME-key.json, says which pictures are the
renderer's. Keep it: without it, answers cannot be scored.""",
)
@click.argument("files", nargs=-1, type=FILE, metavar="[FILE]...")
@click.option("--score", "scoring", is_flag=True, help="Score the answer files FILE.")
@click.option(
    "--pairs",
    type=click.IntRange(2, MAX_PAIRS),
    default=50,
    show_default=True,
    help="Maximum number of pairs, equal for all methods; no view is shown twice.",
)
@click.option(
    "--seconds",
    type=click.FloatRange(0.1, 60),
    default=3.0,
    show_default=True,
    help="Time a pair is shown.",
)
@click.option(
    "--answer-seconds",
    type=click.FloatRange(0.1, 600),
    default=5.0,
    show_default=True,
    help="Time for the answer after the pair has disappeared.",
)
@click.option(
    "--method",
    "methods",
    type=click.Choice(EVALUATED_METHODS),
    multiple=True,
    help="A method to show; repeatable.  [default: pbrnet, product, trained baselines]",
)
@click.option(
    "--out",
    type=FILE,
    default=None,
    help="Page to write, with its key beside it.  [default: metrics/studies/pairs.html]",
)
@click.option("--replace", is_flag=True, help="Overwrite another page and its key.")
@models_option()
@common_options
def command(
    params: Params,
    data: Path,
    models: Path,
    out: Path | None,
    files: tuple[Path, ...],
    scoring: bool,
    replace: bool,
    methods: tuple[str, ...],
    **options: Any,
) -> None:
    """Ask observers which of two pictures is the photo-realistic rendering (Table II).

    Writes a self-contained page that runs in any browser; observers answer, save a file and send
    it. With --score, reads answer files and reports how often each method's picture was taken for
    the renderer's.
    """
    folders = Folders.beside(data, models, models)
    studies = folders.metrics / "studies"
    page = out or studies / "pairs.html"
    if page.suffix != ".html":
        raise click.BadParameter(f"{page}: the file name must end in .html", param_hint="--out")
    if scoring != bool(files):
        raise click.UsageError(
            "--score needs the answer files, and they need --score: "
            "pbrnet study pairs --score FILE..."
        )
    if scoring:
        key = read_key(key_path_of(page))
        result = score(key, read_all(files, key))
        target = studies / "pairs.json"
        write_json(target, plain(result))
        lines = _result_lines(result, target)
    else:
        config = PairsConfig(methods=tuple(dict.fromkeys(methods)), **options)
        lines = _page_lines(write_pairs_page(params, folders, config, page, replace), config, page)
    for line in lines:
        click.echo(line)


def _page_lines(written: WrittenPage, config: PairsConfig, page: Path) -> list[str]:
    names = dict.fromkeys(pair.method for pair in sorted(written.key.pairs, key=_by_method))
    count = len(written.key.pairs)
    lines = [
        f"{page}: {count} pairs, {written.each} each of {', '.join(names)}; "
        f"{written.practice} more for practice ({page.stat().st_size / 1e6:.1f} MB, "
        f"page {written.key.page})"
    ]
    if count < config.pairs:
        lines.append(
            f"{count} pairs, not {config.pairs}: no view is shown twice (the {written.key.split} "
            f"split has {written.views}), and every method gets the same even number"
        )
    if not written.practice:
        lines.append("no practice pairs: the study uses all views")
    lines.append(f"{written.key_path}: the key; do not give it to observers")
    return lines


def _by_method(pair: Pair) -> int:
    return EVALUATED_METHODS.index(pair.method)


def _result_lines(result: PairsResult, target: Path) -> list[str]:
    people = "1 person" if result.people == 1 else f"{result.people} people"
    lines = [f"{people}, {result.pairs} pairs each, shown {result.seconds:g} s"]
    for method in EVALUATED_METHODS:
        if method not in result.methods:
            continue
        figure = result.methods[method]
        around = f" ({interval(figure)})" if figure.answers else ""
        late = f", {figure.timeouts} without an answer in time" if figure.timeouts else ""
        lines.append(
            f"{method:>14}: {percent(figure.rate)}{around} taken for the rendering, "
            f"{figure.answers} answers{late}"
        )
    lines.append(f"{target}: 50 % means indistinguishable")
    return lines
