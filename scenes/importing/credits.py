"""Author and licence of a scene, from the licence file in its folder."""

from __future__ import annotations

import re

from pbrnet.scenes.contract import Credit
from pbrnet.scenes.importing.changes import Changes
from pbrnet.scenes.opened_files import OpenedFiles

_NAMES = ("license", "licence", "copying", "readme", "credits", "attribution")
_COMMONS = re.compile(r"creativecommons\.org/(licenses|publicdomain)/([a-z-]+)/(\d\.\d)")
_SPOKEN = re.compile(r"\bCC[- ]?(BY(?:[- ](?:SA|NC|ND))*|0)\b(?:[- ]?(\d\.\d))?", re.IGNORECASE)
_TITLE = re.compile(
    r"['\"‘“](?P<title>[^'\"’”\n]{2,120})['\"’”],?\s+by\s+(?P<author>[\w .-]{2,60}?)[,.;\n]"
)
_AUTHOR = re.compile(r"(?:author|creator|by|©|\(c\))\s*[:]?\s+([A-Z][\w .-]{1,60}?)(?:[,.;\n]|$)")
_MAX_BYTES = 65536


def find_credit(
    opened: OpenedFiles, title: str, licence: str, author: str, changes: Changes
) -> Credit:
    """Return the credit for everything in a scene.

    `licence` and `author`, if not empty, take precedence over the licence file in the
    scene's folder. `opened` records the files looked for.
    """
    text, name = _licence_text(opened)
    match = _TITLE.search(text)
    found_author = match["author"].strip() if match else ""
    if not found_author:
        by = _AUTHOR.search(text)
        found_author = by[1].strip() if by else ""
    source = re.search(r"https?://\S+", text)
    credit = Credit(
        part="everything",
        title=match["title"] if match else title,
        author=author or found_author or "unknown",
        licence=licence or licence_in(text) or "unknown",
        source=source[0].rstrip(".,)") if source else name,
    )
    if "unknown" in (credit.author, credit.licence):
        changes.note(
            "LICENCE OR AUTHOR UNKNOWN: give them with --licence and --author before you share "
            "anything made from this scene"
        )
    return credit


def _licence_text(opened: OpenedFiles) -> tuple[str, str]:
    """Text and name of the first licence file in the scene's folder."""
    for name in _NAMES:
        for path in opened.with_stem(name):
            if path.suffix.lower() in ("", ".txt", ".md") and opened.is_file(path):
                with path.open("rb") as stream:
                    return stream.read(_MAX_BYTES).decode("utf-8", "replace"), path.name
    return "", ""


def licence_in(text: str) -> str:
    """Return the licence that a text names, in SPDX's manner; empty if it names none known."""
    match = _COMMONS.search(text)
    if match:
        if match[1] == "publicdomain":
            return f"CC0-{match[3]}"
        return f"CC-{match[2].upper()}-{match[3]}"
    spoken = _SPOKEN.search(text)
    if spoken:
        kind = spoken[1].upper().replace(" ", "-")
        if kind == "0":
            return "CC0-1.0"
        return f"CC-{kind}-{spoken[2]}" if spoken[2] else f"CC-{kind}"
    if re.search(r"\bMIT Licen[cs]e\b", text):
        return "MIT"
    if re.search(r"public domain", text, re.IGNORECASE):
        return "CC0-1.0"
    return ""
