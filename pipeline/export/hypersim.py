"""Hypersim's layout of HDF5 files and CSVs, so that loaders written for that dataset read ours.

A scene is a folder `ai_VVV_NNN`, a trajectory or the single views of a scene a camera `cam_XX`, a
view a frame; `scenes.csv` says which. Axes: world Z up in metres (`meters_per_asset_unit` 1),
camera x right, y up, z backward. `depth_meters` is the distance along the ray, not z-depth.
Images are half floats as Hypersim's are; radiance is in a unit of the scene, a power of two, that
half floats hold well: `radiance_scale` in `metadata_scene.csv` restores the renderer's.
`color = diffuse_reflectance x diffuse_illumination + residual`.
"""

from __future__ import annotations

import io
import json
import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

from pbrnet.pipeline.channels import HALF_MAX
from pbrnet.pipeline.export.images import camera_rays
from pbrnet.pipeline.export.parts import Advance, Format, Job, Part, hdf5_file, library
from pbrnet.pipeline.export.rows import Content, ViewRow
from pbrnet.pipeline.images import depth_picture, normal_picture, png_bytes
from pbrnet.pipeline.tonemap import to_bytes
from pbrnet.pipeline.views import opengl_pose
from pbrnet.scenes.arrays import AnyArray, Float64Array
from pbrnet.scenes.errors import InputError
from pbrnet.scenes.files import write_csv

LIGHT = ("irradiance",)
LABELS = ("instance", "nyu40", "instances")
_FIRST_VOLUME = 900  # Hypersim's own volumes are below 100
_SCENES_A_VOLUME = 999
_NEAR, _FAR = 1.0, 1000.0  # of the projection matrix, as in Hypersim's file
_FLIP = np.array([1.0, -1.0, -1.0])  # camera axes from ours to Hypersim's
_FILES = (  # of all scenes
    *("metadata_camera_parameters.csv", "metadata_images.csv"),
    *("metadata_images_split_scene_v1.csv", "scenes.csv"),
)
_SPLITS = {"train": "train", "validation": "val", "test": "test"}


@dataclass(frozen=True)
class HypersimScene:
    """A scene under Hypersim's name; `cameras` are the rows of each camera, all with one K."""

    name: str
    cameras: dict[str, list[ViewRow]]

    @property
    def rows(self) -> list[ViewRow]:
        """All rows of the scene, camera by camera."""
        return [row for rows in self.cameras.values() for row in rows]


def hypersim_scenes(rows: Sequence[ViewRow]) -> list[HypersimScene]:
    """Return the scenes in file order; views of a scene with another K are a scene of their own.

    Hypersim has one projection matrix a scene.
    """
    groups: dict[tuple[Any, ...], list[ViewRow]] = {}
    for row in rows:
        groups.setdefault((row.scene_id, *row.intrinsics.ravel()), []).append(row)
    found = []
    for number, group in enumerate(groups.values()):
        volume, scene = divmod(number, _SCENES_A_VOLUME)
        cameras: dict[str, list[ViewRow]] = {}
        for row in group:
            cameras.setdefault(row.values.get("trajectory") or "", []).append(row)
        for trajectory, own in cameras.items():
            if trajectory:
                own.sort(key=lambda row: row.values["frame"])
        named = {f"cam_{index:02d}": own for index, (_, own) in enumerate(sorted(cameras.items()))}
        found.append(HypersimScene(f"ai_{_FIRST_VOLUME + volume:03d}_{scene + 1:03d}", named))
    return found


def projection(intrinsics: Float64Array, width: int, height: int) -> Float64Array:
    """Return OpenGL's projection matrix (4, 4), y up, from `K` in pixels."""
    k = intrinsics
    depth = _FAR - _NEAR
    return np.array(
        [
            [2 * k[0, 0] / width, 0, 1 - 2 * k[0, 2] / width, 0],
            [0, 2 * k[1, 1] / height, 2 * k[1, 2] / height - 1, 0],
            [0, 0, -(_FAR + _NEAR) / depth, -2 * _FAR * _NEAR / depth],
            [0, 0, -1, 0],
        ]
    )


def camera_from_uv(intrinsics: Float64Array, width: int, height: int) -> Float64Array:
    """Return the matrix (3, 3) from (u, v, 1), in [-1, 1], v up, to a ray with z = -1."""
    k = intrinsics
    return np.array(
        [
            [width / (2 * k[0, 0]), 0, (width / 2 - k[0, 2]) / k[0, 0]],
            [0, height / (2 * k[1, 1]), (k[1, 2] - height / 2) / k[1, 1]],
            [0, 0, -1],
        ]
    )


def _check(job: Job) -> None:
    library("h5py", "an export to Hypersim's layout")
    if not job.options.partial:
        try:
            job.rows.require((*LIGHT, *LABELS), "hypersim")
        except InputError as error:
            raise InputError(f"{error}; or leave those files out with --partial") from None


