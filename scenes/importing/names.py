"""Ids that Mitsuba and file systems take, each given once."""

from __future__ import annotations

import re


class Names:
    """Hands out ids made of labels; no two are equal, whatever their case."""

    def __init__(self) -> None:
        self._taken: set[str] = set()
        self._counts: dict[str, int] = {}  # by stem, so that a thousand equal labels cost little

    def unique(self, label: str) -> str:
        """An id of letters, digits, '-' and '_' that resembles `label`."""
        stem = re.sub(r"[^A-Za-z0-9-]+", "_", label).strip("_-")[:100] or "shape"
        made, count = stem, self._counts.get(stem.lower(), 1)
        while made.lower() in self._taken:
            count += 1
            made = f"{stem}_{count}"
        self._counts[stem.lower()] = count
        self._taken.add(made.lower())
        return made
