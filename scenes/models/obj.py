"""Reader of Wavefront OBJ files with MTL materials: one shape for each object and material.

OBJ defines neither a unit of length nor an up axis; +Y is usual. SketchUp states its unit in a
comment.
"""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from pbrnet.scenes.errors import InputError
from pbrnet.scenes.formats.obj import ObjRun, distinct_rows, read_obj
from pbrnet.scenes.geometry.mesh import cleaned, creased
from pbrnet.scenes.importing.categories import category_of
from pbrnet.scenes.importing.changes import Changes
from pbrnet.scenes.importing.materials.mtl import MtlLibrary
from pbrnet.scenes.importing.materials.textures import TextureStore
from pbrnet.scenes.importing.names import Names
from pbrnet.scenes.importing.sandbox import Sandbox
from pbrnet.scenes.importing.shape import MAX_SHAPES, Shape
from pbrnet.scenes.models.model import Emission, Model

_UNIT = re.compile(r"^File units = (\w+)\s*$", re.MULTILINE)
_METRES = {
    "inches": 0.0254,
    "feet": 0.3048,
    "millimeters": 0.001,
    "centimeters": 0.01,
    "meters": 1.0,
}
_CREASE = 44.0  # degrees; smaller angles between faces are smooth in files without normals


def read_model(
    path: Path, sandbox: Sandbox, textures: TextureStore, unpacked: Path, changes: Changes
) -> Model:
    """Read an `.obj` file; see `importer.ModelReader`."""
    found = read_obj(path)
    for kind, count in found.without_faces.items():
        changes.note(f"{count} elements of type {kind!r} (curves, points) were left out")
    if not len(found.sizes):
        raise InputError(f"{path}: the file has no faces")
    groups: dict[str, set[str]] = {}
    for run in found.runs:
        groups.setdefault(run.object, set()).add(run.group)
    nodes = [_node(run, len(groups[run.object])) for run in found.runs]
    parts = list(dict.fromkeys(zip(nodes, (run.material for run in found.runs), strict=True)))
    if len(parts) > MAX_SHAPES:
        raise InputError(f"{path}: the file has more than the limit of {MAX_SHAPES:,} parts")
    library = MtlLibrary(path, sandbox, textures, changes)
    library.load(found.libraries)
    stated = _UNIT.search(found.header)
    unit = _METRES.get(stated[1].lower()) if stated else None
    model, names = Model(kind="obj", unit=unit), Names()
    numbers = {part: number for number, part in enumerate(parts)}
    part_of_run = np.array(
        [numbers[node, run.material] for node, run in zip(nodes, found.runs, strict=True)]
    )
    for part, faces in distinct_rows(part_of_run[found.run_of_face]):
        node, material_name = parts[part]
        owner = node[-1] if node else ""
        label = owner or material_name
        material = library.material(material_name)
        mesh, dropped = cleaned(found.mesh(faces), f"{path}: {label}")
        if dropped:
            changes.note("triangles without area were left out of {}", label or path.stem)
        if not len(mesh.faces):
            changes.note("a part without area was left out: {}", label)
            continue
        if mesh.normals is None:
            mesh = creased(mesh, _CREASE)
        shape = Shape(names.unique(label or path.stem), owner or path.stem, mesh, material.surface)
        model.shapes.append(shape)
        names_of_nodes = enumerate((path.stem, *node))
        model.node_paths[shape.id] = tuple(f"{depth}:{name}" for depth, name in names_of_nodes)
        if material.emission is not None:
            model.emissions[shape.id] = Emission(
                material.emission, material.emission_image, material.emission_to_uv
            )
    return model


def _node(run: ObjRun, group_count: int) -> tuple[str, ...]:
    """The names of the object and the group of faces, as far as the file gives and needs them.

    A group counts below an object that has several, or whose name does not tell what it is.
    """
    if not (run.object and run.group):
        return (run.owner,) if run.owner else ()
    if group_count > 1 or category_of(run.object) == "other" != category_of(run.group):
        return run.object, run.group
    return (run.object,)
