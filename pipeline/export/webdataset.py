"""WebDataset: tars of OpenEXR files, the images of a view together under one key.

`SPLIT-000000.tar` holds for each view `KEY.COLUMN.exr`, every image column of the dataset in the
renderer's unit, and `KEY.json` with ids, camera and exposure. Tars are without times and
owners: equal rows give equal bytes.
"""

from __future__ import annotations

import io
import json
import tarfile
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from pbrnet.pipeline.channels import light_bands
from pbrnet.pipeline.export.images import write_exr
from pbrnet.pipeline.export.parts import Advance, Format, Job, Part
from pbrnet.pipeline.export.rows import ANY_LENS, ViewRow
from pbrnet.pipeline.frames import banded
from pbrnet.scenes.arrays import AnyArray
from pbrnet.scenes.errors import InputError
from pbrnet.scenes.files import temporary_folder

TAR = tarfile.PAX_FORMAT  # USTAR where names have at most 100 bytes


def key_of(row: ViewRow) -> str:
    """Return the view's key, without dots: WebDataset splits names at the first dot."""
    return f"{row.scene_id}--{row.view_id}".replace(".", "_")


def _check(job: Job) -> None:
    keys: dict[str, str] = {}
    for row in job.rows.rows:
        other = keys.setdefault(key_of(row), row.name)
        if other != row.name:
            raise InputError(
                f"{job.rows.folder}: the views {other} and {row.name} would have the same key, "
                f"{key_of(row)}; export them separately with --scene"
            )


def _parts(job: Job) -> Sequence[Part]:
    parts = []
    for split in dict.fromkeys(row.split for row in job.rows.rows):
        rows = [row for row in job.rows.rows if row.split == split]
        size = job.options.tar_views
        for number, first in enumerate(range(0, len(rows), size)):
            chunk = rows[first : first + size]
            write = partial(_write, job, chunk)
            parts.append(Part(f"{split}-{number:06d}.tar", len(chunk), write, is_folder=False))
    return parts


def _write(job: Job, rows: Sequence[ViewRow], path: Path, advance: Advance) -> None:
    values = [
        name
        for name in ("room_type", "lighting", "light_names", "instances", "licence", "attribution")
        if name in job.rows.columns
    ]
    images = job.rows.image_names()
    with temporary_folder() as folder, tarfile.open(path, "w", format=TAR) as tar:
        for row, content in job.rows.read(rows, images, values):
            key = key_of(row)
            _add(tar, f"{key}.json", json.dumps(_facts(row, content.values), sort_keys=True))
            for name in images:
                file = folder / "image.exr"
                write_exr(file, planes_of(name, content.images[name]))
                _add(tar, f"{key}.{name}.exr", file.read_bytes())
            advance()


def planes_of(name: str, image: AnyArray) -> dict[str, AnyArray]:
    """Return the channels of an image column as EXR names and types them."""
    if name == "lights":
        return {
            band: plane
            for number, group in enumerate(image)
            for band, plane in banded(group, light_bands(number)).items()
        }
    if image.dtype.kind in "iu":
        return {"Y": image.astype(np.uint32)}
    if image.ndim == 2:
        return {"Z" if "depth" in name or name == "distance" else "Y": image}
    if image.shape[2] == 2:
        return {"X": image[..., 0], "Y": image[..., 1]}
    if "normal" in name:
        return banded(image, "XYZ")
    return banded(image)


def _facts(row: ViewRow, values: dict[str, Any]) -> dict[str, Any]:
    facts = {**row.values, **values}
    if facts.get("instances"):
        facts["instances"] = json.loads(facts["instances"])
    own = row.color_exposure
    exposed = {} if own is None else {"exposure_color": own.scale, "white_color": own.white}
    return {
        **facts,
        "scene_id": row.scene_id,
        "view_id": row.view_id,
        "split": row.split,
        "K": None if row.lens_kind == "equirectangular" else row.intrinsics.tolist(),
        "camera_to_world": row.pose.tolist(),
        **exposed,
    }


def _add(tar: tarfile.TarFile, name: str, content: str | bytes) -> None:
    data = content.encode() if isinstance(content, str) else content
    entry = tarfile.TarInfo(name)
    entry.size = len(data)
    tar.addfile(entry, io.BytesIO(data))


FORMAT = Format(
    "webdataset",
    "WebDataset: tars of OpenEXR images and JSON",
    (),
    _parts,
    check=_check,
    uses=("tar_views",),
    lenses=ANY_LENS,
)