def _parts(job: Job) -> Sequence[Part]:
    return [
        Part(scene.name, len(scene.rows), partial(_write, job, scene))
        for scene in hypersim_scenes(job.rows.rows)
    ]


def _write(job: Job, scene: HypersimScene, folder: Path, advance: Advance) -> None:
    detail, images = folder / "_detail", folder / "images"
    (detail / "mesh").mkdir(parents=True)
    unit = _unit(scene.rows)
    optional = ("irradiance", "instance", "nyu40", "normal_bump")
    columns = (*FORMAT.needs, *(name for name in optional if name in job.rows.columns))
    values = tuple(name for name in ("instances",) if name in job.rows.columns)
    instances: dict[int, dict[str, Any]] = {}
    for camera, rows in scene.cameras.items():
        for kind in ("final", "geometry"):
            (images / f"scene_{camera}_{kind}_hdf5").mkdir(parents=True)
            (images / f"scene_{camera}_{kind}_preview").mkdir()
        for frame, (row, content) in enumerate(job.rows.read(rows, columns, values)):
            name = f"frame.{frame:04d}"
            final = _final(content, unit)
            geometry = _geometry(row, content)
            for kind, arrays in (("final", final), ("geometry", geometry)):
                place = images / f"scene_{camera}_{kind}_hdf5"
                for part, array in arrays.items():
                    write_hdf5(place / f"{name}.{part}.hdf5", array)
            preview = images / f"scene_{camera}_final_preview" / f"{name}.tonemap.jpg"
            preview.write_bytes(_preview(final["color"], geometry["render_entity_id"] >= 0))
            seen = content.images["valid"]
            drawn = {
                "depth_meters": depth_picture(content.images["depth"], seen),
                "normal_cam": normal_picture(content.images["normal"], seen),
            }
            for part, picture in drawn.items():
                preview = images / f"scene_{camera}_geometry_preview" / f"{name}.{part}.png"
                preview.write_bytes(png_bytes(picture))
            for instance in json.loads(content.values.get("instances") or "[]"):
                instances[instance["instance"]] = instance
            advance()
        _write_trajectory(detail / camera, rows)
    _write_boxes(detail / "mesh", instances)
    write_csv(detail / "metadata_cameras.csv", ("camera_name",), [(c,) for c in scene.cameras])
    facts = [("meters_per_asset_unit", 1.0), ("radiance_scale", unit)]
    write_csv(detail / "metadata_scene.csv", ("parameter_name", "parameter_value"), facts)


def _unit(rows: Sequence[ViewRow]) -> float:
    """Return the unit of a scene's radiance: the mean of its rows', in stops."""
    return 2.0 ** round(float(np.mean([math.log2(row.radiance_scale) for row in rows])))


def _final(content: Content, unit: float) -> dict[str, AnyArray]:
    """Return colour and what it is made of; the residual is of the halves that are written."""
    color = _half(content.images["color"] / unit)
    found = {"color": color, "diffuse_reflectance": _half(content.images["reflectance"])}
    if "irradiance" in content.images:
        found["diffuse_illumination"] = _half(content.images["irradiance"] / unit)
        product = found["diffuse_reflectance"].astype(np.float32) * found["diffuse_illumination"]
        found["residual"] = _half(color.astype(np.float32) - product)
    return found


def _geometry(row: ViewRow, content: Content) -> dict[str, AnyArray]:
    images = content.images
    depth = images["depth"].astype(np.float64)
    height, width = depth.shape
    seen = (images["valid"] > 0) & (depth > 0)
    rays = camera_rays(row.intrinsics, width, height)
    away = np.where(seen, depth * np.linalg.norm(rays, axis=-1), np.nan)
    place = (rays * depth[..., None]) @ row.pose[:3, :3].T + row.pose[:3, 3]
    place[~seen] = np.nan
    instance = images.get("instance")
    entity = np.where(seen, 1, -1) if instance is None else np.where(instance > 0, instance, -1)
    found = {
        "depth_meters": _half(away),
        "position": _half(place),
        "render_entity_id": entity.astype(np.int16),
        **_normals("normal", images["normal"], seen, row),
    }
    if instance is not None:
        found["semantic_instance"] = entity.astype(np.int16)
        found["semantic"] = np.where(images["nyu40"] > 0, images["nyu40"], -1).astype(np.int16)
    if "normal_bump" in images:
        found |= _normals("normal_bump", images["normal_bump"], seen, row)
    return found


def _normals(name: str, normal: AnyArray, seen: AnyArray, row: ViewRow) -> dict[str, AnyArray]:
    """Return normals in camera and world axes, NaN where there is no surface."""
    own = np.where(seen[..., None], normal.astype(np.float64), np.nan)
    return {f"{name}_cam": _half(own * _FLIP), f"{name}_world": _half(own @ row.pose[:3, :3].T)}


