"""Doors, drawers and panes of exported scenes: hinges, slides, and glass in windows."""

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from pbrnet.pipeline.scene_export.content import Content, Leaf, Piece
from pbrnet.pipeline.scene_export.joints import add_joints
from pbrnet.pipeline.scene_export.panes import add_panes
from pbrnet.scenes.arrays import Float64Array
from pbrnet.scenes.contract import Credit, Portal, Scene, SceneObject
from pbrnet.scenes.geometry.joints import moved
from pbrnet.scenes.geometry.mesh import Mesh
from pbrnet.scenes.models.stated import Statement
from pbrnet.scenes.procedural.finishes import make_finishes
from pbrnet.scenes.procedural.furniture import FURNITURE_KINDS
from pbrnet.scenes.procedural.furniture.style import make_style
from pbrnet.scenes.procedural.home import _merge_by_material
from pbrnet.scenes.procedural.plan import Opening
from pbrnet.scenes.procedural.scene_item import Pose, SceneItem, place_piece
from pbrnet.scenes.procedural.structure import _door
from pbrnet.scenes.seeds import generator

_CREDIT = Credit("everything", "test", "test", "CC0-1.0")


def _content(item: SceneItem) -> Content:
    """An object alone; its parts of one material share a shape, as in a scene."""
    shapes = _merge_by_material(item.parts, None)
    pieces = {
        f"{item.id}.{number}": Piece(f"{item.id}.{number}", Mesh(part.vertices, part.faces), 0)
        for number, part in enumerate(shapes)
    }
    low, high = item.bounds.tolist()
    thing = SceneObject(item.id, item.name, item.category, tuple(pieces), tuple(low), tuple(high),
                        item.is_structure)  # fmt: skip
    scene = Scene("one", {}, (), (thing,), (), (), (_CREDIT,), joints=item.joints)
    return Content(scene, pieces)


def _made(kind: str, seed: int = 0, **options: Any) -> tuple[Content, tuple[Leaf, ...], Pose]:
    """A piece of furniture at an odd place, and its leaves."""
    draw, pose = generator(seed, "piece"), Pose(1.5, -2.25, 0.0, 30.0)
    spec = FURNITURE_KINDS[kind].draw(draw, make_style(generator(seed, "style")), **options)
    content = _content(place_piece(spec.build(), pose, kind, None)[0])
    add_joints(content)
    return content, content.leaves.get(kind, ()), pose


def _own(points: Float64Array, pose: Pose) -> Float64Array:
    """Points (N, 3) in the axes of the piece."""
    turned = Pose(0, 0, 0, -pose.yaw).apply(points - [pose.x, pose.y, pose.z])
    return np.asarray(turned)


def _opening(turn: float, at_start: bool, swing: str, angle: float) -> Opening:
    along = np.array([math.cos(turn), math.sin(turn)])
    start, end = (float(x) for x in 2 * along), (float(x) for x in 2.9 * along)
    return Opening("door", "door", tuple(start), tuple(end), 0.14, 0.0, 2.05, ("one", "two"),
                   at_start, swing, angle)  # fmt: skip


def _points(content: Content, names: tuple[str, ...]) -> Float64Array:
    return np.concatenate([content.pieces[name].mesh.corners.reshape(-1, 3) for name in names])


