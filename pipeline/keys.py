"""Keys: a number for each thing that the project makes, raised when its code makes another.

The table is `keys.yaml`. Fingerprints of scenes, cameras, frames and exports contain keys, and DVC
has them as parameters of stages.
"""

from __future__ import annotations

from functools import lru_cache
from typing import Any

import yaml

from pbrnet.scenes.installation import PACKAGE

FILE = PACKAGE / "project" / "keys.yaml"


def key(name: str) -> int:
    """Return the number of a key by its dotted name, as "scenes.homes"; KeyError if unknown."""
    return table()[name]


def keys(*names: str) -> dict[str, int]:
    """Return several keys by name."""
    return {name: key(name) for name in names}


@lru_cache(maxsize=1)
def table() -> dict[str, int]:
    """Return all keys by dotted name, in the order of the file."""
    return dict(_flat(yaml.safe_load(FILE.read_text(encoding="utf-8")), ""))


def _flat(part: dict[str, Any], prefix: str) -> list[tuple[str, int]]:
    found: list[tuple[str, int]] = []
    for name, value in part.items():
        found += (
            _flat(value, f"{prefix}{name}.")
            if isinstance(value, dict)
            else [(f"{prefix}{name}", int(value))]
        )
    return found
