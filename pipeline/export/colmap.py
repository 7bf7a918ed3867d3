"""COLMAP model as text, a folder a scene: cameras, images, points3D from depth.

COLMAP's cameras have our axes (x right, y down, z forward) and our pixel centres (+0.5); poses are
world to camera. `images/` are tone-mapped PNG with one exposure a scene. Points are on surfaces and
exact, so their reprojection error is 0. Lenses with distortion are `OPENCV`, `FULL_OPENCV` or
`OPENCV_FISHEYE`, and in files for OpenCV.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from pbrnet.pipeline.export.images import Points, exposures, scene_points, write_picture
from pbrnet.pipeline.export.parts import Advance, Format, Job, scene_parts
from pbrnet.pipeline.export.rows import ViewRow
from pbrnet.pipeline.images import tone_picture
from pbrnet.pipeline.lenses.calibration import opencv_text
from pbrnet.scenes.arrays import AnyArray, Int64Array
from pbrnet.scenes.files import write_text


def _write(job: Job, rows: Sequence[ViewRow], folder: Path, advance: Advance) -> None:
    model = folder / "sparse" / "0"
    model.mkdir(parents=True)
    (folder / "images").mkdir()
    depths, pictures = [], []
    found = zip(exposures(rows, job.options), job.rows.read(rows, ("color", "depth")), strict=True)
    for exposure, (row, content) in found:
        color = content.images["color"]
        write_picture(folder / "images" / f"{row.view_id}.png", color, exposure)
        depths.append(content.images["depth"].astype(np.float16))
        pictures.append(tone_picture(color, exposure))
        advance()
    points = scene_points(rows, depths, pictures, job.options.points)
    cameras = _cameras(rows, [depth.shape for depth in depths])
    (model / "cameras.txt").write_text(
        "".join(f"{number} {text}\n" for text, number in cameras.items())
    )
    _write_opencv(folder, rows, depths, cameras)
    numbers = [cameras[_camera(row, depth.shape)] for row, depth in zip(rows, depths, strict=True)]
    places = _write_images(model / "images.txt", rows, numbers, points)
    _write_points(model / "points3D.txt", points, places)


def _camera(row: ViewRow, shape: tuple[int, ...]) -> str:
    """Return model, width, height and the model's parameters as COLMAP writes them."""
    k, distortion = row.intrinsics, tuple(row.values.get("distortion") or ())
    model = {"pinhole": "PINHOLE", "fisheye": "OPENCV_FISHEYE"}.get(row.lens_kind, "OPENCV")
    if model == "PINHOLE":
        distortion = ()
    elif len(distortion) > 4:  # with k3, k4, k5, k6
        model, distortion = "FULL_OPENCV", (*distortion, 0.0, 0.0, 0.0)[:8]
    numbers = (k[0, 0], k[1, 1], k[0, 2], k[1, 2], *distortion)
    return " ".join([model, f"{shape[1]} {shape[0]}", *(f"{value:.12g}" for value in numbers)])


def _write_opencv(
    folder: Path, rows: Sequence[ViewRow], depths: Sequence[AnyArray], cameras: dict[str, int]
) -> None:
    """Write each camera with distortion for OpenCV, too: `opencv-1.yaml` is camera 1."""
    for row, depth in zip(rows, depths, strict=True):
        if row.lens_kind != "pinhole":
            number = cameras[_camera(row, depth.shape)]
            lens = row.lens(depth.shape[1], depth.shape[0])
            write_text(folder / f"opencv-{number}.yaml", opencv_text(lens))


def _cameras(rows: Sequence[ViewRow], shapes: Sequence[tuple[int, ...]]) -> dict[str, int]:
    """Return the number of each distinct camera, from 1."""
    texts = dict.fromkeys(_camera(row, shape) for row, shape in zip(rows, shapes, strict=True))
    return {text: number for number, text in enumerate(texts, 1)}


def _write_images(
    path: Path, rows: Sequence[ViewRow], cameras: Sequence[int], points: Points
) -> Int64Array:
    """Write `images.txt`; returns each sighting's place in its image's list, (M,)."""
    places = np.zeros(len(points.point), dtype=np.int64)
    with path.open("w", encoding="ascii") as stream:
        for index, (row, camera) in enumerate(zip(rows, cameras, strict=True)):
            turn = row.pose[:3, :3].T
            shift = -turn @ row.pose[:3, 3]
            x, y, z, w = Rotation.from_matrix(turn).as_quat()
            pose = " ".join(f"{value:.15g}" for value in (w, x, y, z, *shift))
            own = np.flatnonzero(points.view == index)
            places[own] = np.arange(len(own))
            sightings = zip(points.pixel[own], points.point[own], strict=True)
            seen = " ".join(f"{u:.6f} {v:.6f} {point + 1}" for (u, v), point in sightings)
            stream.write(f"{index + 1} {pose} {camera} {row.view_id}.png\n{seen}\n")
    return places


def _write_points(path: Path, points: Points, places: Int64Array) -> None:
    order = np.argsort(points.point, kind="stable")
    starts = np.searchsorted(points.point[order], np.arange(len(points.positions) + 1))
    with path.open("w", encoding="ascii") as stream:
        for number, (place, color) in enumerate(zip(points.positions, points.colors, strict=True)):
            sightings = order[starts[number] : starts[number + 1]]
            track = " ".join(f"{points.view[one] + 1} {places[one]}" for one in sightings)
            where = " ".join(f"{value:.9g}" for value in place)
            shade = " ".join(map(str, color))
            stream.write(f"{number + 1} {where} {shade} 0 {track}\n")


FORMAT = Format(
    "colmap",
    "COLMAP text model: cameras, images, points from depth",
    ("color", "depth"),
    partial(scene_parts, _write),
    uses=("exposure", "points"),
    lenses=("distorted", "fisheye"),
)
