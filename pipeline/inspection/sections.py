"""Description of a file in sections, as aligned text, JSON and a picture."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any

from pbrnet.pipeline.images import Picture
from pbrnet.pipeline.terminal import counted, visible

_LINE, _CELL = 120, 60  # most signs of a value at the end of a line, and before others
Table = list[dict[str, Any]]
# A section is a mapping of names to values, a table, or a list of sentences.
Section = dict[str, Any] | Table | list[str]


def rows_of(items: Iterable[object], *columns: str) -> Table:
    """Return the `facts_of` items as a table."""
    return [facts_of(item, *columns) for item in items]


def facts_of(item: object, *columns: str) -> dict[str, Any]:
    """Return attributes of an item by name; another name is given by `name=attribute`."""
    pairs = [column.rpartition("=")[::2] for column in columns]
    return {name or key: getattr(item, key) for name, key in pairs}


@dataclass(frozen=True)
class Inspection:
    """Description of a file: `sections` as plain data, `draw` renders the picture."""

    kind: str
    title: str
    sections: dict[str, Section]
    draw: Callable[[], Picture]

    @property
    def text(self) -> str:
        """Title and sections as aligned text, without control characters but line breaks."""
        parts = [visible(self.title)]
        for name, section in self.sections.items():
            if section:
                parts += ["", name, *map(visible, _section_lines(section))]
        return "\n".join(parts)

    @property
    def json(self) -> str:
        """Kind, title and sections as JSON."""
        content = {"kind": self.kind, "title": self.title, **self.sections}
        return json.dumps(content, indent=1, default=str)


def _section_lines(section: Section) -> list[str]:
    if isinstance(section, dict):
        width = max(len(visible(key)) for key in section)
        return [f"  {visible(key):{width}}  {_words(value)}" for key, value in section.items()]
    if isinstance(section[0], str):
        return [f"  - {sentence}" for sentence in section]
    rows = [row for row in section if isinstance(row, dict)]
    names = list(rows[0])
    table = [
        {name: _words(value, _LINE if name == names[-1] else _CELL) for name, value in row.items()}
        for row in (dict(zip(names, names, strict=True)), *rows)
    ]
    widths = {name: max(len(row[name]) for row in table) for name in names}
    right = {name: all(isinstance(row[name], (int, float)) for row in rows) for name in names}
    cells = [
        [f"{row[name]:{'>' if right[name] else '<'}{widths[name]}}" for name in names]
        for row in table
    ]
    return ["  " + "  ".join(line).rstrip() for line in cells]


def _words(value: Any, most: int = _LINE) -> str:
    """Return a value as text of at most so many signs: without Python's brackets and quotes."""
    if isinstance(value, dict):
        text = ", ".join(f"{visible(key)}: {_words(item, _CELL)}" for key, item in value.items())
    elif isinstance(value, (list, tuple)):
        flat = not any(isinstance(one, (dict, list, tuple)) for one in value)
        text = ", ".join(map(visible, value)) if flat else ""
        text = text if 0 < len(text) <= most else counted(len(value), "item") if value else "none"
    else:
        text = visible(value)
    return text if len(text) <= most else f"{text[: most - 1]}…"
