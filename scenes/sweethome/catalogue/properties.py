"""Parser of Java property files."""

from __future__ import annotations

import re

_ESCAPES = {"t": "\t", "n": "\n", "r": "\r", "f": "\f"}
_ESCAPE = re.compile(r"\\(u[0-9A-Fa-f]{4}|.)", re.DOTALL)
# A key ends at the first separator without a backslash before it.
_ENTRY = re.compile(r"((?:\\.|[^\\=:\s])*)\s*[=:\s]?\s*(.*)", re.DOTALL)


def parse_properties(data: bytes) -> dict[str, str]:
    """Parse a `.properties` file (ISO-8859-1, `\\uXXXX` escapes); the last value of a key counts.

    Follows `java.util.Properties.load`: comments start with `#` or `!`, a backslash at a line's
    end joins the next one.
    """
    entries: dict[str, str] = {}
    pending = ""
    for line in data.decode("latin-1").replace("\r\n", "\n").replace("\r", "\n").split("\n"):
        stripped = line.lstrip(" \t\f")
        if not pending and (not stripped or stripped[0] in "#!"):
            continue
        text = pending + stripped
        if (len(text) - len(text.rstrip("\\"))) % 2:
            pending = text[:-1]
            continue
        pending = ""
        match = _ENTRY.fullmatch(text)
        if match and match[1]:
            entries[_unescaped(match[1])] = _unescaped(match[2])
    return entries


def _unescaped(text: str) -> str:
    return _ESCAPE.sub(_meant, text)


def _meant(match: re.Match[str]) -> str:
    what = match[1]
    if what[0] == "u" and len(what) == 5:
        return chr(int(what[1:], 16))
    return _ESCAPES.get(what, what)
