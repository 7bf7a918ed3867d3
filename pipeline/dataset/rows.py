"""Rows of the dataset: the cells of a view, from its frames, camera and scene."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from pbrnet.pipeline.channels import RADIANCE, TRUTHS, Channel, column_channel, dataset_channels
from pbrnet.pipeline.dataset.checks import Frames, noise_of
from pbrnet.pipeline.dataset.columns import PREVIEWS, Column, Preview, room_layout
from pbrnet.pipeline.dataset.description.facts import attribution_of, licence_of
from pbrnet.pipeline.dataset.light import in_row_unit, light_groups, remainder
from pbrnet.pipeline.frames import Frame
from pbrnet.pipeline.images import Picture, fit, jpeg_bytes, png_bytes
from pbrnet.pipeline.photograph import channel_picture, meter, photograph
from pbrnet.pipeline.tonemap import Exposure, ToneParams, exposure_of
from pbrnet.pipeline.views import View
from pbrnet.scenes.arrays import AnyArray, Float32Array, Float64Array
from pbrnet.scenes.contract import Scene

Cells = Mapping[str, Any]  # of a row, by column


@dataclass
class RowSource:
    """Scene, view and frames of a row, and the values that `columns.toml` names."""

    scene: Scene
    view: View
    split: str
    frames: Frames  # in the renderer's unit, afterwards in the row's
    tone: ToneParams
    radiance_scale: float = field(init=False)
    exposures: dict[str, Exposure] = field(init=False)  # of radiance in the renderer's unit

    def __post_init__(self) -> None:
        self.exposures = {
            kind: exposure_of(self.frames[kind].rgb, self.tone)
            for kind in TRUTHS
            if kind in self.frames
        }
        self.frames, self.radiance_scale = in_row_unit(self.frames)
        self.images = image_cells(self.frames)
        self.facts = {kind: frame.meta for kind, frame in self.frames.items()}
        self.noises = {kind: noise_of(frame) for kind, frame in self.frames.items()}

    @property
    def intrinsics(self) -> Float64Array | None:
        """Camera matrix (3, 3), None for an equirectangular view."""
        return None if self.view.is_panorama else np.array(self.view.K)

    @property
    def distortion(self) -> Float64Array:
        """Coefficients of the lens, (k,); those of a fisheye without are 0."""
        return np.array(self.view.distortion or (0.0,) * 4)

    @property
    def objects(self) -> int:
        """Number of objects, without structure, that each cover over 1 % of the view."""
        numbers = self.frames["inputs"].channels["object"].astype(np.int64)
        pixels = np.bincount(numbers.ravel(), minlength=len(self.scene.objects) + 1)[1:]
        furniture = [not item.is_structure for item in self.scene.objects]
        return int((pixels[: len(furniture)][furniture] > 0.01 * numbers.size).sum())

    @property
    def seed(self) -> int | None:
        """Seed of 64 bits in two's complement, for Parquet's signed integers."""
        seed = self.facts["color"].get("seed")
        if not isinstance(seed, int):
            return None
        seed &= (1 << 64) - 1
        return seed - (1 << 64) if seed >= 1 << 63 else seed

    @property
    def renderer(self) -> str:
        """Renderer and instruction set: light frames depend on both."""
        facts = self.facts.get("color", self.facts["inputs"])
        about = (facts.get(name) for name in ("renderer", "instruction_set"))
        return ", ".join(str(text) for text in about if text) or "unknown"

    @property
    def source(self) -> str:
        """Kind of the scene's source."""
        return str(self.scene.source.get("kind", "unknown"))

    @property
    def licence(self) -> str:
        """SPDX expression of the scene."""
        return licence_of(self.scene)

    @property
    def attribution(self) -> str:
        """Title, author and licence of every part of the scene."""
        return attribution_of(self.scene)

    @property
    def plan(self) -> str:
        """Floor plan of the scene."""
        return self.scene.plan or self.scene.scene_id

    @property
    def material_names(self) -> list[str]:
        """Names of the scene's materials, of the labels' frame if there is one."""
        frame = self.frames.get("labels") or self.frames["materials"]
        return [str(name) for name in frame.meta["material_names"]]

    @property
    def layout(self) -> dict[str, Any]:
        """Rooms of the scene."""
        return room_layout(self.scene, self.view)

    @property
    def lights(self) -> AnyArray:
        """Images of the light groups, float16 (n, H, W, 3)."""
        return light_groups(self.frames["light"], len(self.facts["light"]["light_names"]))

    @property
    def noise_lights(self) -> Float32Array:
        """Relative noise of the light groups, (n,)."""
        return np.array(self.facts["light"]["noise_lights"], dtype=np.float32)


def make_row(columns: Iterable[Column], source: RowSource, preview_width: int) -> dict[str, Any]:
    """Return one row by column name; images are arrays in the precision of the frames.

    Radiance is divided by `radiance_scale`; exposures are of radiance in the renderer's unit.
    """
    cells = {column.name: column.value(source) for column in columns if column.value}
    return {**preview_cells(cells, preview_width), **cells}


def image_cells(frames: Frames) -> dict[str, AnyArray]:
    """Return the images of all channels that the frames hold or derive, by column name."""
    return {
        channel.name: remainder(channel, frames)
        if channel.remainder
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


def _preview(row: Cells, preview: Preview) -> Picture:
    """Draw the image that a preview shows; colours are photographed as it says."""
    channel = column_channel(preview.shows)
    if channel.unit != RADIANCE or not channel.shape:
        return channel_picture(preview.shows, row)
    unit = np.float32(row["radiance_scale"])
    metered = preview.metered if preview.metered in row else preview.shows
    settings = meter(row[metered].astype(np.float32) * unit)
    settings = replace(settings, gain=settings.gain * 2**preview.stops)
    return photograph(row[preview.shows].astype(np.float32) * unit, settings)


def preview_cells(row: Cells, width: int) -> dict[str, dict[str, Any]]:
    """Return the pictures of a row by column, encoded and named, at most `width` pixels wide."""
    cells = {}
    for preview in PREVIEWS:
        if preview.shows not in row:
            continue
        picture = fit(_preview(row, preview), width)
        # Flat colours: smaller and sharper as PNG. The first has always been one.
        lossless = preview.name == "preview" or column_channel(preview.shows).is_label
        content = png_bytes(picture) if lossless else jpeg_bytes(picture)
        name = "-".join([row["scene_id"], row["view_id"], *preview.name.split("_")[1:]])
        cells[preview.name] = {"bytes": content, "path": f"{name}.{'png' if lossless else 'jpg'}"}
    return cells
