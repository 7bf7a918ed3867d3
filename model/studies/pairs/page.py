"""The page of blind pairs: a method's picture beside the renderer's, shown for a few seconds.

After Table II of the paper, and Chen and Koltun (2017), who asked which of two pictures is the real
one. No view is shown twice: whoever saw a picture again would know that it is the renderer's,
which is the same in all pairs of a view.
"""

from __future__ import annotations

import base64
import os
import struct
import zlib
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch

from model.data.reader import Dataset
from model.evaluation.evaluate import image_of, open_split, true_color
from model.evaluation.inference import Networks
from model.methods import BASELINES, trained_baselines
from model.studies.pairs.answers import Key, Pair, Side, read_key
from model.training.train import Folders
from pipeline.images import Picture, png_bytes
from pipeline.params import Params
from pipeline.progress import Progress
from pipeline.templating import templates
from pipeline.tonemap import to_bytes
from scenes.checked import plain
from scenes.errors import InputError, ParameterError
from scenes.files import digest_bytes, write_json, write_text
from scenes.seeds import generator

PRACTICE = 2  # pairs before the study, that do not count
_GAP = 0.5  # seconds of nothing before a pair
_STEP = 1024  # bytes: the pictures of a pair are filled up to a whole number of them


@dataclass(frozen=True)
class Wish:
    """What the page shall be like."""

    pairs: int = 50  # at most
    seconds: float = 3.0  # that a pair is shown
    answer_seconds: float = 5.0  # to answer after that
    methods: tuple[str, ...] = ()  # of evaluation; empty: ours, the product, trained baselines


@dataclass(frozen=True)
class Card:
    """A pair before its pictures are made."""

    number: int  # of the view, in the split's order
    method: str
    truth: Side


@dataclass(frozen=True)
class Deal:
    """Who sees what, in the order of the page."""

    practice: tuple[Card, ...]
    pairs: tuple[Card, ...]

    @property
    def each(self) -> int:
        """Pairs of every method."""
        return len(self.pairs) // len({card.method for card in self.pairs})


@dataclass(frozen=True)
class Made:
    """What `make_pairs` has written."""

    key: Key
    key_path: Path
    views: int  # of the split
    each: int
    practice: int


