"""Hinges of the doors of procedural homes, found in their shapes.

Scenes do not record how doors open. A door is a leaf with two levers in a frame; the leaf may
share shapes with the frame, so that shapes are parted here. See `scenes/procedural/structure.py`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
import trimesh
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from pbrnet.pipeline.scene_export.content import Content, Joint, Piece
from pbrnet.scenes.arrays import BoolArray, Float64Array, Int64Array
from pbrnet.scenes.contract import SceneObject
from pbrnet.scenes.models.restored import LEAF_SUFFIX
from pbrnet.scenes.procedural.structure import CASING, LEAF, LINING

_SOURCES = ("procedural", "layout")  # kinds whose doors the generator built
_WIDEST = 90.0  # degrees that a door opens, unless it stands open wider
_GAP = 0.003  # metres between the leaf and its lining
_NEAR = 0.009  # metres that the hinge may differ from its place in the frame
_MOULDING = 0.008  # metres that parts of the leaf stand out
_LEVER = (0.062, 0.93, 1.13)  # metres that levers stand out, and their heights


@dataclass(frozen=True)
class _Rectangle:
    """A rectangle seen from above: its middle (2,), unit axes along and across, half sizes."""

    middle: Float64Array
    along: Float64Array
    across: Float64Array
    half: tuple[float, float]

    def within(self, points: Float64Array) -> Float64Array:
        """Coordinates (N, 2) of points (N, 2 or 3)."""
        return np.asarray((points[:, :2] - self.middle) @ np.stack([self.along, self.across]).T)

    def point(self, along: float, across: float) -> Float64Array:
        """The point (2,) at such coordinates."""
        return np.asarray(self.middle + along * self.along + across * self.across)


def add_joints(content: Content) -> None:
    """Add the doors' joints to `content`, and part its pieces into what moves and what does not."""
    for thing in content.scene.objects:
        if thing.category != "door":
            continue
        built = content.scene.source.get("kind") in _SOURCES
        joint = _door(content, thing) if built else None
        if joint is not None:
            content.joints[thing.id] = joint
        elif not built:
            content.lost.note("doors of imported scenes have no joints: {}", thing.name)


def _door(content: Content, thing: SceneObject) -> Joint | None:
    pieces = [content.pieces[name] for name in thing.shapes if name in content.pieces]
    corners = np.concatenate([piece.mesh.corners for piece in pieces])
    label = _components(corners)
    leaf = _leaf(corners, label)
    if leaf is None:
        return None
    moves, levers = _moving(corners, label, leaf)
    if not levers.any() or moves.all():
        return None
    sign = math.copysign(1.0, -leaf.within(corners[levers].reshape(-1, 3))[:, 0].mean())
    joint = _hinge(leaf, sign, _around(corners[~moves].reshape(-1, 3)), corners[moves])
    if joint is None:
        return None
    starts = np.cumsum([0, *(len(piece.mesh.faces) for piece in pieces)])
    names = [
        _parted(content, piece, moves[start : start + len(piece.mesh.faces)])
        for piece, start in zip(pieces, starts, strict=False)
    ]
    return replace(joint, moving=tuple(name for name in names if name))


def _components(corners: Float64Array) -> Int64Array:
    """The number of the connected part of each face (F,), whichever shape it is in."""
    _, vertex = np.unique(corners.reshape(-1, 3), axis=0, return_inverse=True)
    faces = vertex.reshape(-1, 3)
    ends = np.concatenate([faces[:, :2], faces[:, 1:]])
    count = int(faces.max()) + 1
    links = coo_matrix((np.ones(len(ends)), (ends[:, 0], ends[:, 1])), (count, count))
    label = connected_components(links, directed=False)[1]
    return np.asarray(label[faces[:, 0]], np.int64)


def _leaf(corners: Float64Array, label: Int64Array) -> _Rectangle | None:
    """The leaf: the part that is a box of its thickness, as high as a door."""
    for number in range(int(label.max()) + 1):
        points = np.unique(corners[label == number].reshape(-1, 3), axis=0)
        if len(points) == 8 and np.ptp(points[:, 2]) > 1.5:
            made = _around(points)
            if made.half[0] > 0.2 and abs(2 * made.half[1] - LEAF) < 1e-3:
                return made
    return None


def _around(points: Float64Array) -> _Rectangle:
    """The least rectangle around points (N, 3) seen from above, its longer side along."""
    to_box, sizes = trimesh.bounds.oriented_bounds_2D(points[:, :2])
    back = np.linalg.inv(to_box)
    axes, half = back[:2, :2].T, 0.5 * sizes
    if half[0] < half[1]:
        axes, half = axes[::-1], half[::-1]
    return _Rectangle(back[:2, 2], axes[0], axes[1], (float(half[0]), float(half[1])))


def _moving(
    corners: Float64Array, label: Int64Array, leaf: _Rectangle
) -> tuple[BoolArray, BoolArray]:
    """Faces (F,) of the leaf, and those of its levers among them, as masks."""
    moves, levers = np.zeros((2, len(corners)), bool)
    for number in range(int(label.max()) + 1):
        chosen = label == number
        points = corners[chosen].reshape(-1, 3)
        place = np.abs(leaf.within(points)) - leaf.half
        out, low, high = _LEVER
        if place[:, 0].max() > 1e-3:
            continue
        if place[:, 1].max() < _MOULDING:
            moves |= chosen
        elif place[:, 1].max() < out and low < points[:, 2].min() and points[:, 2].max() < high:
            moves |= chosen
            levers |= chosen
    return moves, levers


def _hinge(leaf: _Rectangle, sign: float, frame: _Rectangle, corners: Float64Array) -> Joint | None:
    """The hinge at the end of the leaf on the side `sign`; None where the frame has no place."""
    s = frame.half[0] - (CASING[0] - LINING + 0.005) - LINING - _GAP
    d = frame.half[1] - CASING[1]
    ends = [leaf.point(sign * leaf.half[0], side * leaf.half[1]) for side in (-1, 1)]
    places = [(a * s, b * d) for a in (-1, 1) for b in (-1, 1)]
    found = [(float(np.linalg.norm(end - frame.point(*place))), *place, *end)
             for end in ends for place in places]  # fmt: skip
    distance, along, across, x, y = min(found)
    if distance > _NEAR:
        return None
    closed = -math.copysign(1.0, along) * frame.along  # from the hinge along the closed leaf
    inward = math.copysign(1.0, across) * frame.across  # towards the room it swings into
    now = -sign * leaf.along
    angle = math.degrees(math.atan2(float(now @ inward), float(now @ closed)))
    angle = 0.0 if abs(angle) < 0.01 else round(angle, 3)
    up = math.copysign(1.0, float(closed[0] * inward[1] - closed[1] * inward[0]))
    pivot = np.array([x, y, corners[..., 2].min()])
    return Joint(pivot, np.array([0, 0, up]), (0.0, max(_WIDEST, angle)), angle, ())


def _parted(content: Content, piece: Piece, moves: BoolArray) -> str | None:
    """The name of the moving part of a piece, None without any."""
    if not moves.any():
        return None
    if moves.all():
        return piece.id
    name = piece.id + LEAF_SUFFIX
    content.pieces[piece.id] = replace(piece, mesh=piece.mesh.subset(~moves))
    content.pieces[name] = replace(piece, id=name, mesh=piece.mesh.subset(moves))
    return name