def _half(values: AnyArray) -> AnyArray:
    return np.clip(values, -HALF_MAX, HALF_MAX).astype(np.float16)


def write_hdf5(path: Path, array: AnyArray) -> None:
    """Write an array as the dataset `dataset`, compressed if it is an image."""
    packed = {"compression": "gzip", "compression_opts": 4} if array.ndim >= 2 else {}
    with hdf5_file(path) as file:
        file.create_dataset("dataset", data=array, track_times=False, **packed)


def _preview(color: AnyArray, seen: AnyArray) -> bytes:
    """Return a JPEG tone-mapped as Hypersim's previews: 90th percentile to 0.8, gamma 2.2."""
    linear = color.astype(np.float64)
    grey = linear @ np.array([0.3, 0.59, 0.11])
    bright = float(np.percentile(grey[seen], 90)) if seen.any() else 0.0
    scale = 0.8**2.2 / bright if bright > 0 else 1.0
    picture = to_bytes(np.clip(np.maximum(scale * linear, 0) ** (1 / 2.2), 0, 1))
    stream = io.BytesIO()
    Image.fromarray(picture).save(stream, "JPEG", quality=90)
    return stream.getvalue()


def _write_trajectory(folder: Path, rows: Sequence[ViewRow]) -> None:
    folder.mkdir()
    poses = np.stack([opengl_pose(row.pose) for row in rows])
    write_hdf5(folder / "camera_keyframe_frame_indices.hdf5", np.arange(len(rows)))
    write_hdf5(folder / "camera_keyframe_positions.hdf5", poses[:, :3, 3])
    write_hdf5(folder / "camera_keyframe_orientations.hdf5", poses[:, :3, :3])


def _write_boxes(folder: Path, instances: dict[int, dict[str, Any]]) -> None:
    """Write the boxes of all instances that are seen, by instance id; others are infinite."""
    if not instances:
        return
    count = max(instances) + 1
    boxes = {
        "extents": np.full((count, 3), np.inf),
        "orientations": np.full((count, 3, 3), np.inf),
        "positions": np.full((count, 3), np.inf),
    }
    for number, instance in instances.items():
        boxes["extents"][number] = 2 * np.array(instance["half_sizes"])
        boxes["orientations"][number] = np.array(instance["axes"]).T  # rows are the box's axes
        boxes["positions"][number] = instance["centre"]
    for name, array in boxes.items():
        stem = "metadata_semantic_instance_bounding_box_object_aligned_2d"
        write_hdf5(folder / f"{stem}_{name}.hdf5", array)


def _finish(job: Job) -> None:
    cameras, frames, names = [], [], []
    sizes = _sizes(job)
    for scene in hypersim_scenes(job.rows.rows):
        first = scene.rows[0]
        width, height = sizes
        k = first.intrinsics
        fov = 2 * math.atan(width / (2 * k[0, 0]))
        matrices = (camera_from_uv(k, width, height), projection(k, width, height))
        numbers = [value for matrix in matrices for value in matrix.ravel()]
        cameras.append((scene.name, float(height), float(width), 1.0, False, fov, *numbers))
        for camera, rows in scene.cameras.items():
            for frame, row in enumerate(rows):
                frames.append((scene.name, camera, frame, True, "", _SPLITS[row.split]))
                names.append((scene.name, camera, frame, row.scene_id, row.view_id))
    uv = [f"M_cam_from_uv_{i}{j}" for i in range(3) for j in range(3)]
    proj = [f"M_proj_{i}{j}" for i in range(4) for j in range(4)]
    header = (
        *("scene_name", "settings_output_img_height", "settings_output_img_width"),
        *("settings_units_info_meters_scale", "use_camera_physical", "settings_camera_fov"),
        *(*uv, *proj),
    )
    of_cameras, of_frames, of_splits, of_names = (job.out / name for name in _FILES)
    write_csv(of_cameras, header, cameras)
    header = ("scene_name", "camera_name", "frame_id", "included_in_public_release")
    header += ("exclude_reason",)
    write_csv(of_frames, header, [frame[:5] for frame in frames])
    header += ("split_partition_name",)
    write_csv(of_splits, header, frames)
    header = ("scene_name", "camera_name", "frame_id", "scene_id", "view_id")
    write_csv(of_names, header, names)


def _sizes(job: Job) -> tuple[int, int]:
    """Return width and height of the dataset's images."""
    _, content = next(iter(job.rows.read(job.rows.rows[:1], ("depth",))))
    height, width = content.images["depth"].shape
    return width, height


FORMAT = Format(
    "hypersim",
    "Hypersim's layout: HDF5 images, camera files, CSVs",
    ("color", "reflectance", "depth", "normal", "valid"),
    _parts,
    _finish,
    _check,
    _FILES,
    uses=("partial",),
)
