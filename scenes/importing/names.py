"""Unique ids that are valid in Mitsuba scenes and as file names."""

from __future__ import annotations

import re


class Names:
    """Makes ids from labels; no two are equal, even if case is ignored."""

    def __init__(self) -> None:
        self._taken: set[str] = set()
        self._counts: dict[str, int] = {}  # by stem, so that equal labels are numbered quickly

    def unique(self, label: str) -> str:
        """Return a new id of letters, digits, '-' and '_' that resembles `label`."""
        stem = re.sub(r"[^A-Za-z0-9-]+", "_", label).strip("_-")[:100] or "shape"
        made, count = stem, self._counts.get(stem.lower(), 1)
        while made.lower() in self._taken:
            count += 1
            made = f"{stem}_{count}"
        self._counts[stem.lower()] = count
        self._taken.add(made.lower())
        return made
