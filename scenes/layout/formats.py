"""Table of layout formats: each recognises its files by content and reads them as a `Layout`."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from pbrnet.scenes.layout.layout import Layout
from pbrnet.scenes.layout.readers import own


@dataclass(frozen=True)
class LayoutFormat:
    """A format of layouts.

    `recognises` and `read` get the content of a file: text, or the value that a JSON file holds
    (mappings, lists, text, numbers; depth and size are checked). `read(content, path)` raises
    `InputError` with path and key, or line.
    """

    title: str
    content: Literal["json", "text"]
    recognises: Callable[[Any], bool]
    read: Callable[[Any, Path], Layout]
    # Text of a file and message that begins with a key -> the line, such as "line 12: "
    line: Callable[[str, str], str] | None = None


FORMATS: tuple[LayoutFormat, ...] = (
    LayoutFormat("pbrnet's layout", "json", own.recognises, own.read, own.line_of),
)
