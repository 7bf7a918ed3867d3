"""Import options of PBRT scenes."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import ClassVar, Literal

from pbrnet.scenes.importing.options import FreeAxesOptions, described


@dataclass(frozen=True, kw_only=True)
class PbrtOptions(FreeAxesOptions):
    """Options of a `.pbrt` file: unit, axes, missing meshes."""

    title: ClassVar[str] = "PBRT"
    suffixes: ClassVar[tuple[str, ...]] = (".pbrt",)
    importer: ClassVar[str] = "pbrnet.scenes.pbrt.importer:import_pbrt"
    auto_lamps: ClassVar[Literal["auto", "unlit"]] = "unlit"

    skip_missing: bool = field(
        default=False, metadata=described("Leave out shapes whose mesh file is missing.")
    )
