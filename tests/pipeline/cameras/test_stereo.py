"""Stereo pairs: same orientation, room for both eyes, and disparity from depth."""

from dataclasses import replace

import numpy as np
import pytest

from pbrnet.pipeline.cameras.camera_files import make_cameras
from pbrnet.pipeline.cameras.view_sampling import TOO_CLOSE
from pbrnet.pipeline.passes.inputs import render_inputs
from pbrnet.pipeline.passes.video import reproject
from pbrnet.pipeline.render.scene import RenderScene, open_scene, set_variant
from pbrnet.pipeline.views import CameraFile, View, look
from pbrnet.scenes.contract import load_scene
from tests.fixtures.params import pbrs_cameras, pbrs_params, view_params
from tests.fixtures.stages import write_room

BASELINE = 0.12
OPTIONS = pbrs_cameras(views_per_room=4, stereo_baseline=BASELINE)


@pytest.fixture(scope="module")
def room(tmp_path_factory: pytest.TempPathFactory) -> RenderScene:
    set_variant("auto")
    folder = tmp_path_factory.mktemp("stereo") / "room"
    write_room(folder)
    return open_scene(load_scene(folder))


def pairs(file: CameraFile) -> list[tuple[View, View]]:
    views = {view.view_id: view for view in file.views}
    lefts = [view for view in file.views if view.stereo_offset > 0]
    return [(left, views[left.stereo_partner]) for left in lefts]


def test_each_view_has_a_partner_to_its_right(room: RenderScene) -> None:
    file = make_cameras(room, view_params(pbrs_params(cameras=OPTIONS)), 0)
    found = pairs(file)
    assert len(found) >= 2 and len(file.views) == 2 * len(found) + len(file.stored_left_out)
    for left, right in found:
        assert right.view_id == f"{left.view_id}-right" and right.stereo_partner == left.view_id
        assert right.stereo_offset == -left.stereo_offset == -BASELINE
        np.testing.assert_array_equal(left.pose[:3, :3], right.pose[:3, :3])
        offset = left.pose[:3, :3].T @ (right.eye - left.eye)
        np.testing.assert_allclose(offset, (BASELINE, 0, 0), atol=1e-12)
        assert right.K == left.K and right.room == left.room and right.seen
        x, y, z = right.eye
        assert min(x, 4 - x, y, 3 - y, 2.6 - z) >= OPTIONS.clearance - 1e-3


def test_disparity_follows_from_depth(room: RenderScene) -> None:
    """A point at column x of the left image is at x - focal * baseline / depth of the right one."""
    left, right = pairs(make_cameras(room, view_params(pbrs_params(cameras=OPTIONS)), 0))[0]
    small = replace(left, width=64, height=48, K=((40, 0, 32), (0, 40, 24), (0, 0, 1)))
    depth = render_inputs(room, small)["Z"]
    found = reproject(depth, small, right.pose)
    rows, columns = np.mgrid[:48, :64] + 0.5
    expected = columns - 40 * BASELINE / depth
    np.testing.assert_allclose(found.places[:, 0], expected.ravel(), atol=1e-4)
    np.testing.assert_allclose(found.places[:, 1], rows.ravel(), atol=1e-4)
    np.testing.assert_allclose(found.depth, depth.ravel(), atol=1e-5)


def test_a_pair_of_walks_is_two_trajectories(room: RenderScene) -> None:
    options = pbrs_cameras(walks=1, stereo_baseline=0.02, clearance=0.03)
    file = make_cameras(room, view_params(pbrs_params(cameras=options)), 0)
    walk = [pair for pair in pairs(file) if pair[0].trajectory]
    assert len(walk) == 24
    for left, right in walk:
        assert right.trajectory == "walk-00-right" and right.frame == left.frame
        assert right.view_id == f"walk-00-right-{left.frame:04d}"
    assert walk[3][1].pose_after == walk[4][1].camera_to_world


def test_a_partner_behind_a_wall_is_left_out(room: RenderScene) -> None:
    stored = {"name": "corner", "camera_to_world": look((3.7, 1.9, 1.5), (-0.1, -1, -0.2)).tolist()}
    turned = {"name": "turned", "camera_to_world": look((3.7, 2.0, 1.5), (-0.1, 1, -0.2)).tolist()}
    source = {"kind": "test", "views": [stored, turned]}
    scene = replace(room.scene, source=source)
    options = pbrs_cameras(stereo_baseline=0.5, min_objects=50)
    views = make_cameras(replace(room, scene=scene), view_params(pbrs_params(cameras=options)), 0)
    assert views.stored_left_out["stored-turned-right"] == TOO_CLOSE
    (pair,) = pairs(views)
    assert pair[0].view_id == "stored-corner"
    lone = next(view for view in views.views if view.view_id == "stored-turned")
    assert lone.stereo_partner == ""


def test_pairs_change_no_view(room: RenderScene) -> None:
    def bare(file: CameraFile) -> list[View]:
        kept = [view for view in file.views if view.stereo_offset >= 0]
        return [replace(view, stereo_partner="", stereo_offset=0.0) for view in kept]

    without = make_cameras(
        room, view_params(pbrs_params(cameras=replace(OPTIONS, stereo_baseline=0.0))), 0
    )
    assert bare(make_cameras(room, view_params(pbrs_params(cameras=OPTIONS)), 0)) == list(
        without.views
    )
