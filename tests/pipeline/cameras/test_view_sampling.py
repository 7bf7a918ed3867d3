"""Cameras: scores worked out by hand, eyes where a person could stand, every candidate counted."""

import itertools
import math
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from pbrnet.pipeline.cameras import view_sampling
from pbrnet.pipeline.cameras.settings import CameraParams, RoomShare
from pbrnet.pipeline.cameras.view_sampling import sample_cameras, score_ids
from pbrnet.pipeline.params import Params
from pbrnet.pipeline.render.scene import RenderScene, open_scene, set_variant
from pbrnet.pipeline.views import CameraFile, ImageParams, load_cameras, look, save_cameras
from pbrnet.scenes.contract import Room, load_scene
from tests.fixtures.params import pbrs_cameras, pbrs_params, view_params
from tests.fixtures.stages import LIVING, Block, write_room

PARAMS = pbrs_params(cameras=pbrs_cameras(views_per_room=6))


@pytest.fixture(scope="module")
def living(tmp_path_factory: pytest.TempPathFactory) -> RenderScene:
    return _opened(tmp_path_factory.mktemp("cameras") / "living")


def _opened(folder: Path, **options: object) -> RenderScene:
    set_variant("auto")
    write_room(folder, **options)  # type: ignore[arg-type]
    return open_scene(load_scene(folder))


def _sample(rs: RenderScene, params: Params = PARAMS, seed: int = 0) -> CameraFile:
    return sample_cameras(rs, view_params(params), seed)


def _with_rooms(rs: RenderScene, *rooms: Room) -> RenderScene:
    return replace(rs, scene=replace(rs.scene, rooms=rooms))


def test_score_by_hand(living: RenderScene) -> None:
    names = [thing.id for thing in living.scene.objects]
    ids = np.zeros((2, 10, 20), dtype=np.uint32)  # 200 pixels, 2 % are 4 of them
    ids[0, :, :] = names.index("floor") + 1
    ids[0, 0, :8] = names.index("sofa") + 1  # 8 pixels: counts, log(8 / 4)
    ids[0, 1, :4] = names.index("table") + 1  # exactly the minimum: does not count
    ids[0, 2:4, :20] = names.index("shelf") + 1  # 40 pixels: counts, log(40 / 4)
    (first, second) = score_ids(ids, living.scene, min_coverage=0.02)
    assert first[0] == pytest.approx(math.log(2) + math.log(10), abs=1e-12)
    assert first[1] == ("sofa", "shelf")
    assert first[2] == {"floor": 200 - 52, "sofa": 8, "table": 4, "shelf": 40}
    assert second == (0.0, (), {})


def test_structure_never_counts(living: RenderScene) -> None:
    ids = np.ones((1, 8, 8), dtype=np.uint32)
    assert score_ids(ids, living.scene, 0.01)[0][1] == ()  # the first object is the floor
    blocks = replace(living.scene, objects=living.scene.objects[6:])
    assert score_ids(ids, blocks, 0.01)[0][1] == ("sofa",)


def test_an_empty_room_is_seen_by_its_building(living: RenderScene, tmp_path: Path) -> None:
    """Structure counts only where no candidate sees three pieces of furniture."""
    bare = replace(living.scene, objects=living.scene.objects[:6])
    assert all(part.is_structure for part in bare.objects)
    opened = replace(_opened(tmp_path / "bare", blocks=[]), scene=bare)
    empty = sample_cameras(opened, view_params(PARAMS), 0)
    assert empty.unfurnished and len(empty.views) >= 3
    assert len(empty.views) + sum(empty.rejected.values()) == empty.candidates
    for view in empty.views:
        counted = [count for count in view.seen.values() if count > 48]
        assert view.score > sum(math.log(n / 48) for n in counted)  # and how far the view reaches
    furnished = _sample(living)
    assert furnished.views and not furnished.unfurnished
    assert not _sample(living, pbrs_params(cameras=pbrs_cameras(min_objects=50))).unfurnished


def test_an_empty_corridor_is_seen_along_its_length(tmp_path: Path) -> None:
    rs = _opened(tmp_path / "corridor", blocks=[], size=(8.0, 1.6, 2.6))
    views = sorted(_sample(rs).views, key=lambda view: -view.score)
    assert len(views) >= 2
    for view in views[:2]:
        forward = view.pose[:3, 2]
        assert abs(forward[0]) > 4 * abs(forward[1])


