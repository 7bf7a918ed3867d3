"""Rows of the dataset as pictures of the report."""

from __future__ import annotations

import base64
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from pipeline.images import (
    Picture,
    contact_sheet,
    depth_picture,
    distance_picture,
    enlarge,
    fit,
    intensity_picture,
    jpeg_bytes,
    normal_picture,
    png_bytes,
    read_picture,
    reflectance_picture,
    share_picture,
    tint_picture,
    tone_picture,
)
from pipeline.tonemap import Exposure

THUMBNAIL = 320  # pixels wide at most
MODALITIES = {
    "color": ("Colour", "The finished image, path traced; tone-mapped to look at."),
    "shading": ("Shading", "The same light on the same shapes, every colour removed."),
    "reflectance": ("Reflectance", "Base colour, without any light."),
    "normal": ("Normal", "Where surfaces face: red right, green up, blue towards the camera."),
    "depth": (
        "Depth",
        "Distance along the optical axis, logarithmic: near is bright, far is violet.",
    ),
    "intensity": ("Illumination: intensity", "Light sources all around the camera, logarithmic."),
    "distance": ("Illumination: distance", "How far away each of them is: near is bright."),
    "tint": ("Illumination: colour", "The colour of each of them, whatever its brightness."),
    "visibility": ("Shadows", "How much of their direct light reaches each surface."),
}


def draw(name: str, row: Mapping[str, Any], shared: bool = False) -> Picture:
    """One image column of a row as a picture; `shared` shows colour under shading's exposure."""
    values = row[name]
    if name in ("color", "shading"):
        by = "shading" if shared else name
        return tone_picture(values, Exposure(row[f"exposure_{by}"], row[f"white_{by}"]))
    if name == "normal":
        return normal_picture(values, row["valid"])
    if name == "depth":
        return depth_picture(values, row["valid"])
    if name == "intensity":
        return intensity_picture(values)
    if name == "tint":
        return tint_picture(values)
    if name == "visibility":
        return share_picture(values)
    return distance_picture(values) if name == "distance" else reflectance_picture(values)


def mosaic(sheet: Sequence[Mapping[str, Any]], columns: int, rows: int) -> str:
    """So many previews side by side as one small data URI; nothing if there are too few."""
    if len(sheet) < columns * rows:
        return ""
    places = np.linspace(0, len(sheet) - 1, columns * rows).astype(int)
    previews = [
        fit(read_picture(sheet[place]["preview"]["bytes"]), 240 // columns) for place in places
    ]
    return uri(contact_sheet(previews, columns, gap=2))


def shrink(picture: Picture) -> Picture:
    """Thumbnail size; what is much smaller keeps hard pixel edges."""
    return enlarge(fit(picture, THUMBNAIL), THUMBNAIL)


def uri(picture: Picture, png: bool = False) -> str:
    content = png_bytes(picture) if png else jpeg_bytes(picture)
    kind = "png" if png else "jpeg"
    return f"data:image/{kind};base64,{base64.b64encode(content).decode()}"


def row_label(row: Mapping[str, Any]) -> str:
    return f"{row['scene_id']} {row['view_id']} · {row['room_type']}, {row['lighting']}"
