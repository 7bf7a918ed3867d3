"""TUM RGB-D sequences, a folder a trajectory: lists of images, 16-bit depth, poses.

`groundtruth.txt` has camera to world as `timestamp tx ty tz qx qy qz qw`, camera axes x right, y
down, z forward. Depth is along the optical axis, 5000 units a metre, 0: no surface, or beyond
13.1 m. `calibration.txt` holds fx fy cx cy with pixel centres at whole numbers, as TUM has them.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from pbrnet.pipeline.export.images import exposures, write_depth, write_picture
from pbrnet.pipeline.export.parts import Advance, Format, Job, Part
from pbrnet.pipeline.export.rows import ViewRow
from pbrnet.scenes.errors import InputError

UNITS_A_METRE = 5000.0


def _trajectories(job: Job) -> dict[str, list[ViewRow]]:
    """Return the rows of each trajectory in the order of their frames; by scene and name."""
    found: dict[str, list[ViewRow]] = {}
    for row in job.rows.rows:
        if row.values.get("trajectory"):
            found.setdefault(f"{row.scene_id}/{row.values['trajectory']}", []).append(row)
    return {name: sorted(rows, key=lambda row: row.values["frame"]) for name, rows in found.items()}


def _check(job: Job) -> None:
    if not _trajectories(job):
        raise InputError(
            f"{job.rows.folder}: tum requires trajectories, but no view is part of one; set "
            "cameras.walks in params.yaml, then run: dvc repro dataset"
        )


def _parts(job: Job) -> Sequence[Part]:
    return [
        Part(name, len(rows), partial(_write, job, rows))
        for name, rows in _trajectories(job).items()
    ]


def _write(job: Job, rows: Sequence[ViewRow], folder: Path, advance: Advance) -> None:
    for name in ("rgb", "depth"):
        (folder / name).mkdir()
    lists: dict[str, list[str]] = {"rgb": [], "depth": [], "groundtruth": []}
    found = zip(exposures(rows, job.options), job.rows.read(rows, ("color", "depth")), strict=True)
    for exposure, (row, content) in found:
        time = f"{row.values['frame'] / job.options.fps:.6f}"
        write_picture(folder / "rgb" / f"{time}.png", content.images["color"], exposure)
        write_depth(folder / "depth" / f"{time}.png", content.images["depth"], UNITS_A_METRE)
        for name in ("rgb", "depth"):
            lists[name].append(f"{time} {name}/{time}.png")
        pose = (*row.pose[:3, 3], *Rotation.from_matrix(row.pose[:3, :3]).as_quat())
        lists["groundtruth"].append(" ".join([time, *(f"{value:.9f}" for value in pose)]))
        advance()
    headers = {
        "rgb": "color images",
        "depth": "depth maps, 5000 units a metre",
        "groundtruth": "timestamp tx ty tz qx qy qz qw",
    }
    for name, lines in lists.items():
        text = "\n".join([f"# {headers[name]}", *lines, ""])
        (folder / f"{name}.txt").write_text(text, encoding="ascii")
    k = rows[0].intrinsics - np.array([[0, 0, 0.5], [0, 0, 0.5], [0, 0, 0]])
    camera = " ".join(f"{value:.9g}" for value in (k[0, 0], k[1, 1], k[0, 2], k[1, 2]))
    (folder / "calibration.txt").write_text(f"# fx fy cx cy\n{camera}\n", encoding="ascii")


FORMAT = Format(
    "tum",
    "TUM RGB-D: one sequence per trajectory",
    ("color", "depth", "trajectory", "frame"),
    _parts,
    check=_check,
    uses=("exposure", "fps"),
)
