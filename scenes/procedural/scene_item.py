"""Things of a home in world space: what becomes one object of the scene."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from scenes.arrays import Float64Array
from scenes.procedural.furniture.geometry import Mesh, merge
from scenes.procedural.piece import Credit, Material, Part, Piece


@dataclass(frozen=True)
class Thing:
    """One object: its parts' vertices are in world coordinates, metres, Z up."""

    id: str
    name: str
    category: str
    parts: tuple[Part, ...]
    is_structure: bool
    room: str | None = None
    credit: Credit | None = None

    @property
    def bounds(self) -> Float64Array:
        """Axis-aligned bounds (2, 3), metres."""
        points = np.concatenate([part.vertices for part in self.parts])
        return np.stack([points.min(axis=0), points.max(axis=0)])


@dataclass(frozen=True)
class Pose:
    """Where a piece stands: its origin in the world and its turn about Z, in degrees.

    At turn 0 its front faces -Y; turns are counter-clockwise from above.
    """

    x: float
    y: float
    z: float
    turn: float

    def apply(self, points: Float64Array) -> Float64Array:
        """Points (N, 3) of the piece's frame in the world; quarter turns are exact."""
        sine, cosine = _sine_cosine(self.turn)
        x = self.x + cosine * points[:, 0] - sine * points[:, 1]
        y = self.y + sine * points[:, 0] + cosine * points[:, 1]
        return np.stack([x, y, points[:, 2] + self.z], axis=1)

    def turned(self, directions: Float64Array) -> Float64Array:
        """Directions (N, 3) of the piece's frame in the world."""
        return replace(self, x=0.0, y=0.0, z=0.0).apply(directions)


def _sine_cosine(degrees: float) -> tuple[float, float]:
    quarter, rest = divmod(degrees, 90.0)
    if rest == 0:
        return ((0.0, 1.0), (1.0, 0.0), (0.0, -1.0), (-1.0, 0.0))[int(quarter) % 4]
    return float(np.sin(np.radians(degrees))), float(np.cos(np.radians(degrees)))


def placed(piece: Piece, pose: Pose, thing_id: str, room: str | None) -> Thing:
    """A piece of furniture at its place in the world."""
    parts = tuple(
        replace(
            part,
            vertices=pose.apply(part.vertices),
            given=None if part.given is None else pose.turned(part.given),
        )
        for part in piece.parts
    )
    return Thing(thing_id, piece.name, piece.category, parts, False, room, piece.credit)


def part_of(name: str, material: Material, *meshes: Mesh, smooth: bool = False) -> Part:
    """Meshes of one material as one part."""
    mesh = merge(meshes)
    return Part(name, mesh.vertices, mesh.faces, mesh.uvs, material, smooth)
