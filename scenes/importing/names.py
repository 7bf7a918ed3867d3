"""Unique ids that are valid in Mitsuba scenes and as file names."""

from __future__ import annotations

import re


def numbered(stem: str, between: str, taken: dict[str, int]) -> str:
    """A new id: `stem`, or `stem` with a number, even if case is ignored.

    `taken` maps ids in lower case to the last number tried after them, so that equal stems are
    numbered quickly; the new id is added.
    """
    made, count = stem, taken.get(stem.lower(), 1)
    while made.lower() in taken:
        count += 1
        made = f"{stem}{between}{count}"
    taken[made.lower()] = 1
    taken[stem.lower()] = count
    return made


def extended(name: str, taken: set[str]) -> str:
    """`name` with underscores until it is none of `taken`, ids in lower case; it is added."""
    while name.lower() in taken:
        name += "_"
    taken.add(name.lower())
    return name


class Names:
    """Makes ids from labels; no two are equal, even if case is ignored."""

    def __init__(self) -> None:
        self._taken: dict[str, int] = {}

    def unique(self, label: str) -> str:
        """Return a new id of letters, digits, '-' and '_' that resembles `label`."""
        stem = re.sub(r"[^A-Za-z0-9-]+", "_", label).strip("_-")[:100] or "shape"
        return numbered(stem, "_", self._taken)