@pytest.mark.parametrize("turn", [0.0, 0.5, 2.2])
@pytest.mark.parametrize("angle", [0.0, 35.0, 90.0, 104.0])
@pytest.mark.parametrize(("at_start", "swing"), [(True, "one"), (False, "one"), (True, "two")])
def test_a_door_closes_about_its_hinge(
    turn: float, at_start: bool, swing: str, angle: float
) -> None:
    opening = _opening(turn, at_start, swing, angle)
    finishes = make_finishes(generator(1, "finishes"), make_style(generator(1, "style")), {})
    content = _content(_door(opening, finishes))
    count = sum(len(piece.mesh.faces) for piece in content.pieces.values())
    add_joints(content)
    (leaf,) = content.leaves["door"]
    assert leaf.joint.value == pytest.approx(angle, abs=0.01)
    assert sum(len(piece.mesh.faces) for piece in content.pieces.values()) == count
    # Closed, the leaf fills the opening but for its lining, and lies inside the wall.
    points = _points(content, leaf.moving)
    closed = moved(points, leaf.joint, 0)
    places = np.array([opening.edge.coordinates((x, y)) for x, y in closed[:, :2]])
    assert places[:, 0].min() == pytest.approx(0.023, abs=1e-3)
    assert places[:, 0].max() == pytest.approx(0.9 - 0.023, abs=1e-3)
    assert np.sort(places[:, 1])[len(places) // 20] > -0.2 and places[:, 1].max() < 0.07
    # Opened by a right angle, its free end stands in the room into which it swings.
    wide = moved(points, leaf.joint, 90)
    edge = opening.edge_in(swing)
    assert max(edge.coordinates((x, y))[1] for x, y in wide[:, :2]) > 0.8


def test_drawers_leave_their_carcass_along_one_axis() -> None:
    content, leaves, pose = _made("chest_of_drawers", pulled=(0.0, 0.2, 0.0))
    assert [leaf.joint.kind for leaf in leaves] == 3 * ["slide"]
    assert [leaf.joint.value for leaf in leaves] == [0.0, 0.2, 0.0]
    thing = content.scene.objects[0]
    stays = _own(np.concatenate([one.mesh.vertices for one in content.fixed(thing)]), pose)
    front = stays[:, 1].min()
    for leaf in leaves:
        points = _points(content, leaf.moving)
        closed, out = (_own(moved(points, leaf.joint, value), pose) for value in (0.0, 0.3))
        assert np.allclose(out - closed, [0, -0.3, 0], atol=1e-9)
        inside = closed[closed[:, 1] > front + 0.04]
        assert len(inside) > 0 if leaf.joint.value else len(inside) == 0  # only that one has a box
        assert (np.abs(inside[:, 0]) < stays[:, 0].max()).all()


@pytest.mark.parametrize("ajar", [0, 1])
def test_doors_of_a_wardrobe_turn_about_their_edge(ajar: int) -> None:
    content, leaves, pose = _made(
        "wardrobe", width=1.2, depth=0.6, drawers=0.0, ajar=ajar, angle=40
    )
    assert [leaf.joint.value for leaf in leaves] == [40.0 if k == ajar else 0.0 for k in (0, 1)]
    for leaf, side in zip(leaves, (-1, 1), strict=True):
        points = _points(content, leaf.moving)
        closed, wide = (_own(moved(points, leaf.joint, value), pose) for value in (0.0, 90.0))
        edge = np.abs(closed[:, :2] - [side * 0.5985, -0.281]).max(axis=1) < 2e-3  # by its bevel
        assert edge.sum() >= 2 and np.ptp(closed[edge, 2]) > 1.8
        assert np.allclose(closed[edge], wide[edge], atol=4e-3)
        assert closed[:, 1].max() == pytest.approx(-0.281) and closed[:, 0].min() > -0.6
        assert wide[:, 1].min() == pytest.approx(-0.281 - 0.597, abs=1e-6)  # its width
        assert np.allclose(closed[:, 2], wide[:, 2])


def test_an_oven_opens_downwards() -> None:
    content, (leaf,), pose = _made("hob_unit")
    wide = _own(moved(_points(content, leaf.moving), leaf.joint, 90), pose)
    closed = _own(moved(_points(content, leaf.moving), leaf.joint, 0), pose)
    assert np.ptp(wide[:, 1]) == pytest.approx(np.ptp(closed[:, 2]))
    assert wide[:, 1].min() < -0.6 and wide[:, 2].min() > 0.1


@pytest.mark.parametrize("kind", ["fridge", "base_cupboard", "drawer_unit", "sideboard", "tv_stand",
                                  "night_table", "desk", "wash_basin", "washing_machine", "shower",
                                  "microwave", "wall_cupboard", "built_in_wardrobe"])  # fmt: skip
def test_every_joint_moves_something_and_every_front_is_moved(kind: str) -> None:
    count = 0
    for seed in range(4):
        content, leaves, pose = _made(kind, seed)
        joints = content.scene.joints
        assert [leaf.joint for leaf in leaves] == list(joints)
        count += len(leaves)
        for leaf in leaves:  # closed or wide open, it never stands behind the piece
            points = _points(content, leaf.moving)
            reach = [_own(moved(points, leaf.joint, value), pose) for value in leaf.joint.limits]
            assert reach[1][:, 1].min() < reach[0][:, 1].min() - 0.1
    assert count >= 2


def test_doors_without_a_stated_hinge_stay_as_they_are() -> None:
    opening = _opening(0.0, True, "one", 35.0)
    finishes = make_finishes(generator(1, "finishes"), make_style(generator(1, "style")), {})
    content = _content(replace(_door(opening, finishes), joints=()))
    names = set(content.pieces)
    add_joints(content)
    assert content.leaves == {} and set(content.pieces) == names
    assert any("no joint" in line for line in content.lost.sentences())


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


def test_a_joint_of_an_object_without_shapes_moves_nothing() -> None:
    content, _, _ = _made("wardrobe")
    (thing,) = content.scene.objects
    bare = replace(content.scene, objects=(replace(thing, shapes=()),))
    empty = Content(bare, {})
    add_joints(empty)
    assert empty.leaves == {thing.id: ()}


@pytest.mark.parametrize("wrong", [{"axis": (0.0, 0.0, 0.0)}, {"boxes": ()}])
def test_joints_need_an_axis_and_a_box(wrong: dict[str, Any]) -> None:
    joint = replace(_made("wardrobe")[0].scene.joints[0], **wrong)
    with pytest.raises(ValueError, match="a joint needs an axis of unit length and a box"):
        joint.verify("scene.json")
