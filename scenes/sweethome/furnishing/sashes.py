"""Hinges of doors and windows, from the sashes that a home states.

A sash has its axis, its width and its angles in the plan; whether the model shows it open, and how
far, is found in the model (`PlanComponent` of the application draws sashes by these rules).
"""

from __future__ import annotations

import math

import numpy as np
from scipy.ndimage import maximum, minimum

from pbrnet.scenes.arrays import Float64Array, Int64Array, as_triple
from pbrnet.scenes.contract import Joint
from pbrnet.scenes.geometry.joints import bodies, within
from pbrnet.scenes.sweethome.furnishing.items import ItemPart
from pbrnet.scenes.sweethome.home import HomePiece, Sash

_SLACK = 0.02  # of the width of the piece, that a leaf may differ from its sash
_THICK = 0.13  # metres to both sides of the axis, handles included
_TALL = 0.5  # of the height of the piece, that the body of a leaf has at least
_MOST = 32  # sashes of a piece, and bodies that may be leaves
_LEAST = math.radians(10)  # between closed and open; smaller ones are no hinges


def hinges(piece: HomePiece, name: str, parts: tuple[ItemPart, ...]) -> tuple[Joint, ...]:
    """Return the hinges of a placed piece, of the object `name`; none where no leaf is found."""
    wanted = [one for one in piece.sashes[:_MOST] if abs(one.end - one.start) > _LEAST]
    if not wanted or piece.pitch or piece.roll:
        return ()
    corners = np.concatenate([part.mesh.corners for part in parts])
    label = bodies(corners)
    count = int(label.max()) + 1
    heights = maximum(corners[..., 2].max(axis=1), label, np.arange(count)) - minimum(
        corners[..., 2].min(axis=1), label, np.arange(count)
    )
    tall = np.flatnonzero(heights > _TALL * 0.01 * piece.height)[:_MOST]
    made = (_hinge(piece, sash, name, corners, label, tall) for sash in wanted)
    return tuple(joint for joint in made if joint is not None)


def _hinge(
    piece: HomePiece,
    sash: Sash,
    name: str,
    corners: Float64Array,
    label: Int64Array,
    tall: Int64Array,
) -> Joint | None:
    side = -1.0 if piece.mirrored else 1.0
    width, depth, height = (0.01 * size for size in (piece.width, piece.depth, piece.height))
    turn = np.array([[math.cos(piece.angle), math.sin(piece.angle)],
                     [-math.sin(piece.angle), math.cos(piece.angle)]])  # fmt: skip
    place = [0.01 * piece.x, -0.01 * piece.y] + turn @ [
        side * (sash.x - 0.5) * width, (0.5 - sash.y) * depth
    ]  # fmt: skip
    low = float(corners[..., 2].min())
    closed = sash.start if side > 0 else math.pi - sash.start
    yaw = math.degrees(closed - piece.angle) % 360
    slack = _SLACK * width
    box = (-slack, -_THICK, -0.01), (sash.width * width + slack, _THICK, height + 0.01)
    sign = side * math.copysign(1.0, sash.end - sash.start)
    widest = math.degrees(abs(sash.end - sash.start))
    pivot = as_triple(np.round([*place, low], 6))
    leaves = [corners[label == k].reshape(-1, 3)[:, :2] for k in tall]
    for value in (0.0, *(_angle(leaf, place, sign, yaw) for leaf in leaves)):
        limits = (0.0, round(max(widest, value), 3))
        axis = (0.0, 0.0, sign)
        joint = Joint(name, "hinge", pivot, axis, limits, value, (box,), round(yaw, 6))
        moves = within(corners, label, joint)
        if not moves.all() and np.isin(label[moves], tall).any():
            return joint
    return None


def _angle(points: Float64Array, place: Float64Array, sign: float, yaw: float) -> float:
    """The angle, degrees from closed, of a leaf with corners (N, 2) that turns about `place`."""
    points = np.unique(points, axis=0)
    middle = points.mean(axis=0)
    along = np.linalg.svd(points - middle, full_matrices=False)[2][0]
    along = along * math.copysign(1.0, float(along @ (middle - place)))
    return round((sign * (math.degrees(math.atan2(along[1], along[0])) - yaw)) % 360, 2)
