"""Import options of all scene sources, and the entries of `scenes.imports`."""

from __future__ import annotations

from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

from pbrnet.scenes.checked import check_name
from pbrnet.scenes.ifc.options import IfcOptions
from pbrnet.scenes.mitsuba.options import MitsubaOptions
from pbrnet.scenes.models.options import ModelOptions
from pbrnet.scenes.pbrt.options import PbrtOptions
from pbrnet.scenes.source_options import SourceOptions
from pbrnet.scenes.sweethome.options import SweetHomeOptions


@dataclass(frozen=True, kw_only=True)
class ImportEntry(MitsubaOptions, SweetHomeOptions, ModelOptions, PbrtOptions, IfcOptions):
    """A file of `scenes.imports` with options. The base classes are the registry of sources."""

    file: str
    id: str | None = None  # of the scene; by default made from the name of the file

    def verify(self, where: str) -> None:
        """Check that the options suit the kind of file; raises ValueError."""
        suffix = Path(self.file).suffix.lower()
        known = option_names(suffix)
        for name in self.given():
            if name not in known:
                kind = f"{suffix} files" if known else "scene folders"
                allowed = f"; they take {', '.join(known)}" if known else ""
                raise ValueError(f"{where}.{name}: not for {kind}{allowed}")
        source = source_of(suffix)
        if source is not None:  # with the rules of this source alone
            source(**{name: getattr(self, name) for name in known}).verify(where)
        if self.id is not None:
            check_name(self.id, "a scene's id", f"{where}.id", ValueError)

    def given(self) -> dict[str, Any]:
        """Return the options that differ from their defaults."""
        return {
            one.name: value
            for one in fields(self)
            if one.name not in ("file", "id")
            and (value := getattr(self, one.name)) not in (one.default, (), {})
        }

    def options(self) -> dict[str, Any]:
        """Return the given options as keyword arguments of `import_scene`; `root` is absolute."""
        made = self.given()
        if self.root is not None:
            made["root"] = self.root.expanduser().resolve()
        return made


SOURCES: tuple[type[SourceOptions], ...] = ImportEntry.__bases__


def source_of(suffix: str) -> type[SourceOptions] | None:
    """Return the options class of the source that reads files with `suffix`, or None."""
    return next((one for one in SOURCES if suffix.lower() in one.suffixes), None)


def option_names(suffix: str) -> tuple[str, ...]:
    """Return the names of the options for files with `suffix`; none for unknown kinds."""
    source = source_of(suffix)
    return tuple(one.name for one in fields(source)) if source is not None else ()
