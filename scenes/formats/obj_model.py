"""Furniture models from OBJ and MTL, with the default materials of Java 3D."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from pbrnet.scenes.arrays import Int64Array
from pbrnet.scenes.errors import InputError
from pbrnet.scenes.files import data_beside
from pbrnet.scenes.formats.model_parts import (
    MAX_TRIANGLES,
    Model,
    ModelMaterial,
    ModelPart,
    UnreadableModel,
    check_points,
    make_part,
    triangulated,
)
from pbrnet.scenes.formats.mtl import Mtl, read_mtl
from pbrnet.scenes.formats.obj import Obj, distinct_rows, parse_obj

_MAX_CORNERS = 4096  # of one polygon
_CREASE = 44.0  # degrees: Java 3D's default
_UNNAMED = "default"  # group or material


def read_obj_model(
    data: bytes, place: str, library: Callable[[str], dict[str, ModelMaterial]]
) -> Model:
    """Read an OBJ to parts by group and material; `library` returns the materials of an MTL.

    Raises `UnreadableModel`.
    """
    try:
        obj = parse_obj(data, place)
    except InputError as error:
        raise UnreadableModel(str(error)) from None
    if (obj.sizes - 2).sum() > MAX_TRIANGLES or obj.sizes.max(initial=0) > _MAX_CORNERS:
        raise UnreadableModel(f"more than {MAX_TRIANGLES:,} triangles")
    for points in (obj.positions, obj.uvs, obj.normals):
        check_points(points)
    if (obj.corners[:, 0] < 1).any() or (obj.corners[:, 0] > len(obj.positions)).any():
        raise UnreadableModel("a face refers to a vertex that does not exist")
    materials = dict(_DEFAULTS)
    for name in obj.libraries:
        materials |= library(name)
    starts = np.cumsum(obj.sizes) - obj.sizes
    parts = [
        part
        for number, faces in distinct_rows(obj.run_of_face)
        if (part := _part(obj, number, faces, starts, materials)) is not None
    ]
    if not parts:
        raise UnreadableModel("no faces in it")
    return Model(tuple(parts), obj.header)


def read_model_materials(
    data: bytes, place: str, find: Callable[[str], str | None]
) -> dict[str, ModelMaterial]:
    """Read the materials of an MTL; `find` returns the member for the name of an image, or None.

    Damaged lines are skipped and leave the defaults.
    """
    found = read_mtl(data, place, on_damage=lambda _error: None)
    return {name: _material(mtl, find) for name, mtl in found.items()}


def _material(mtl: Mtl, find: Callable[[str], str | None]) -> ModelMaterial:
    red, green, blue = mtl.numbers.get("Kd", (1.0, 1.0, 1.0))
    shines = mtl.numbers.get("illum", (2.0,))[0] >= 2
    image = None
    if "map_Kd" in mtl.maps and mtl.maps["map_Kd"].name:
        name = mtl.maps["map_Kd"].name
        image = find(name) or find(name.split()[-1])
    return ModelMaterial(
        color=(red, green, blue),
        highlight=float(np.mean(mtl.numbers.get("Ks", (0.0,)))) if shines else 0.0,
        exponent=max(mtl.numbers.get("Ns", (0.0,))[0], 0.0),
        opacity=mtl.opacity,
        image=image,
    )


def _part(
    obj: Obj,
    number: int,
    faces: Int64Array,
    starts: Int64Array,
    materials: dict[str, ModelMaterial],
) -> ModelPart | None:
    run = obj.runs[number]
    sizes = obj.sizes[faces]
    polygons = [
        obj.corners[starts[faces[sizes == size]][:, None] + np.arange(size)] - 1
        for size in np.unique(sizes[sizes >= 3])
    ]
    name = run.material or _UNNAMED
    return make_part(
        run.group or run.object or _UNNAMED,
        name,
        materials.get(name, ModelMaterial()),
        triangulated(polygons, obj.positions),
        obj.positions,
        obj.uvs,
        obj.normals,
        _CREASE if run.smooth else 0.0,
    )


_DEFAULTS = {
    name: ModelMaterial((red, green, blue), highlight, exponent, opacity)
    for name, row in data_beside(__file__).items()
    for red, green, blue, highlight, exponent, opacity in (map(float, row),)
}
