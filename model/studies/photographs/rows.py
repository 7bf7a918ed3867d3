"""Rows of the study: on which sets a network is trained, and how."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import yaml

from pbrnet.scenes.checked import build, shown
from pbrnet.scenes.errors import InputError, ParameterError
from pbrnet.scenes.files import digest_bytes, read_text

_MOST = 1000  # rows
_USUAL = ("data", "dataset")  # names of folders that say nothing
_SET = re.compile(r"(?P<path>.*?)(@(?P<views>[1-9]\d{0,8}))?")


@dataclass(frozen=True)
class Source:
    """A training set: its path, and the number of its pictures; None for all of them."""

    path: Path
    views: int | None

    @property
    def name(self) -> str:
        """Name for results: the last parts of the path that tell it from other data folders."""
        parts = self.path.parts
        names = next((n for n, part in enumerate(parts[::-1]) if part not in _USUAL), 0)
        return "/".join(parts[-1 - names :])


@dataclass(frozen=True)
class Row:
    """A training: its name, and for each of its stages the sets whose pictures are mixed.

    A set is a path, with `@N` behind it for N of its pictures. `varied`: whether pictures vary in
    exposure, white balance, noise and so on.
    """

    name: str
    train: tuple[tuple[str, ...], ...]
    varied: bool = True

    def verify(self, where: str) -> None:
        """Check name and stages; raises ValueError."""
        if not self.name.strip() or len(self.name) > 100 or not self.name.isprintable():
            raise ValueError(f"{where}: a row needs a name of at most 100 characters")
        if not self.train or not all(one for stage in self.train for one in stage or [""]):
            raise ValueError(f"{where}: the row {self.name!r} names no set to train on")

    @property
    def stages(self) -> list[list[Source]]:
        """The sets of every stage."""
        return [[_source(text) for text in stage] for stage in self.train]

    @property
    def folder(self) -> str:
        """Name of the folder of the row's trainings."""
        return row_folder(self.name)


def row_folder(name: str) -> str:
    """Return the name of the folder of a row's trainings."""
    words = re.sub(r"[^A-Za-z0-9]+", "-", name).strip("-")[:60]
    return f"{words}-{digest_bytes(name.encode())[:6]}".lstrip("-")


def parse_row(text: str) -> Row:
    """Read `NAME=SET[,SET...][:SET...]`: sets mixed, then after a colon those of the next stage.

    Raises `ParameterError` for another text.
    """
    name, sign, sets = text.partition("=")
    if not sign:
        raise ParameterError(f"--row: {shown(text)} is not NAME=SET[,SET...][:SET...]")
    stages = [stage.split(",") for stage in sets.split(":")]
    return build(Row, {"name": name.strip(), "train": stages}, "--row")


def read_rows(path: Path) -> list[Row]:
    """Read a YAML list of rows, whose sets are relative to the file; raises `InputError`."""
    try:
        content: Any = yaml.safe_load(read_text(path))
    except (yaml.YAMLError, RecursionError, ValueError) as error:
        raise InputError(f"{path}: not YAML ({' '.join(str(error).split())[:200]})") from None
    if not isinstance(content, list) or not 0 < len(content) <= _MOST:
        raise InputError(f"{path}: expected a list of rows, each with name and train")
    rows = [build(Row, one, f"{path}: row {n + 1}", InputError) for n, one in enumerate(content)]
    return [_beside(row, path.parent) for row in rows]


def check_rows(rows: Sequence[Row], reference: str | None) -> str:
    """Return the name of the reference row, by default the first.

    Raises `ParameterError` without rows, for two of one name, and for an unknown reference.
    """
    names = [row.name for row in rows]
    if not names:
        raise ParameterError("no rows; name training sets with --row NAME=SET or --rows FILE")
    for name in names:
        if names.count(name) > 1:
            raise ParameterError(f"two rows are called {name!r}; choose another name")
    if reference is not None and reference not in names:
        raise ParameterError(f"--reference: no row {reference!r} (rows: {', '.join(names)})")
    return reference or names[0]


def _source(text: str) -> Source:
    found = _SET.fullmatch(text)
    assert found is not None
    views = found["views"]
    return Source(Path(found["path"]), int(views) if views else None)


def _beside(row: Row, folder: Path) -> Row:
    return replace(row, train=tuple(tuple(str(folder / s) for s in stage) for stage in row.train))