def test_a_candidate_outdoors_is_no_view(living: RenderScene) -> None:
    (room,) = living.scene.rooms
    garden = replace(room, floor=((10, 0), (14, 0), (14, 3), (10, 3)))
    file = _sample(_with_rooms(living, garden), pbrs_params(cameras=pbrs_cameras(min_objects=0)))
    assert file.views == () and file.rejected[view_sampling.OUTDOORS] > 0


def test_views_obey_the_rules_of_pbrs(living: RenderScene) -> None:
    file = _sample(living)
    assert len(file.views) >= 3
    for view in file.views:
        forward = view.pose[:3, 2]
        horizontal = math.hypot(forward[0], forward[1])
        assert forward[2] / horizontal == pytest.approx(-0.2, abs=1e-9)
        assert math.degrees(math.asin(-forward[2])) == pytest.approx(11.31, abs=0.01)
        azimuth = math.atan2(forward[1], forward[0]) % (2 * math.pi)
        assert int(azimuth / (math.pi / 3)) == view.sector
        assert abs(view.eye[2] - 1.55) <= 0.05
        assert 0 < view.eye[0] < 4 and 0 < view.eye[1] < 3
        assert abs(view.pose[2, 0]) < 1e-12  # the horizon is level
        assert view.room == "living" and view.room_type == "living"


def test_ranges_are_kept_and_filled(living: RenderScene) -> None:
    ranges = {"half_fov_x": (0.4, 0.7), "pitch": (-0.5, 0.1), "roll": (-0.2, 0.05)}
    every = pbrs_cameras(views_per_room=36, views_per_scene=36, sectors=36, max_alike=1.0)
    views = _sample(living, pbrs_params(cameras=replace(every, min_objects=0, **ranges))).views
    assert len(views) > 20
    drawn = {
        "half_fov_x": [math.atan(0.5 * view.width / view.intrinsics[0, 0]) for view in views],
        "pitch": [math.asin(view.pose[2, 2]) for view in views],
        # the camera's right axis sinks when it rolls clockwise
        "roll": [math.atan2(-view.pose[2, 0], -view.pose[2, 1]) for view in views],
    }
    for name, values in drawn.items():
        low, high = ranges[name]
        assert low - 1e-9 <= min(values) < low + 0.3 * (high - low), name
        assert high - 0.3 * (high - low) < max(values) <= high + 1e-9, name


def test_framing_rejects_and_room_shares_leave_rooms_out(living: RenderScene) -> None:
    narrow = replace(PARAMS.cameras, half_fov_x=(0.2, 0.2), min_objects=1)
    options = replace(narrow, framing="photograph")
    framed = _sample(living, replace(PARAMS, cameras=options))
    assert framed.rejected[view_sampling.UNFRAMED] > 0
    assert framed.candidates == len(framed.views) + sum(framed.rejected.values())
    plain = _sample(living, replace(PARAMS, cameras=narrow))
    assert view_sampling.UNFRAMED not in plain.rejected
    none = replace(options, room_shares=(RoomShare(living.scene.rooms[0].type, 0.0),))
    empty = _sample(living, replace(PARAMS, cameras=none))
    assert not empty.views
    assert empty.rejected[view_sampling.NOT_SHARED] == empty.candidates == plain.candidates


def test_a_range_of_one_value_is_that_value(living: RenderScene) -> None:
    """Places and azimuths stay as without ranges; a range of the usual values changes nothing."""
    usual = _sample(living)
    pitch = math.atan(PARAMS.cameras.tilt)
    fov = PARAMS.image.half_fov_x
    options = replace(PARAMS.cameras, half_fov_x=(fov, fov), pitch=(pitch, pitch), roll=(0.0, 0.0))
    same = _sample(living, pbrs_params(cameras=options))
    assert [view.view_id for view in same.views] == [view.view_id for view in usual.views]
    for one, other in zip(same.views, usual.views, strict=True):
        assert np.allclose(one.pose, other.pose, atol=1e-12) and one.K == other.K


@pytest.mark.parametrize("bounds", [(0.3,), (0.5, 0.4), (0.1, 0.2, 0.3)])
def test_a_range_is_two_ascending_numbers(bounds: tuple[float, ...]) -> None:
    with pytest.raises(ValueError, match="a range is"):
        pbrs_cameras(roll=bounds).verify("cameras")


