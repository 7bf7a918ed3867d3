"""Import options of glTF, GLB and OBJ models."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from scenes.source_options import FreeAxesOptions


@dataclass(frozen=True, kw_only=True)
class ModelOptions(FreeAxesOptions):
    """Options of a `.gltf`, `.glb` or `.obj` file."""

    title: ClassVar[str] = "glTF, GLB, OBJ"
    suffixes: ClassVar[tuple[str, ...]] = (".gltf", ".glb", ".obj")
