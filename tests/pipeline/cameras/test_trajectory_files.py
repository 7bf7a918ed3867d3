"""Trajectories from files: both formats say the same, and faults are named with their place."""

from __future__ import annotations

import json
import math
from pathlib import Path

import numpy as np
import pytest

from pipeline.cameras.trajectory_files import read_trajectory
from scenes.errors import InputError


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
