"""Checked access to JSON from outside: every error names the file and the place in it."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

from pbrnet.scenes.checked import shown
from pbrnet.scenes.errors import InputError

MAX_ITEMS = 20_000  # of a list
_LARGEST = 1e6  # of a number, metres or degrees


@dataclass(frozen=True)
class Node:
    """A value of JSON and its place, such as "house.json: objects[3].position".

    Keys that are missing, also of what is missing itself, give a node with the value None.
    """

    value: Any
    where: str

    def __getitem__(self, key: str) -> Node:
        if self.value is not None and not isinstance(self.value, dict):
            raise self.error("expected a mapping of keys")
        separator = "" if self.where.endswith(": ") else "."
        return Node((self.value or {}).get(key), f"{self.where}{separator}{key}")

    def __bool__(self) -> bool:
        return self.value is not None

    def error(self, problem: str) -> InputError:
        """Return an error that names place and value."""
        return InputError(f"{self.where.removesuffix(': ')}: {problem}, got {shown(self.value)}")

    def items(self) -> Iterator[Node]:
        """Yield the items of a list; of one that is missing, none."""
        if self.value is None:
            return
        if not isinstance(self.value, list):
            raise self.error("expected a list")
        if len(self.value) > MAX_ITEMS:
            raise InputError(f"{self.where}: {len(self.value):,} items; at most {MAX_ITEMS:,}")
        for number, item in enumerate(self.value):
            yield Node(item, f"{self.where}[{number}]")

    def text(self, default: str | None = None) -> str:
        """Return text; `default`, if there is one, where it is missing."""
        if self.value is None and default is not None:
            return default
        if not isinstance(self.value, str) or len(self.value) > 10_000:
            raise self.error("expected text")
        return self.value

    def number(self, default: float | None = None) -> float:
        """Return a finite number of at most a million; `default` where it is missing."""
        if self.value is None and default is not None:
            return default
        if isinstance(self.value, bool) or not isinstance(self.value, (int, float)):
            raise self.error("expected a number")
        if not math.isfinite(self.value) or abs(self.value) > _LARGEST:
            raise self.error("expected a number of at most a million")
        return float(self.value)

    def numbers(self, count: int) -> tuple[float, ...]:
        """Return a list of `count` numbers."""
        if not isinstance(self.value, list) or len(self.value) != count:
            raise self.error(f"expected a list of {count} numbers")
        return tuple(Node(item, f"{self.where}[{n}]").number() for n, item in enumerate(self.value))

    def single_key(self) -> str:
        """Return text, or the only key of a mapping, as Swift encodes a case: {"wall": {}}."""
        if isinstance(self.value, dict) and len(self.value) == 1:
            return Node(next(iter(self.value)), self.where).text()
        return self.text()