def test_score_follows_from_the_objects_seen(living: RenderScene) -> None:
    furniture = {thing.id for thing in living.scene.objects if not thing.is_structure}
    for view in _sample(living).views:
        counted = [n for name, n in view.seen.items() if name in furniture and n > 48]
        assert len(counted) >= PARAMS.cameras.min_objects
        assert view.score == pytest.approx(sum(math.log(n / 48) for n in counted), abs=1e-9)


def test_no_surface_within_clearance(living: RenderScene) -> None:
    clearance = 0.3
    file = _sample(living, pbrs_params(cameras=pbrs_cameras(clearance=clearance, views_per_room=6)))
    assert file.views
    for view in file.views:
        x, y, z = view.eye
        assert min(x, 4 - x, y, 3 - y, 2.6 - z) >= clearance - 1e-3
        for block in LIVING:
            gap = np.maximum(np.maximum(np.array(block.low) - view.eye, 0), view.eye - block.high)
            # The test rays are 7 cm apart at this distance: a corner may lie between two.
            assert np.linalg.norm(np.maximum(gap, 0)) >= clearance - 0.01, block.name


def test_no_eye_inside_furniture(tmp_path: Path) -> None:
    closet = Block("closet", (0.2, 0.2, 0.0), (2.2, 2.8, 2.5))
    rs = _opened(tmp_path / "closet", blocks=[closet])
    no_limits = pbrs_cameras(clearance=0.0, min_objects=0, views_per_room=36, max_near=1.0)
    file = _sample(rs, pbrs_params(cameras=replace(no_limits, candidates=4096)))
    area = 2.0 * 2.6 / (4 * 3)
    share = file.rejected[view_sampling.INSIDE] / file.candidates
    assert share == pytest.approx(area, abs=0.05)
    assert all(not (0.2 < v.eye[0] < 2.2 and 0.2 < v.eye[1] < 2.8) for v in file.views)


def test_every_candidate_is_accounted_for(living: RenderScene) -> None:
    for options in (
        pbrs_cameras(),
        pbrs_cameras(views_per_room=1, views_per_scene=1, candidates=3),
        pbrs_cameras(min_score=9.0),
        pbrs_cameras(min_objects=50),
        pbrs_cameras(eye_height=2.59, eye_jitter=0.0),
    ):
        file = _sample(living, pbrs_params(cameras=options))
        assert len(file.views) + sum(file.rejected.values()) == file.candidates == 12 * 16 * 6
        assert all(count > 0 for count in file.rejected.values())
        assert len(file.views) <= min(options.views_per_room, options.views_per_scene)


@pytest.mark.parametrize(
    ("options", "reason"),
    [
        (pbrs_cameras(min_objects=50), view_sampling.FEW_OBJECTS),
        (pbrs_cameras(min_score=99.0), view_sampling.LOW_SCORE),
        (pbrs_cameras(eye_height=2.59, eye_jitter=0.0), view_sampling.ABOVE),
        (pbrs_cameras(near=9.0, max_near=0.0), view_sampling.BLOCKED),
    ],
)
def test_a_scene_without_a_view_says_why(
    living: RenderScene, options: CameraParams, reason: str
) -> None:
    file = _sample(living, pbrs_params(cameras=options))
    assert file.views == ()
    assert file.rejected[reason] > 0


@pytest.mark.parametrize(
    ("options", "relaxed"),
    [
        (pbrs_cameras(candidates=1, sectors=1), ""),
        (pbrs_cameras(min_objects=50), "min_objects: 2"),
        (pbrs_cameras(pitch=(0.9, 0.9), min_objects=1, framing="photograph"), "framing: paper"),
        (pbrs_cameras(near=9.0, max_near=0.0), None),
    ],
)
def test_a_room_without_views_is_searched_again(
    living: RenderScene, options: CameraParams, relaxed: str | None, tmp_path: Path
) -> None:
    """Other rooms keep their views; every candidate of both searches is counted."""
    (room,) = living.scene.rooms
    corner = replace(room, id="corner", floor=((2.3, 1), (3.5, 1), (3.5, 2), (2.3, 2)))
    both = _with_rooms(living, room, corner)
    own = replace(options, min_own=0.0, views_per_scene=64)
    first, second = (
        _sample(both, pbrs_params(cameras=replace(own, every_room=every)))
        for every in (False, True)
    )
    assert len(second.views) + sum(second.rejected.values()) == second.candidates
    seen = {view.room for view in first.views}
    assert "corner" not in seen
    assert [view for view in second.views if view.room in seen] == list(first.views)
    found = set() if relaxed is None else {"living", "corner"}
    assert {view.room for view in second.views} == found
    assert set((second.relaxed or {}).values()) == ({relaxed} if relaxed else set())
    save_cameras(tmp_path / "cameras.json", second)
    assert load_cameras(tmp_path / "cameras.json") == second


