"""Page of blind pairs: a method's picture beside the renderer's, shown for a few seconds.

After Table II of the paper and Chen and Koltun (2017). No view is shown twice: the renderer's
picture is the same in all pairs of a view, so an observer would recognise it.
"""

from __future__ import annotations

import base64
import os
import struct
import zlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import click
import numpy as np
import torch

from pbrnet.model.data.reader import Dataset
from pbrnet.model.evaluation.evaluate import image_of, open_split, true_color
from pbrnet.model.evaluation.inference import Networks
from pbrnet.model.methods import BASELINES, trained_baselines
from pbrnet.model.studies.options import option
from pbrnet.model.studies.pairs.answers import (
    MAX_PAIRS,
    FolderKey,
    Key,
    Pair,
    Side,
    read_key,
)
from pbrnet.model.training.train import Folders
from pbrnet.pipeline.commands.options import NumberRange
from pbrnet.pipeline.images import Picture, png_bytes
from pbrnet.pipeline.params import Params
from pbrnet.pipeline.progress import Progress
from pbrnet.pipeline.templating import templates
from pbrnet.pipeline.tonemap import to_bytes
from pbrnet.scenes.checked import plain
from pbrnet.scenes.errors import InputError, ParameterError
from pbrnet.scenes.files import digest_bytes, write_json, write_text
from pbrnet.scenes.seeds import generator

PRACTICE_PAIRS = 2  # before the study; not scored
QUESTION = "Which of the two looks more like a photograph?"  # about folders of pictures
_GAP = 0.5  # blank time before a pair, seconds
_PADDING = 1024  # bytes; the PNGs of a pair are padded to the same multiple of it


@dataclass(frozen=True)
class PairsConfig:
    """Content of the page."""

    pairs: int = option(
        50,
        click.IntRange(2, MAX_PAIRS),
        "Maximum number of pairs, equal for all methods; no view or image is shown twice.",
    )
    seconds: float = option(3.0, NumberRange(0.1, 60), "Time a pair is shown.")
    answer_seconds: float = option(
        5.0,
        NumberRange(0.1, 600),
        "Time for the answer after the pair has disappeared.",
    )
    methods: tuple[str, ...] = ()  # empty: pbrnet, product and all trained baselines
    folders: tuple[tuple[str, Path], ...] = ()  # names and places, for a page of pictures of files
    question: str = QUESTION  # for a page of folders


@dataclass(frozen=True)
class PlannedPair:
    """View, method and sides of a pair."""

    number: int  # index of the view in the split
    method: str  # or the names of both folders
    truth: Side  # or the side of the first folder


@dataclass(frozen=True)
class PairPlan:
    """All pairs, in the order of the page."""

    practice: tuple[PlannedPair, ...]
    pairs: tuple[PlannedPair, ...]

    @property
    def each(self) -> int:
        """Number of pairs of every method."""
        return len(self.pairs) // len({pair.method for pair in self.pairs})


@dataclass(frozen=True)
class WrittenPage:
    """Key of the written page, and numbers of views and pairs."""

    key: Key | FolderKey
    key_path: Path
    views: int  # of the split, or pictures in the smallest folder
    each: int  # pairs of every method, or of every two folders
    practice: int  # practice pairs


