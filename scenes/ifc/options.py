"""Import options of IFC files."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import ClassVar

from pbrnet.scenes.importing.options import SourceOptions, described


@dataclass(frozen=True, kw_only=True)
class IfcOptions(SourceOptions):
    """Options of an `.ifc` file. It states its unit, up axis and rooms."""

    title: ClassVar[str] = "IFC"
    suffixes: ClassVar[tuple[str, ...]] = (".ifc",)
    importer: ClassVar[str] = "pbrnet.scenes.ifc.importer:import_ifc"

    storey: tuple[str, ...] = field(
        default=(),
        metadata=described(
            "Storey to import (repeatable; of HBJSON one).  [default: all; of HBJSON that of most "
            "rooms]",
            "NAME",
        ),
    )
