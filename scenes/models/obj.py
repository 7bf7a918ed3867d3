"""Wavefront OBJ files with their MTL materials: one shape for every object and material.

Lengths have no unit in an OBJ and +Y is up by custom.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from scenes.errors import InputError
from scenes.formats.obj import distinct_rows, read_obj
from scenes.geometry.mesh import cleaned, creased
from scenes.importing.changes import Changes
from scenes.importing.mtl_materials import MtlLibrary
from scenes.importing.names import Names
from scenes.importing.sandbox import Sandbox
from scenes.importing.shape import MAX_SHAPES, Shape
from scenes.importing.textures import TextureStore
from scenes.models.model import Glow, Model

_CREASE = 44.0  # degrees: smooth up to this where a file brings no normals


def read_model(path: Path, sandbox: Sandbox, textures: TextureStore, changes: Changes) -> Model:
    """All shapes of an OBJ file; `InputError` names what is damaged."""
    found = read_obj(path)
    for kind, count in found.without_faces.items():
        changes.note(f"{count} lines of kind {kind!r} (curves, points) were left out")
    if not len(found.sizes):
        raise InputError(f"{path}: an OBJ without faces")
    parts = list(dict.fromkeys((run.owner, run.material) for run in found.runs))
    if len(parts) > MAX_SHAPES:
        raise InputError(f"{path}: more than {MAX_SHAPES:,} parts; refused")
    library = MtlLibrary(path, sandbox, textures, changes)
    library.load(found.libraries)
    model, names = Model(kind="obj"), Names()
    part_of_run = np.array([parts.index((run.owner, run.material)) for run in found.runs])
    for part, faces in distinct_rows(part_of_run[found.run_of_face]):
        owner, material = parts[part]
        mesh = found.mesh(faces)
        finish = library.finish(material)
        mesh, dropped = cleaned(mesh, f"{path}: {owner or material}")
        if dropped:
            changes.note(
                "triangles without area were dropped from {}", owner or material or path.stem
            )
        if not len(mesh.faces):
            changes.note("a part without area was left out: {}", owner or material)
            continue
        if mesh.normals is None:
            mesh = creased(mesh, _CREASE)
        shape = Shape(
            names.unique(owner or material or path.stem), owner or path.stem, mesh, finish.surface
        )
        model.shapes.append(shape)
        model.owners[shape.id] = (f"0:{path.stem}", f"1:{owner}") if owner else (f"0:{path.stem}",)
        if finish.light is not None:
            model.glows[shape.id] = Glow(finish.light, finish.light_image, finish.light_to_uv)
    return model
