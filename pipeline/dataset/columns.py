"""Columns of the dataset: types, shapes, units and meaning.

The Parquet schema, the dataset card and the Croissant description are made from this module.
An image is a `.npy` file of its byte planes in a binary cell (`pbrnet.pipeline.dataset.parquet`),
so that NumPy alone restores it whatever program reads the table; type and shape also stand in the
field's metadata. Small matrices are nested lists. docs/dataset.md compares this form with others.
"""

from __future__ import annotations

import json
import math
from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pyarrow as pa

from pbrnet.pipeline.cameras.settings import Projection
from pbrnet.pipeline.channels import (
    RADIANCE,
    SETS,
    ChannelSet,
    Kind,
    dataset_channels,
    kinds_of_sets,
)
from pbrnet.pipeline.dataset.label_tables import CLASSES, json_text


@dataclass(frozen=True)
class Column:
    """A column; for a scalar `shape` is empty and `dtype` is the type of the column."""

    name: str
    dtype: pa.DataType
    description: str
    unit: str = ""
    shape: tuple[int, ...] = ()

    @property
    def length(self) -> int:
        """Number of values in one cell."""
        return math.prod(self.shape)

    @property
    def is_image(self) -> bool:
        """True for images and panoramas, which are large and never searched by value."""
        return len(self.shape) >= 2 and self.length > 16

    @property
    def image_bytes(self) -> int:
        """Bytes of the values of one image; 0 for other columns."""
        return self.length * self.numpy_dtype.itemsize if self.is_image else 0

    @property
    def numpy_dtype(self) -> np.dtype[Any]:
        """NumPy type of the values of an image."""
        return np.dtype(self.dtype.to_pandas_dtype())

    @property
    def type(self) -> pa.DataType:
        """Arrow type of the column."""
        if self.is_image:
            return pa.binary()
        kind = self.dtype
        for length in reversed(self.shape):
            kind = pa.list_(pa.field("item", kind, nullable=False), length)
        return kind

    @property
    def field(self) -> pa.Field:
        """Arrow field with description, unit, shape and an image's type as metadata."""
        metadata = {"description": self.description}
        if self.unit:
            metadata["unit"] = self.unit
        if self.shape:
            metadata["shape"] = json.dumps(list(self.shape))
        if self.is_image:
            metadata |= {"dtype": self.numpy_dtype.name, "encoding": ENCODING}
        return pa.field(self.name, self.type, nullable=not self.is_image, metadata=metadata)


FORMAT = "2"  # of shards, in their metadata; 1: images as flat lists of numbers
ENCODING = "npy byte planes"  # of images in their cells
NAMES = pa.list_(pa.string())  # a list of any length
NOISE_OF_PARTS = ("direct", "indirect", "diffuse", "specular", "irradiance")
_LEFT = "Relative noise that the denoiser leaves, an estimate without its bias,"
_UNKNOWN = "null: no denoiser, or a single block of samples."
# Of all images of radiance in a row.
_RADIANCE = f"radiance_scale {RADIANCE}"
PREVIEW = pa.struct([("bytes", pa.binary()), ("path", pa.string())])


@dataclass(frozen=True)
class Preview:
    """A small 8-bit picture of a row: its column, the image column it shows, and what it is."""

    name: str
    shows: str
    description: str


# In the order in which viewers show them; each is in the dataset if the column that it shows is.
PREVIEWS = (
    Preview("preview", "color", "color, as an automatic camera makes it"),
    Preview("preview_dark", "color", "color, exposed two stops less"),
    Preview("preview_bright", "color", "color, exposed two stops more"),
    Preview("preview_shading", "shading", "shading, by a camera of its own"),
    Preview("preview_depth", "depth", "depth, logarithmic: near is bright, no surface grey"),
    Preview("preview_normal", "normal", "normal: red right, green up, blue to the camera"),
    Preview("preview_reflectance", "reflectance", "reflectance"),
    Preview("preview_lights", "intensity", "intensity of the panorama, logarithmic"),
    Preview("preview_roughness", "roughness", "roughness: polished is black, matt is white"),
    Preview("preview_material", "material", "a colour for each material"),
    Preview("preview_instance", "instance", "a colour for each object"),
    Preview("preview_nyu40", "nyu40", "a colour for each NYU40 class"),
    Preview("preview_indirect", "indirect", "indirect light, exposed as color"),
    Preview("preview_flow", "flow_forward", "flow to the next frame: hue is direction"),
    Preview("preview_environment", "environment", "panorama of all around, exposed as color"),
    Preview("preview_noisy", "noisy_color", "noisy_color, exposed as color"),
)


