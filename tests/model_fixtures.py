"""A tiny analytic world for the networks' tests: a box room with one bulb, packed as Parquet."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from pipeline.dataset.columns import arrow_schema, dataset_columns
from pipeline.params import ToneParams
from pipeline.tonemap import exposure_of

ROOM = np.array([4.0, 5.0, 2.6])  # metres; one corner at the origin, Z up


def box_view(seed: int, width: int = 40, height: int = 30, panorama: int = 32) -> dict[str, Any]:
    """What the dataset holds of one view: walls lit by a bulb, plus a little even light."""
    rng = np.random.default_rng(seed)
    eye = rng.uniform(0.25, 0.75, 3) * ROOM
    lamp = rng.uniform(0.2, 0.8, 3) * ROOM
    yaw = rng.uniform(0, 2 * np.pi)
    forward = np.array([np.cos(yaw), np.sin(yaw), -0.2])
    forward /= np.linalg.norm(forward)
    right = np.cross(forward, [0, 0, 1.0])
    right /= np.linalg.norm(right)
    turn = np.stack([right, np.cross(forward, right), forward], axis=1)  # camera to world

    focal = 0.5 * width / np.tan(0.5534)
    column, row = np.meshgrid(np.arange(width) + 0.5, np.arange(height) + 0.5)
    rays = np.stack(
        [(column - width / 2) / focal, (row - height / 2) / focal, np.ones_like(column)], axis=-1
    )
    direction = rays @ turn.T
    with np.errstate(divide="ignore"):
        far = np.where(direction > 0, (ROOM - eye) / direction, -eye / direction)
    axis = far.argmin(axis=-1)
    depth = far.min(axis=-1)
    point = eye + depth[..., None] * direction
    normal = -np.sign(direction) * np.eye(3)[axis]
    palette = np.random.default_rng(7).uniform(0.1, 0.9, (3, 2, 3))
    checker = (np.floor(point).sum(axis=-1) % 2).astype(int)
    reflectance = palette[axis, checker]

    to_lamp = lamp - point
    metres = np.linalg.norm(to_lamp, axis=-1)
    cosine = np.maximum((normal * to_lamp).sum(axis=-1) / metres, 0)
    irradiance = 10 * cosine / metres**2 + 0.5
    shading = np.repeat((0.5 * irradiance / np.pi)[..., None], 3, axis=-1)

    azimuth = ((np.arange(panorama) + 0.5) / panorama * 2 - 1) * np.pi
    elevation = (0.5 - (np.arange(panorama // 2) + 0.5) / (panorama // 2)) * np.pi
    azimuth, elevation = np.meshgrid(azimuth, elevation)
    sphere = np.stack(
        [
            np.cos(elevation) * np.sin(azimuth),
            -np.sin(elevation),
            np.cos(elevation) * np.cos(azimuth),
        ],
        axis=-1,
    )
    bulb = (lamp - eye) @ turn
    lit = sphere @ (bulb / np.linalg.norm(bulb)) > np.cos(0.2)
    return {
        "depth": depth.astype(np.float32),
        "normal": (normal @ turn).astype(np.float16),
        "reflectance": reflectance.astype(np.float16),
        "valid": np.ones((height, width), np.uint8),
        "intensity": np.where(lit, 50.0, 0.0).astype(np.float32),
        "distance": np.where(lit, np.linalg.norm(bulb), 0.0).astype(np.float32),
        "tint": np.repeat(lit[..., None], 3, axis=-1).astype(np.float16),
        "K": np.array([focal, 0, width / 2, 0, focal, height / 2, 0, 0, 1]),
        "shading": shading.astype(np.float16),
        "color": (2 * reflectance * shading).astype(np.float16),
    }


def grained(images: dict[str, Any], seed: int) -> dict[str, Any]:
    """What a few paths a pixel might make of colour and shading, with the same luck in both; and
    a denoiser that is good at its trade but dims all it touches."""
    rng = np.random.default_rng(seed)
    luck = rng.exponential(1, (*images["depth"].shape, 1))
    return {
        "noisy_color": (luck * images["color"]).astype(np.float16),
        "noisy_shading": (luck * images["shading"]).astype(np.float16),
        "denoised_color": (0.8 * luck**0.1 * images["color"]).astype(np.float16),
        "denoised_shading": (0.8 * luck**0.1 * images["shading"]).astype(np.float16),
        "noisy_spp": 2,
    }


def box_rows(
    scenes: Sequence[str], views: int, split: str, noisy: bool = False, **size: int
) -> list[dict[str, Any]]:
    """Complete rows: `views` views of each of these scenes, with `noisy` also samples."""
    rows = []
    for scene in scenes:
        for index in range(views):
            seed = sum(scene.encode()) * 100 + index
            images = box_view(seed, **size)
            samples = grained(images, seed) if noisy else {}
            tone = ToneParams()
            shading = exposure_of(images["shading"].astype(np.float32), tone)
            color = exposure_of(images["color"].astype(np.float32), tone)
            rows.append(
                {
                    **images,
                    **samples,
                    "scene_id": scene,
                    "view_id": f"v{index:03d}",
                    "split": split,
                    "exposure_shading": shading.scale,
                    "white_shading": shading.white,
                    "exposure_color": color.scale,
                    "white_color": color.white,
                    "licence": "MIT",
                    "attribution": "a test",
                }
            )
    return rows


def write_shard(path: Path, rows: Sequence[dict[str, Any]], row_group: int = 4) -> None:
    """Pack rows by the dataset's own schema; columns that no row has are null."""
    height, width = rows[0]["depth"].shape
    panorama = rows[0]["intensity"].shape
    sizes = (width, height), (panorama[1], panorama[0])
    schema = arrow_schema(dataset_columns(*sizes, noisy="noisy_color" in rows[0]))
    columns = []
    for field in schema:
        if field.name not in rows[0]:
            columns.append(pa.nulls(len(rows), field.type))
        elif isinstance(rows[0][field.name], np.ndarray):
            flat = np.concatenate([row[field.name].ravel() for row in rows])
            values = pa.array(flat, type=field.type.value_type)
            columns.append(pa.FixedSizeListArray.from_arrays(values, field.type.list_size))
        else:
            columns.append(pa.array([row[field.name] for row in rows], type=field.type))
    path.parent.mkdir(parents=True, exist_ok=True)
    table = pa.Table.from_arrays(columns, schema=schema)
    pq.write_table(table, path, row_group_size=row_group, compression="zstd")


def box_dataset(
    folder: Path,
    train: int = 8,
    validation: int = 2,
    test: int = 4,
    noisy: bool = False,
    **size: int,
) -> Path:
    """A data folder with `dataset/` of box rooms, two views a scene; returns the data folder."""
    for split, count in (("train", train), ("validation", validation), ("test", test)):
        if count:
            scenes = [f"{split}-room-{index}" for index in range(count // 2)]
            rows = box_rows(scenes, 2, split, noisy, **size)
            write_shard(folder / "dataset" / f"{split}-00000-of-00001.parquet", rows)
    return folder
