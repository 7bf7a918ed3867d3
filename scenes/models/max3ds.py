"""Model format 3D Studio (`.3ds`): meshes, materials and images; Z up, without a unit."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from pbrnet.scenes.errors import InputError
from pbrnet.scenes.formats.max3ds import read_3ds
from pbrnet.scenes.formats.model_parts import UnreadableModel
from pbrnet.scenes.importing.changes import Changes
from pbrnet.scenes.importing.materials.textures import TextureStore
from pbrnet.scenes.importing.sandbox import Sandbox
from pbrnet.scenes.models.model import Model
from pbrnet.scenes.models.parts import PartImages, model_of_parts, read_bytes

# From the axes of `read_3ds`, y up, back to the file's.
_AS_STORED = np.array([[1.0, 0, 0, 0], [0, 0, -1, 0], [0, 1, 0, 0], [0, 0, 0, 1]])


def read_model(
    path: Path, sandbox: Sandbox, textures: TextureStore, unpacked: Path, changes: Changes
) -> Model:
    """Read a `.3ds` file; see `importer.ModelReader`."""
    try:
        found = read_3ds(read_bytes(path), PartImages(path, sandbox, changes).find)
    except UnreadableModel as error:
        raise InputError(f"{path}: {error}") from None
    parts = tuple(replace(part, mesh=part.mesh.transformed(_AS_STORED)) for part in found.parts)
    return model_of_parts(replace(found, parts=parts, up="z"), path, "3ds", textures, changes)