def deal(methods: Sequence[str], views: int, wanted: int, rng: np.random.Generator) -> Deal:
    """Draw views, methods, sides and order.

    Every method comes equally often, with the truth on the left in just half of its pairs, and no
    view comes twice; so there are `wanted` pairs, or the next smaller multiple of twice the methods
    that the views suffice for. Views for practice are kept back unless that leaves too few.
    Raises `ParameterError` if that many cannot be dealt fairly, `InputError` if the views
    are too few.
    """
    block = 2 * len(methods)
    if wanted < block:
        raise ParameterError(
            f"--pairs: {wanted} is not allowed; {len(methods)} methods need at least {block}, "
            "one with the truth on either side of each"
        )
    if views < block:
        raise InputError(
            f"the split has {views} views, but pairs of {len(methods)} methods need at least "
            f"{block}, each view shown once; render more homes, or name fewer with --method"
        )
    usable = views - PRACTICE if views - PRACTICE >= block else views
    each = 2 * (min(wanted, usable) // block)
    drawn = [int(number) for number in rng.permutation(views)]
    cards = []
    for method in methods:
        halves = rng.permutation(each) % 2
        cards += [Card(drawn.pop(), method, _side(half)) for half in halves]
    order = rng.permutation(len(cards))
    practice = [
        Card(drawn.pop(), methods[index % len(methods)], _side(int(rng.integers(2))))
        for index in range(min(PRACTICE, len(drawn)))
    ]
    return Deal(tuple(practice), tuple(cards[place] for place in order))


def make_pairs(
    params: Params, folders: Folders, wish: Wish, out: Path, replace: bool = False
) -> Made:
    """Write the page `out` and its key beside it, `NAME-key.json`.

    Raises `ParameterError` if a key of another page is there and shall not be replaced: nobody
    could score the answers to that page any more. Else as `open_split` and `deal`.
    """
    torch.set_num_threads(len(os.sched_getaffinity(0)))
    methods = wish.methods or ("pbrnet", "product", *trained_baselines(folders.models))
    networks, dataset = open_split(params, folders, [name for name in methods if name in BASELINES])
    weights = {name: card.sha256 for name, card in sorted(networks.cards.items())}
    # The seed stands on the page; what else the lots depend on does not, so that they cannot be
    # drawn again by whoever has only the page and this program.
    secret = digest_bytes(dataset.fingerprint().encode(), *map(str.encode, weights.values()))
    rng = generator(params.seed, "study", "pairs", secret)
    dealt = deal(methods, len(dataset), wish.pairs, rng)
    names, pictures = _pictures(dealt, dataset, networks)
    shown = {
        card: alike([pictures[card][side] for side in ("left", "right")], rng)
        for card in (*dealt.practice, *dealt.pairs)
    }
    content = {
        "study": "pairs",
        "version": 1,
        "seed": params.seed,
        "seconds": wish.seconds,
        "answer_seconds": wish.answer_seconds,
        "gap": min(_GAP, wish.seconds),
    }
    seen = [picture for pictures in shown.values() for picture in pictures]
    page = digest_bytes(repr(sorted(content.items())).encode(), *seen)[:16]
    key = Key(
        study="pairs",
        version=1,
        page=page,
        seed=params.seed,
        split=dataset.split,
        seconds=wish.seconds,
        answer_seconds=wish.answer_seconds,
        models=weights,
        pairs=tuple(
            Pair(_name(index), *names[card.number], card.method, card.truth)
            for index, card in enumerate(dealt.pairs)
        ),
    )
    key_path = key_beside(out)
    if not replace:
        _keep_other_key(key_path, key)
    write_json(key_path, plain(key))
    content |= {
        "page": page,
        "practice": [_shown(f"practice-{i}", shown[c]) for i, c in enumerate(dealt.practice)],
        "pairs": [_shown(_name(i), shown[c]) for i, c in enumerate(dealt.pairs)],
    }
    write_text(out, _render(content))
    return Made(key, key_path, len(dataset), dealt.each, len(dealt.practice))


def key_beside(page: Path) -> Path:
    """Where the key of a page lies."""
    return page.with_name(f"{page.stem}-key.json")


def alike(pictures: Sequence[Picture], rng: np.random.Generator) -> list[bytes]:
    """PNGs of equal length, so that the length does not tell the noisier picture.

    Each gets a private chunk of random bytes, which every reader skips (PNG specification, 5.4).
    """
    plainly = [png_bytes(picture) for picture in pictures]
    length = (max(map(len, plainly)) // _STEP + 2) * _STEP
    padded = []
    for content in plainly:
        body = b"paDd" + rng.bytes(length - len(content) - 12)
        chunk = struct.pack(">I", len(body) - 4) + body + struct.pack(">I", zlib.crc32(body))
        padded.append(content[:-12] + chunk + content[-12:])  # before the closing IEND
    return padded


def _pictures(
    dealt: Deal, dataset: Dataset, networks: Networks
) -> tuple[dict[int, tuple[str, str]], dict[Card, dict[Side, Picture]]]:
    """Scene and view of every number that was dealt, and both pictures of every card."""
    cards = sorted((*dealt.practice, *dealt.pairs), key=lambda card: card.number)
    names: dict[int, tuple[str, str]] = {}
    pictures: dict[Card, dict[Side, Picture]] = {}
    with Progress(len(cards), "study pairs") as progress:
        views = dataset.at([card.number for card in cards])
        for card, example in zip(cards, views, strict=True):
            names[card.number] = (example.scene_id, example.view_id)
            method = to_bytes(image_of(card.method, example, None, networks))
            truth = to_bytes(true_color(example, networks))
            left, right = (truth, method) if card.truth == "left" else (method, truth)
            pictures[card] = {"left": left, "right": right}
            progress.advance()
    return names, pictures


def _keep_other_key(path: Path, key: Key) -> None:
    if not path.exists():
        return
    try:
        page = read_key(path).page
    except InputError:
        page = ""
    if page != key.page:
        raise ParameterError(
            f"{path}: the key of another page ({page or 'unreadable'}), whose answers could no "
            "longer be scored; give the new page another name with --out, or say --replace"
        )


def _side(half: int) -> Side:
    return "right" if half else "left"


def _name(index: int) -> str:
    return f"p{index + 1:04d}"


def _shown(name: str, pictures: Sequence[bytes]) -> dict[str, Any]:
    left, right = (
        f"data:image/png;base64,{base64.b64encode(picture).decode()}" for picture in pictures
    )
    return {"pair": name, "left": left, "right": right}


def _render(content: dict[str, Any]) -> str:
    template = templates("model.studies.pairs").get_template("pairs.html")
    return template.render(
        content=content,
        pairs=len(content["pairs"]),
        practice=len(content["practice"]),
        seconds=f"{content['seconds']:g}",
        answer_seconds=f"{content['answer_seconds']:g}",
        minutes=_minutes(content),
    )


def _minutes(content: dict[str, Any]) -> int:
    """About how long it takes, if people answer when the pictures are gone."""
    each = content["seconds"] + content["gap"] + 1
    return max(1, round(len(content["pairs"]) * each / 60))
