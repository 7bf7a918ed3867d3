"""Pictures of dataset rows for the report."""

from __future__ import annotations

import base64
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from pbrnet.pipeline.images import (
    Picture,
    contact_sheet,
    enlarge,
    fit,
    jpeg_bytes,
    png_bytes,
    read_picture,
    tone_picture,
)
from pbrnet.pipeline.photograph import channel_picture, meter, photograph
from pbrnet.pipeline.tonemap import Exposure

THUMBNAIL = 320  # largest width, pixels
MODALITIES = {
    "color": ("Colour", "The path-traced image, exposed and balanced as a camera does."),
    "shading": ("Shading", "Every colour replaced by one grey; gloss, metal and glass stay."),
    "reflectance": ("Reflectance", "Base colour of the surfaces, without light."),
    "normal": ("Normal", "Surface normals: red is right, green up, blue towards the camera."),
    "depth": (
        "Depth",
        "Distance along the optical axis, logarithmic: near is bright, far is violet.",
    ),
    "intensity": (
        "Illumination: intensity",
        "Radiance of the light sources in all directions around the camera, logarithmic.",
    ),
    "distance": ("Illumination: distance", "Distance of each light source: near is bright."),
    "tint": ("Illumination: colour", "Colour of each light source, without its brightness."),
    "visibility": ("Shadows", "Share of the sources' direct light that reaches each surface."),
    "roughness": ("Roughness", "Perceptual roughness: polished is black, matt is white."),
    "metalness": ("Metalness", "Share of the metallic lobe: metals are white."),
    "specular_color": ("Specular colour", "Reflectance at normal incidence of the gloss."),
    "normal_bump": ("Normal with bumps", "As the normal, with bump and normal maps."),
    "emission": ("Emission", "White where the surface emits light to the camera."),
    "material": ("Materials", "A colour for each material."),
    "instance": ("Instances", "A colour for each object."),
    "nyu40": ("NYU40 classes", "A colour for each class."),
    "flow_forward": ("Flow", "Motion to the next frame: hue is direction, paler is shorter."),
    "occluded_forward": ("Occlusion", "White where the next frame does not see the surface."),
}
# Parts of a row's light, in order, shown under colour's exposure.
PARTS = {
    "color": "Colour",
    "direct": "Direct",
    "indirect": "Indirect",
    "diffuse": "Diffuse",
    "specular": "Specular",
}


def rows_with(name: str, sheet: Sequence[Mapping[str, Any]]) -> list[Mapping[str, Any]]:
    """Return the rows that have this image; without a next frame there is no motion to it."""
    if name.endswith("_forward"):
        sheet = [row for row in sheet if np.any(row.get("flow_forward", 0))]
    return [row for row in sheet if name in row]


def tone_mapped(name: str, row: Mapping[str, Any], shared: bool = False) -> Picture:
    """Draw colour or shading as networks see it; `shared`: under the exposure of shading."""
    by = "shading" if shared else name
    return tone_picture(row[name], Exposure(row[f"exposure_{by}"], row[f"white_{by}"]))


def light_pictures(row: Mapping[str, Any]) -> list[tuple[str, Picture]]:
    """Draw the parts of a row's light, and its light groups by name; empty if it has none."""
    if "direct" not in row:
        return []
    settings = meter(row["color"])
    pictures = [(title, photograph(row[name], settings)) for name, title in PARTS.items()]
    pictures.append(("Irradiance", photograph(row["irradiance"])))
    scale = np.float32(row["radiance_scale"])
    for name, image in zip(row.get("light_names") or (), row.get("lights", ()), strict=False):
        if name and image.any():
            lit = image.astype(np.float32) * scale
            pictures.append((f"Light of {name}", photograph(lit, settings)))
    return pictures


def environment_pictures(row: Mapping[str, Any]) -> list[tuple[str, Picture]]:
    """Draw a row's panorama of the surroundings; empty if it has none."""
    titles = {
        "environment": "Environment",
        "environment_depth": "Distance along the rays",
        "environment_normal": "Normal",
    }
    return [(title, channel_picture(name, row)) for name, title in titles.items() if name in row]


def mosaic(sheet: Sequence[Mapping[str, Any]], columns: int, rows: int) -> str:
    """Return a grid of previews as a small data URI; empty if there are too few rows."""
    if len(sheet) < columns * rows:
        return ""
    places = np.linspace(0, len(sheet) - 1, columns * rows).astype(int)
    previews = [
        fit(read_picture(sheet[place]["preview"]["bytes"]), 240 // columns) for place in places
    ]
    return uri(contact_sheet(previews, columns, gap=2))


def shrink(picture: Picture) -> Picture:
    """Scale to thumbnail size; small pictures are enlarged by whole pixels."""
    return enlarge(fit(picture, THUMBNAIL), THUMBNAIL)


def uri(picture: Picture, png: bool = False) -> str:
    """Encode a picture as a data URI, JPEG or (`png`) PNG."""
    content = png_bytes(picture) if png else jpeg_bytes(picture)
    kind = "png" if png else "jpeg"
    return f"data:image/{kind};base64,{base64.b64encode(content).decode()}"


def row_label(row: Mapping[str, Any]) -> str:
    """Return scene, view, room type and lighting of a row."""
    return f"{row['scene_id']} {row['view_id']} · {row['room_type']}, {row['lighting']}"