def dataset_columns(
    size: tuple[int, int],
    panorama: tuple[int, int],
    shadows: bool = False,
    noisy: bool = False,
    channels: Sequence[ChannelSet] = ("paper",),
    links: bool = False,
    environment: tuple[int, int] = (256, 128),
    lights: int = 0,
    projection: Projection = "perspective",
) -> tuple[Column, ...]:
    """Return all columns, in order, for images and panoramas of these (width, height).

    `shadows` adds the column of visibility frames, `noisy` those of noisy frames, `channels` those
    of further sets, and `links` those that say which rows belong together, at the end.
    `environment` is the size of that set's panoramas, `lights` the number of light groups. Images
    of an equirectangular `projection` have a column that says so, and distances as depth.
    """
    paper = SETS["paper"]
    further = tuple(kind for kind in kinds_of_sets(channels) if kind not in paper)
    text, single, double = pa.string(), pa.float32(), pa.float64()
    columns = (
        Column("scene_id", text, "Scene; with view_id it names the row."),
        Column("view_id", text, "View within the scene."),
        Column("split", text, "train, validation or test; whole floor plans, never single views."),
        Column("room_type", text, "living, bedroom, kitchen, bathroom, study, dining or other."),
        Column("lighting", text, "Light setting: day, evening, night, mixed or unknown."),
        Column("width", pa.int32(), "Width of the images.", "pixel"),
        Column("height", pa.int32(), "Height of the images.", "pixel"),
        *_image_columns(paper, size, panorama),
        Column("K", double, "Camera intrinsics; pixel centres at +0.5.", "pixel", (3, 3)),
        Column(
            "camera_to_world",
            double,
            "Pose; camera axes x right, y down, z forward; world Z up.",
            "metre",
            (4, 4),
        ),
        Column(
            "radiance_scale",
            single,
            "Unit of the row's radiance, a power of two: radiance in the renderer's unit is "
            f"radiance_scale times the image, for every image with the unit {_RADIANCE}.",
            RADIANCE,
        ),
        Column(
            "exposure_shading",
            double,
            "Scale before tone mapping of radiance_scale x shading, by its log average.",
        ),
        Column("white_shading", double, "Luminance of shading, so scaled, that maps to white."),
        Column(
            "exposure_color",
            double,
            "Scale before tone mapping of radiance_scale x color, by its log average.",
        ),
        Column("white_color", double, "Luminance of color, so scaled, that maps to white."),
        Column("spp", pa.int32(), "Samples per pixel of shading and color."),
        Column("noise_shading", single, "Relative noise of shading as traced, an estimate."),
        Column("noise_color", single, "Relative noise of color as traced, an estimate."),
        Column("denoiser", text, "Denoiser of shading and color, and its version; null: none."),
        Column("residual_noise_shading", single, f"{_LEFT} of shading; {_UNKNOWN}"),
        Column("residual_noise_color", single, f"{_LEFT} of color; {_UNKNOWN}"),
        Column("score", single, "Camera score: how much furniture the view shows."),
        Column("objects", pa.int32(), "Pieces of furniture that cover over 1 % of the view each."),
        Column("seed", pa.int64(), "Seed of the path tracer; 64 bits in two's complement."),
        Column(
            "renderer", text, "Renderer, version, variant, and the processor's instruction set."
        ),
        Column("source", text, "Where the scene came from."),
        Column("licence", text, "Licence of the scene's parts, SPDX expression."),
        Column("attribution", text, "Title, author and licence of every part of the scene."),
        *(_image_columns(("visibility",), size, panorama) if shadows else ()),
        *(_noisy_columns(size, panorama) if noisy else ()),
        *_image_columns(further, size, environment),
        *(_table_columns(further)),
        *(_light_columns(size, lights) if lights else ()),
        *(_link_columns() if links else ()),
    )
    if projection != "perspective":
        columns = _equirectangular(columns)
    return (*_preview_columns({column.name for column in columns}), *columns)


def _equirectangular(columns: tuple[Column, ...]) -> tuple[Column, ...]:
    """Return the columns of a dataset of equirectangular views."""
    described = {
        "depth": "Distance along the ray through the pixel's centre, not z-depth; 0: no surface.",
        "K": "Null: equirectangular images have no intrinsics.",
    }
    told = Column(
        "projection",
        pa.string(),
        "equirectangular: images show all directions, the centre column straight ahead, right of "
        "it the camera's right, top row up.",
    )
    return (
        *(replace(one, description=described.get(one.name, one.description)) for one in columns),
        told,
    )


def _preview_columns(names: Collection[str]) -> tuple[Column, ...]:
    """Return the columns of small pictures of the image columns `names`."""
    return tuple(
        Column(preview.name, PREVIEW, f"8-bit sRGB picture, to look at: {preview.description}.")
        for preview in PREVIEWS
        if preview.shows in names
    )


