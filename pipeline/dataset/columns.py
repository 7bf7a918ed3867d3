"""Table of the dataset's columns: types, shapes, units, meaning, and how their values are made.

Schema, rows, dataset card and Croissant description are made from this module. `columns.toml` holds
the table; image columns follow from `pbrnet.pipeline.channels`. An image is a `.npy` file of its
byte planes in a binary cell (`pbrnet.pipeline.dataset.parquet`), so that NumPy alone restores it
whatever program reads the table; type and shape also stand in the field's metadata. Small matrices
are nested lists. docs/dataset.md compares this form with others.
"""

from __future__ import annotations

import json
import math
import tomllib
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa

from pbrnet.pipeline.channels import RADIANCE, SETS, Channel, Kind, dataset_channels, paper_columns
from pbrnet.pipeline.params import Params
from pbrnet.pipeline.views import View
from pbrnet.scenes.checked import plain
from pbrnet.scenes.contract import Scene
from pbrnet.scenes.importing.semantics import (
    CATEGORY_LABELS,
    NYU13_NAMES,
    NYU13_OF_NYU40,
    NYU40_NAMES,
    NYU40_OF_CATEGORY,
)

# In the metadata of every shard, and beside the shards: what the numbers in label images mean.
CLASSES = {
    "category": list(CATEGORY_LABELS),
    "nyu40": list(NYU40_NAMES),
    "nyu13": list(NYU13_NAMES),
    "nyu40_of_category": list(NYU40_OF_CATEGORY),
    "nyu13_of_nyu40": list(NYU13_OF_NYU40),
}


@dataclass(frozen=True)
class Column:
    """A column; for a scalar `shape` is empty and `dtype` is the type of the column.

    `value` takes a cell from a `pbrnet.pipeline.dataset.rows.RowSource`; previews have none, they
    are drawn from the other cells.
    """

    name: str
    dtype: pa.DataType
    description: str
    unit: str = ""
    shape: tuple[int, ...] = ()
    value: Callable[[object], Any] | None = None

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
    def dtype_name(self) -> str:
        """Name of `dtype`, of numbers NumPy's."""
        names = {"halffloat": "float16", "float": "float32", "double": "float64"}
        return names.get(str(self.dtype), str(self.dtype))

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
PREVIEW = pa.struct([("bytes", pa.binary()), ("path", pa.string())])
# Of all images of radiance in a row.
_RADIANCE = f"radiance_scale {RADIANCE}"


@dataclass(frozen=True)
class Preview:
    """A small 8-bit picture of a row: its column, the image column it shows, and what it is.

    Radiance is photographed with the exposure of the image `metered`, `stops` brighter.
    """

    name: str
    shows: str
    description: str
    metered: str = ""
    stops: int = 0


_ARROW = {"json": pa.string(), "names": NAMES}
_UNITS = {"radiance": RADIANCE, "stored radiance": _RADIANCE}
_TABLE = tomllib.loads(Path(__file__).with_name("columns.toml").read_text(encoding="utf-8"))
_DESCRIPTIONS = _TABLE.pop("descriptions")
# In the order in which viewers show them; each is in the dataset if the column that it shows is.
PREVIEWS = tuple(Preview(name, **entry) for name, entry in _TABLE.pop("previews").items())
_WHEN = {group: {*entries.pop("when", [group])} for group, entries in _TABLE.items()}


def dataset_columns(params: Params) -> tuple[Column, ...]:
    """Return all columns, in order, of a dataset with these parameters."""
    image, kinds = params.image, params.kinds
    paper, kept = SETS["paper"], paper_columns(params.channels)
    lights = params.light.images if "light" in kinds else 0
    conditions = {
        "lights": lights,
        "links": "video" in kinds or params.cameras.has_links,
        "distortion": image.coefficients,
        "aperture": params.optics.f_number,
        "shutter": params.optics.moves,
    }
    words = {"row", "camera", image.projection, *kinds}
    words |= {word for word, holds in conditions.items() if holds}
    lengths = {"n": lights, "w": image.width, "h": image.height, "k": image.coefficients}

    def facts(*groups: str) -> Iterator[Column]:
        return (
            _fact(name, entry, lengths)
            for group in groups
            if _WHEN[group] & words
            for name, entry in _TABLE[group].items()
            if _origin(name, entry) in (*kinds, "")
        )

    def images(*among: Kind) -> Iterator[Column]:
        return (
            _image_column(channel, params.size_of(channel.kind))
            for channel in dataset_channels([kind for kind in among if kind in kinds])
            if channel.kind not in paper or channel.name in kept
        )

    sampled: tuple[Kind, ...] = ("visibility", "noisy")
    columns = [
        *facts("row"),
        *images(*paper),
        *facts("camera"),
        *images(*sampled),
        *facts("noisy"),
        *images(*(kind for kind in kinds if kind not in (*paper, *sampled))),
        *facts(*(group for group in _TABLE if group not in ("row", "camera", "noisy"))),
    ]
    if image.projection != "perspective" or image.coefficients:
        other = _DESCRIPTIONS[image.projection]
        columns = [
            replace(one, description=other.get(one.name, one.description)) for one in columns
        ]
    names = {column.name for column in columns}
    previews = (
        Column(one.name, PREVIEW, f"8-bit sRGB picture, to look at: {one.description}.")
        for one in PREVIEWS
        if one.shows in names
    )
    return (*previews, *columns)


