"""The pairs study's key, the answers that people send back, and what follows from both.

Answer files come from other people's machines: they are read with a limit of size and depth, and
every field is checked before it is believed.
"""

from __future__ import annotations

import json
import re
import stat
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal, TypeVar

from scipy.stats import binomtest

from model.studies.pairs.results import PairsFigure, PairsResult
from scenes.checked import build, within
from scenes.errors import InputError

T = TypeVar("T")
Side = Literal["left", "right"]
MAX_BYTES = 2**20  # of a key or an answer file; a thousand answers are 80 kB
MAX_PAIRS = 1000
_LONGEST = 400  # characters of an error that quotes a file


@dataclass(frozen=True)
class Pair:
    """What hides behind a pair of the page."""

    pair: str  # its id on the page
    scene_id: str
    view_id: str
    method: str
    truth: Side  # where the renderer's picture is


@dataclass(frozen=True)
class Key:
    """`NAME-key.json` beside the page `NAME.html`."""

    study: Literal["pairs"]
    version: Literal[1]
    page: str
    seed: int
    split: str
    seconds: float = field(metadata=within(above=0))  # that a pair is shown
    answer_seconds: float = field(metadata=within(above=0))  # to answer after that
    models: dict[str, str]  # name -> SHA-256 of the weights
    pairs: tuple[Pair, ...]

    def verify(self, where: str) -> None:
        """Raises ValueError if there are no pairs, or two of one id."""
        names = [pair.pair for pair in self.pairs]
        if not names or len(set(names)) < len(names):
            raise ValueError(f"{where}.pairs: no pairs, or two with the same id")


@dataclass(frozen=True)
class Answer:
    """One person's choice in one pair."""

    pair: str
    side: Side | None  # that was taken for the rendering; None: none in time
    ms: int = field(metadata=within(0, 3_600_000))  # from the pictures' appearance
    timed_out: bool

    def verify(self, where: str) -> None:
        """Raises ValueError if it is both, an answer and none."""
        if self.timed_out != (self.side is None):
            raise ValueError(
                f"{where}.timed_out: {self.timed_out}, but the side is {self.side!r}; "
                "exactly the pairs without a side have timed out"
            )


@dataclass(frozen=True)
class Answers:
    """A downloaded answer file."""

    study: Literal["pairs"]
    version: Literal[1]
    page: str
    seed: int
    session: str  # drawn by the page for each person, 32 hex digits
    answers: tuple[Answer, ...]

    def verify(self, where: str) -> None:
        """Raises ValueError for a session that no page has drawn."""
        if not re.fullmatch(r"[0-9a-f]{32}", self.session):
            raise ValueError(f"{where}.session: {self.session!r} is not 32 hex digits")


def read_key(path: Path) -> Key:
    """The key of a page; `InputError` names file and field of what is wrong."""
    if not path.is_file():
        raise InputError(
            f"{path}: no such key; it is written beside the page by: pbrnet study pairs"
        )
    return _read(Key, path)


def read_answers(path: Path, key: Key) -> Answers:
    """One person's answers to the key's page, every pair answered once.

    Raises `InputError` that names the file and the field that does not fit.
    """
    answers = _read(Answers, path)
    if answers.page != key.page:
        raise InputError(
            _readable(f"{path}.page: {answers.page!r}, but the key is of the page {key.page!r}")
        )
    if answers.seed != key.seed:
        raise InputError(f"{path}.seed: {answers.seed}, but the key's is {key.seed}")
    known = {pair.pair for pair in key.pairs}
    seen: set[str] = set()
    for index, answer in enumerate(answers.answers):
        where = f"{path}.answers[{index}].pair"
        if answer.pair not in known:
            raise InputError(_readable(f"{where}: the page has no pair {answer.pair!r}"))
        if answer.pair in seen:
            raise InputError(f"{where}: {answer.pair!r} is answered twice")
        seen.add(answer.pair)
    missing = sorted(known - seen)
    if missing:
        raise InputError(
            f"{path}.answers: {len(missing)} of {len(known)} pairs are missing, "
            f"{missing[0]!r} first; only whole runs count"
        )
    return answers


