"""Table of layout formats: each recognises its files by content and reads them as a `Layout`."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from pbrnet.scenes.layout.layout import Layout
from pbrnet.scenes.layout.options import LayoutOptions
from pbrnet.scenes.layout.readers import hbjson, own, procthor, roomplan, spatiallm


@dataclass(frozen=True)
class LayoutFormat:
    """A format of layouts.

    `recognises` and `read` get the content of a file: text, or the value that a JSON file holds
    (mappings, lists, text, numbers; depth and size are checked). `read(content, path, options)`
    raises `InputError` with path and key, or line.
    """

    title: str
    content: Literal["json", "text"]
    recognises: Callable[[Any], bool]
    read: Callable[[Any, Path, LayoutOptions], Layout]
    # Text of a file and message that begins with a key -> the line, such as "line 12: "
    line: Callable[[str, str], str] | None = None


def _plain(read: Callable[[Any, Path], Layout]) -> Callable[[Any, Path, LayoutOptions], Layout]:
    """A reader that takes no options."""
    return lambda content, path, _: read(content, path)


FORMATS: tuple[LayoutFormat, ...] = (
    LayoutFormat("pbrnet's layout", "json", own.recognises, _plain(own.read), own.line_of),
    LayoutFormat(
        "house of ProcTHOR",
        "json",
        procthor.recognises,
        lambda content, path, options: procthor.read(content, path, options.assets),
    ),
    LayoutFormat("capture of RoomPlan", "json", roomplan.recognises, _plain(roomplan.read)),
    LayoutFormat(
        "HBJSON",
        "json",
        hbjson.recognises,
        lambda content, path, options: hbjson.read(content, path, "".join(options.storey)),
    ),
    LayoutFormat("SpatialLM", "text", spatiallm.recognises, _plain(spatiallm.read)),
)
