"""Pictures of a submission: files named by view, read into what their task compares.

A view's file is `SCENE--VIEW.exr` or `.png`, or the same name in a folder, `SCENE/VIEW.exr`.
"""

from __future__ import annotations

from pathlib import Path
from typing import Literal

import numpy as np

from pbrnet.pipeline.export.rows import ViewRow
from pbrnet.scenes.arrays import AnyArray, Float32Array
from pbrnet.scenes.color import decode_srgb
from pbrnet.scenes.errors import InputError
from pbrnet.scenes.files import read_csv, read_json
from pbrnet.scenes.image_files import UnreadableImage, exr_channels, open_image

Task = Literal["color", "albedo", "normal"]
SUFFIXES = (".exr", ".png")
MAX_VALUE = 1e12  # its square is finite in single precision
_BANDS = {
    "color": (("R", "G", "B"),),
    "albedo": (("R", "G", "B"), ("albedo.R", "albedo.G", "albedo.B")),
    "normal": (("X", "Y", "Z"), ("N.X", "N.Y", "N.Z"), ("R", "G", "B")),
}


def find_picture(folder: Path, row: ViewRow) -> Path | None:
    """Return the file of a view, EXR before PNG, or None."""
    for suffix in SUFFIXES:
        for name in (f"{row.scene_id}--{row.view_id}", f"{row.scene_id}/{row.view_id}"):
            path = folder / f"{name}{suffix}"
            if path.is_file():
                return path
    return None


def read_picture(path: Path, task: Task, size: tuple[int, int]) -> tuple[Float32Array, bool]:
    """Return a picture as float32 (H, W, 3), and whether it is linear.

    colour: linear radiance of an EXR, display values in [0, 1] of a PNG; albedo: linear; normal:
    vectors in camera axes x right, y down, z forward, not yet of unit length. A PNG of albedo is
    sRGB, one of normals has red right, green up, blue to the camera, each from -1 to 1.

    Raises `InputError` for damage, another size than `size` (width, height), NaN and infinity.
    """
    linear = path.suffix == ".exr"
    pixels = _read_exr(path, task, size) if linear else _read_png(path)
    if pixels.shape[1::-1] != size:
        found = " x ".join(map(str, pixels.shape[1::-1]))
        raise InputError(f"{path}: {found} pixels, the truth has {size[0]} x {size[1]}")
    if not (np.abs(pixels) <= MAX_VALUE).all():
        raise InputError(f"{path}: holds NaN, or values beyond {MAX_VALUE:g}")
    if not linear and task == "albedo":
        pixels = decode_srgb(pixels)
    if not linear and task == "normal":
        pixels = (2 * pixels - 1) * np.array([1, -1, -1], np.float32)
    return pixels.astype(np.float32), linear


def _read_exr(path: Path, task: Task, size: tuple[int, int]) -> AnyArray:
    try:
        planes = exr_channels(path, 4 * size[0] * size[1])
    except UnreadableImage as error:
        raise InputError(f"{path}: not a readable EXR ({error})") from None
    for bands in _BANDS[task]:
        if set(bands) <= planes.keys():
            return np.stack([planes[band].astype(np.float32) for band in bands], axis=-1)
    wanted = " or ".join(", ".join(bands) for bands in _BANDS[task])
    raise InputError(f"{path}: no channels {wanted}; it has {', '.join(sorted(planes))[:200]}")


def _read_png(path: Path) -> AnyArray:
    try:
        with open_image(path) as image:
            pixels = np.asarray(image.convert("RGB"))
    except (UnreadableImage, OSError) as error:
        raise InputError(f"{path}: {error}") from None
    return pixels.astype(np.float32) / 255


def read_seconds(folder: Path) -> dict[str, float] | float | None:
    """Return a submission's CPU seconds: by view (`SCENE--VIEW`), one for all, or None.

    From `seconds.json`, a number or an object by view, or `seconds.csv` with the columns
    `scene_id`, `view_id`, `seconds`. Raises `InputError` for anything else.
    """
    table = folder / "seconds.csv"
    found: object = None
    if (folder / "seconds.json").is_file():
        found = read_json(folder / "seconds.json")
    elif table.is_file():
        lines = read_csv(table)
        try:
            found = {f"{one['scene_id']}--{one['view_id']}": float(one["seconds"]) for one in lines}
        except (KeyError, TypeError, ValueError):
            raise InputError(f"{table}: expected the columns scene_id, view_id, seconds") from None
    else:
        return None
    values = list(found.values()) if isinstance(found, dict) else [found]
    numbers = [one for one in values if isinstance(one, (int, float)) and not isinstance(one, bool)]
    if len(numbers) != len(values) or not all(0 <= number < 1e9 for number in numbers):
        raise InputError(
            f"{folder}: seconds must be numbers from 0 on, one for all or one per view"
        )
    if isinstance(found, dict):
        return {str(name).replace("/", "--"): float(value) for name, value in found.items()}
    return float(numbers[0])