def _image_columns(
    kinds: tuple[Kind, ...], size: tuple[int, int], panorama: tuple[int, int]
) -> tuple[Column, ...]:
    """Return the columns of the image channels of these kinds of frames."""
    columns = []
    for channel in dataset_channels(kinds):
        width, height = panorama if channel.is_panorama else size
        dtype = pa.from_numpy_dtype(channel.dataset_dtype)
        columns.append(
            Column(
                channel.name,
                dtype,
                channel.description,
                _RADIANCE if channel.unit == RADIANCE else channel.unit,
                (height, width, *channel.shape),
            )
        )
    return tuple(columns)


def _table_columns(kinds: tuple[Kind, ...]) -> tuple[Column, ...]:
    """Return the columns that say what images of these kinds mean, and how they were made."""
    text, columns = pa.string(), []
    if "light" in kinds:
        columns += [
            Column(f"noise_{part}", pa.float32(), f"Relative noise estimate of {part}.")
            for part in NOISE_OF_PARTS
        ]
    if "materials" in kinds or "labels" in kinds:
        meaning = "Names of the scene's materials; material i is entry i - 1."
        columns.append(Column("material_names", NAMES, meaning))
    if "environment" in kinds:
        columns += [
            Column("environment_spp", pa.int32(), "Samples per pixel of environment."),
            Column("noise_environment", pa.float32(), "Relative noise estimate of environment."),
        ]
    if "labels" in kinds:
        columns += [
            Column(
                "instances",
                text,
                "JSON: every instance that is seen, with its classes, visible fraction, occlusion, "
                "truncation and oriented 3D box.",
                "metre, pixel",
            ),
            Column(
                "layout",
                text,
                "JSON: the rooms' floor polygons, floor and ceiling heights and openings.",
                "metre",
            ),
            Column(
                "light_sources",
                text,
                "JSON: the lights that are on, with place, radiant flux (unit of radiance_scale "
                "times m^2 sr) and lumens.",
                "metre",
            ),
        ]
    return tuple(columns)


def _link_columns() -> tuple[Column, ...]:
    """Return the columns that link rows with each other."""
    return (
        Column("plan", pa.string(), "Floor plan; scenes of one plan differ in furniture or light."),
        Column("trajectory", pa.string(), "Trajectory within the scene; null: a single view."),
        Column("frame", pa.int32(), "Number of the frame in its trajectory, from 0."),
        Column(
            "stereo_partner", pa.string(), "View id of the other view of a stereo pair, or null."
        ),
        Column(
            "stereo_offset",
            pa.float64(),
            "Distance from this camera to its partner, along this camera's x axis.",
            "metre",
        ),
        Column("view_set", pa.string(), "Overlapping set of views within the scene, or null."),
        Column("set_overlap", pa.float64(), "Median overlap of the set's pairs of views, 0 to 1."),
    )


def _light_columns(size: tuple[int, int], count: int) -> tuple[Column, ...]:
    """Return the columns of `count` light groups."""
    width, height = size
    return (
        Column(
            "lights",
            pa.float16(),
            "Parts of color: light from the sky, from the sun, from single lamps, from all others. "
            "Their sum is color.",
            _RADIANCE,
            (count, height, width, 3),
        ),
        Column("light_names", NAMES, "Name of each image in lights; empty: no such light."),
        Column("noise_lights", pa.float32(), "Relative noise estimates of lights.", "", (count,)),
    )


def _noisy_columns(size: tuple[int, int], panorama: tuple[int, int]) -> tuple[Column, ...]:
    spp = Column("noisy_spp", pa.int32(), "Samples per pixel of noisy_color and noisy_shading.")
    return (*_image_columns(("noisy",), size, panorama), spp)


def arrow_schema(columns: tuple[Column, ...]) -> pa.Schema:
    """Return the Parquet schema, with the features that Hugging Face `datasets` reads."""
    features = {column.name: _feature(column) for column in columns}
    huggingface = json.dumps({"info": {"features": features}}, sort_keys=False)
    metadata = {"huggingface": huggingface, "pbrnet": FORMAT}
    if "category" in features:
        metadata["classes"] = json_text(CLASSES)
    return pa.schema([column.field for column in columns], metadata=metadata)


def _feature(column: Column) -> dict[str, Any]:
    if column.dtype == PREVIEW:
        return {"_type": "Image"}
    if column.dtype == NAMES:
        return {"feature": {"dtype": "string", "_type": "Value"}, "length": -1, "_type": "Sequence"}
    if column.is_image:
        return {"dtype": "binary", "_type": "Value"}
    names = {"halffloat": "float16", "float": "float32", "double": "float64"}
    feature: dict[str, Any] = {
        "dtype": names.get(str(column.dtype), str(column.dtype)),
        "_type": "Value",
    }
    for length in reversed(column.shape):
        # "Sequence" is understood by old and new releases of `datasets`, "List" by new ones only.
        feature = {"feature": feature, "length": length, "_type": "Sequence"}
    return feature
