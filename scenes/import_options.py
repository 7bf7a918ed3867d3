"""What may be said about a scene file that is brought in, whichever way: command or parameters."""

from __future__ import annotations

import re
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Any, Literal

from scenes.checked import within

_MITSUBA = ("parameters", "scale", "up", "root", "skip_missing", "sky", "licence", "author")
_MODEL = ("scale", "up", "root", "sky", "licence", "author")
_HOME = ("levels", "time", "lamps", "licence", "author")
# The options of `import_scene` by a file's suffix; a scene folder takes none.
OPTIONS = {".xml": _MITSUBA, ".sh3d": _HOME, ".gltf": _MODEL, ".glb": _MODEL, ".obj": _MODEL}
# What options are called where a user writes them, where that differs.
SPELLED = {"parameters": "parameter", "levels": "level"}


@dataclass(frozen=True)
class ImportEntry:
    """A file of `scenes.imports` with options, which are those of `pbrnet import`."""

    file: str
    id: str | None = None  # of the scene; after the file's name if None
    level: tuple[str, ...] = ()
    time: str | None = field(default=None, metadata={"allowed": "in quotes, such as '19:30'"})
    lamps: Literal["home", "on", "off"] = "home"
    parameter: dict[str, str] = field(default_factory=dict)
    scale: float | None = field(default=None, metadata=within(1e-6, 1e6))
    up: Literal["auto", "x", "y", "z"] = "auto"
    root: str | None = None
    skip_missing: bool = False
    sky: bool = False
    licence: str = ""
    author: str = ""

    def verify(self, where: str) -> None:
        """Options must be for this kind of file; raises ValueError."""
        suffix = Path(self.file).suffix.lower()
        taken = [SPELLED.get(name, name) for name in OPTIONS.get(suffix, ())]
        for name in self.given():
            if name not in taken:
                kind = f"{suffix} files" if suffix in OPTIONS else "scene folders"
                known = f"; they take {', '.join(taken)}" if taken else ""
                raise ValueError(f"{where}.{name}: not for {kind}{known}")
        if self.time is not None and not re.fullmatch(r"([01]?\d|2[0-3]):[0-5]\d", self.time):
            raise ValueError(f"{where}.time: {self.time!r} is no time of day, such as '19:30'")
        if self.id is not None and not re.fullmatch(r"[A-Za-z0-9][A-Za-z0-9._-]{0,127}", self.id):
            raise ValueError(f"{where}.id: {self.id!r}; letters, digits, '.', '_' and '-' only")

    def given(self) -> dict[str, Any]:
        """The options that are not what they are anyway, as spelled here."""
        return {
            one.name: getattr(self, one.name)
            for one in fields(self)
            if one.name not in ("file", "id")
            and getattr(self, one.name) not in (one.default, (), {})
        }

    def options(self) -> dict[str, Any]:
        """The same as `import_scene` takes them; `root` as a path."""
        called = {spelled: name for name, spelled in SPELLED.items()}
        made = {called.get(name, name): value for name, value in self.given().items()}
        if "root" in made:
            made["root"] = Path(made["root"]).expanduser().resolve()
        return made
