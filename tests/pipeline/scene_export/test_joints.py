"""Doors and panes of exported scenes: hinges that open, and glass in windows."""

import math

import numpy as np
import pytest

from pbrnet.pipeline.scene_export.content import Content, Joint, Piece
from pbrnet.pipeline.scene_export.joints import add_joints
from pbrnet.pipeline.scene_export.panes import add_panes
from pbrnet.scenes.arrays import Float64Array
from pbrnet.scenes.contract import Credit, Portal, Scene, SceneObject
from pbrnet.scenes.geometry.mesh import Mesh
from pbrnet.scenes.models.stated import Statement
from pbrnet.scenes.procedural.finishes import make_finishes
from pbrnet.scenes.procedural.furniture.style import make_style
from pbrnet.scenes.procedural.plan import Opening
from pbrnet.scenes.procedural.structure import _door
from pbrnet.scenes.seeds import generator

_CREDIT = Credit("everything", "test", "test", "CC0-1.0")


def _content(opening: Opening, kind: str = "procedural") -> Content:
    """A door alone; the parts of its leaf but for the levers share a shape with its frame."""
    finishes = make_finishes(generator(1, "finishes"), make_style(generator(1, "style")), {})
    parts = _door(opening, finishes).parts
    meshes = [Mesh(part.vertices, part.faces, None, part.uvs) for part in parts]
    starts = np.cumsum([0, *(len(mesh.vertices) for mesh in meshes[:-1])])
    shared = Mesh(
        np.concatenate([mesh.vertices for mesh in meshes[:-1]]),
        np.concatenate([m.faces + s for m, s in zip(meshes[:-1], starts, strict=False)]),
    )
    box = np.array(shared.bounds)
    door = SceneObject("door", "door", "door", ("a", "b"), tuple(box[0]), tuple(box[1]), True)
    content = Content(Scene("door", {"kind": kind}, (), (door,), (), (), (_CREDIT,)))
    content.pieces = {"a": Piece("a", shared, 0), "b": Piece("b", meshes[-1], 1)}
    return content


def _opening(turn: float, at_start: bool, swing: str, angle: float) -> Opening:
    along = np.array([math.cos(turn), math.sin(turn)])
    start, end = (float(x) for x in 2 * along), (float(x) for x in 2.9 * along)
    return Opening("door", "door", tuple(start), tuple(end), 0.14, 0.0, 2.05, ("one", "two"),
                   at_start, swing, angle)  # fmt: skip


def _points(content: Content, names: tuple[str, ...]) -> Float64Array:
    return np.concatenate([content.pieces[name].mesh.corners.reshape(-1, 3) for name in names])


def _turned(points: Float64Array, joint: Joint, degrees: float) -> Float64Array:
    """Points (N, 3) turned about a hinge."""
    angle = math.radians(degrees) * joint.axis[2]
    cos, sin = math.cos(angle), math.sin(angle)
    return (points - joint.pivot) @ np.array([[cos, -sin, 0], [sin, cos, 0], [0, 0, 1]]).T + (
        joint.pivot
    )


@pytest.mark.parametrize("turn", [0.0, 0.5, 2.2])
@pytest.mark.parametrize("angle", [0.0, 35.0, 90.0, 104.0])
@pytest.mark.parametrize(("at_start", "swing"), [(True, "one"), (False, "one"), (True, "two")])
def test_a_door_closes_about_its_hinge(
    turn: float, at_start: bool, swing: str, angle: float
) -> None:
    opening = _opening(turn, at_start, swing, angle)
    content = _content(opening)
    count = sum(len(piece.mesh.faces) for piece in content.pieces.values())
    add_joints(content)
    joint = content.joints["door"]
    assert joint.current == pytest.approx(angle, abs=0.01)
    assert joint.moving == ("a.leaf", "b")
    assert sum(len(piece.mesh.faces) for piece in content.pieces.values()) == count
    # Closed, the leaf fills the opening but for its lining, and lies inside the wall.
    closed = _turned(_points(content, ("a.leaf",)), joint, -joint.current)
    places = np.array([opening.edge.coordinates((x, y)) for x, y in closed[:, :2]])
    assert places[:, 0].min() == pytest.approx(0.023, abs=1e-3)
    assert places[:, 0].max() == pytest.approx(0.9 - 0.023, abs=1e-3)
    assert places[:, 1].min() > -0.15 and places[:, 1].max() < 0.01
    # Opened by a right angle, its free end stands in the room into which it swings.
    wide = _turned(_points(content, ("a.leaf",)), joint, 90 - joint.current)
    edge = opening.edge_in(swing)
    assert max(edge.coordinates((x, y))[1] for x, y in wide[:, :2]) > 0.8


def test_doors_of_imported_scenes_stay_as_they_are() -> None:
    content = _content(_opening(0.0, True, "one", 35.0), "sweethome")
    add_joints(content)
    assert content.joints == {} and set(content.pieces) == {"a", "b"}
    assert any("no joints" in line for line in content.lost.sentences())


def test_a_pane_fills_its_portal_and_faces_outdoors() -> None:
    corners = ((1.0, 0, 1), (1, 0, 2), (3, 0, 2), (3, 0, 1))
    glazed = Portal("p", "window", corners, (0, 1, 0), True, panes=2)
    closed = Portal("q", "door", corners, (0, 1, 0), False)
    content = Content(Scene("room", {}, (), (), (), (glazed, closed), (_CREDIT,)))
    add_panes(content)
    assert set(content.pieces) == set(content.panes) == {"pane-p"}
    mesh = content.pieces["pane-p"].mesh
    normals = np.cross(mesh.corners[:, 1] - mesh.corners[:, 0],
                       mesh.corners[:, 2] - mesh.corners[:, 0])  # fmt: skip
    assert 0.5 * np.linalg.norm(normals, axis=1).sum() == pytest.approx(2.0)
    assert (normals[:, 1] > 0).all()
    _, look, _ = content.materials[content.pieces["pane-p"].material]
    assert look.opacity == 0.08 and look.stated == Statement("thindielectric")
