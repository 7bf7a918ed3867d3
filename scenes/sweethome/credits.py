"""Authors and licences of a home and its parts, from properties, comments and licence files."""

from __future__ import annotations

import re

from pbrnet.scenes.contract import Credit
from pbrnet.scenes.formats.archive import HomeArchive
from pbrnet.scenes.formats.model_parts import Model
from pbrnet.scenes.importing.changes import Changes
from pbrnet.scenes.sweethome.home import Home, Texture

_CC_URL = re.compile(
    r"creativecommons\.org/(?P<kind>licenses|publicdomain)/(?P<terms>[a-z-]+)/(?P<version>\d\.\d)"
    r"(?:/(?P<region>at|au|de|nl|us)(?![a-z]))?",  # ports with an SPDX identifier
    re.IGNORECASE,
)
_CC_NAME = re.compile(
    r"\bCC[- ]?(?P<terms>BY(?:[- ](?:SA|NC|ND))*|0)\b(?:.{0,60}?\b(?P<version>\d\.\d)\b)?",
    re.IGNORECASE | re.DOTALL,
)
_LICENCE_FILE = re.compile(r"licen[cs]e|copying|readme|credits", re.IGNORECASE)
_MAX_TEXT = 2**16
_SOURCE = "Sweet Home 3D home"


def licence_in(text: str) -> str:
    """Return an SPDX-like identifier of the licence that a text names; "" if none is known."""
    commons = _CC_URL.search(text)
    if commons:
        terms = commons["terms"].upper()
        name = "CC0" if commons["kind"].lower() == "publicdomain" else f"CC-{terms}"
        region = f"-{commons['region'].upper()}" if commons["region"] else ""
        return f"{name}-{commons['version']}{region}"
    spoken = _CC_NAME.search(text)
    if spoken:
        terms = spoken["terms"].upper().replace(" ", "-")
        if terms == "0":
            return "CC0-1.0"
        return f"CC-{terms}-{spoken['version']}" if spoken["version"] else f"CC-{terms}"
    if re.search(r"GNU General Public License|\bGPL\b", text):
        return "GPL-2.0-or-later"
    if re.search(r"Free Art Licen[cs]e", text, re.IGNORECASE):
        return "LAL-1.3"
    if re.search(r"public domain", text, re.IGNORECASE):
        return "CC0-1.0"
    if re.search(r"\bMIT Licen[cs]e\b", text):
        return "MIT"
    return ""


class Credits:
    """Collects credits of the parts of a home, one for each author and licence."""

    def __init__(self, home: Home, archive: HomeArchive, title: str, licence: str, author: str):
        self._archive = archive
        self._parts: dict[tuple[str, str], set[str]] = {}
        properties = home.properties
        self._home = Credit(
            part="home",
            title=properties.get("Title") or home.name.removesuffix(".sh3d") or title,
            author=author or properties.get("Author", "") or "unknown",
            licence=licence or licence_in(properties.get("License", "")) or "unknown",
            source=_SOURCE,
        )

    def model(self, name: str, creator: str, member: str, model: Model) -> None:
        """Add a model; its licence is in its comment or in a file beside it."""
        licence = licence_in(model.header)
        for other in self._archive.folder(member):
            if not licence and _LICENCE_FILE.search(other.rpartition("/")[2]):
                licence = licence_in(
                    self._archive.read(other)[:_MAX_TEXT].decode("utf-8", "replace")
                )
        self._note(creator, licence, name)

    def texture(self, texture: Texture | None) -> None:
        """Add a texture, if any."""
        if texture is not None:
            self._note(texture.creator, "", f"texture {texture.name}")

    def _note(self, creator: str, licence: str, name: str) -> None:
        self._parts.setdefault((creator or "unknown", licence or "unknown"), set()).add(name)

    def all(self, changes: Changes) -> tuple[Credit, ...]:
        """Return the credit of the home, then those of its parts, sorted by author."""
        made = [self._home]
        for (author, licence), names in sorted(self._parts.items()):
            part = ", ".join(sorted(names))
            title = f"furniture and textures by {author}"
            made.append(Credit(part, title, author, licence, _SOURCE))
        if any("unknown" in (credit.author, credit.licence) for credit in made):
            changes.note(
                "LICENCE OR AUTHOR UNKNOWN for some of it, see the credits; give the home's with "
                "--licence and --author before you share anything made from this scene"
            )
        return tuple(made)
