"""Import options of layouts."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import ClassVar, Literal

from pbrnet.scenes.importing.options import FILE, SourceOptions, described
from pbrnet.scenes.looks import LightSetting, StyleName


@dataclass(frozen=True, kw_only=True)
class LayoutOptions(SourceOptions):
    """Options of a layout, which states rooms and boxes; all else is drawn."""

    title: ClassVar[str] = "Layout"
    suffixes: ClassVar[tuple[str, ...]] = (".json", ".hbjson", ".txt")
    importer: ClassVar[str] = "pbrnet.scenes.layout.importer:import_layout"

    lighting: LightSetting = field(
        default="day", metadata=described("Light of the home: hour, weather and lamps.")
    )
    style: StyleName | None = field(
        default=None,
        metadata=described("Interior style.  [default: the file's, else drawn]", "NAME"),
    )
    outdoors: Literal["surroundings", "none"] = field(
        default="surroundings", metadata=described("Street, garden or town outside, or nothing.")
    )
    seed: int | None = field(
        default=None,
        metadata=described("Seed of all that the file leaves open.  [default: the file's, else 0]"),
    )
    things: bool = field(
        default=False,
        metadata=described(
            "Add small things, switches and sockets that the file does not state, as in "
            "procedural homes."
        ),
    )
    catalogue: Path | None = field(
        default=None,
        metadata=described("Folder of converted catalogues whose pieces are used where they fit."),
    )
    assets: Path | None = field(
        default=None,
        metadata=described(
            "AI2-THOR's asset-database.json, for the sizes of objects in houses of ProcTHOR.", FILE
        ),
    )
    storey: tuple[str, ...] = field(
        default=(),
        metadata=described(
            "Storey to import (repeatable; of HBJSON one).  [default: all; of HBJSON that of most "
            "rooms]",
            "NAME",
        ),
    )

    def verify(self, where: str) -> None:
        """Check that at most one storey is named; raises ValueError."""
        super().verify(where)
        if len(self.storey) > 1:
            raise ValueError(f"{where}.storey: {len(self.storey)} are named; a layout has one")
