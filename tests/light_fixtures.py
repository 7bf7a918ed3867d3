"""Two rooms with a lamp, a window and a sky, packed as a dataset: a workplace for the studies."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from model_fixtures import write_shard
from render_fixtures import (
    WINDOW,
    ball,
    diffuse,
    glow,
    make_view,
    quad,
    room_walls,
    write_scene,
)
from study_fixtures import untrained

from model.training.train import Folders
from pipeline.frames import TINT
from pipeline.params import GroundTruthParams, IlluminationParams, ImageParams, Params, ToneParams
from pipeline.passes.illumination import render_illumination
from pipeline.passes.inputs import render_inputs
from pipeline.passes.registry import render_truths
from pipeline.render.scene import open_scene, set_variant
from pipeline.tonemap import exposure_of
from pipeline.views import CameraFile, View, save_cameras
from scenes.contract import Light, Scene

SIZE = (48, 40)
SKY = '<emitter type="constant"><rgb name="radiance" value="1"/></emitter>'
PARAMS = Params(
    image=ImageParams(*SIZE),
    illumination=IlluminationParams(width=32, light_samples=16),
    groundtruth=GroundTruthParams(spp=4, block_spp=2, max_depth=4),
)
YAML = """\
seed: 0
image: {width: 48, height: 40}
illumination: {width: 32, light_samples: 16}
groundtruth: {spp: 4, block_spp: 2, max_depth: 4}
"""


def room(folder: Path, lamp: float = 3.0, window: bool = True, more: str = "") -> Scene:
    """A grey box room with a glowing ball below its ceiling, a table, a window to a white sky."""
    walls, names = room_walls(diffuse(0.6), window)
    table = quad("table", (0.6, 1.2, 0.7), (0, 0, 1), (0.4, 0.3), diffuse("0.5 0.3 0.2"), (0, 1, 0))
    bulb = ball("bulb", (0.5, 0.8, 2.5), 0.15, glow(lamp))
    body = walls + table + bulb + more + (SKY if window else "")
    objects = {"walls": names, "table": ("table",), "lamp": ("bulb",)}
    lights = [Light("lamp", "area", ("bulb",), "r")]
    lights += [Light("sky", "environment")] if window else []
    return write_scene(folder, body, objects, (WINDOW,) if window else (), lights)


def views(scene_id: str) -> list[View]:
    """Two views of the room with space behind them."""
    poses = (((-0.3, -0.5, 1.5), (0.1, 1, -0.2)), ((0.4, -0.4, 1.4), (-0.2, 1, -0.2)))
    return [
        replace(make_view(eye, towards, SIZE), scene_id=scene_id, view_id=f"v{number}", room="r")
        for number, (eye, towards) in enumerate(poses)
    ]


def lit_workplace(root: Path, scenes: int = 2, train: int = 0) -> Folders:
    """Scenes, cameras, splits and untrained networks, as `pbrnet` expects them in `root`.

    `scenes` rooms are tested on, so many more trained on.
    """
    set_variant()
    folders = Folders(*(root / part for part in ("data", "models", "metrics", "plots", "models")))
    rows: dict[str, list[dict[str, Any]]] = {"test": [], "train": []}
    for number in range(scenes + train):
        name, split = f"room-{number}", "test" if number < scenes else "train"
        scene = room(folders.data / "scenes" / name, lamp=3.0 + number)
        save_cameras(
            folders.data / "cameras" / f"{name}.json", CameraFile(name, tuple(views(name)))
        )
        opened = open_scene(scene)
        rows[split] += [_row(opened, view) | {"split": split} for view in views(name)]
    for split in ("test", "train") if train else ("test",):
        write_shard(folders.data / "dataset" / f"{split}-00000-of-00001.parquet", rows[split])
    untrained(folders.models)
    (root / "params.yaml").write_text(YAML)
    return folders


def _row(opened: Any, view: View) -> dict[str, Any]:
    inputs = render_inputs(opened, view)
    panorama = render_illumination(opened, view, PARAMS.illumination)
    truths = render_truths(opened, view, PARAMS, 1)
    images = {
        kind: np.stack([truths[kind][0][band] for band in "RGB"], axis=-1)  # type: ignore[index]
        for kind in ("shading", "color")
    }
    exposures = {kind: exposure_of(image, ToneParams()) for kind, image in images.items()}
    return {
        "scene_id": view.scene_id,
        "view_id": view.view_id,
        "depth": inputs["Z"],
        "normal": np.stack([inputs[f"N.{axis}"] for axis in "XYZ"], -1).astype(np.float16),
        "reflectance": np.stack([inputs[f"albedo.{b}"] for b in "RGB"], -1).astype(np.float16),
        "valid": inputs["valid"].astype(np.uint8),
        "intensity": panorama["intensity.Y"],
        "distance": panorama["distance.Z"],
        "tint": np.stack([panorama[name] for name in TINT], -1).astype(np.float16),
        "K": view.intrinsics.ravel(),
        **{kind: image.astype(np.float16) for kind, image in images.items()},
        **{f"exposure_{kind}": exposure.scale for kind, exposure in exposures.items()},
        **{f"white_{kind}": exposure.white for kind, exposure in exposures.items()},
        "licence": "CC0-1.0",
        "attribution": "a test",
    }
