"""Faces that a file holds twice in one place.

Programs that paint the two sides of a face apart, such as SketchUp, write it once for each side, in
opposite windings. Here every material is two-sided, so a ray would meet either at random. Sides of
different materials move a hair's breadth towards their fronts, so that each is seen from its own;
of sides of one material, one is enough.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass, replace
from xml.etree.ElementTree import tostring

import numpy as np

from pbrnet.scenes.arrays import Float64Array, Int64Array
from pbrnet.scenes.geometry.mesh import Mesh, face_areas
from pbrnet.scenes.importing.changes import Changes
from pbrnet.scenes.importing.shape import Shape

_SAME_PLACE = 1e-5  # metres
_FARTHEST = 2.0**62  # of these
_APART = 2.5e-4  # metres by which a side moves
# Odd factors that spread the bits of coordinates, so that no two triangles have one sum by chance
_FACTORS = np.array([0x9E3779B97F4A7C15, 0xC2B2AE3D27D4EB4F, 0x165667B19E3779F9], np.uint64)


@dataclass(frozen=True)
class _Faces:
    """The faces that share their place with others, sorted by place."""

    shape: Int64Array  # (N,) number of the shape
    face: Int64Array  # (N,) number of the face in it
    place: Int64Array  # (N,) number of the place, ascending
    normal: Float64Array  # (N, 3)


def with_doubled_faces_apart(
    shapes: list[Shape], emitting: Collection[str], changes: Changes
) -> list[Shape]:
    """Return shapes (metres) of which no ray can meet one of two faces at random.

    Of faces in one place, the first stays, and the first that faces the other way with another
    material; both move apart. If one of them transmits light, it stays alone, since a pane that is
    painted on one side is a pane. Faces of one material stay if they belong to several shapes, as
    where a cupboard touches a wall, whose closed surfaces tell rooms from solids, or to a shape
    that emits light, by its id in `emitting`: each face emits to its own side.
    """
    faces = _sharing(shapes)
    if not len(faces.place):
        return shapes
    material = _materials(shapes, emitting)
    is_pane = [shape.surface.transmissive for shape in shapes]
    dropped: dict[int, list[int]] = {}
    moved: dict[int, list[int]] = {}
    starts = np.flatnonzero(np.diff(faces.place, prepend=-1))
    for members in np.split(np.arange(len(faces.place)), starts[1:]):
        owners = faces.shape[members].tolist()
        is_alike = len({material[owner] for owner in owners}) == 1
        if is_alike and (len(set(owners)) > 1 or shapes[owners[0]].id in emitting):
            continue
        panes = [place for place, owner in enumerate(owners) if is_pane[owner]]
        kept = panes[:1] or _sides(faces.normal[members], [material[owner] for owner in owners])
        for place, (owner, face) in enumerate(
            zip(owners, faces.face[members].tolist(), strict=True)
        ):
            if place not in kept:
                dropped.setdefault(owner, []).append(face)
            elif len(kept) > 1:
                moved.setdefault(owner, []).append(face)
    if moved:
        changes.note("faces that are painted differently on their two sides were moved apart by "
                     f"{2000 * _APART:g} mm ({sum(map(len, moved.values())) // 2:,})")  # fmt: skip
    if dropped:
        changes.note("faces in the place of others were left out "
                     f"({sum(map(len, dropped.values())):,})")  # fmt: skip
    made = []
    for number, shape in enumerate(shapes):
        mesh = _moved(shape.mesh, moved.get(number, []))
        gone = dropped.get(number)
        if gone:
            keep = np.ones(len(mesh.faces), dtype=bool)
            keep[gone] = False
            if not keep.any():
                continue
            mesh = mesh.subset(keep)
        made.append(replace(shape, mesh=mesh))
    return made


def _materials(shapes: list[Shape], emitting: Collection[str]) -> list[str]:
    """A text for each shape that is the same for the same material."""
    texts: dict[int, str] = {}
    found = []
    for shape in shapes:
        element = shape.surface.element
        if element is not None and id(element) not in texts:
            texts[id(element)] = tostring(element, encoding="unicode")
        text = "" if element is None else texts[id(element)]
        found.append(f"{shape.id}: {text}" if shape.id in emitting else text)
    return found


def _sharing(shapes: list[Shape]) -> _Faces:
    """The faces of all shapes that share the places of their corners with another face."""
    keys = [_keys(shape.mesh) for shape in shapes]
    counts = [len(one) for one in keys]
    key = np.concatenate(keys)
    order = np.argsort(key, kind="stable")
    ordered = key[order]
    is_same = ordered[1:] == ordered[:-1]
    shared = np.append(False, is_same) | np.append(is_same, False)
    number, place = order[shared], np.cumsum(np.append(True, ~is_same))[shared]
    firsts = np.cumsum([0, *counts])
    shape = np.searchsorted(firsts, number, side="right") - 1
    face = number - firsts[shape]
    normal = np.empty((len(number), 3))
    for owner in np.unique(shape):
        own = shape == owner
        mesh = shapes[owner].mesh
        normal[own] = face_areas(mesh.vertices[mesh.faces[face[own]]])[1]
    return _Faces(shape, face, place, normal)


def _keys(mesh: Mesh) -> np.ndarray:
    """A number (F,) of each face that depends on the places of its corners, not on their order."""
    places = np.clip(np.round(mesh.vertices / _SAME_PLACE), -_FARTHEST, _FARTHEST)
    grid = places.astype(np.int64).astype(np.uint64)
    mixed = np.zeros(len(grid), np.uint64)
    for axis in range(3):
        mixed = (mixed ^ grid[:, axis]) * _FACTORS[axis]
        mixed ^= mixed >> np.uint64(29)
    return mixed[mesh.faces].sum(axis=1, dtype=np.uint64)


def _sides(normals: Float64Array, materials: list[str]) -> list[int]:
    """The first of the faces of one place, and the first of the other side and material."""
    for number in range(1, len(materials)):
        if normals[number] @ normals[0] < 0 and materials[number] != materials[0]:
            return [0, number]
    return [0]


def _moved(mesh: Mesh, faces: list[int]) -> Mesh:
    """The mesh with some faces moved towards their front; they share no vertex any more."""
    if not faces:
        return mesh
    chosen = np.array(faces)
    corners = mesh.faces[chosen]
    _, normals = face_areas(mesh.vertices[corners])
    places = mesh.vertices[corners] + _APART * normals[:, None]
    renumbered = mesh.faces.copy()
    renumbered[chosen] = len(mesh.vertices) + np.arange(corners.size).reshape(-1, 3)

    def extended(values: Float64Array | None) -> Float64Array | None:
        return None if values is None else np.concatenate([values, values[corners.ravel()]])

    whole = Mesh(
        np.concatenate([mesh.vertices, places.reshape(-1, 3)]),
        renumbered,
        extended(mesh.normals),
        extended(mesh.uvs),
    )
    return whole.subset(np.ones(len(renumbered), dtype=bool))
