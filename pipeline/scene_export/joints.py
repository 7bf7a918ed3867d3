"""Hinges and slides of a scene: shapes parted into what they move and what stays.

A joint of `scene.json` states its kind, its place and boxes. The connected bodies of the object
that lie within one of the boxes, moved back to the closed position, are its leaf. A leaf may share
shapes with the rest of the object.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from pbrnet.pipeline.scene_export.content import Content, Leaf, Piece
from pbrnet.scenes.arrays import Int64Array
from pbrnet.scenes.contract import Joint, SceneObject
from pbrnet.scenes.geometry.joints import bodies, within, world_axis
from pbrnet.scenes.models.restored import LEAF_SUFFIX


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


def _leaves(content: Content, thing: SceneObject, joints: list[Joint]) -> tuple[Leaf, ...]:
    pieces = [content.pieces[name] for name in thing.shapes if name in content.pieces]
    if not pieces:
        return ()
    corners = np.concatenate([piece.mesh.corners for piece in pieces])
    label = bodies(corners)
    owner = np.zeros(len(corners), int)  # of each face: 0 where it stays, else the joint's number
    for number, joint in enumerate(joints, 1):
        owner[(owner == 0) & within(corners, label, joint)] = number
    if owner.all():
        return ()
    moving: dict[int, list[str]] = {}
    ends = np.cumsum([len(piece.mesh.faces) for piece in pieces])
    for piece, own in zip(pieces, np.split(owner, ends[:-1]), strict=True):
        for number, name in _parted(content, piece, own).items():
            moving.setdefault(number, []).append(name)
    return tuple(Leaf(joints[number - 1], world_axis(joints[number - 1]), tuple(names))
                 for number, names in sorted(moving.items()))  # fmt: skip


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
