"""Frames and scenes to predict from, as the rendering stages would leave them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from model_fixtures import ROOM, box_view
from render_fixtures import ball, diffuse, glow, write_scene

from pipeline.frames import TINT, write_frame
from pipeline.params import ImageParams
from pipeline.views import CameraFile, View, as_matrix, intrinsics_of, look, save_cameras


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
    shadows = np.random.default_rng(3).integers(0, 9, images["depth"].shape)
    channels = {
        "inputs": {
            "Z": images["depth"],
            **{f"N.{axis}": images["normal"][..., i] for i, axis in enumerate("XYZ")},
            **{f"albedo.{band}": images["reflectance"][..., i] for i, band in enumerate("RGB")},
            "valid": images["valid"].astype(np.float16),
            "object": np.ones_like(images["depth"], np.uint32),
        },
        "illumination": {
            "intensity.Y": images["intensity"],
            "distance.Z": images["distance"],
            **{name: images["tint"][..., k] for k, name in enumerate(TINT)},
        },
        "visibility": {"visibility.Y": shadows / 8},
        **rgb,
    }
    for kind, pixels in channels.items():
        path = data / kind / "box" / f"{name}.exr"
        write_frame(path, kind, pixels, view, fingerprint="test")  # type: ignore[arg-type]
    return view


def box_room(data: Path, *views: View, lamp: tuple[float, float, float] = (2, 2.5, 2.2)) -> Path:
    """The scene folder `box`: a closed room with a lamp, and a camera file of these views."""
    x, y, z = ROOM / 2
    walls = f"""
    <shape type="cube" id="room"><boolean name="flip_normals" value="true"/>
      <transform name="to_world"><scale x="{x}" y="{y}" z="{z}"/>
      <translate x="{x}" y="{y}" z="{z}"/></transform>{diffuse("0.6 0.4 0.2")}</shape>"""
    folder = data / "scenes" / "box"
    bulb = ball("bulb", lamp, 0.15, glow(5))
    write_scene(folder, walls + bulb, {"room": ("room",), "bulb": ("bulb",)})
    save_cameras(data / "cameras" / "box.json", CameraFile("box", views))
    return folder


def box_camera(
    name: str,
    size: tuple[int, int],
    eye: tuple[float, float, float],
    towards: tuple[float, float, float],
) -> View:
    """A view of `box_room`; `size` is (width, height)."""
    camera = as_matrix(intrinsics_of(ImageParams(*size)))
    return View("box", name, *size, camera, as_matrix(look(eye, towards)))
