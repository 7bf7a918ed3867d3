"""Objects of a home in world coordinates; each becomes one object of the scene."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from pbrnet.scenes.arrays import Float64Array, as_triple
from pbrnet.scenes.contract import Joint
from pbrnet.scenes.procedural.furniture.parts.geometry import BodyMesh, merge
from pbrnet.scenes.procedural.piece import (
    CatalogueCredit,
    Contained,
    FurniturePiece,
    Material,
    PiecePart,
)


@dataclass(frozen=True)
class SceneItem:
    """One object; the vertices of its parts are in world coordinates, metres, Z up."""

    id: str
    name: str
    category: str
    parts: tuple[PiecePart, ...]
    is_structure: bool
    room: str | None = None
    credit: CatalogueCredit | None = None
    joints: tuple[Joint, ...] = ()

    @property
    def bounds(self) -> Float64Array:
        """Axis-aligned bounds (2, 3), metres."""
        points = np.concatenate([part.vertices for part in self.parts])
        return np.stack([points.min(axis=0), points.max(axis=0)])


@dataclass(frozen=True)
class Pose:
    """Position of a piece's origin in the world, metres, and its yaw about Z, degrees.

    At yaw 0 the front faces -Y; yaw is counter-clockwise seen from above.
    """

    x: float
    y: float
    z: float
    yaw: float

    def apply(self, points: Float64Array) -> Float64Array:
        """Transform points (N, 3) from the piece's frame to the world.

        Quarter turns are exact.
        """
        sine, cosine = _sine_cosine(self.yaw)
        x = self.x + cosine * points[:, 0] - sine * points[:, 1]
        y = self.y + sine * points[:, 0] + cosine * points[:, 1]
        return np.stack([x, y, points[:, 2] + self.z], axis=1)

    def beside(self, x: float, y: float, turn: float = 0.0) -> Pose:
        """The pose at (x, y) of the piece's frame, turned against it by degrees."""
        at = self.apply(np.array([[x, y, 0.0]]))[0]
        return Pose(float(at[0]), float(at[1]), self.z, (self.yaw + turn) % 360)

    def rotate(self, directions: Float64Array) -> Float64Array:
        """Rotate directions (N, 3) from the piece's frame to the world."""
        return replace(self, x=0.0, y=0.0, z=0.0).apply(directions)


def _sine_cosine(degrees: float) -> tuple[float, float]:
    quarter, rest = divmod(degrees, 90.0)
    if rest == 0:
        return ((0.0, 1.0), (1.0, 0.0), (0.0, -1.0), (-1.0, 0.0))[int(quarter) % 4]
    return float(np.sin(np.radians(degrees))), float(np.cos(np.radians(degrees)))


def place_piece(
    piece: FurniturePiece, pose: Pose, item_id: str, room: str | None
) -> list[SceneItem]:
    """Transform a piece of furniture to its pose in the world.

    Returns the piece itself, then the things that it holds, numbered in its parts' order: a bed
    `room-0-bed-1` holds `room-0-bed_1-pillow-1`.
    """
    carrier = "_".join(item_id.rsplit("-", 1))
    groups: dict[Contained | None, list[PiecePart]] = {None: []}
    for part in piece.parts:
        normals = None if part.given_normals is None else pose.rotate(part.given_normals)
        placed = replace(part, vertices=pose.apply(part.vertices), given_normals=normals)
        groups.setdefault(part.own, []).append(placed)
    items = []
    for number, (own, parts) in enumerate(groups.items()):
        name, category = (own.name, own.category) if own else (piece.name, piece.category)
        one = f"{carrier}-{name.replace(' ', '_')}-{number}" if own else item_id
        items.append(SceneItem(one, name, category, tuple(parts), False, room, piece.credit))
    joints = tuple(_placed(joint, pose, item_id) for joint in piece.joints)
    return [replace(items[0], joints=joints), *items[1:]]


def _placed(joint: Joint, pose: Pose, item_id: str) -> Joint:
    """The joint of a piece in the world."""
    at = np.round(pose.apply(np.array([joint.pivot]))[0], 6)
    yaw = round((joint.yaw + pose.yaw) % 360, 6)
    return replace(joint, object=item_id, pivot=as_triple(at), yaw=yaw)


def outdoor_item(name: str, category: str, *parts: PiecePart) -> SceneItem:
    """An object outdoors."""
    return SceneItem(f"outside-{name.replace(' ', '-')}", name, category, parts, True)


def make_part(name: str, material: Material, *meshes: BodyMesh, smooth: bool = False) -> PiecePart:
    """Merge meshes of one material into one part."""
    mesh = merge(meshes)
    return PiecePart(name, mesh.vertices, mesh.faces, mesh.uvs, material, smooth)
