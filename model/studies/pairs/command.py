"""`pbrnet study pairs`."""

from __future__ import annotations

from itertools import combinations
from pathlib import Path
from typing import Any

import click

from pbrnet.model.evaluation.evaluate import EVALUATED_METHODS
from pbrnet.model.options import folders_options, methods_option
from pbrnet.model.studies.options import config_options
from pbrnet.model.studies.pairs.answers import (
    FolderKey,
    FolderPair,
    Key,
    read_all,
    read_key,
    score,
    score_folders,
)
from pbrnet.model.studies.pairs.folders import parse_folders, write_folders_page
from pbrnet.model.studies.pairs.results import (
    ChosenRate,
    FoldersResult,
    MistakenRate,
    PairsResult,
    folder_figures,
    interval,
    percent,
)
from pbrnet.model.studies.pairs.study import (
    QUESTION,
    PairsConfig,
    WrittenPage,
    key_path_of,
    write_pairs_page,
)
from pbrnet.model.training.train import Folders
from pbrnet.pipeline.commands.options import FILE, Request
from pbrnet.pipeline.terminal import say
from pbrnet.scenes.checked import plain
from pbrnet.scenes.files import write_json


@click.command(
    "pairs",
    epilog="""\b
Examples:
  pbrnet study pairs                            50 pairs, 3 seconds each
  pbrnet study pairs --method pbrnet --method unet --pairs 40 --seed 7 --out other.html
  pbrnet study pairs --folder old=renders/old --folder new=renders/new
  pbrnet study pairs --score answers/*.json

Give observers only the page. The key beside it, NAME-key.json, states the origin of each image.
Keep it: without it, answers cannot be scored.""",
)
@click.argument("files", nargs=-1, type=FILE, metavar="[FILE]...")
@click.option("--score", "scoring", is_flag=True, help="Score the answer files FILE.")
@config_options(PairsConfig)
@methods_option(
    EVALUATED_METHODS,
    "Method to show (repeatable).  [default: pbrnet, product, trained baselines]",
)
@click.option(
    "--folder",
    "pictures",
    multiple=True,
    metavar="NAME=FOLDER",
    help="Compare folders of PNG or JPEG images instead of methods; at least two.",
)
@click.option(
    "--question", metavar="TEXT", help=f"Question about images of folders.  [default: {QUESTION}]"
)
@click.option(
    "--out",
    type=FILE,
    help="Page to write, with its key beside it.  [default: metrics/studies/pairs.html]",
)
@click.option("--replace", is_flag=True, help="Overwrite another page and its key.")
@folders_options()
def command(
    request: Request,
    folders: Folders,
    out: Path | None,
    files: tuple[Path, ...],
    scoring: bool,
    replace: bool,
    methods: tuple[str, ...],
    pictures: tuple[str, ...],
    question: str | None,
    **options: Any,
) -> None:
    """Ask observers which of two images is the photo-realistic rendering (Table II).

    Writes a self-contained page that runs in any browser; observers answer, save a file and send
    it. With --score, reads answer files and reports how often each method's picture was taken for
    the renderer's.

    With --folder, the pictures come from folders, such as renders of an old and a new version, or
    photographs, and people choose the one that looks more like a photograph.
    """
    params, studies = request.params, folders.metrics / "studies"
    page = out or studies / "pairs.html"
    if page.suffix != ".html":
        raise click.BadParameter(f"{page}: the file name must end in .html", param_hint="--out")
    if scoring != bool(files):
        raise click.UsageError(
            "--score requires the answer files, and they require --score: "
            "pbrnet study pairs --score FILE..."
        )
    if pictures and methods:
        raise click.UsageError("--folder and --method exclude each other")
    if question is not None and not pictures:
        raise click.UsageError("--question requires --folder")
    if scoring:
        key = read_key(key_path_of(page))
        people = read_all(files, key)
        result = score_folders(key, people) if isinstance(key, FolderKey) else score(key, people)
        target = studies / "pairs.json"
        write_json(target, plain(result))
        lines = _result_lines(result, target)
    elif pictures:
        asked = QUESTION if question is None else question
        config = PairsConfig(folders=parse_folders(pictures), question=asked, **options)
        lines = _page_lines(write_folders_page(params.seed, config, page, replace), config, page)
    else:
        config = PairsConfig(methods=tuple(dict.fromkeys(methods)), **options)
        lines = _page_lines(write_pairs_page(params, folders, config, page, replace), config, page)
    for line in lines:
        say(line)


def _page_lines(written: WrittenPage, config: PairsConfig, page: Path) -> list[str]:
    key, count = written.key, len(written.key.pairs)
    lines = [
        f"{page}: {count} pairs, {_shares(key, written.each)}; "
        f"{written.practice} more for practice ({page.stat().st_size / 1e6:.1f} MB, "
        f"page {key.page})"
    ]
    if count < config.pairs and isinstance(key, Key):
        lines.append(
            f"{count} pairs, not {config.pairs}: no view is shown twice (the {key.split} "
            f"split has {written.views}), and every method gets the same even number"
        )
    elif count < config.pairs:
        lines.append(
            f"{count} pairs, not {config.pairs}: no image is shown twice (the smallest folder "
            f"has {written.views}), and every two folders get the same even number"
        )
    if not written.practice:
        every = "views" if isinstance(key, Key) else "pictures"
        lines.append(f"no practice pairs: the study uses all {every}")
    lines.append(f"{written.key_path}: the key; do not give it to observers")
    return lines


def _shares(key: Key | FolderKey, each: int) -> str:
    if isinstance(key, FolderKey):
        both = ", ".join(map(" and ".join, combinations(key.folders, 2)))
        alike = sum(map(_has_one_name, key.pairs))
        return f"{each} each of {both}, {alike} in all of the same file name"
    shown = {pair.method for pair in key.pairs}
    return f"{each} each of {', '.join(name for name in EVALUATED_METHODS if name in shown)}"


def _has_one_name(pair: FolderPair) -> bool:
    return Path(pair.left.file).stem == Path(pair.right.file).stem


def _result_lines(result: PairsResult | FoldersResult, target: Path) -> list[str]:
    people = "1 person" if result.people == 1 else f"{result.people} people"
    lines = [f"{people}, {result.pairs} pairs each, shown {result.seconds:g} s"]
    figures: dict[str, MistakenRate] | dict[str, ChosenRate]
    if isinstance(result, FoldersResult):
        lines.append(result.question)
        figures, words, meaning = folder_figures(result), "chosen", "chosen as often as the other"
    else:
        figures = {
            name: result.methods[name] for name in EVALUATED_METHODS if name in result.methods
        }
        words, meaning = "taken for the rendering", "indistinguishable"
    for name, figure in figures.items():
        around = f" ({interval(figure)})" if figure.answers else ""
        late = f", {figure.timeouts} without an answer in time" if figure.timeouts else ""
        lines.append(
            f"{name:>14}: {percent(figure.rate)}{around} {words}, {figure.answers} answers{late}"
        )
    lines.append(f"{target}: 50 % means {meaning}")
    return lines