def test_room_without_light_is_dropped(tmp_path: Path) -> None:
    file = _sample(_opened(tmp_path / "dark", has_light=False))
    assert file.views == ()
    assert file.rejected == {view_sampling.NO_LIGHT: file.candidates}


def test_best_of_every_sector_then_of_the_room(living: RenderScene) -> None:
    everything = _sample(living, pbrs_params(cameras=pbrs_cameras(views_per_room=36)))
    sectors = [view.sector for view in everything.views]
    assert len(set(sectors)) == len(sectors)
    best = sorted(everything.views, key=lambda view: (-view.score, view.sector))[:2]
    chosen = _sample(living, pbrs_params(cameras=pbrs_cameras(views_per_room=2))).views
    assert [v.view_id for v in chosen] == sorted(v.view_id for v in best)


def test_no_two_views_of_a_room_show_the_same(living: RenderScene) -> None:
    freely = pbrs_params(cameras=pbrs_cameras(views_per_room=36, max_alike=1.0))
    strictly = pbrs_params(cameras=pbrs_cameras(views_per_room=36, max_alike=0.3))
    assert view_sampling.ALIKE not in _sample(living, freely).rejected
    file = _sample(living, strictly)
    assert file.rejected[view_sampling.ALIKE] > 0
    furniture = {thing.id for thing in living.scene.objects if not thing.is_structure}
    for one, other in itertools.combinations(file.views, 2):
        pairs = [(one.seen.get(name, 0), other.seen.get(name, 0)) for name in furniture]
        assert sum(map(min, pairs)) <= 0.3 * sum(map(max, pairs))


def test_a_view_shows_its_own_room(living: RenderScene) -> None:
    (room,) = living.scene.rooms
    narrow = replace(room, id="hall")  # the furniture belongs to "living"
    assert _sample(_with_rooms(living, narrow)).rejected[view_sampling.ELSEWHERE] > 0
    assert _sample(_with_rooms(living, narrow)).views == ()
    anyhow = pbrs_params(cameras=pbrs_cameras(min_own=0.0))
    assert _sample(_with_rooms(living, narrow), anyhow).views


def test_each_room_gets_its_best_view_before_any_gets_a_second(living: RenderScene) -> None:
    (room,) = living.scene.rooms
    halves = [
        replace(room, id="east", floor=((2, 0), (4, 0), (4, 3), (2, 3))),
        replace(room, id="west", floor=((0, 0), (2, 0), (2, 3), (0, 3))),
    ]
    file = _sample(
        _with_rooms(living, *halves),
        pbrs_params(cameras=pbrs_cameras(views_per_room=4, views_per_scene=2, min_own=0)),
    )
    assert sorted(view.room or "" for view in file.views) == ["east", "west"]


def test_eyes_stay_inside_an_l_shaped_room(living: RenderScene) -> None:
    (room,) = living.scene.rooms
    floor = ((0, 0), (4, 0), (4, 1.4), (1.5, 1.4), (1.5, 3), (0, 3))
    file = _sample(_with_rooms(living, replace(room, floor=floor)))
    assert file.views
    assert all(view.eye[0] < 1.5 or view.eye[1] < 1.4 for view in file.views)
    outside = file.rejected[view_sampling.OUTSIDE] / file.candidates
    assert outside == pytest.approx(2.5 * 1.6 / 12, abs=0.05)


def test_a_floor_that_crosses_itself_is_no_crash(living: RenderScene) -> None:
    (room,) = living.scene.rooms
    bow_tie = replace(room, floor=((0, 0), (4, 3), (4, 0), (0, 3)))
    file = _sample(_with_rooms(living, bow_tie))
    assert file.rejected[view_sampling.OUTSIDE] > 0


def test_equal_arguments_give_equal_views_and_another_seed_others(living: RenderScene) -> None:
    assert _sample(living) == _sample(living)
    assert _sample(living).views != _sample(living, seed=1).views


