"""Model format COLLADA (`.dae`): nodes, instances, materials, images; axes and unit as stored."""

from __future__ import annotations

from pathlib import Path

from pbrnet.scenes.errors import InputError
from pbrnet.scenes.formats.model_parts import UnreadableModel
from pbrnet.scenes.importing.changes import Changes
from pbrnet.scenes.importing.materials.textures import TextureStore
from pbrnet.scenes.importing.sandbox import Sandbox
from pbrnet.scenes.importing.shape import MAX_SCENE_TRIANGLES
from pbrnet.scenes.installation import optional
from pbrnet.scenes.models.model import Model
from pbrnet.scenes.models.parts import PartImages, model_of_parts, read_bytes


def read_model(
    path: Path, sandbox: Sandbox, textures: TextureStore, unpacked: Path, changes: Changes
) -> Model:
    """Read a `.dae` file; see `importer.ModelReader`."""
    images = PartImages(path, sandbox, changes)
    try:
        found = optional("pbrnet.scenes.formats.collada").read_dae(
            read_bytes(path),
            images.find,
            changes.note,
            as_stored=True,
            most_triangles=MAX_SCENE_TRIANGLES,
        )
    except UnreadableModel as error:
        raise InputError(f"{path}: {error}") from None
    return model_of_parts(found, path, "collada", textures, changes)
