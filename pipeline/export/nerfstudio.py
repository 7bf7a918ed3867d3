"""nerfstudio's and instant-ngp's `transforms.json`, a folder a scene.

Camera axes are OpenGL's: x right, y up, z backward. World: metres, Z up, as nerfstudio has it, too.
Pixel centres at +0.5. `images/` are tone-mapped PNG with one exposure a scene, or linear EXR;
`depths/` 16-bit PNG in millimetres along the optical axis (of fisheye views along the ray), 0: no
surface, or beyond 65.5 m;
`points.ply` starts Gaussian splats.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from pbrnet.pipeline.export.images import (
    Points,
    exposures,
    scene_points,
    write_depth,
    write_exr,
    write_picture,
)
from pbrnet.pipeline.export.parts import Advance, Format, Job, scene_parts
from pbrnet.pipeline.export.rows import ViewRow
from pbrnet.pipeline.frames import banded
from pbrnet.pipeline.images import tone_picture
from pbrnet.pipeline.views import opengl_pose
from pbrnet.scenes.errors import InputError
from pbrnet.scenes.files import write_json

_MILLIMETRES = 1000.0
_OWN = ("file_path", "depth_file_path", "transform_matrix")  # of each frame


def _write(job: Job, rows: Sequence[ViewRow], folder: Path, advance: Advance) -> None:
    for name in ("images", "depths"):
        (folder / name).mkdir()
    frames, depths, pictures = [], [], []
    found = zip(exposures(rows, job.options), job.rows.read(rows, ("color", "depth")), strict=True)
    for exposure, (row, content) in found:
        color, depth = content.images["color"], content.images["depth"]
        image = f"images/{row.view_id}.{job.options.images}"
        if job.options.images == "png":
            write_picture(folder / image, color, exposure)
        else:
            write_exr(folder / image, banded(color))
        write_depth(folder / "depths" / f"{row.view_id}.png", depth, _MILLIMETRES)
        frames.append(_frame(row, image, depth.shape))
        depths.append(depth.astype(np.float16))
        pictures.append(tone_picture(color, exposure))
        advance()
    write_ply(folder / "points.ply", scene_points(rows, depths, pictures, job.options.points))
    model = "OPENCV_FISHEYE" if rows[0].lens_kind == "fisheye" else "OPENCV"
    write_json(folder / "transforms.json", _transforms(frames, model))


def _frame(row: ViewRow, image: str, shape: tuple[int, ...]) -> dict[str, Any]:
    height, width = shape
    return {
        "file_path": image,
        "depth_file_path": f"depths/{row.view_id}.png",
        "transform_matrix": opengl_pose(row.pose).tolist(),
        "w": width,
        "h": height,
        "fl_x": row.intrinsics[0, 0],
        "fl_y": row.intrinsics[1, 1],
        "cx": row.intrinsics[0, 2],
        "cy": row.intrinsics[1, 2],
        **_distortion(row),
    }


def _distortion(row: ViewRow) -> dict[str, float]:
    """Return the coefficients by nerfstudio's names; raises `InputError` for rational ones."""
    values = row.values.get("distortion") or (0.0,) * 4
    if row.lens_kind == "fisheye":
        return dict(zip(("k1", "k2", "k3", "k4"), values, strict=True))
    if any(values[5:]):
        raise InputError(
            f"{row.name}: nerfstudio has no k4, k5, k6 of OpenCV's rational model; use colmap"
        )
    return dict(zip(("k1", "k2", "p1", "p2", "k3"), values[:5], strict=False))


def _transforms(frames: list[dict[str, Any]], model: str) -> dict[str, Any]:
    """Return the file's content; intrinsics that all frames share stand at its top."""
    names = [name for name in frames[0] if name not in _OWN]
    shared = {
        name: frames[0][name] for name in names if len({frame[name] for frame in frames}) == 1
    }
    if len(shared) == len(names):
        frames = [
            {key: value for key, value in frame.items() if key not in names} for frame in frames
        ]
    else:
        shared = {}
    return {
        "camera_model": model,
        **({"is_fisheye": True} if model == "OPENCV_FISHEYE" else {}),
        **shared,
        "depth_unit_scale_factor": 1 / _MILLIMETRES,
        "ply_file_path": "points.ply",
        "frames": frames,
    }


def write_ply(path: Path, points: Points) -> None:
    """Write a point cloud as binary PLY: x, y, z, red, green, blue."""
    places, bands = ("x", "y", "z"), ("red", "green", "blue")
    types = [*((name, "<f4") for name in places), *((name, "u1") for name in bands)]
    columns = [*points.positions.T, *points.colors.T]
    vertices = np.rec.fromarrays(columns, dtype=types)
    lines = [
        *("ply", "format binary_little_endian 1.0", f"element vertex {len(vertices)}"),
        *(f"property float {name}" for name in places),
        *(f"property uchar {name}" for name in bands),
        *("end_header", ""),
    ]
    path.write_bytes("\n".join(lines).encode("ascii") + vertices.tobytes())


FORMAT = Format(
    "nerfstudio",
    "nerfstudio and instant-ngp: transforms.json, images, depths, points",
    ("color", "depth"),
    partial(scene_parts, _write),
    uses=("images", "exposure", "points"),
    lenses=("distorted", "fisheye"),
)
