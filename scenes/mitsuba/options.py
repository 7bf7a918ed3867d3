"""Import options of Mitsuba XML scenes."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import ClassVar, Literal

from pbrnet.scenes.importing.options import FreeAxesOptions, described


@dataclass(frozen=True, kw_only=True)
class MitsubaOptions(FreeAxesOptions):
    """Options of an `.xml` file: values of its parameters, missing meshes."""

    title: ClassVar[str] = "Mitsuba"
    suffixes: ClassVar[tuple[str, ...]] = (".xml",)
    importer: ClassVar[str] = "pbrnet.scenes.mitsuba.importer:import_mitsuba"
    auto_lamps: ClassVar[Literal["auto", "unlit"]] = "unlit"

    parameter: dict[str, str] = field(
        default_factory=dict,
        metadata=described("Value of a $parameter of the file (repeatable).", "NAME=VALUE"),
    )
    skip_missing: bool = field(
        default=False, metadata=described("Leave out shapes whose mesh file is missing.")
    )
