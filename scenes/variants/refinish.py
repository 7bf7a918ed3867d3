"""Floors, walls, ceilings and fabrics of an imported scene in procedural finishes of true size."""

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

from scenes.arrays import Float64Array
from scenes.contract import Room, Scene, SceneObject
from scenes.formats.ply import read_ply, write_ply
from scenes.geometry.mesh import Mesh, face_areas
from scenes.importing.xml_elements import prop
from scenes.procedural.finishes import Finishes, RoomFinish, make_finishes
from scenes.procedural.furniture.style import Style, make_style
from scenes.procedural.materials import MaterialLibrary
from scenes.procedural.piece import Material
from scenes.seeds import generator

_BEFORE = 0.03  # metres in front of a face where the room is looked up that it faces
_BESIDE = 0.3  # metres above and below a room's own heights that still count as in it
_INDOORS = 0.2  # share of a wall's surface that must face rooms, or it is a facade
_STEEP = 0.7  # |z| of unit normals: flat above, upright below
_TILED = 2.0  # metres of wall tiles from which a whole wall of an import is tiled
_NEVER = ("dielectric", "thindielectric", "roughdielectric", "null", "mask", "conductor",
          "roughconductor", "principledthin")  # fmt: skip
_STRUCTURE = ("floor", "wall", "ceiling", "skirting")
_FABRICS = ("sofa", "armchair", "bed", "cushion", "pillow", "curtain", "rug", "carpet")
_LYING = ("bed", "rug", "carpet")  # their cloth is what faces up most


def refinish(
    folder: Path, root: Element, scene: Scene, texture_size: int, seed: int, variant: int
) -> dict[str, Any]:
    """Give `root` (of `scene.xml` in `folder`) other finishes; returns what was chosen.

    Changed shapes get uvs in which the finish has its true size. Lights, glass, metal, mirrors
    and cut-outs stay as they are.
    """
    style = make_style(generator(seed, "variant", variant, "style"))
    kinds = {room.id: room.type for room in scene.rooms}
    finishes = make_finishes(generator(seed, "variant", variant, "finishes"), style, kinds)
    library = MaterialLibrary(folder, texture_size, prefix=f"variant{variant}-")
    shapes = {shape.get("id", ""): shape for shape in root.findall("shape")}
    materials = {bsdf.get("id", ""): bsdf for bsdf in root.findall("bsdf")}
    (folder / "textures").mkdir(exist_ok=True)
    chosen: dict[str, str] = {}
    accents: dict[str, tuple[float, str, Mesh]] = {}  # room -> its largest wall, to differ
    for thing in scene.objects:
        for name in _cloth(folder, thing, shapes, materials):
            mesh = read_ply(folder / "meshes" / f"{name}.ply")
            room = thing.room
            if thing.is_structure:
                room, area = _faced(mesh, scene.rooms, thing)
                if thing.category == "wall" and room is not None:
                    accents[room] = max(
                        accents.get(room, (0.0, "", mesh)),
                        (area, name, mesh),
                        key=lambda one: one[0],
                    )
            material = _material(thing, room, finishes, style)
            if material is not None:
                _cover(folder, shapes[name], mesh, library, material, _turned(room, scene))
                chosen[name] = material.kind
    for room, (_, name, mesh) in sorted(accents.items()):
        accent = finishes.rooms[room].accent
        if accent is not None:
            _cover(folder, shapes[name], mesh, library, accent, False)
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