def _origin(name: str, entry: Mapping[str, Any]) -> str:
    """Return the kind of frames that a column of `columns.toml` tells of; "" for any."""
    first, *rest = entry.get("value", name).split(".")
    of_frames = first in ("facts", "exposures", "noises")
    return rest[0] if of_frames else str(entry.get("of", ""))


def _fact(name: str, entry: Mapping[str, Any], lengths: Mapping[Any, int]) -> Column:
    """Return a column of `columns.toml`; `lengths` are those that its shape names."""
    kind, unit = entry["type"], entry.get("unit", "")
    return Column(
        name,
        _ARROW.get(kind) or pa.type_for_alias(kind),
        entry["description"],
        _UNITS.get(unit, unit),
        tuple(lengths.get(length, length) for length in entry.get("shape", ())),
        partial(_value, entry.get("value", name), entry.get("null_unless"), kind == "json"),
    )


def _value(path: str, condition: str | None, as_json: bool, source: object) -> Any:
    """Return the value at a path of attributes and keys, such as `facts.color.spp`, or None."""
    if condition and not _value(condition, None, False, source):
        return None
    for name in path.split("."):
        source = source.get(name) if isinstance(source, dict) else getattr(source, name)
    return json_text(source) if as_json else source


def _image_column(channel: Channel, size: tuple[int, int]) -> Column:
    """Return the column of an image channel of this (width, height)."""
    return Column(
        channel.name,
        pa.from_numpy_dtype(channel.dataset_dtype),
        channel.description,
        _RADIANCE if channel.unit == RADIANCE else channel.unit,
        (*size[::-1], *channel.shape),
        partial(_value, f"images.{channel.name}", None, False),
    )


# Types of all columns but images, in any dataset; lists of any length where datasets differ in it.
TYPES = {
    **{preview.name: PREVIEW for preview in PREVIEWS},
    **{
        name: _fact(name, entry, {"n": -1, "k": -1}).type
        for entries in _TABLE.values()
        for name, entry in entries.items()
        if "h" not in entry.get("shape", ())
    },
}


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
    feature: dict[str, Any] = {"dtype": column.dtype_name, "_type": "Value"}
    for length in reversed(column.shape):
        # "Sequence" is understood by old and new releases of `datasets`, "List" by new ones only.
        feature = {"feature": feature, "length": length, "_type": "Sequence"}
    return feature


def room_layout(scene: Scene, view: View) -> dict[str, Any]:
    """Return the rooms of a scene in world metres, and which of them the camera is in.

    Each room has its floor polygon, floor and ceiling height, and its `openings` to the outside:
    windows and doors with polygon, outward normal, and whether light passes them. `doors` are the
    door leaves of the whole scene, inner ones too, by their bounds.
    """
    rooms = []
    for room in scene.rooms:
        openings = [
            {key: value for key, value in plain(portal).items() if key != "room"}
            for portal in scene.portals
            if portal.room == room.id
        ]
        rooms.append({**plain(room), "openings": openings})
    doors = [
        {"object": item.id, "bbox_min": list(item.bbox_min), "bbox_max": list(item.bbox_max)}
        for item in scene.objects
        if item.category == "door"
    ]
    return {"room": view.room or None, "rooms": rooms, "doors": doors}


def json_text(value: Any) -> str:
    """Return compact JSON."""
    return json.dumps(value, ensure_ascii=False, separators=(",", ":"))