def read_all(paths: Sequence[Path], key: Key) -> list[Answers]:
    """Everybody's answers; raises `InputError` if one person's come twice."""
    found: list[Answers] = []
    sessions: dict[str, Path] = {}
    for path in paths:
        answers = read_answers(path, key)
        if answers.session in sessions:
            raise InputError(
                f"{path}.session: the same person's answers as {sessions[answers.session]}; "
                "give each file once"
            )
        sessions[answers.session] = path
        found.append(answers)
    return found


def score(key: Key, people: Sequence[Answers]) -> PairsResult:
    """How often each method's picture was taken for the truth, over all people.

    With Wilson's 95 % interval (Wilson 1927), which takes every answer for independent; one half
    is what guessing gives.
    """
    behind = {pair.pair: pair for pair in key.pairs}
    counts = {pair.method: [0, 0, 0] for pair in key.pairs}  # answers, mistaken, timeouts
    for person in people:
        for answer in person.answers:
            pair = behind[answer.pair]
            count = counts[pair.method]
            if answer.side is None:
                count[2] += 1
            else:
                count[0] += 1
                count[1] += answer.side != pair.truth
    return PairsResult(
        page=key.page,
        seed=key.seed,
        split=key.split,
        seconds=key.seconds,
        people=len(people),
        pairs=len(key.pairs),
        methods={method: _figure(*count) for method, count in counts.items()},
    )


def _figure(answers: int, mistaken: int, timeouts: int) -> PairsFigure:
    if not answers:
        return PairsFigure(0, 0, timeouts, None, None, None)
    around = binomtest(mistaken, answers).proportion_ci(0.95, method="wilson")
    low, high = (min(1.0, max(0.0, float(end))) for end in (around.low, around.high))
    return PairsFigure(answers, mistaken, timeouts, mistaken / answers, low, high)


def _read(cls: type[T], path: Path) -> T:
    """A small JSON file as `cls`; whatever is wrong with it is an `InputError` of one line."""
    try:
        return build(cls, _parse(path), str(path), InputError)
    except InputError as error:
        raise InputError(_readable(str(error))) from None


def _parse(path: Path) -> Any:
    try:
        if not stat.S_ISREG(path.stat().st_mode):
            raise InputError(f"{path}: not a plain file")
        with path.open("rb") as stream:
            content = stream.read(MAX_BYTES + 1)
    except FileNotFoundError:
        raise InputError(f"{path}: no such file") from None
    if len(content) > MAX_BYTES:
        raise InputError(f"{path}: more than {MAX_BYTES >> 10} KiB; not an answer file or a key")
    try:
        return json.loads(
            content.decode("utf-8"), object_pairs_hook=_single, parse_constant=_no_number
        )
    except RecursionError:
        raise InputError(f"{path}: nested too deeply; not an answer file or a key") from None
    except ValueError as error:  # also what is not UTF-8, and numbers of thousands of digits
        raise InputError(f"{path}: not valid JSON ({error})") from None


def _single(items: list[tuple[str, Any]]) -> dict[str, Any]:
    """An object whose keys come once: else two readers could see two different files."""
    content = dict(items)
    if len(content) < len(items):
        twice = Counter(name for name, _ in items).most_common(1)[0][0]
        raise ValueError(f"the key {twice!r} comes twice in one object")
    return content


def _no_number(text: str) -> Any:
    raise ValueError(f"{text} is no number")


def _readable(message: str) -> str:
    """Without what could steer a terminal, and not longer than a few lines."""
    clean = "".join(letter if letter.isprintable() else "?" for letter in message)
    return clean if len(clean) <= _LONGEST else clean[:_LONGEST] + " …"
