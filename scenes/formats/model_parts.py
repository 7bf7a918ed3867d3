"""Models independent of their file format: parts of one group and material.

Axes: x right, y up, z to the front, in the units of the model. Texture coordinates have v = 0 at
the bottom of an image.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Literal

import numpy as np

from pbrnet.scenes.arrays import Float64Array, Int64Array
from pbrnet.scenes.errors import InputError
from pbrnet.scenes.geometry.mesh import Mesh, cleaned, creased, faces_of_polygon

MAX_TRIANGLES = 2_000_000  # of one model
_FAR = 1e12  # largest coordinate


class UnreadableModel(Exception):
    """The model is damaged, empty or of an unsupported kind."""


@dataclass(frozen=True)
class ModelMaterial:
    """A material of a model; colours are sRGB values in [0, 1]."""

    color: tuple[float, float, float] = (0.7102, 0.702, 0.6531)
    highlight: float = 0.0
    exponent: float = 0.0
    opacity: float = 1.0
    image: str | None = None  # as `find` of the reader returned it, such as a member of an archive
    emission: tuple[float, float, float] = (0.0, 0.0, 0.0)


@dataclass(frozen=True)
class ModelPart:
    """The faces of one group and material."""

    group: str
    material_name: str
    material: ModelMaterial
    mesh: Mesh
    path: tuple[str, ...] = ()  # "number:name" of the nodes that contain it, outermost first


@dataclass(frozen=True)
class Model:
    """All parts of a model, in its own axes and units."""

    parts: tuple[ModelPart, ...]
    header: str = ""  # comment at the start of the file, which may name the licence
    up: Literal["x", "y", "z"] = "y"  # axis that points up
    unit: float | None = None  # metres, if the file states one

    @property
    def bounds(self) -> Float64Array:
        """Axis-aligned bounds (2, 3) in the model's units."""
        bounds = np.array([part.mesh.bounds for part in self.parts])
        return np.stack([bounds[:, 0].min(axis=0), bounds[:, 1].max(axis=0)])


def make_part(
    group: str,
    material_name: str,
    material: ModelMaterial,
    corners: Int64Array,
    positions: Float64Array,
    uvs: Float64Array,
    normals: Float64Array,
    crease: float,
) -> ModelPart | None:
    """Return a part of triangles; None if no triangle has an area.

    `corners` (T, 3, 3) are indices of position, uv and normal, -1 for none. If any corner lacks
    a uv or a normal, the whole part has none; missing normals are computed, smooth across edges
    up to `crease` degrees. Raises `UnreadableModel`.
    """
    if not len(corners):
        return None
    flat = corners.reshape(-1, 3)
    if ((flat[:, 0] < 0) | (flat[:, 0] >= len(positions))).any():
        raise UnreadableModel("a face refers to a vertex that does not exist")
    has_uvs = len(uvs) > 0 and bool(((flat[:, 1] >= 0) & (flat[:, 1] < len(uvs))).all())
    has_normals = len(normals) > 0 and bool(((flat[:, 2] >= 0) & (flat[:, 2] < len(normals))).all())
    columns = [0] + ([1] if has_uvs else []) + ([2] if has_normals else [])
    keys, inverse = np.unique(flat[:, columns], axis=0, return_inverse=True)
    index = {column: keys[:, place] for place, column in enumerate(columns)}
    mesh = Mesh(
        positions[index[0]],
        inverse.reshape(-1, 3),
        normals[index[2]] if has_normals else None,
        uvs[index[1]] if has_uvs else None,
    )
    try:
        mesh, _ = cleaned(mesh, "model")
    except InputError as error:
        raise UnreadableModel(str(error)) from None
    if not len(mesh.faces):
        return None
    if mesh.normals is None:
        # Faceted parts get facet normals, so that all parts of a piece have normals.
        mesh = creased(mesh, crease)
    return ModelPart(group, material_name, material, mesh)


def check_points(points: Float64Array) -> None:
    """Raise `UnreadableModel` unless all coordinates are finite and not too large."""
    if points.size and not (np.isfinite(points).all() and np.abs(points).max() <= _FAR):
        raise UnreadableModel("a coordinate is not a finite number")


def triangulated(groups: Iterable[Int64Array], positions: Float64Array) -> Int64Array:
    """Triangulate polygons to corners (T, 3, 3): convex ones as fans, others by ear clipping.

    Each group (P, size, 3) holds P polygons with `size` corners.
    """
    made = []
    for indices in groups:
        size = indices.shape[1]
        if size == 3:
            made.append(indices)
            continue
        points = positions[indices[:, :, 0]]
        ahead, behind = np.roll(points, -1, axis=1), np.roll(points, 1, axis=1)
        normals = np.cross(points, ahead).sum(axis=1)  # twice the areas (Newell)
        turns = np.einsum("pki,pi->pk", np.cross(points - behind, ahead - points), normals)
        is_convex = (turns >= -1e-12 * (normals**2).sum(axis=1)[:, None]).all(axis=1)
        fans = [indices[is_convex][:, [0, k, k + 1]] for k in range(1, size - 1)]
        made.append(np.stack(fans, axis=1).reshape(-1, 3, 3))
        others = np.nonzero(~is_convex)[0]
        made += [indices[p][faces_of_polygon(points[p], normals[p])] for p in others]
    return np.concatenate(made) if made else np.zeros((0, 3, 3), dtype=np.int64)
