"""Preview image of a piece by point splatting, for contact sheets."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from pbrnet.scenes.arrays import Float64Array, Int64Array, UInt8Array
from pbrnet.scenes.assets.free_space import subdivide_triangles
from pbrnet.scenes.geometry.mesh import Mesh, face_areas

SIZE = 112  # pixels a side
_AZIMUTH, _ELEVATION = math.radians(32), math.radians(24)  # of the viewer, relative to the front
_BACKGROUND = 0.93  # display value
_MARGIN = 6  # pixels

Picture = UInt8Array


def draw_preview(parts: Sequence[tuple[Mesh, Float64Array, Picture | None]]) -> Picture:
    """Draw parts (mesh, display colour (3,) in [0, 1], texture or None) from the front right.

    Returns sRGB uint8 (SIZE, SIZE, 3). Orthographic projection; the light is above the viewer.
    """
    right, up, towards = _axes()
    side = SIZE
    frame = np.concatenate([part[0].vertices for part in parts]) @ np.stack([right, up]).T
    low, high = frame.min(axis=0), frame.max(axis=0)
    scale = (side - 2 * _MARGIN) / max(float((high - low).max()), 1e-9)
    picture = np.full((side * side, 3), _BACKGROUND)
    nearest = np.full(side * side, -np.inf)
    light = 0.45 * towards + 0.8 * np.array([0.0, 0.0, 1.0]) + 0.25 * right
    light /= np.linalg.norm(light)
    for mesh, color, texture in parts:
        small, owner = subdivide_triangles(mesh.corners, 0.9 / scale)
        points = (small[:, 0] + small[:, 1] + small[:, 2]) / 3
        seen = np.stack([points @ right, points @ up], axis=1)
        cells = np.rint((seen - 0.5 * (low + high)) * scale + 0.5 * side).astype(np.int64)
        cells = np.clip(cells, 0, side - 1)
        place = (side - 1 - cells[:, 1]) * side + cells[:, 0]
        depth = points @ towards
        np.maximum.at(nearest, place, depth)
        front = np.flatnonzero(depth >= nearest[place])  # nearest point of each pixel
        place, points, owner = place[front], points[front], owner[front]
        normals = face_areas(mesh.corners)[1][owner]
        shade = 0.35 + 0.65 * np.abs(normals @ light)
        base = (
            color if texture is None or mesh.uvs is None else _texels(mesh, texture, points, owner)
        )
        picture[place] = np.clip(base * shade[:, None], 0, 1)
    return np.rint(picture.reshape(side, side, 3) * 255).astype(np.uint8)


def _axes() -> tuple[Float64Array, Float64Array, Float64Array]:
    """Right and up of the image and the direction to the viewer, in the piece's frame (3,)."""
    flat = math.cos(_ELEVATION)
    towards = np.array(
        [flat * math.sin(_AZIMUTH), -flat * math.cos(_AZIMUTH), math.sin(_ELEVATION)]
    )
    right = np.array([math.cos(_AZIMUTH), math.sin(_AZIMUTH), 0.0])
    return right, np.cross(towards, right), towards


def _texels(mesh: Mesh, texture: Picture, points: Float64Array, owner: Int64Array) -> Float64Array:
    """Display values (N, 3) of the texture at points (N, 3) on triangles `owner` (N,)."""
    assert mesh.uvs is not None
    a, b, c = (mesh.corners[owner, corner] for corner in range(3))
    normal = np.cross(b - a, c - a)
    area = np.maximum((normal**2).sum(axis=1), 1e-300)
    u = (np.cross(c - b, points - b) * normal).sum(axis=1) / area
    v = (np.cross(a - c, points - c) * normal).sum(axis=1) / area
    weights = np.stack([u, v, 1 - u - v], axis=1)
    at = (mesh.uvs[mesh.faces[owner]] * weights[..., None]).sum(axis=1)
    height, width = texture.shape[:2]
    column = np.floor((at[:, 0] % 1.0) * width).astype(int) % width
    row = np.floor((at[:, 1] % 1.0) * height).astype(int) % height
    return texture[row, column] / 255.0
