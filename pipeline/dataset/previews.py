"""Small 8-bit pictures of a row's images, for people and for the viewers of data hubs."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from pbrnet.pipeline.channels import RADIANCE, Channel, column_channel
from pbrnet.pipeline.dataset.columns import PREVIEWS, Preview
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


def _draw(row: Cells, preview: Preview) -> Picture:
    """Draw the image that a preview shows, as its channel says what it is."""
    channel, image = column_channel(preview.shows), row[preview.shows]
    if _is_labels(channel):
        return label_picture(image)
    if channel.is_direction:
        return normal_picture(image, row["valid"])
    if channel.unit == "metre":
        return depth_picture(image, row["valid"])
    if channel.unit == RADIANCE:
        return _photo(row, preview) if channel.shape else intensity_picture(image)
    if channel.shape == (2,):
        return flow_picture(image)
    return reflectance_picture(image) if channel.shape else share_picture(image)


def _photo(row: Cells, preview: Preview) -> Picture:
    """Photograph an image of radiance."""
    unit = np.float32(row["radiance_scale"])
    metered = preview.metered if preview.metered in row else preview.shows
    settings = meter(row[metered].astype(np.float32) * unit)
    settings = replace(settings, gain=settings.gain * 2**preview.stops)
    return photograph(row[preview.shows].astype(np.float32) * unit, settings)


def _is_labels(channel: Channel) -> bool:
    return np.issubdtype(channel.dtype, np.integer)


def preview_cells(row: Cells, width: int) -> dict[str, dict[str, Any]]:
    """Return the pictures of a row by column, encoded and named, at most `width` pixels wide."""
    cells = {}
    for preview in PREVIEWS:
        if preview.shows not in row:
            continue
        picture = fit(_draw(row, preview), width)
        # Flat colours: smaller and sharper as PNG. The first has always been one.
        lossless = preview.name == "preview" or _is_labels(column_channel(preview.shows))
        content = png_bytes(picture) if lossless else jpeg_bytes(picture)
        name = "-".join([row["scene_id"], row["view_id"], *preview.name.split("_")[1:]])
        cells[preview.name] = {
            "bytes": content,
            "path": f"{name}.{'png' if lossless else 'jpg'}",
        }
    return cells
