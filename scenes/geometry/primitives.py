"""Mitsuba's analytic shapes as triangle meshes, in their local frames."""

from __future__ import annotations

import numpy as np

from pbrnet.scenes.arrays import Float64Array
from pbrnet.scenes.geometry.mesh import Mesh

SIDES = 96


def rectangle() -> Mesh:
    """Return [-1, 1]^2 in the plane z = 0, facing +z, with uv in [0, 1]^2."""
    uvs = np.array([[0.0, 0], [1, 0], [1, 1], [0, 1]])
    vertices = np.column_stack([2 * uvs - 1, np.zeros(4)])
    return Mesh(vertices, np.array([[0, 1, 2], [0, 2, 3]]), None, uvs)


def cube() -> Mesh:
    """Return [-1, 1]^3, facing outwards; each face has uv in [0, 1]^2 as in Mitsuba."""
    # Directions of the normal, of u and of v, face by face.
    x, y, z = np.eye(3)
    sides = [(-y, z, x), (y, -x, -z), (x, y, -z), (z, y, x), (-x, y, z), (-z, -y, x)]
    corners = np.array([[0.0, 1], [1, 1], [1, 0], [0, 0]])
    signed = 2 * corners - 1
    vertices = np.concatenate(
        [normal + signed[:, :1] * u + signed[:, 1:] * v for normal, u, v in sides]
    )
    faces = np.concatenate([np.array([[0, 1, 2], [3, 0, 2]]) + 4 * i for i in range(6)])
    return Mesh(vertices, faces, None, np.tile(corners, (6, 1)))


def disk() -> Mesh:
    """Return the unit disk in the plane z = 0, facing +z; u is the radius, v the angle."""
    angle = np.linspace(0, 2 * np.pi, SIDES + 1)
    rim = np.column_stack([np.cos(angle), np.sin(angle), np.zeros(SIDES + 1)])
    centre = np.zeros((SIDES, 3))
    vertices = np.concatenate([rim, centre])
    step = np.arange(SIDES)
    faces = np.column_stack([step, step + 1, SIDES + 1 + step])
    turn = angle / (2 * np.pi)
    uvs = np.concatenate(
        [np.column_stack([np.ones(SIDES + 1), turn]), np.column_stack([np.zeros(SIDES), turn[:-1]])]
    )
    return Mesh(vertices, faces, None, uvs)


def cylinder(start: Float64Array, end: Float64Array, radius: float) -> Mesh:
    """Return an open cylinder from `start` to `end`, facing outwards; u: angle, v: length."""
    axis = end - start
    frame = _frame(axis / np.linalg.norm(axis))
    angle = np.linspace(0, 2 * np.pi, SIDES + 1)
    normals = np.cos(angle)[:, None] * frame[:, 0] + np.sin(angle)[:, None] * frame[:, 1]
    vertices = np.concatenate([start + radius * normals, end + radius * normals])
    step = np.arange(SIDES)
    low, high = step, step + SIDES + 1
    faces = np.concatenate(
        [np.column_stack([low, low + 1, high + 1]), np.column_stack([low, high + 1, high])]
    )
    u = angle / (2 * np.pi)
    uvs = np.concatenate(
        [np.column_stack([u, np.zeros_like(u)]), np.column_stack([u, np.ones_like(u)])]
    )
    return Mesh(vertices, faces, np.concatenate([normals, normals]), uvs)


def sphere() -> Mesh:
    """Return the unit sphere with smooth normals; u: azimuth, v: polar angle from +z."""
    u = np.linspace(0, 1, SIDES + 1)
    v = np.linspace(0, 1, SIDES // 2 + 1)
    azimuth, polar = np.meshgrid(2 * np.pi * u, np.pi * v)
    vertices = np.stack(
        [np.sin(polar) * np.cos(azimuth), np.sin(polar) * np.sin(azimuth), np.cos(polar)], axis=-1
    ).reshape(-1, 3)
    row = SIDES + 1
    start = (np.arange(SIDES // 2)[:, None] * row + np.arange(SIDES)).ravel()
    faces = np.concatenate(
        [
            np.column_stack([start, start + row, start + row + 1]),
            np.column_stack([start, start + row + 1, start + 1]),
        ]
    )
    # Remove the triangles at the poles that have no area.
    corners = vertices[faces]
    area = np.linalg.norm(
        np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1
    )
    uvs = np.stack(np.meshgrid(u, v), axis=-1).reshape(-1, 2)
    return Mesh(vertices, faces[area > 1e-12], vertices.copy(), uvs)


def _frame(normal: Float64Array) -> Float64Array:
    """Return the rotation (3, 3) with last column `normal` that Mitsuba uses.

    Duff et al., *Building an Orthonormal Basis, Revisited* (2017).
    """
    x, y, z = normal
    sign = np.copysign(1.0, z)
    a = -1.0 / (sign + z)
    b = x * y * a
    first = np.array([1 + sign * x * x * a, sign * b, -sign * x])
    return np.stack([first, np.array([b, sign + y * y * a, -y]), normal], axis=1)