def test_room_names_become_safe_and_stay_apart(living: RenderScene) -> None:
    (room,) = living.scene.rooms
    rooms = [replace(room, id="Küche/1"), replace(room, id="K?che 1"), replace(room, id="../..")]
    views = _sample(_with_rooms(living, *rooms), pbrs_params(cameras=pbrs_cameras(min_own=0))).views
    assert len({view.view_id for view in views}) == len(views)
    assert all(re.fullmatch(r"[A-Za-z0-9_-]+", view.view_id) for view in views)
    assert [view.view_id for view in views] == sorted(view.view_id for view in views)


def test_stored_views_are_kept_beside_the_sampled_ones(tmp_path: Path) -> None:
    pose = look((2.0, 1.5, 1.5), (1.0, 0.2, 0.0))
    stored = {"name": "my camera", "camera_to_world": pose.tolist(), "half_fov_x": 0.4}
    rs = _opened(tmp_path / "stored", source={"views": [stored]})
    file = _sample(rs)
    (view,) = [view for view in file.views if view.view_id == "stored-my-camera"]
    assert np.array_equal(view.pose, pose)
    assert view.intrinsics[0, 0] == pytest.approx(0.5 * view.width / math.tan(0.4))
    assert view.room == "living"
    assert len(file.views) - 1 + sum(file.rejected.values()) == file.candidates
    without = _sample(rs, pbrs_params(cameras=pbrs_cameras(stored_views=False)))
    assert all(not view.view_id.startswith("stored") for view in without.views)


@pytest.mark.parametrize(
    ("eye", "towards", "reason"),
    [
        ((2.0, 1.5, 1.5), (0.0, 1.0, 0.0), view_sampling.BLANK),
        ((3.0, 2.4, 1.5), (0.0, 1.0, -0.2), view_sampling.BLOCKED),
        ((1.0, 1.0, 1.5), (1.0, 0.0, 0.0), view_sampling.INSIDE),
    ],
    ids=["at a wall", "at a wall near by", "in a closet"],
)
def test_a_stored_camera_that_shows_nothing_is_left_out_and_named(
    tmp_path: Path,
    eye: tuple[float, float, float],
    towards: tuple[float, float, float],
    reason: str,
) -> None:
    blocks = (
        [] if reason == view_sampling.BLANK else [Block("closet", (0.2, 0.2, 0.0), (1.8, 2.8, 2.5))]
    )
    pose = look(eye, towards)
    stored = {"name": "visitor", "camera_to_world": pose.tolist(), "half_fov_x": 0.4}
    file = _sample(_opened(tmp_path / "stored", blocks=blocks, source={"views": [stored]}))
    assert file.stored_left_out == {"stored-visitor": reason}
    assert not [view for view in file.views if view.view_id == "stored-visitor"]


@pytest.mark.parametrize(
    ("eye", "is_inside"),
    [((2.0, 1.5, 1.5), True), ((-0.101, 1.5, 1.5), True), ((2.0, 1.5, 9.0), False),
     ((-5.0, 1.5, 1.5), False)],
    ids=["inside", "in the doorway", "above", "outside"],
)  # fmt: skip
def test_stored_views_outside_every_room_are_views_only_where_asked_for(
    tmp_path: Path, eye: tuple[float, float, float], is_inside: bool
) -> None:
    towards = (-1.0 if eye[0] == -0.101 else 1.0, 0.2, -0.3)  # away from the wall beside the eye
    stored = {"name": "own", "camera_to_world": look(eye, towards).tolist()}
    rs = _opened(tmp_path / "stored", source={"views": [stored]})

    def rooms(options: CameraParams) -> list[str | None]:
        views = _sample(rs, pbrs_params(cameras=options)).views
        return [view.room for view in views if view.view_id == "stored-own"]

    assert rooms(pbrs_cameras()) == (["living"] if is_inside else [])
    assert rooms(pbrs_cameras(outside_views=True)) == ["living" if is_inside else None]


def test_a_bigger_image_changes_no_choice(living: RenderScene) -> None:
    small = _sample(living, pbrs_params(image=ImageParams(160, 120)))
    large = _sample(living, pbrs_params(image=ImageParams(640, 480)))
    assert [v.camera_to_world for v in small.views] == [v.camera_to_world for v in large.views]
    assert large.views[0].intrinsics[0, 0] == pytest.approx(4 * small.views[0].intrinsics[0, 0])
