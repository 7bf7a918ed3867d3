"""Walks: smooth, within bounds, clear of everything, through open doors alone."""

import itertools
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from pbrnet.pipeline.cameras.camera_files import NO_WALK, make_cameras
from pbrnet.pipeline.cameras.settings import CameraParams
from pbrnet.pipeline.cameras.view_sampling import sample_cameras
from pbrnet.pipeline.cameras.walks import BODY, _walked, free_floors
from pbrnet.pipeline.render.scene import RenderScene, open_scene, set_variant
from pbrnet.pipeline.views import View
from pbrnet.scenes.contract import load_scene
from tests.fixtures.params import pbrs_cameras, pbrs_params, view_params
from tests.fixtures.stages import Block, write_room

DESK = Block("desk", (0.6, 0.9, 0.0), (1.3, 1.9, 0.75))
WALLS = (
    Block("wall-a", (2.95, 0.0, 0.0), (3.05, 1.0, 2.6), is_structure=True),
    Block("wall-b", (2.95, 1.9, 0.0), (3.05, 3.0, 2.6), is_structure=True),
)
LEAF = Block("leaf", (2.98, 1.0, 0.0), (3.02, 1.9, 2.6))
OPTIONS = pbrs_cameras(walks=2, walk_frames=60)


def two_rooms(folder: Path, *more: Block) -> RenderScene:
    """Two rooms of 3 x 3 m with a doorway between them, a desk in one."""
    set_variant("auto")
    write_room(folder, [DESK, *WALLS, *more], size=(6.0, 3.0, 2.6))
    scene = load_scene(folder)
    (room,) = scene.rooms
    halves = (
        replace(room, id="west", floor=((0, 0), (2.95, 0), (2.95, 3), (0, 3))),
        replace(room, id="east", floor=((3.05, 0), (6, 0), (6, 3), (3.05, 3))),
    )
    opened = open_scene(scene)
    return replace(opened, scene=replace(scene, rooms=halves))


@pytest.fixture(scope="module")
def flat(tmp_path_factory: pytest.TempPathFactory) -> RenderScene:
    return two_rooms(tmp_path_factory.mktemp("walks") / "flat")


def walks(rs: RenderScene, options: CameraParams, seed: int = 0) -> list[list[View]]:
    """The frames of each walk, in order."""
    views = make_cameras(rs, view_params(pbrs_params(cameras=options)), seed).views
    names = sorted({view.trajectory for view in views} - {""})
    return [[view for view in views if view.trajectory == name] for name in names]


def test_a_walk_keeps_its_bounds_and_its_clearance(flat: RenderScene) -> None:
    found = walks(flat, OPTIONS)
    assert [len(walk) for walk in found] == [60, 60]
    for walk in found:
        eyes = np.array([view.eye for view in walk])
        angles = np.unwrap([math.atan2(view.pose[1, 2], view.pose[0, 2]) for view in walk])
        steps = np.linalg.norm(np.diff(eyes, axis=0), axis=1)
        assert steps.max() <= OPTIONS.walk_step + 1e-5
        assert np.abs(np.diff(angles)).max() <= OPTIONS.walk_turn + 1e-5
        # Speed and turn change little by little.
        assert np.abs(np.diff(steps)).max() < 0.25 * OPTIONS.walk_step
        assert np.abs(np.diff(angles, n=2)).max() < 0.25 * OPTIONS.walk_turn
        assert steps.sum() > 0.3 and np.ptp(eyes[:, 2]) == 0
        near = BODY - 0.11  # less a cell of the grid, and what smoothing may take
        for block in (DESK, *WALLS):
            gap = np.maximum(np.array(block.low) - eyes, eyes - np.array(block.high))[:, :2]
            assert np.linalg.norm(np.maximum(gap, 0), axis=1).min() >= near, block.name
        assert (eyes[:, :2] >= near).all() and (eyes[:, :2] <= (6 - near, 3 - near)).all()


def test_frames_know_their_neighbours(flat: RenderScene) -> None:
    for walk in walks(flat, OPTIONS):
        assert [view.frame for view in walk] == list(range(60))
        assert walk[0].view_id == f"{walk[0].trajectory}-0000"
        assert walk[0].pose_before == () and walk[-1].pose_after == ()
        for one, other in itertools.pairwise(walk):
            assert one.pose_after == other.camera_to_world
            assert other.pose_before == one.camera_to_world
            assert one.K == other.K


def test_walks_pass_an_open_door_and_no_shut_one(flat: RenderScene, tmp_path: Path) -> None:
    longer = replace(OPTIONS, walk_frames=200, walks=1)
    assert {view.room for view in walks(flat, longer)[0]} == {"west", "east"}
    shut = two_rooms(tmp_path / "shut", LEAF)
    (floor,) = free_floors(shut, shut.scene.rooms, 1.55)
    centre = np.array([[3.0, 1.45]])
    assert floor.clearance_at(centre)[0] < BODY
    for walk in walks(shut, replace(OPTIONS, walk_frames=120)):
        assert len({view.room for view in walk}) == 1


def test_walks_change_no_sampled_view(flat: RenderScene) -> None:
    params = pbrs_params(cameras=OPTIONS)
    plain = sample_cameras(flat, view_params(pbrs_params()), 0)
    file = make_cameras(flat, view_params(params), 0)
    assert tuple(view for view in file.views if not view.trajectory) == plain.views
    assert make_cameras(flat, view_params(pbrs_params()), 0) == plain
    assert make_cameras(flat, view_params(params), 0) == file
    first = walks(flat, replace(OPTIONS, walks=1))
    assert first[0] == walks(flat, OPTIONS)[0], "a further walk changes no other"
    assert first != walks(flat, replace(OPTIONS, walks=1), seed=1)


def test_a_scene_without_free_floor_has_no_walk(tmp_path: Path) -> None:
    full = two_rooms(tmp_path / "full", Block("heap", (0.0, 0.0, 0.0), (6.0, 3.0, 0.4)))
    file = make_cameras(full, view_params(pbrs_params(cameras=OPTIONS)), 0)
    assert file.stored_left_out == {"walk-00": NO_WALK, "walk-01": NO_WALK}
    assert not any(view.trajectory for view in file.views)


def test_a_way_shorter_than_the_look_ahead_is_walked_looking_at_its_end() -> None:
    way = np.stack([np.arange(0, 0.6, 0.02), np.zeros(30)], axis=1)
    places, headings = _walked(way, 3, step=0.005, turn=0.05)
    assert places.shape == (3, 2) and (np.diff(places[:, 0]) > 0).all()
    np.testing.assert_allclose(headings, 0)
    assert len(_walked(way, 3, step=0.5, turn=0.05)[0]) == 0, "too short for so long steps"
