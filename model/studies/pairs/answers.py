"""Key and answer files of the pairs study, and the score of the answers.

Answer files come from other machines and are not trusted: size and nesting are limited, and every
field is checked.
"""

from __future__ import annotations

import json
import re
import stat
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal, TypeVar

from scipy.stats import binomtest

from pbrnet.model.studies.pairs.results import ChosenRate, FoldersResult, MistakenRate, PairsResult
from pbrnet.scenes.checked import build, within
from pbrnet.scenes.errors import InputError

T = TypeVar("T")
R = TypeVar("R", MistakenRate, ChosenRate)
Side = Literal["left", "right"]
MAX_BYTES = 2**20  # of a key or answer file; a thousand answers take 80 kB
MAX_PAIRS = 1000
_MAX_MESSAGE = 400  # characters of an error that quotes a file


@dataclass(frozen=True)
class Pair:
    """Solution of a pair of the page."""

    pair: str  # id on the page
    scene_id: str
    view_id: str
    method: str
    truth: Side  # side of the renderer's picture


@dataclass(frozen=True)
class Key:
    """Contract of `NAME-key.json`, beside the page `NAME.html` of methods and the renderer."""

    study: Literal["pairs"]
    version: Literal[1]
    page: str
    seed: int
    split: str
    seconds: float = field(metadata=within(above=0))  # a pair is shown
    answer_seconds: float = field(
        metadata=within(above=0)
    )  # for the answer, after the pair has disappeared
    models: dict[str, str]  # name -> SHA-256 of the weights
    pairs: tuple[Pair, ...]

    def verify(self, where: str) -> None:
        """Raise ValueError if there are no pairs, or two with the same id."""
        _verify_ids([pair.pair for pair in self.pairs], where)


@dataclass(frozen=True)
class PictureFile:
    """Picture of a folder."""

    folder: str  # name of the folder in `FolderKey.folders`
    file: str  # its name in the folder


@dataclass(frozen=True)
class FolderPair:
    """Origin of both pictures of a pair."""

    pair: str  # id on the page
    left: PictureFile
    right: PictureFile


@dataclass(frozen=True)
class FolderKey:
    """Contract of `NAME-key.json`, beside the page `NAME.html` of folders of pictures."""

    study: Literal["pairs"]
    version: Literal[2]
    page: str
    seed: int
    question: str
    seconds: float = field(metadata=within(above=0))  # a pair is shown
    answer_seconds: float = field(metadata=within(above=0))
    folders: tuple[str, ...]
    pairs: tuple[FolderPair, ...]

    def verify(self, where: str) -> None:
        """Raise ValueError for repeated ids, and for a pair that is not of two of the folders."""
        _verify_ids([pair.pair for pair in self.pairs], where)
        for index, pair in enumerate(self.pairs):
            sides = {pair.left.folder, pair.right.folder}
            if len(sides) < 2 or not sides <= set(self.folders):
                raise ValueError(f"{where}.pairs[{index}]: not of two of the folders")


def _verify_ids(names: Sequence[str], where: str) -> None:
    if not names or len(set(names)) < len(names):
        raise ValueError(f"{where}.pairs: no pairs, or two with the same id")


@dataclass(frozen=True)
class Answer:
    """Choice of one person in one pair."""

    pair: str
    side: Side | None  # chosen; None: no answer in time
    ms: int = field(metadata=within(0, 3_600_000))  # since the pictures appeared
    timed_out: bool

    def verify(self, where: str) -> None:
        """Raise ValueError if a side was chosen after the time, or none in time."""
        if self.timed_out != (self.side is None):
            raise ValueError(
                f"{where}.timed_out: {self.timed_out}, but the side is {self.side!r}; "
                "it must be true exactly if the side is null"
            )


@dataclass(frozen=True)
class Answers:
    """Contract of an answer file, as saved by the page."""

    study: Literal["pairs"]
    version: Literal[1]
    page: str
    seed: int
    session: str  # random id of a run, 32 hex digits
    answers: tuple[Answer, ...]

    def verify(self, where: str) -> None:
        """Raise ValueError for a malformed session id."""
        if not re.fullmatch(r"[0-9a-f]{32}", self.session):
            raise ValueError(f"{where}.session: {self.session!r} is not 32 hex digits")


