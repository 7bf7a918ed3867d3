"""Trajectories from files: both formats say the same, and faults are named with their place."""

import json
import math
from collections import Counter
from pathlib import Path

import numpy as np
import pytest

from pbrnet.pipeline.cameras.camera_files import THROUGH, make_cameras
from pbrnet.pipeline.cameras.trajectory_files import Trajectory, read_trajectory
from pbrnet.pipeline.cameras.view_sampling import INSIDE, TOO_CLOSE
from pbrnet.pipeline.render.scene import open_scene
from pbrnet.pipeline.views import ImageParams, as_matrix, look
from pbrnet.scenes.contract import load_scene
from pbrnet.scenes.errors import InputError
from tests.fixtures.params import pbrs_cameras, pbrs_params, view_params
from tests.fixtures.stages import write_room


def test_both_formats_hold_the_same_poses(tmp_path: Path) -> None:
    """A camera that looks along +X with level horizon, then turned left by 90 degrees."""
    first = [[0, 0, 1, 1], [-1, 0, 0, 2], [0, -1, 0, 1.5], [0, 0, 0, 1]]
    then = [[1, 0, 0, 1], [0, 0, 1, 2.5], [0, -1, 0, 1.5], [0, 0, 0, 1]]
    (tmp_path / "a.json").write_text(json.dumps({"camera_to_world": [first, then]}))
    half = math.sqrt(0.5)
    (tmp_path / "a.txt").write_text(
        "# timestamp tx ty tz qx qy qz qw\n"
        "0.0 1 2 1.5 -0.5 0.5 -0.5 0.5\n"
        f"0.1 1 2.5 1.5 {-half} 0 0 {half}\n"
    )
    matrices, lines = (read_trajectory(tmp_path / f"a.{kind}", "a") for kind in ("json", "txt"))
    np.testing.assert_allclose(lines.camera_to_world, matrices.camera_to_world, atol=1e-12)
    np.testing.assert_array_equal(matrices.camera_to_world, [first, then])


@pytest.mark.parametrize(
    ("name", "text", "words"),
    [
        ("a.txt", "0 1 2 3 0 0 0\n", "line 1: expected timestamp"),
        ("a.txt", "0 1 2 3 0 0 0 1\n0 1 2 3 0 0 0 nan\n", "line 2"),
        ("a.txt", "0 1 2 3 0 0 0 2\n", "length is 2"),
        ("a.txt", "0 1 2 3 0 0 0 1\n", "1 frames"),
        ("a.json", '{"camera_to_world": [[[1]], [[1]]]}', "frame 0: must be 4x4"),
        ("a.json", '{"poses": []}', "unknown key"),
        ("a.json", "{", "a.json"),
        ("a.csv", "", "a trajectory is a .json file"),
    ],
)
def test_a_wrong_file_is_refused_in_one_line(
    name: str, text: str, words: str, tmp_path: Path
) -> None:
    (tmp_path / name).write_text(text)
    with pytest.raises(InputError, match=words) as caught:
        read_trajectory(tmp_path / name, "a")
    assert "\n" not in str(caught.value)


def test_a_missing_file_is_named(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"none\.txt: no such file"):
        read_trajectory(tmp_path / "none.txt", "a")


@pytest.mark.usefixtures("variant")
def test_frames_that_collide_are_named_or_their_path_is_left_out(tmp_path: Path) -> None:
    """A path through a table, 1.2 to 2.2 m along x, in steps of 10 cm, and one above it."""
    write_room(tmp_path / "living")
    scene = open_scene(load_scene(tmp_path / "living"))

    def path(name: str, height: float) -> Trajectory:
        eyes = [(0.55 + 0.1 * number, 1.8, height) for number in range(20)]
        return Trajectory(name, tuple(as_matrix(look(eye, (1, 0, 0))) for eye in eyes))

    given = (path("path-00", 0.25), path("path-01", 1.0))
    files = {}
    for way in ("warn", "reject", "accept"):
        options = pbrs_cameras(views_per_room=1, collisions=way)  # type: ignore[arg-type]
        params = pbrs_params(image=ImageParams(32, 24), cameras=options)
        files[way] = make_cameras(scene, view_params(params), 0, given)
    frames = {way: Counter(v.trajectory for v in file.views) for way, file in files.items()}
    assert frames["warn"]["path-00"] == frames["accept"]["path-00"] == 20
    assert [frames[way]["path-01"] for way in files] == [20] * 3
    wrong = {6: THROUGH, **dict.fromkeys(range(7, 17), INSIDE), 17: TOO_CLOSE}
    expected = {str(frame): reason for frame, reason in wrong.items()}
    assert files["warn"].collisions == files["reject"].collisions == {"path-00": expected}
    assert not files["accept"].collisions and not files["warn"].stored_left_out
    reason = files["reject"].stored_left_out["path-00"]
    assert reason.startswith("12 of 20 frames collide; ") and f"{INSIDE}: 7-16" in reason
    assert frames["reject"]["path-00"] == 0
