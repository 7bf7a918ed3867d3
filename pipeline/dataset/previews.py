"""Small 8-bit pictures of a row's images, for people and for the viewers of data hubs."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from pbrnet.pipeline.dataset.columns import PREVIEWS
from pbrnet.pipeline.images import (
    Picture,
    depth_picture,
    fit,
    flow_picture,
    intensity_picture,
    jpeg_bytes,
    label_picture,
    normal_picture,
    png_bytes,
    reflectance_picture,
    share_picture,
)
from pbrnet.pipeline.photograph import meter, photograph

Cells = Mapping[str, Any]  # of a row, by column


def _photo(name: str, stops: float = 0.0, metered: str = "") -> Callable[[Cells], Picture]:
    """Return a function that photographs an image of radiance.

    Exposure and white balance are those of the image `metered`, by default itself; exposure is
    `stops` higher.
    """

    def draw(row: Cells) -> Picture:
        unit = np.float32(row["radiance_scale"])
        settings = meter(row[metered or name].astype(np.float32) * unit)
        settings = replace(settings, gain=settings.gain * 2**stops)
        return photograph(row[name].astype(np.float32) * unit, settings)

    return draw


_DRAW: dict[str, Callable[[Cells], Picture]] = {
    "preview": _photo("color"),
    "preview_dark": _photo("color", -2),
    "preview_bright": _photo("color", 2),
    "preview_shading": _photo("shading"),
    "preview_depth": lambda row: depth_picture(row["depth"], row["valid"]),
    "preview_normal": lambda row: normal_picture(row["normal"], row["valid"]),
    "preview_reflectance": lambda row: reflectance_picture(row["reflectance"]),
    "preview_lights": lambda row: intensity_picture(row["intensity"]),
    "preview_roughness": lambda row: share_picture(row["roughness"]),
    "preview_material": lambda row: label_picture(row["material"]),
    "preview_instance": lambda row: label_picture(row["instance"]),
    "preview_nyu40": lambda row: label_picture(row["nyu40"]),
    "preview_indirect": _photo("indirect", metered="color"),
    "preview_flow": lambda row: flow_picture(row["flow_forward"]),
    "preview_environment": _photo("environment", metered="color"),
    "preview_noisy": _photo("noisy_color", metered="color"),
}
# Flat colours: smaller and sharper as PNG. The first has always been one.
_LOSSLESS = ("preview", "preview_material", "preview_instance", "preview_nyu40")


def preview_cells(row: Cells, width: int) -> dict[str, dict[str, Any]]:
    """Return the pictures of a row by column, encoded and named, at most `width` pixels wide."""
    cells = {}
    for preview in PREVIEWS:
        if preview.shows not in row:
            continue
        picture = fit(_DRAW[preview.name](row), width)
        lossless = preview.name in _LOSSLESS
        content = png_bytes(picture) if lossless else jpeg_bytes(picture)
        name = "-".join([row["scene_id"], row["view_id"], *preview.name.split("_")[1:]])
        cells[preview.name] = {
            "bytes": content,
            "path": f"{name}.{'png' if lossless else 'jpg'}",
        }
    return cells
