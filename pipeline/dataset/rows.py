"""Rows of the dataset: the cells of a view, from its frames, camera and scene."""

from __future__ import annotations

from typing import Any

import numpy as np

from pbrnet.pipeline.channels import Channel, dataset_channels
from pbrnet.pipeline.dataset.checks import Frames, noise_of
from pbrnet.pipeline.dataset.columns import NOISE_OF_PARTS
from pbrnet.pipeline.dataset.description.card import attribution_of, licence_of
from pbrnet.pipeline.dataset.label_tables import json_text, room_layout
from pbrnet.pipeline.dataset.light import in_row_unit, light_groups, remainders
from pbrnet.pipeline.dataset.previews import preview_cells
from pbrnet.pipeline.frames import Frame
from pbrnet.pipeline.tonemap import ToneParams, exposure_of
from pbrnet.pipeline.views import View
from pbrnet.scenes.arrays import AnyArray
from pbrnet.scenes.contract import Scene


def make_row(
    scene: Scene, view: View, split: str, frames: Frames, tone: ToneParams, preview_width: int
) -> dict[str, Any]:
    """Return one row by column name; images are arrays in the precision of the frames.

    Radiance is divided by `radiance_scale`; exposures are of radiance in the renderer's unit.
    """
    shading, color = frames["shading"], frames["color"]
    frames, radiance_scale = in_row_unit(frames)
    own_shading, own_color = exposure_of(shading.rgb, tone), exposure_of(color.rgb, tone)
    cells = {
        "scene_id": view.scene_id,
        "view_id": view.view_id,
        "split": split,
        "room_type": view.room_type,
        "lighting": scene.lighting,
        "width": view.width,
        "height": view.height,
        **image_cells(frames),
        "K": None if view.is_panorama else view.intrinsics,
        "camera_to_world": view.pose,
        "radiance_scale": radiance_scale,
        "exposure_shading": own_shading.scale,
        "white_shading": own_shading.white,
        "exposure_color": own_color.scale,
        "white_color": own_color.white,
        "spp": color.meta.get("spp"),
        "noise_shading": noise_of(shading),
        "noise_color": noise_of(color),
        "denoiser": color.meta.get("denoiser"),
        "residual_noise_shading": shading.meta.get("residual_noise"),
        "residual_noise_color": color.meta.get("residual_noise"),
        "score": view.score,
        "objects": _objects_in(frames, scene),
        "seed": _signed(color.meta.get("seed")),
        "renderer": _renderer(color),
        "source": str(scene.source.get("kind", "unknown")),
        "licence": licence_of(scene),
        "attribution": attribution_of(scene),
        "plan": scene.plan or scene.scene_id,
        "trajectory": view.trajectory or None,
        "frame": view.frame if view.trajectory else None,
        "stereo_partner": view.stereo_partner or None,
        "stereo_offset": view.stereo_offset if view.stereo_partner else None,
        "view_set": view.view_set or None,
        "set_overlap": view.set_overlap if view.view_set else None,
        "projection": view.projection,
        **_tables(view, scene, frames),
        **_light_cells(frames),
        **({"noisy_spp": frames["noisy"].meta.get("spp")} if "noisy" in frames else {}),
        **_environment_cells(frames),
    }
    return {**preview_cells(cells, preview_width), **cells}


def _environment_cells(frames: Frames) -> dict[str, Any]:
    """Return the cells that say how the panorama of the environment was made."""
    if "environment" not in frames:
        return {}
    frame = frames["environment"]
    return {"environment_spp": frame.meta.get("spp"), "noise_environment": noise_of(frame)}


def _renderer(color: Frame) -> str:
    """Return renderer and instruction set: light frames depend on both."""
    about = (color.meta.get(name) for name in ("renderer", "instruction_set"))
    return ", ".join(str(text) for text in about if text) or "unknown"


def _tables(view: View, scene: Scene, frames: Frames) -> dict[str, Any]:
    """Return the cells that explain the numbers in images of materials and labels."""
    cells: dict[str, Any] = {}
    for kind in ("materials", "labels"):
        if kind in frames:
            cells["material_names"] = [str(name) for name in frames[kind].meta["material_names"]]
    if "labels" in frames:
        facts = frames["labels"].meta
        cells |= {name: json_text(facts[name]) for name in ("instances", "light_sources")}
        cells["layout"] = json_text(room_layout(scene, view))
    return cells


def _light_cells(frames: Frames) -> dict[str, Any]:
    """Return the noise estimates of the light's parts, and its groups."""
    if "light" not in frames:
        return {}
    facts = frames["light"].meta
    cells = {f"noise_{part}": facts.get(f"noise_{part}") for part in NOISE_OF_PARTS}
    names = facts.get("light_names")
    if names:
        cells["lights"] = light_groups(frames["light"], len(names))
        cells["light_names"] = [str(name) for name in names]
        cells["noise_lights"] = np.array(facts["noise_lights"], dtype=np.float32)
    return cells


def image_cells(frames: Frames) -> dict[str, AnyArray]:
    """Return the images of all channels that the frames hold or derive, by column name."""
    derived = remainders(frames) if "light" in frames else {}
    return {
        channel.name: derived[channel.name]
        if channel.derived
        else _image(frames[channel.kind], channel)
        for channel in dataset_channels(tuple(frames))
    }


def _image(frame: Frame, channel: Channel) -> AnyArray:
    """Return a channel as (H, W) or (H, W, C), in the frame's own precision; masks as uint8."""
    planes = [frame.channels[band] for band in channel.bands]
    if channel.mask:
        planes = [plane > 0 for plane in planes]
    planes = [plane.astype(channel.dataset_dtype, copy=False) for plane in planes]
    return planes[0] if len(planes) == 1 else np.stack(planes, axis=-1)


def _objects_in(frames: Frames, scene: Scene) -> int:
    """Return the number of objects, without structure, that each cover over 1 % of the view."""
    numbers = frames["inputs"].channels["object"].astype(np.int64)
    pixels = np.bincount(numbers.ravel(), minlength=len(scene.objects) + 1)[1:]
    furniture = [not item.is_structure for item in scene.objects]
    return int((pixels[: len(furniture)][furniture] > 0.01 * numbers.size).sum())


def _signed(seed: Any) -> int | None:
    """Return a 64-bit seed in two's complement, for Parquet's signed integers."""
    if not isinstance(seed, int):
        return None
    seed &= (1 << 64) - 1
    return seed - (1 << 64) if seed >= 1 << 63 else seed
