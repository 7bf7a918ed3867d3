"""Transformation of a piece of furniture from the axes of its model to the world.

The rules of the application (`ModelManager`): centre the model, apply `modelRotation`, scale to
the unit box, then to width, height and depth (a mirrored piece has negative width), pitch about
x, roll about z, centre again, rotate about the vertical axis, and move the lower side to the
elevation. Pitch, roll and rotation are clockwise seen from the tip of the axis.
"""

from __future__ import annotations

import math

import numpy as np

from pbrnet.scenes.arrays import Float64Array
from pbrnet.scenes.sweethome.home import HomePiece

_LEAST = 0.001  # the application's least extent of a model, in the model's units

# From the application's axes (x right, y up, z to the viewer; cm) to the world's (m, Z up).
_TO_WORLD = 0.01 * np.array(
    [[1.0, 0, 0, 0], [0, 0, -1, 0], [0, 1, 0, 0], [0, 0, 0, 100]]
)  # fmt: skip


def model_to_unit_box(points: Float64Array, piece: HomePiece) -> Float64Array:
    """Return the 4x4 matrix from model vertices (N, 3) to the unit box about the origin."""
    low, high = points.min(axis=0), points.max(axis=0)
    matrix = _translation(-0.5 * (low + high))
    if piece.rotation is not None:
        turn = np.eye(4)
        turn[:3, :3] = piece.rotation
        matrix = turn @ matrix
        turned = _mapped(matrix, points)
        low, high = turned.min(axis=0), turned.max(axis=0)
        if piece.centered:
            matrix = _translation(-0.5 * (low + high)) @ matrix
    return np.diag([*(1 / np.maximum(high - low, _LEAST)), 1.0]) @ matrix


def unit_box_to_world(points: Float64Array, piece: HomePiece, elevation: float) -> Float64Array:
    """Return the 4x4 matrix from the unit box to the world (m).

    `points` (N, 3) are the vertices in the unit box: a piece with pitch or roll is centred by
    them. `elevation` is that of the level (cm).
    """
    width = -piece.width if piece.mirrored else piece.width
    matrix = np.diag([width, piece.height, piece.depth, 1.0])
    height = piece.height
    if piece.pitch != 0 or piece.roll != 0:
        matrix = _turn(-piece.roll, 0, 1) @ _turn(-piece.pitch, 1, 2) @ matrix
        turned = _mapped(matrix, points)
        low, high = turned.min(axis=0), turned.max(axis=0)
        matrix = _translation(-0.5 * (low + high)) @ matrix
        height = max(float(high[1] - low[1]), _LEAST)
    place = _translation(np.array([piece.x, elevation + piece.elevation + height / 2, piece.y]))
    return _TO_WORLD @ place @ _turn(-piece.angle, 2, 0) @ matrix


def _mapped(matrix: Float64Array, points: Float64Array) -> Float64Array:
    return points @ matrix[:3, :3].T + matrix[:3, 3]


def _translation(offset: Float64Array) -> Float64Array:
    matrix = np.eye(4)
    matrix[:3, 3] = offset
    return matrix


def _turn(angle: float, first: int, second: int) -> Float64Array:
    """Return the rotation from axis `first` towards axis `second`."""
    matrix = np.eye(4)
    cosine, sine = math.cos(angle), math.sin(angle)
    matrix[first, first] = matrix[second, second] = cosine
    matrix[second, first], matrix[first, second] = sine, -sine
    return matrix
