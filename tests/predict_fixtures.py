"""Frames to predict from, as the rendering stages would leave them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from model_fixtures import box_view

from pipeline.frames import write_frame
from pipeline.params import ImageParams
from pipeline.views import View, as_matrix, intrinsics_of


def box_frames(data: Path, name: str = "v0", **size: int) -> View:
    """Frames of a box room, as the rendering stages would leave them."""
    images = box_view(3, **size)
    view = View(
        "box",
        name,
        size["width"],
        size["height"],
        as_matrix(intrinsics_of(ImageParams(size["width"], size["height"]))),
        as_matrix(np.eye(4)),
    )
    rgb = {
        kind: {band: images[kind][..., i] for i, band in enumerate("RGB")}
        for kind in ("shading", "color")
    }
    channels = {
        "inputs": {
            "Z": images["depth"],
            **{f"N.{axis}": images["normal"][..., i] for i, axis in enumerate("XYZ")},
            **{f"albedo.{band}": images["reflectance"][..., i] for i, band in enumerate("RGB")},
            "valid": images["valid"].astype(np.float16),
            "object": np.ones_like(images["depth"], np.uint32),
        },
        "illumination": {"intensity.Y": images["intensity"], "distance.Z": images["distance"]},
        **rgb,
    }
    for kind, pixels in channels.items():
        path = data / kind / "box" / f"{name}.exr"
        write_frame(path, kind, pixels, view, fingerprint="test")  # type: ignore[arg-type]
    return view
