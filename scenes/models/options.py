"""Import options of model files, and the table of their formats."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from pbrnet.scenes.importing.options import FreeAxesOptions

# Suffix in lower case -> reader of the format, "module:function", see `importer.ModelReader`.
READERS = {
    ".gltf": "pbrnet.scenes.models.gltf.reader:read_model",
    ".glb": "pbrnet.scenes.models.gltf.reader:read_model",
    ".obj": "pbrnet.scenes.models.obj:read_model",
    ".dae": "pbrnet.scenes.models.collada:read_model",
    ".3ds": "pbrnet.scenes.models.max3ds:read_model",
    **dict.fromkeys((".blend", ".fbx"), "pbrnet.scenes.models.blender.reader:read_model"),
    **dict.fromkeys(
        (".usd", ".usda", ".usdc", ".usdz"), "pbrnet.scenes.models.usd.reader:read_model"
    ),
}


@dataclass(frozen=True, kw_only=True)
class ModelOptions(FreeAxesOptions):
    """Options of a file with a suffix in `READERS`."""

    title: ClassVar[str] = "models"
    suffixes: ClassVar[tuple[str, ...]] = tuple(READERS)
    importer: ClassVar[str] = "pbrnet.scenes.models.importer:import_model"
