"""Hinges and slides of a scene: shapes parted into what they move and what stays.

A joint of `scene.json` states its kind, its place and boxes. The connected bodies of the object
that lie within one of the boxes, moved back to the closed position, are its leaf. A leaf may share
shapes with the rest of the object.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import trimesh
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from pbrnet.pipeline.scene_export.content import Content, Leaf, Piece
from pbrnet.scenes.arrays import BoolArray, Float64Array, Int64Array
from pbrnet.scenes.contract import Joint, SceneObject
from pbrnet.scenes.models.restored import LEAF_SUFFIX

_NEAR = 1e-3  # metres that a body may stand out of its box
_Z = np.array([0.0, 0.0, 1.0])


def add_joints(content: Content) -> None:
    """Add the leaves of all joints to `content`, and part its pieces into what moves and stays."""
    joints: dict[str, list[Joint]] = {}
    for joint in content.scene.joints:
        joints.setdefault(joint.object, []).append(joint)
    for thing in content.scene.objects:
        if thing.id in joints:
            content.leaves[thing.id] = _leaves(content, thing, joints[thing.id])
        elif thing.category == "door":
            content.lost.note("doors without a stated hinge have no joint: {}", thing.name)


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


def _leaves(content: Content, thing: SceneObject, joints: list[Joint]) -> tuple[Leaf, ...]:
    pieces = [content.pieces[name] for name in thing.shapes if name in content.pieces]
    corners = np.concatenate([piece.mesh.corners for piece in pieces])
    label = _bodies(corners)
    owner = np.zeros(len(corners), int)  # of each face: 0 where it stays, else the joint's number
    for number, joint in enumerate(joints, 1):
        owner[(owner == 0) & _within(corners, label, joint)] = number
    if owner.all():
        return ()
    moving: dict[int, list[str]] = {}
    ends = np.cumsum([len(piece.mesh.faces) for piece in pieces])
    for piece, own in zip(pieces, np.split(owner, ends[:-1]), strict=True):
        for number, name in _parted(content, piece, own).items():
            moving.setdefault(number, []).append(name)
    return tuple(Leaf(joints[number - 1], world_axis(joints[number - 1]), tuple(names))
                 for number, names in sorted(moving.items()))  # fmt: skip


def _bodies(corners: Float64Array) -> Int64Array:
    """The number of the connected body of each face (F,), whichever shape it is in."""
    _, vertex = np.unique(corners.reshape(-1, 3), axis=0, return_inverse=True)
    faces = vertex.reshape(-1, 3)
    ends = np.concatenate([faces[:, :2], faces[:, 1:]])
    count = int(faces.max()) + 1
    links = coo_matrix((np.ones(len(ends)), (ends[:, 0], ends[:, 1])), (count, count))
    label = connected_components(links, directed=False)[1]
    return np.asarray(label[faces[:, 0]], np.int64)


def _within(corners: Float64Array, label: Int64Array, joint: Joint) -> BoolArray:
    """Faces (F,) of the bodies that lie within a box of the joint when it is closed."""
    closed = moved(corners.reshape(-1, 3), joint, 0.0) - np.array(joint.pivot)
    places = (closed @ _turn(_Z, joint.yaw)).reshape(-1, 3, 3)
    moves = np.zeros(len(corners), bool)
    for low, high in joint.boxes:
        out = ((places < np.array(low) - _NEAR) | (places > np.array(high) + _NEAR)).any((1, 2))
        moves |= (np.bincount(label, out) == 0)[label]
    return moves


def _parted(content: Content, piece: Piece, owner: Int64Array) -> dict[int, str]:
    """Names of the parts of a piece by the joint that moves them; a whole piece keeps its name."""
    numbers = [int(number) for number in np.unique(owner)]
    if len(numbers) == 1:
        return {number: piece.id for number in numbers if number}
    del content.pieces[piece.id]
    names = {number: f"{piece.id}{LEAF_SUFFIX}{number}" if number else piece.id
             for number in numbers}  # fmt: skip
    for number, name in names.items():
        content.pieces[name] = replace(piece, id=name, mesh=piece.mesh.subset(owner == number))
    return {number: name for number, name in names.items() if number}
