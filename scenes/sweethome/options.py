"""Import options of Sweet Home 3D homes."""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from typing import ClassVar

from pbrnet.scenes.importing.options import SourceOptions, described


@dataclass(frozen=True, kw_only=True)
class SweetHomeOptions(SourceOptions):
    """Options of a `.sh3d` file: levels, time of day."""

    title: ClassVar[str] = "Sweet Home 3D"
    suffixes: ClassVar[tuple[str, ...]] = (".sh3d",)
    importer: ClassVar[str] = "pbrnet.scenes.sweethome.importer:import_sweethome"
    can_switch_lamps: ClassVar[bool] = True

    level: tuple[str, ...] = field(
        default=(),
        metadata=described("Level to import (repeatable).  [default: all]", "NAME"),
    )
    time: str | None = field(
        default=None,
        metadata=described(
            "Local time of day, instead of the home's.",
            "HH:MM",
            allowed="in quotes, such as '19:30'",
        ),
    )

    def verify(self, where: str) -> None:
        """Check the time of day; raises ValueError."""
        super().verify(where)
        if self.time is not None and not re.fullmatch(r"([01]?\d|2[0-3]):[0-5]\d", self.time):
            raise ValueError(
                f"{where}.time: {self.time!r} is not a time of day; give it as '19:30'"
            )