def with_metric_uvs(mesh: Mesh, turned: bool = False, tile: float = 1.0) -> Mesh:
    """The mesh with corners of its own and uvs (V, 2) along its faces, in units of `tile` metres.

    Upright faces run horizontally in u and up in v; flat ones along x and y, or y and x where
    `turned`.
    """
    corners = mesh.corners
    cross = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals = cross / np.maximum(np.linalg.norm(cross, axis=1), 1e-300)[:, None]
    flat = np.abs(normals[:, 2]) > _STEEP
    along = np.stack([-normals[:, 1], normals[:, 0]], axis=1)
    along /= np.maximum(np.linalg.norm(along, axis=1), 1e-9)[:, None]
    upright = np.stack(
        [np.einsum("fcx,fx->fc", corners[:, :, :2], along), corners[:, :, 2]], axis=-1
    )
    level = corners[:, :, 1::-1] if turned else corners[:, :, :2]
    uvs = np.where(flat[:, None, None], level, upright)
    own = None if mesh.normals is None else mesh.normals[mesh.faces].reshape(-1, 3)
    return Mesh(
        corners.reshape(-1, 3),
        np.arange(corners.size // 3).reshape(-1, 3),
        own,
        uvs.reshape(-1, 2) / tile,
    )


def _cloth(
    folder: Path,
    thing: SceneObject,
    shapes: dict[str, Element],
    materials: dict[str, Element],
) -> list[str]:
    """The shapes of a thing that take another finish."""
    fabric = thing.category in _FABRICS and not thing.is_structure
    if not fabric and not (thing.is_structure and thing.category in _STRUCTURE):
        return []
    able = [name for name in thing.shapes if name in shapes and _is_plain(shapes[name], materials)]
    able = [name for name in able if (folder / "meshes" / f"{name}.ply").is_file()]
    if not fabric or thing.category == "curtain":
        return able

    def cloth(name: str) -> float:
        mesh = read_ply(folder / "meshes" / f"{name}.ply")
        areas, normals = face_areas(mesh.corners)[0], _normals(mesh)
        return float((areas * np.maximum(normals[:, 2], 0)).sum() if lying else areas.sum())

    lying = thing.category in _LYING
    return sorted(able, key=lambda name: (-cloth(name), name))[:1]


def _is_plain(shape: Element, materials: dict[str, Element]) -> bool:
    """Whether a shape is an opaque, non-metallic mesh that does not shine."""
    if shape.get("type") != "ply" or shape.find("emitter") is not None:
        return False
    bsdf = shape.find("bsdf")
    ref = shape.find("ref")
    if bsdf is None and ref is not None:
        bsdf = materials.get(ref.get("id", ""))
    if bsdf is None:
        return False
    if any(inner.get("type") in _NEVER for inner in bsdf.iter("bsdf")):
        return False
    metallic = [item for item in bsdf.iter() if item.get("name") == "metallic"]
    return all(item.tag == "float" and float(item.get("value", 0)) < 0.5 for item in metallic)


def _material(
    thing: SceneObject, room: str | None, finishes: Finishes, style: Style
) -> Material | None:
    """What a thing is to be made of; None to leave it as it is."""
    finish = finishes.rooms.get(room or "")
    if thing.category == "floor":
        return None if finish is None else finish.floor
    if thing.category == "wall":
        return finishes.facade if finish is None else _wall(finish)
    own = {
        "ceiling": finishes.ceiling,
        "skirting": finishes.skirting,
        "sofa": style.upholstery,
        "armchair": style.second_upholstery,
        "bed": style.bedding,
        "cushion": style.cushions[0],
        "pillow": style.cushions[1],
        # Thin cloth needs an open mesh, which a stranger's curtain may not be.
        "curtain": replace(style.curtain, translucent=False),
        "rug": style.rug,
        "carpet": style.rug,
    }
    return own[thing.category]


def _wall(finish: RoomFinish) -> Material:
    if finish.wall_tiles is not None and finish.tile_height >= _TILED:
        return finish.wall_tiles
    return finish.wall


def _faced(mesh: Mesh, rooms: Iterable[Room], thing: SceneObject) -> tuple[str | None, float]:
    """The room that most of a mesh's surface faces, and how much of it, m^2."""
    if thing.category == "floor" and thing.room is not None:
        return thing.room, 0.0
    areas, normals = face_areas(mesh.corners)[0], _normals(mesh)
    points = mesh.corners.mean(axis=1) + _BEFORE * normals
    best: tuple[str | None, float] = (None, 0.0)
    indoors = 0.0
    for room in rooms:
        inside = shapely.contains_xy(Polygon(room.floor), points[:, 0], points[:, 1])
        inside &= (points[:, 2] > room.floor_z - _BESIDE) & (
            points[:, 2] < room.ceiling_z + _BESIDE
        )
        area = float(areas[inside].sum())
        indoors += area
        if area > best[1]:
            best = (room.id, area)
    # A facade, too, faces rooms where its doors and windows are.
    return best if indoors > _INDOORS * float(areas.sum()) else (None, 0.0)


def _turned(room: str | None, scene: Scene) -> bool:
    """Whether boards run along y: along the longer side of the room."""
    for one in scene.rooms:
        if one.id == room:
            west, south, east, north = Polygon(one.floor).bounds
            return north - south > east - west
    return False


def _cover(
    folder: Path,
    shape: Element,
    mesh: Mesh,
    library: MaterialLibrary,
    material: Material,
    turned: bool,
) -> None:
    """Put `material` on the shape, its mesh written with uvs that give it its true size."""
    covered = with_metric_uvs(mesh, turned, library.tile(material))
    write_ply(folder / "meshes" / f"{shape.get('id')}.ply", covered)
    for old in [*shape.findall("ref"), *shape.findall("bsdf")]:
        shape.remove(old)
    shape.append(Element("ref", {"id": library.bsdf(material)}))
    if mesh.normals is None and not any(
        item.get("name") == "face_normals" for item in shape.findall("boolean")
    ):
        shape.append(prop("face_normals", True))


def _normals(mesh: Mesh) -> Float64Array:
    corners = mesh.corners
    cross = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    return cross / np.maximum(np.linalg.norm(cross, axis=1), 1e-300)[:, None]
