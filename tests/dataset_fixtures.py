"""Synthetic data folders: scenes, cameras and frames of small box rooms, no renderer needed."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from pipeline.frames import TINT, Channels, Kind, fingerprint, frame_path, write_frame
from pipeline.params import IlluminationParams, ImageParams, Params
from pipeline.views import CameraFile, View, as_matrix, intrinsics_of, look, save_cameras
from scenes.contract import (
    Credit,
    Light,
    Portal,
    Room,
    Scene,
    SceneObject,
    save_scene,
    writing_scene,
)

ROOM = (4.0, 5.0, 2.6)  # metres: x, y, height
WARM = (1.6, 0.89, 0.32)  # the lamps' colour, of luminance 1
LIGHTING = ("day", "evening", "night", "mixed")


def small_params(**dataset: Any) -> Params:
    """32x24 images, 32x16 panoramas; `dataset` overrides fields of its section."""
    params = Params(
        image=ImageParams(width=32, height=24), illumination=IlluminationParams(width=32)
    )
    return replace(params, dataset=replace(params.dataset, **dataset))


def make_data(
    folder: Path, params: Params, scenes: int = 4, views: int = 3, **scene_fields: Any
) -> Path:
    """`folder` with that many one-room scenes, each with that many views and all frames."""
    for index in range(scenes):
        add_scene(folder, params, f"home-{index:04d}", views, index, **scene_fields)
    return folder


def add_scene(
    folder: Path, params: Params, scene_id: str, views: int, index: int = 0, **fields: Any
) -> Scene:
    """One scene with cameras and frames."""
    scene = box_scene(scene_id, LIGHTING[index % len(LIGHTING)], **fields)
    with writing_scene(folder / "scenes" / scene_id) as partial:
        (partial / "scene.xml").write_text('<scene version="3.0.0"/>\n')
        save_scene(partial, scene)
    cameras = tuple(make_view(params, scene_id, number) for number in range(views))
    save_cameras(
        folder / "cameras" / f"{scene_id}.json",
        CameraFile(scene_id, cameras, 40, {"too few objects": 20, "too close": 5}, "camera"),
    )
    for view in cameras:
        for kind, channels in box_frames(view, params).items():
            write_view(folder, kind, channels, view)
    return scene


def write_view(folder: Path, kind: Kind, channels: Channels, view: View, **meta: Any) -> Path:
    """Write one frame with believable metadata, which `meta` overrides."""
    path = frame_path(folder, kind, view)
    meta = {
        "fingerprint": fingerprint(view=view, kind=kind),
        "spp": 64,
        "noise": 0.125,
        "firefly_light": 0.0,
        "seed": 2**64 - 5,
        "renderer": "mitsuba 3.9.1 llvm_ad_rgb",
        **meta,
    }
    write_frame(path, kind, channels, view, **meta)
    return path


def make_view(params: Params, scene_id: str, number: int) -> View:
    """A camera in the middle of the room that turns from view to view."""
    angle = 0.3 + 1.1 * number
    pose = look((2.0, 2.5, 1.5), (math.cos(angle), math.sin(angle), -0.2))
    return View(
        scene_id=scene_id,
        view_id=f"{number:03d}",
        width=params.image.width,
        height=params.image.height,
        K=as_matrix(intrinsics_of(params.image)),
        camera_to_world=as_matrix(pose),
        room="room-0",
        room_type="living",
        sector=number % 6,
        score=3.5 + number,
        seen={"sofa": 120, "lamp": 30},
    )


def box_scene(scene_id: str, lighting: str = "day", **fields: Any) -> Scene:
    """A one-room home with three pieces of furniture, a lamp and a window."""
    x, y, z = ROOM
    values: dict[str, Any] = {
        "scene_id": scene_id,
        "source": {"kind": "procedural", "seed": 0},
        "rooms": (
            Room("room-0", "Living room", "living", ((0, 0), (x, 0), (x, y), (0, y)), 0.0, z, True),
            Room("room-1", "Bath", "bathroom", ((x, 0), (6, 0), (6, 2), (x, 2)), 0.0, z, False),
        ),
        "objects": (
            SceneObject("floor", "floor", "floor", ("f",), (0, 0, -0.2), (x, y, 0), True, "room-0"),
            SceneObject(
                "sofa", "Sofa", "sofa", ("s",), (0.2, 1, 0), (1.1, 3, 0.8), False, "room-0"
            ),
            SceneObject("lamp", "Lamp", "lamp", ("l",), (3, 4, 0), (3.4, 4.4, 1.6), False),
        ),
        "lights": (Light("bulb", "area", ("l",), "room-0", 800.0), Light("sky", "sky")),
        "portals": (
            Portal(
                "window",
                "window",
                ((1, y, 1), (3, y, 1), (3, y, 2), (1, y, 2)),
                (0, 1, 0),
                True,
                "room-0",
            ),
        ),
        "credits": (Credit("everything", "Box room", "A. Maker", "CC0-1.0", "generated"),),
        "lighting": lighting,
        **fields,
    }
    return Scene(**values)


def box_frames(view: View, params: Params) -> dict[Kind, Channels]:
    """Exact depth and normals inside the box; made-up light, seeded by the view's name."""
    height, width = view.height, view.width
    columns, rows = np.meshgrid(np.arange(width) + 0.5, np.arange(height) + 0.5)
    rays = np.stack([columns, rows, np.ones_like(rows)], -1) @ np.linalg.inv(view.intrinsics).T
    turn = view.pose[:3, :3]
    world = rays @ turn.T
    with np.errstate(divide="ignore"):
        reach = np.where(world > 0, (np.array(ROOM) - view.eye) / world, -view.eye / world)
    axis = reach.argmin(axis=-1)
    depth = reach.min(axis=-1)
    outward = np.take_along_axis(np.sign(world), axis[..., None], -1)
    normal = (-outward * np.eye(3)[axis]) @ turn
    random = np.random.default_rng(sum(map(ord, view.scene_id + view.view_id)))
    albedo = np.array([[0.8, 0.3, 0.2], [0.3, 0.6, 0.3], [0.6, 0.5, 0.4]])[axis]
    cosine = np.clip(-(normal * rays / np.linalg.norm(rays, axis=-1, keepdims=True)).sum(-1), 0, 1)
    light = (0.02 + cosine / depth**2)[..., None] * random.uniform(0.9, 1.1, (height, width, 1))
    panorama = (params.illumination.width // 2, params.illumination.width)
    intensity = np.zeros(panorama, np.float32)
    intensity[5:7, 10:13] = random.uniform(20, 30, (2, 3))
    intensity[3:7, 22:27] = 120000.0  # brighter than a half float can say
    distance = np.where(intensity > 0, np.float32(2.25), np.float32(0))
    tint = {name: np.where(intensity > 0, value, 0) for name, value in zip(TINT, WARM, strict=True)}
    planes = {
        "Z": depth.astype(np.float32),
        **{f"N.{name}": normal[..., index] for index, name in enumerate("XYZ")},
        **{f"albedo.{name}": albedo[..., index] for index, name in enumerate("RGB")},
        "valid": np.ones((height, width)),
        "object": np.ones((height, width), np.uint32),
    }
    shading = np.broadcast_to(0.5 * light, (height, width, 3))
    color = albedo * light
    return {
        "inputs": planes,
        "illumination": {"intensity.Y": intensity, "distance.Z": distance, **tint},
        "visibility": {"visibility.Y": random.integers(0, 9, (height, width)) / 8},
        "shading": {name: shading[..., index] for index, name in enumerate("RGB")},
        "color": {name: color[..., index] for index, name in enumerate("RGB")},
    }
