"""Keys: a number for each thing that the project makes, raised when its code makes another.

The table is `keys.yaml`. Fingerprints of scenes, cameras, frames, exports and studies contain keys,
and DVC has them as parameters of stages.
"""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path
from typing import Any

from pbrnet.pipeline.params import read_yaml
from pbrnet.scenes.errors import ParameterError
from pbrnet.scenes.installation import PACKAGE

FILE = PACKAGE / "project" / "keys.yaml"


def key(name: str) -> int:
    """Return the number of a key by its dotted name, as "scenes.homes"; KeyError if unknown."""
    return table()[name]


def keys(*names: str) -> dict[str, int]:
    """Return several keys by name."""
    return {name: key(name) for name in names}


def raised(*names: str) -> dict[str, int]:
    """Return those of several keys that are above 1.

    For fingerprints of things that were first made before their keys were part of them.
    """
    return {name: number for name, number in keys(*names).items() if number > 1}


@lru_cache(maxsize=1)
def table() -> dict[str, int]:
    """Return all keys of this version by dotted name, in the order of the file."""
    return read_table(FILE)


def read_table(file: Path) -> dict[str, int]:
    """Return the keys of a file, of a project or of this version; raises `ParameterError`."""
    try:
        return dict(_flat(read_yaml(file) or {}, ""))
    except (AttributeError, OverflowError, TypeError, ValueError):
        raise ParameterError(f"{file}: not a table of numbers by name") from None


def _flat(part: dict[str, Any], prefix: str) -> list[tuple[str, int]]:
    found: list[tuple[str, int]] = []
    for name, value in part.items():
        found += (
            _flat(value, f"{prefix}{name}.")
            if isinstance(value, dict)
            else [(f"{prefix}{name}", int(value))]
        )
    return found
