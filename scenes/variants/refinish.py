"""Procedural finishes for floors, walls, ceilings and fabrics of an imported scene."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path
from typing import Any
from xml.etree.ElementTree import Element

import defusedxml.ElementTree
import numpy as np
import shapely
from shapely.geometry import Polygon

from pbrnet.scenes.contract import Room, Scene, SceneObject
from pbrnet.scenes.formats.ply import read_ply, write_ply
from pbrnet.scenes.geometry.mesh import Mesh, face_areas
from pbrnet.scenes.importing.xml_elements import prop
from pbrnet.scenes.procedural.finishes import Finishes, RoomFinish, make_finishes
from pbrnet.scenes.procedural.furniture.style import Style, make_style
from pbrnet.scenes.procedural.materials import MaterialLibrary
from pbrnet.scenes.procedural.piece import Material
from pbrnet.scenes.seeds import derive, generator

_PROBE_OFFSET = 0.03  # metres in front of a face, where its room is looked up
_HEIGHT_MARGIN = 0.3  # metres above and below a room that still belong to it
_INDOOR_SHARE = 0.2  # least share of a wall's surface that faces rooms; below: a facade
_HORIZONTAL_NORMAL = 0.7  # least |z| of the unit normals of horizontal faces
_TILED_HEIGHT = 2.0  # metres; from this height of wall tiles on, whole walls are tiled
_EXCLUDED_BSDFS = ("dielectric", "thindielectric", "roughdielectric", "null", "mask", "conductor",
          "roughconductor", "principledthin")  # fmt: skip
_STRUCTURE = ("floor", "wall", "ceiling", "skirting")
_FABRICS = ("sofa", "armchair", "bed", "cushion", "pillow", "curtain", "rug", "carpet")
_HORIZONTAL_FABRICS = ("bed", "rug", "carpet")  # the shape with most upward area is the cloth


def refinish(
    folder: Path, root: Element, scene: Scene, texture_size: int, seed: int, variant: int
) -> dict[str, Any]:
    """Apply new finishes to `root` (of `scene.xml` in `folder`); returns the choices.

    Changed shapes get uvs in metres, so that textures have their true size. Lights, glass,
    metals, mirrors and cut-outs do not change.
    """
    style = make_style(generator(seed, "variant", variant, "style"))
    kinds = {room.id: room.type for room in scene.rooms}
    finishes = make_finishes(generator(seed, "variant", variant, "finishes"), style, kinds)
    library = MaterialLibrary(
        folder,
        texture_size,
        prefix=f"variant{variant}-",
        seed=derive(seed, "variant", variant, "textures"),
        wear=float(generator(seed, "variant", variant, "wear").random()),
    )
    shapes = {shape.get("id", ""): shape for shape in root.findall("shape")}
    materials = {bsdf.get("id", ""): bsdf for bsdf in root.findall("bsdf")}
    (folder / "textures").mkdir(exist_ok=True)
    chosen: dict[str, str] = {}
    accents: dict[str, tuple[float, str, Mesh]] = {}  # room -> largest wall (area, id, mesh)
    for item in scene.objects:
        for name in _refinished_shapes(folder, item, shapes, materials):
            mesh = read_ply(folder / "meshes" / f"{name}.ply")
            room = item.room
            if item.is_structure:
                room, area = _facing_room(mesh, scene.rooms, item)
                if item.category == "wall" and room is not None:
                    accents[room] = max(
                        accents.get(room, (0.0, "", mesh)),
                        (area, name, mesh),
                        key=lambda one: one[0],
                    )
            material = _material_for(item, room, finishes, style)
            if material is not None:
                _apply_material(
                    folder, shapes[name], mesh, library, material, _runs_along_y(room, scene)
                )
                chosen[name] = material.kind
    for room, (_, name, mesh) in sorted(accents.items()):
        accent = finishes.rooms[room].accent
        if accent is not None:
            _apply_material(folder, shapes[name], mesh, library, accent, False)
            chosen[name] = accent.kind
    first = min((list(root).index(shape) for shape in shapes.values()), default=len(root))
    for offset, text in enumerate(library.xml):
        root.insert(first + offset, defusedxml.ElementTree.fromstring(text))
    return {
        "rooms": {
            room: {"floor": finish.floor.kind, "walls": _wall(finish).kind}
            for room, finish in sorted(finishes.rooms.items())
        },
        "shapes": chosen,
    }


def with_metric_uvs(mesh: Mesh, along_y: bool = False) -> Mesh:
    """Return the mesh with separate corners and uvs (V, 2) in metres.

    On vertical faces u is horizontal and v points up; on horizontal faces (u, v) is (x, y), or
    (y, x) if `along_y`.
    """
    corners = mesh.corners
    normals = face_areas(corners)[1]
    flat = np.abs(normals[:, 2]) > _HORIZONTAL_NORMAL
    along = np.stack([-normals[:, 1], normals[:, 0]], axis=1)
    along /= np.maximum(np.linalg.norm(along, axis=1), 1e-9)[:, None]
    upright = np.stack(
        [np.einsum("fcx,fx->fc", corners[:, :, :2], along), corners[:, :, 2]], axis=-1
    )
    level = corners[:, :, 1::-1] if along_y else corners[:, :, :2]
    uvs = np.where(flat[:, None, None], level, upright)
    own = None if mesh.normals is None else mesh.normals[mesh.faces].reshape(-1, 3)
    return Mesh(
        corners.reshape(-1, 3), np.arange(corners.size // 3).reshape(-1, 3), own, uvs.reshape(-1, 2)
    )


def _refinished_shapes(
    folder: Path, item: SceneObject, shapes: dict[str, Element], materials: dict[str, Element]
) -> list[str]:
    """Ids of the shapes of an object that get a new finish."""
    fabric = item.category in _FABRICS and not item.is_structure
    if not fabric and not (item.is_structure and item.category in _STRUCTURE):
        return []
    able = [
        name
        for name in item.shapes
        if name in shapes and _is_opaque_dielectric(shapes[name], materials)
    ]
    able = [name for name in able if (folder / "meshes" / f"{name}.ply").is_file()]
    if not fabric or item.category == "curtain":
        return able

    def cloth(name: str) -> float:
        mesh = read_ply(folder / "meshes" / f"{name}.ply")
        areas, normals = face_areas(mesh.corners)
        return float((areas * np.maximum(normals[:, 2], 0)).sum() if lying else areas.sum())

    lying = item.category in _HORIZONTAL_FABRICS
    return sorted(able, key=lambda name: (-cloth(name), name))[:1]


def _is_opaque_dielectric(shape: Element, materials: dict[str, Element]) -> bool:
    """Return True if a shape is an opaque, non-metallic mesh without emitter."""
    if shape.get("type") != "ply" or shape.find("emitter") is not None:
        return False
    bsdf = shape.find("bsdf")
    ref = shape.find("ref")
    if bsdf is None and ref is not None:
        bsdf = materials.get(ref.get("id", ""))
    if bsdf is None:
        return False
    if any(inner.get("type") in _EXCLUDED_BSDFS for inner in bsdf.iter("bsdf")):
        return False
    metallic = [item for item in bsdf.iter() if item.get("name") == "metallic"]
    return all(item.tag == "float" and float(item.get("value", 0)) < 0.5 for item in metallic)


def _material_for(
    item: SceneObject, room: str | None, finishes: Finishes, style: Style
) -> Material | None:
    """The new material of an object; None leaves its material unchanged."""
    finish = finishes.rooms.get(room or "")
    if item.category == "floor":
        return None if finish is None else finish.floor
    if item.category == "wall":
        return finishes.facade if finish is None else _wall(finish)
    own = {
        "ceiling": finishes.ceiling,
        "skirting": finishes.skirting,
        "sofa": style.upholstery,
        "armchair": style.second_upholstery,
        "bed": style.bedding,
        "cushion": style.cushions[0],
        "pillow": style.cushions[1],
        # Translucent cloth needs an open mesh; curtains of imports may be closed.
        "curtain": replace(style.curtain, translucent=False),
        "rug": style.rug,
        "carpet": style.rug,
    }
    return own[item.category]


def _wall(finish: RoomFinish) -> Material:
    if finish.wall_tiles is not None and finish.tile_height >= _TILED_HEIGHT:
        return finish.wall_tiles
    return finish.wall


def _facing_room(mesh: Mesh, rooms: Iterable[Room], item: SceneObject) -> tuple[str | None, float]:
    """The room that most of a mesh's surface faces, and the area that faces it, m^2."""
    if item.category == "floor" and item.room is not None:
        return item.room, 0.0
    areas, normals = face_areas(mesh.corners)
    points = mesh.corners.mean(axis=1) + _PROBE_OFFSET * normals
    best: tuple[str | None, float] = (None, 0.0)
    indoors = 0.0
    for room in rooms:
        inside = shapely.contains_xy(Polygon(room.floor), points[:, 0], points[:, 1])
        inside &= (points[:, 2] > room.floor_z - _HEIGHT_MARGIN) & (
            points[:, 2] < room.ceiling_z + _HEIGHT_MARGIN
        )
        area = float(areas[inside].sum())
        indoors += area
        if area > best[1]:
            best = (room.id, area)
    # A facade also faces rooms through its doors and windows.
    return best if indoors > _INDOOR_SHARE * float(areas.sum()) else (None, 0.0)


def _runs_along_y(room: str | None, scene: Scene) -> bool:
    """Return True if the longer side of the room, and so its floor boards, run along y."""
    for one in scene.rooms:
        if one.id == room:
            west, south, east, north = Polygon(one.floor).bounds
            return north - south > east - west
    return False


def _apply_material(
    folder: Path,
    shape: Element,
    mesh: Mesh,
    library: MaterialLibrary,
    material: Material,
    along_y: bool,
) -> None:
    """Set the material of a shape and write its mesh with uvs in true size."""
    covered = with_metric_uvs(mesh, along_y)
    assert covered.uvs is not None
    uvs = library.placed(material, covered.vertices, covered.faces, covered.normals, covered.uvs)
    write_ply(folder / "meshes" / f"{shape.get('id')}.ply", replace(covered, uvs=uvs))
    for old in [*shape.findall("ref"), *shape.findall("bsdf")]:
        shape.remove(old)
    shape.append(Element("ref", {"id": library.bsdf(material)}))
    if mesh.normals is None and not any(
        item.get("name") == "face_normals" for item in shape.findall("boolean")
    ):
        shape.append(prop("face_normals", True))
