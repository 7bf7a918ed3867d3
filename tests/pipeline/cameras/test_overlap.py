"""Overlap by reprojection: analytic pairs, and sets whose median overlap is what was asked for."""

import itertools
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from pbrnet.pipeline.cameras.camera_files import NO_SET, make_cameras
from pbrnet.pipeline.cameras.overlap import outlook, overlap
from pbrnet.pipeline.lenses.model import Lens
from pbrnet.pipeline.passes.inputs import render_inputs
from pbrnet.pipeline.passes.video import reproject
from pbrnet.pipeline.render.scene import RenderScene, open_scene, set_variant
from pbrnet.pipeline.views import ImageParams, View, look
from pbrnet.scenes.contract import load_scene
from tests.fixtures.params import pbrs_cameras, pbrs_params, view_params
from tests.fixtures.render import diffuse, quad, write_scene
from tests.fixtures.stages import write_room

OPTIONS = pbrs_cameras(overlap_views=4, overlap=0.5)


@pytest.fixture(scope="module")
def room(tmp_path_factory: pytest.TempPathFactory) -> RenderScene:
    set_variant("auto")
    folder = tmp_path_factory.mktemp("overlap") / "room"
    write_room(folder)
    return open_scene(load_scene(folder))


def test_overlap_before_a_wall_is_what_geometry_says(tmp_path: Path) -> None:
    """Side by side at 4 m from a wall, moved by a quarter of the image's width there."""
    set_variant("auto")
    wall = quad("wall", (0, 4, 1.5), (0, -1, 0), (20, 20), diffuse())
    board = quad("board", (0.4, 0.5, 1.5), (0, -1, 0), (0.3, 20), diffuse())
    lens = Lens("perspective", 96, 72, ((60.0, 0, 48), (0, 60, 36), (0, 0, 1)))
    quarter = 4 * 96 / 60 / 4
    poses = [look((x, 0, 1.5), (0, 1, 0)) for x in (0.0, quarter)]
    back = look((0, 0, 1.5), (0, -1, 0))
    scene = open_scene(write_scene(tmp_path / "wall", wall))
    one, other, behind = (outlook(scene, pose, lens) for pose in (*poses, back))
    assert overlap(scene, one, other) == pytest.approx(0.75, abs=1e-6)
    assert overlap(scene, one, one) == 1.0
    assert overlap(scene, one, behind) == 0.0
    hidden = open_scene(write_scene(tmp_path / "board", wall + board))
    one, other = (outlook(hidden, pose, lens) for pose in poses)
    assert overlap(hidden, one, other) < 0.6, "the board hides other parts of the wall from each"


def visible_share(rs: RenderScene, one: View, other: View) -> float:
    """The overlap again, from depth images: a point is seen where the other's depth is its own."""
    depth, there = (render_inputs(rs, view)["Z"] for view in (one, other))
    found = reproject(depth, one, other.pose)
    columns, rows = np.floor(found.places[found.inside]).astype(int).T
    seen = (
        np.abs(there[rows, columns] - found.depth[found.inside]) < 0.03 * found.depth[found.inside]
    )
    return float(seen.sum()) / depth.size


def test_a_set_overlaps_by_its_median(room: RenderScene) -> None:
    params = pbrs_params(cameras=OPTIONS, image=ImageParams(96, 72))
    file = make_cameras(room, view_params(params), 0)
    members = [view for view in file.views if view.view_set]
    assert len(members) == 4 and {view.view_set for view in members} == {"set-living"}
    assert {view.room for view in members} == {"living"}
    pairs = [
        0.5 * (visible_share(room, one, other) + visible_share(room, other, one))
        for one, other in itertools.combinations(members, 2)
    ]
    assert np.median(pairs) == pytest.approx(members[0].set_overlap, abs=0.05)
    assert members[0].set_overlap >= 0.5
    eyes = np.array([view.eye for view in members])
    away = [np.linalg.norm(a - b) for a, b in itertools.combinations(eyes, 2)]
    assert min(away) > 0.1, "different places"
    for view in members:
        x, y, z = view.eye
        assert min(x, 4 - x, y, 3 - y, 2.6 - z) >= OPTIONS.clearance - 1e-3


def test_sets_change_no_sampled_view_and_are_left_out_if_impossible(room: RenderScene) -> None:
    plain = make_cameras(room, view_params(pbrs_params()), 0)
    file = make_cameras(room, view_params(pbrs_params(cameras=OPTIONS)), 0)
    kept = [view for view in file.views if not view.view_id.startswith("set-")]
    assert [replace(view, view_set="", set_overlap=0.0) for view in kept] == list(plain.views)
    assert sum(bool(view.view_set) for view in kept) == 1
    impossible = replace(OPTIONS, overlap=0.95, overlap_views=16)
    file = make_cameras(room, view_params(pbrs_params(cameras=impossible)), 0)
    assert file.views == plain.views and file.stored_left_out == {"set-living": NO_SET}
