"""Wavefront OBJ files with their MTL materials: one shape for every object and material.

Lengths have no unit in an OBJ and +Y is up by custom.
"""

from __future__ import annotations

from pathlib import Path

from scenes.errors import InputError
from scenes.geometry.mesh import cleaned, creased, obj_lines, read_obj_parts
from scenes.importing.changes import Changes
from scenes.importing.mtl_materials import MtlLibrary, obj_parts
from scenes.importing.names import Names
from scenes.importing.sandbox import Sandbox
from scenes.importing.shape import MAX_SHAPES, Shape
from scenes.importing.textures import TextureStore
from scenes.models.model import Glow, Model

_CREASE = 44.0  # degrees: smooth up to this where a file brings no normals


def read_model(path: Path, sandbox: Sandbox, textures: TextureStore, changes: Changes) -> Model:
    """All shapes of an OBJ file; `InputError` names what is damaged."""
    lines = obj_lines(path)
    found = obj_parts(lines)
    for kind, count in found.lost.items():
        changes.note(f"{count} lines of kind {kind!r} (curves, points) were left out")
    if not len(found.part_of_face):
        raise InputError(f"{path}: an OBJ without faces")
    if len(found.owners) > MAX_SHAPES:
        raise InputError(f"{path}: more than {MAX_SHAPES:,} parts; refused")
    library = MtlLibrary(path, sandbox, textures, changes)
    library.load(found.libraries)
    model, names = Model(kind="obj"), Names()
    for part, mesh in read_obj_parts(path, lines, found.part_of_face).items():
        owner, material = found.owners[part]
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
