"""Hinges of doors that a home states as sashes."""

import math

import numpy as np
import pytest

from pbrnet.scenes.arrays import Float64Array
from pbrnet.scenes.geometry import primitives
from pbrnet.scenes.geometry.joints import bodies, moved, within
from pbrnet.scenes.geometry.mesh import Mesh, join_meshes
from pbrnet.scenes.sweethome.furnishing.items import ItemPart, SurfaceFinish
from pbrnet.scenes.sweethome.furnishing.sashes import hinges
from pbrnet.scenes.sweethome.home import HomePiece, Sash

_PLACE = np.array([3.0, -1.0])
_SASH = Sash(0.05, 0.5, 0.9, 0.0, -math.pi / 2)


def _block(low: tuple[float, ...], high: tuple[float, ...]) -> Mesh:
    cube = primitives.cube()
    middle, half = 0.5 * (np.array(low) + high), 0.5 * (np.array(high) - low)
    return Mesh(cube.vertices * half + middle, cube.faces)


def _turned(
    points: Float64Array, angle: float, about: tuple[float, float] = (0, 0)
) -> Float64Array:
    cos, sin = math.cos(angle), math.sin(angle)
    flat = (points[:, :2] - about) @ np.array([[cos, sin], [-sin, cos]]) + about
    return np.column_stack([flat, points[:, 2]])


def _door(angle: float, mirrored: bool, opened: float) -> tuple[HomePiece, tuple[ItemPart, ...]]:
    """A frame 1 x 0.2 x 2 m and a leaf 0.9 m wide, hinge at the left, x = -0.45."""
    posts = [_block((x - 0.02, -0.1, 0), (x + 0.02, 0.1, 2)) for x in (-0.48, 0.48)]
    frame = join_meshes([*posts, _block((-0.5, -0.1, 1.95), (0.5, 0.1, 2.0))])
    leaf = join_meshes([_block((-0.45, -0.02, 0), (0.45, 0.02, 1.94)),
                        _block((0.35, -0.07, 1.0), (0.37, 0.07, 1.02))])  # fmt: skip
    side = -1.0 if mirrored else 1.0
    parts = []
    for mesh, turn in ((frame, 0.0), (leaf, -math.radians(opened))):
        points = _turned(mesh.vertices, turn, (-0.45, 0.0)) * [side, 1, 1]
        points = _turned(points, -angle) + np.array([*_PLACE, 0.0])
        parts.append(ItemPart(Mesh(points, mesh.faces), SurfaceFinish()))
    piece = HomePiece("d", "doorOrWindow", "Door", "", "", None, "m", 300.0, 100.0, 0.0, 100.0,
                      20.0, 200.0, angle, mirrored=mirrored, sashes=(_SASH,))  # fmt: skip
    return piece, tuple(parts)


@pytest.mark.parametrize("angle", [0.0, 0.7, math.pi / 2])
@pytest.mark.parametrize("mirrored", [False, True])
@pytest.mark.parametrize("opened", [0.0, 47.0])
def test_a_door_swings_about_the_edge_at_its_sash(
    angle: float, mirrored: bool, opened: float
) -> None:
    piece, parts = _door(angle, mirrored, opened)
    (joint,) = hinges(piece, "door", parts)
    assert joint.value == pytest.approx(opened, abs=0.5)
    assert joint.limits == (0.0, 90.0)
    corners = np.concatenate([part.mesh.corners for part in parts])
    moves = within(corners, bodies(corners), joint)
    assert moves.sum() == len(parts[1].mesh.faces)  # leaf and handle, not the frame
    points = corners[moves].reshape(-1, 3)
    closed, wide = (moved(points, joint, value) for value in (0.0, 90.0))
    edge = np.hypot(*(closed[:, :2] - joint.pivot[:2]).T) < 0.03
    assert edge.sum() and np.allclose(edge, np.hypot(*(wide[:, :2] - joint.pivot[:2]).T) < 0.03)
    # In the axes of the piece: closed within the frame, opened towards its front.
    own = [_turned(each - [*_PLACE, 0], angle) for each in (closed, wide)]
    assert np.abs(own[0][:, 0]).max() < 0.46 and np.abs(own[0][:, 1]).max() < 0.08
    assert own[1][:, 1].min() == pytest.approx(-0.9, abs=0.01)
    assert own[1][:, 1].max() < 0.03


def test_pieces_of_one_body_have_no_hinge() -> None:
    piece, parts = _door(0.0, False, 0.0)
    solid = ItemPart(_block((2.5, -1.1, 0), (3.5, -0.9, 2)), SurfaceFinish())
    assert hinges(piece, "door", (solid,)) == ()
    assert hinges(piece, "door", parts[:1]) == ()  # a frame alone
