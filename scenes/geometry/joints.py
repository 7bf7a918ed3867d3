"""Hinges and slides of objects: what they move, and where it is at another value."""

from __future__ import annotations

import math

import numpy as np
import trimesh
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from pbrnet.scenes.arrays import BoolArray, Float64Array, Int64Array
from pbrnet.scenes.contract import Joint

_NEAR = 1e-3  # metres that a body may stand out of its box
_Z = np.array([0.0, 0.0, 1.0])


def moved(points: Float64Array, joint: Joint, value: float) -> Float64Array:
    """Points (N, 3) of the leaf as it is when the joint has another value."""
    axis = world_axis(joint)
    if joint.kind == "slide":
        return points + (value - joint.value) * axis
    turn, pivot = _turn(axis, value - joint.value), np.array(joint.pivot)
    return np.asarray((points - pivot) @ turn.T + pivot)


def world_axis(joint: Joint) -> Float64Array:
    """The axis (3,) of a joint in the world."""
    return np.asarray(_turn(_Z, joint.yaw) @ np.array(joint.axis))


def _turn(axis: Float64Array, degrees: float) -> Float64Array:
    made = trimesh.transformations.rotation_matrix(math.radians(degrees), axis)
    return np.asarray(made[:3, :3])


def bodies(corners: Float64Array) -> Int64Array:
    """The number of the connected body of each face (F,), whichever shape it is in."""
    _, vertex = np.unique(corners.reshape(-1, 3), axis=0, return_inverse=True)
    faces = vertex.reshape(-1, 3)
    ends = np.concatenate([faces[:, :2], faces[:, 1:]])
    count = int(faces.max()) + 1
    links = coo_matrix((np.ones(len(ends)), (ends[:, 0], ends[:, 1])), (count, count))
    label = connected_components(links, directed=False)[1]
    return np.asarray(label[faces[:, 0]], np.int64)


def within(corners: Float64Array, label: Int64Array, joint: Joint) -> BoolArray:
    """Faces (F,) of the bodies that lie within a box of the joint when it is closed."""
    closed = moved(corners.reshape(-1, 3), joint, 0.0) - np.array(joint.pivot)
    places = (closed @ _turn(_Z, joint.yaw)).reshape(-1, 3, 3)
    moves = np.zeros(len(corners), bool)
    for low, high in joint.boxes:
        out = ((places < np.array(low) - _NEAR) | (places > np.array(high) + _NEAR)).any((1, 2))
        moves |= (np.bincount(label, out) == 0)[label]
    return moves