def read_key(path: Path) -> Key | FolderKey:
    """Read the key of a page; `InputError` names the file and the field of an error."""
    if not path.is_file():
        raise InputError(f"{path}: no such key; pbrnet study pairs writes it beside the page")

    def kind(content: Any) -> type[Key | FolderKey]:
        folders = isinstance(content, dict) and content.get("version") == 2
        return FolderKey if folders else Key

    return _read(path, kind)


def read_answers(path: Path, key: Key | FolderKey) -> Answers:
    """Read the answers of one person to the key's page, with every pair answered once.

    `InputError` names the file and the field that does not match the key.
    """
    answers = _read(path, lambda _content: Answers)
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
            f"{missing[0]!r} first; only complete runs count"
        )
    return answers


def read_all(paths: Sequence[Path], key: Key | FolderKey) -> list[Answers]:
    """Read the answers of all persons; raises `InputError` if a run is given twice."""
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
    """Return the rate at which each method's picture was taken for the rendering, over all people.

    With Wilson's 95 % interval (Wilson 1927), which assumes independent answers; guessing gives one
    half.
    """
    solutions = {pair.pair: pair for pair in key.pairs}
    counts = {pair.method: [0, 0, 0] for pair in key.pairs}  # answers, mistaken, timeouts
    for person in people:
        for answer in person.answers:
            pair = solutions[answer.pair]
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
        methods={method: _figure(MistakenRate, *count) for method, count in counts.items()},
    )


def score_folders(key: FolderKey, people: Sequence[Answers]) -> FoldersResult:
    """Return the share of answers that chose each folder's picture, over all people.

    Of all its pairs, and of those against each other folder; intervals as in `score`.
    """
    solutions = {pair.pair: pair for pair in key.pairs}
    counts: dict[str, dict[str, Counter[str]]] = {name: {} for name in key.folders}
    for person in people:
        for answer in person.answers:
            pair = solutions[answer.pair]
            for side, own, other in (
                ("left", pair.left.folder, pair.right.folder),
                ("right", pair.right.folder, pair.left.folder),
            ):
                count = counts[own].setdefault(other, Counter())
                if answer.side is None:
                    count["timeouts"] += 1
                else:
                    count["answers"] += 1
                    count["chosen"] += answer.side == side
    return FoldersResult(
        page=key.page,
        seed=key.seed,
        question=key.question,
        seconds=key.seconds,
        people=len(people),
        pairs=len(key.pairs),
        folders={name: _chosen(sum(others.values(), Counter())) for name, others in counts.items()},
        against={
            name: {other: _chosen(count) for other, count in others.items()}
            for name, others in counts.items()
        },
    )


def _chosen(count: Counter[str]) -> ChosenRate:
    return _figure(ChosenRate, count["answers"], count["chosen"], count["timeouts"])


def _figure(kind: type[R], answers: int, chosen: int, timeouts: int) -> R:
    if not answers:
        return kind(0, 0, timeouts, None, None, None)
    around = binomtest(chosen, answers).proportion_ci(0.95, method="wilson")
    low, high = (min(1.0, max(0.0, float(end))) for end in (around.low, around.high))
    return kind(answers, chosen, timeouts, chosen / answers, low, high)


def _read(path: Path, kind: Callable[[Any], type[T]]) -> T:
    """Read a small JSON file as the `kind` of its content; errors are an `InputError` of a line."""
    try:
        content = _parse(path)
        return build(kind(content), content, str(path), InputError)
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
            content.decode("utf-8"), object_pairs_hook=_unique_keys, parse_constant=_refuse_constant
        )
    except RecursionError:
        raise InputError(f"{path}: nested too deeply; not an answer file or a key") from None
    except ValueError as error:  # includes invalid UTF-8 and numbers with thousands of digits
        raise InputError(f"{path}: not valid JSON ({error})") from None


def _unique_keys(items: list[tuple[str, Any]]) -> dict[str, Any]:
    """Return an object, refusing repeated keys, which parsers interpret differently."""
    content = dict(items)
    if len(content) < len(items):
        repeated = Counter(name for name, _ in items).most_common(1)[0][0]
        raise ValueError(f"the key {repeated!r} comes twice in one object")
    return content


def _refuse_constant(text: str) -> Any:
    raise ValueError(f"{text} is not a number")


def _readable(message: str) -> str:
    """Replace control characters, and shorten the message to a few lines."""
    clean = "".join(letter if letter.isprintable() else "?" for letter in message)
    return clean if len(clean) <= _MAX_MESSAGE else clean[:_MAX_MESSAGE] + " …"