def plan_pairs(
    methods: Sequence[str], views: int, wanted: int, rng: np.random.Generator
) -> PairPlan:
    """Draw views, methods, sides and order at random.

    All methods have the same number of pairs, the truth is on the left in exactly half of them, and
    no view is used twice. The number of pairs is the largest multiple of twice the number of
    methods up to `wanted` for which the views suffice. Views for practice are reserved if enough
    remain. Raises `ParameterError` if `wanted` is too small, `InputError` if there are too few
    views.
    """
    block = 2 * len(methods)
    if wanted < block:
        raise ParameterError(
            f"--pairs: {wanted} is not allowed; {len(methods)} methods need at least {block}, "
            "for each method one with the truth on either side"
        )
    if views < block:
        raise InputError(
            f"the split has {views} views, but pairs of {len(methods)} methods need at least "
            f"{block}, because no view is shown twice; render more homes, or select fewer methods "
            "with --method"
        )
    usable = views - PRACTICE_PAIRS if views - PRACTICE_PAIRS >= block else views
    each = 2 * (min(wanted, usable) // block)
    drawn = [int(number) for number in rng.permutation(views)]
    pairs = []
    for method in methods:
        halves = rng.permutation(each) % 2
        pairs += [PlannedPair(drawn.pop(), method, _side(half)) for half in halves]
    order = rng.permutation(len(pairs))
    practice = [
        PlannedPair(drawn.pop(), methods[index % len(methods)], _side(int(rng.integers(2))))
        for index in range(min(PRACTICE_PAIRS, len(drawn)))
    ]
    return PairPlan(tuple(practice), tuple(pairs[index] for index in order))


def write_pairs_page(
    params: Params, folders: Folders, config: PairsConfig, out: Path, replace: bool = False
) -> WrittenPage:
    """Write the page `out` and its key `NAME-key.json` beside it.

    Raises `ParameterError` if the key of another page exists and `replace` is false, because
    without it the answers to that page could no longer be scored. Raises as `open_split` and
    `plan_pairs`.
    """
    torch.set_num_threads(len(os.sched_getaffinity(0)))
    methods = config.methods or ("pbrnet", "product", *trained_baselines(folders.models))
    trained = [name for name in methods if name in BASELINES]
    own = [name for name in methods if name not in (*trained, "denoised", "radiosity")]
    split, measured = params.evaluate.split, (*(["pbrnet"] if own or not trained else []), *trained)
    more = ("denoised_color",) if "denoised" in methods else ()
    networks, dataset = open_split(split, params.tone, folders, measured, more)
    weights = {name: card.sha256 for name, card in sorted(networks.cards.items())}
    # The seed is on the page; the secret is not, so that nobody who has only the page and this
    # program can reconstruct the sides.
    secret = digest_bytes(dataset.fingerprint().encode(), *map(str.encode, weights.values()))
    rng = generator(params.seed, "study", "pairs", secret)
    plan = plan_pairs(methods, len(dataset), config.pairs, rng)
    names, pictures = _pictures(plan, dataset, networks)
    shown = {
        pair: equal_length_pngs([pictures[pair][side] for side in ("left", "right")], rng)
        for pair in (*plan.practice, *plan.pairs)
    }

    def key_of(page: str) -> Key:
        return Key(
            study="pairs",
            version=1,
            page=page,
            seed=params.seed,
            split=dataset.split,
            seconds=config.seconds,
            answer_seconds=config.answer_seconds,
            models=weights,
            pairs=tuple(
                Pair(pair_id(index), *names[pair.number], pair.method, pair.truth)
                for index, pair in enumerate(plan.pairs)
            ),
        )

    key = write_page_and_key(out, params.seed, config, plan, shown, key_of, replace)
    return WrittenPage(key, key_path_of(out), len(dataset), plan.each, len(plan.practice))


def write_page_and_key(
    out: Path,
    seed: int,
    config: PairsConfig,
    plan: PairPlan,
    shown: Mapping[PlannedPair, Sequence[bytes]],
    key_of: Callable[[str], Key | FolderKey],
    replace: bool,
) -> Key | FolderKey:
    """Write the page `out` and its key, which `key_of` makes with the page's id.

    `shown`: PNGs of every planned pair, left and right. Raises as `write_pairs_page`.
    """
    content: dict[str, Any] = {
        "study": "pairs",
        "version": 1,  # of the answer files
        "seed": seed,
        "seconds": config.seconds,
        "answer_seconds": config.answer_seconds,
        "gap": min(_GAP, config.seconds),
    }
    if config.folders:
        content["question"] = config.question
    seen = [picture for pictures in shown.values() for picture in pictures]
    page = digest_bytes(repr(sorted(content.items())).encode(), *seen)[:16]
    key, key_path = key_of(page), key_path_of(out)
    if not replace:
        _check_key_may_be_replaced(key_path, key)
    write_json(key_path, plain(key))
    content |= {
        "page": page,
        "practice": [_page_pair(f"practice-{i}", shown[c]) for i, c in enumerate(plan.practice)],
        "pairs": [_page_pair(pair_id(i), shown[c]) for i, c in enumerate(plan.pairs)],
    }
    write_text(out, _render(content))
    return key


def key_path_of(page: Path) -> Path:
    """Return the path of a page's key."""
    return page.with_name(f"{page.stem}-key.json")


def equal_length_pngs(pictures: Sequence[Picture], rng: np.random.Generator) -> list[bytes]:
    """Encode pictures as PNGs of equal length, so that the length does not reveal the noisier one.

    Each gets a private chunk of random bytes, which readers skip (PNG specification, 5.4).
    """
    encoded = [png_bytes(picture) for picture in pictures]
    length = (max(map(len, encoded)) // _PADDING + 2) * _PADDING
    padded = []
    for content in encoded:
        body = b"paDd" + rng.bytes(length - len(content) - 12)
        chunk = struct.pack(">I", len(body) - 4) + body + struct.pack(">I", zlib.crc32(body))
        padded.append(content[:-12] + chunk + content[-12:])  # before the closing IEND
    return padded


def _pictures(
    plan: PairPlan, dataset: Dataset, networks: Networks
) -> tuple[dict[int, tuple[str, str]], dict[PlannedPair, dict[Side, Picture]]]:
    """Return scene and view of every planned index, and both pictures of every pair."""
    pairs = sorted((*plan.practice, *plan.pairs), key=lambda pair: pair.number)
    names: dict[int, tuple[str, str]] = {}
    pictures: dict[PlannedPair, dict[Side, Picture]] = {}
    with Progress(len(pairs), "study pairs") as progress:
        views = dataset.at([pair.number for pair in pairs])
        for pair, example in zip(pairs, views, strict=True):
            names[pair.number] = (example.scene_id, example.view_id)
            method = to_bytes(image_of(pair.method, example, None, networks))
            truth = to_bytes(true_color(example, networks))
            left, right = (truth, method) if pair.truth == "left" else (method, truth)
            pictures[pair] = {"left": left, "right": right}
            progress.advance()
    return names, pictures


def _check_key_may_be_replaced(path: Path, key: Key | FolderKey) -> None:
    if not path.exists():
        return
    try:
        page = read_key(path).page
    except InputError:
        page = ""
    if page != key.page:
        raise ParameterError(
            f"{path}: the key of another page ({page or 'unreadable'}), whose answers could no "
            "longer be scored; name the new page with --out, or overwrite with --replace"
        )


def _side(half: int) -> Side:
    return "right" if half else "left"


def pair_id(index: int) -> str:
    """Return the id of a pair on the page."""
    return f"p{index + 1:04d}"


def _page_pair(name: str, pictures: Sequence[bytes]) -> dict[str, Any]:
    left, right = (
        f"data:image/png;base64,{base64.b64encode(picture).decode()}" for picture in pictures
    )
    return {"pair": name, "left": left, "right": right}


def _render(content: dict[str, Any]) -> str:
    template = templates("pbrnet.model.studies.pairs").get_template("pairs.html")
    return template.render(
        content=content,
        question=content.get("question"),
        pairs=len(content["pairs"]),
        practice=len(content["practice"]),
        seconds=f"{content['seconds']:g}",
        answer_seconds=f"{content['answer_seconds']:g}",
        minutes=_minutes(content),
    )


def _minutes(content: dict[str, Any]) -> int:
    """Estimate the duration, with one second for each answer."""
    each = content["seconds"] + content["gap"] + 1
    return max(1, round(len(content["pairs"]) * each / 60))
