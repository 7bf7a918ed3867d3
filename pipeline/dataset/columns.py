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
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa

from pbrnet.pipeline.channels import (
    RADIANCE,
    SETS,
    ChannelSet,
    Kind,
    dataset_channels,
    kinds_of_sets,
    paper_columns,
)
from pbrnet.pipeline.views import Projection, View
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


# In the order in which viewers show them; each is in the dataset if the column that it shows is.
PREVIEWS = (
    Preview("preview", "color", "color, as an automatic camera makes it"),
    Preview("preview_dark", "color", "color, exposed two stops less", stops=-2),
    Preview("preview_bright", "color", "color, exposed two stops more", stops=2),
    Preview("preview_shading", "shading", "shading, by a camera of its own"),
    Preview("preview_depth", "depth", "depth, logarithmic: near is bright, no surface grey"),
    Preview("preview_normal", "normal", "normal: red right, green up, blue to the camera"),
    Preview("preview_reflectance", "reflectance", "reflectance"),
    Preview("preview_lights", "intensity", "intensity of the panorama, logarithmic"),
    Preview("preview_roughness", "roughness", "roughness: polished is black, matt is white"),
    Preview("preview_material", "material", "a colour for each material"),
    Preview("preview_instance", "instance", "a colour for each object"),
    Preview("preview_nyu40", "nyu40", "a colour for each NYU40 class"),
    Preview("preview_indirect", "indirect", "indirect light, exposed as color", "color"),
    Preview("preview_flow", "flow_forward", "flow to the next frame: hue is direction"),
    Preview(
        "preview_environment", "environment", "panorama of all around, exposed as color", "color"
    ),
    Preview("preview_noisy", "noisy_color", "noisy_color, exposed as color", "color"),
)


_TYPES = {"json": pa.string(), "names": NAMES}
_UNITS = {"radiance": RADIANCE, "stored radiance": _RADIANCE}
_TABLE = tomllib.loads(Path(__file__).with_name("columns.toml").read_text(encoding="utf-8"))


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
    aperture: bool = False,
    shutter: bool = False,
    distortion: int = 0,
) -> tuple[Column, ...]:
    """Return all columns, in order, for images and panoramas of these (width, height).

    `shadows` adds the column of visibility frames, `noisy` those of noisy frames, `channels` those
    of further sets or of parts of `paper`, and `links` those that say which rows belong together.
    `environment` is the size of that set's panoramas, `lights` the number of light groups. Images
    of another `projection` than perspective, and those with so many coefficients of `distortion`,
    have columns that say so, and other meanings of `depth` and `K`.
    `aperture` and `shutter` add the columns of color that is not that of a pinhole standing still.
    """
    paper, kinds = SETS["paper"], kinds_of_sets(channels)
    kept = paper_columns(channels)
    further = tuple(kind for kind in kinds if kind not in paper)
    groups = {
        "light": "light" in further,
        "materials": {"materials", "labels"} & set(further),
        "environment": "environment" in further,
        "labels": "labels" in further,
        "lights": lights,
        "links": links,
        "equirectangular": projection == "equirectangular",
        "lens": projection in ("fisheye", "orthographic") or distortion,
        "distortion": distortion,
        "aperture": aperture and "color" in kinds,
        "shutter": shutter and "color" in kinds,
    }
    sizes: dict[str | int, int] = {"n": lights, "w": size[0], "h": size[1], "k": distortion}

    def facts(group: str) -> Iterator[Column]:
        return (_fact(name, entry, sizes) for name, entry in _TABLE[group].items())

    columns = [
        *facts("row"),
        *(one for one in _image_columns(paper, size, panorama) if one.name in kept),
        *(one for one in facts("camera") if _origin(one.name) in (*kinds, "")),
        *_image_columns(("visibility",) if shadows else (), size, panorama),
        *_image_columns(("noisy",) if noisy else (), size, panorama),
        *(facts("noisy") if noisy else ()),
        *_image_columns(further, size, environment),
        *(column for group, there in groups.items() if there for column in facts(group)),
    ]
    if projection != "perspective" or distortion:
        other = _TABLE[f"{projection}_descriptions"]
        columns = [
            replace(one, description=other.get(one.name, one.description)) for one in columns
        ]
    return (*_preview_columns({column.name for column in columns}), *columns)


def _origin(name: str) -> str:
    """Return the kind of frames that a column of the group `camera` tells of; "" for any."""
    entry = _TABLE["camera"][name]
    first, *rest = entry.get("value", name).split(".")
    of_frames = first in ("facts", "exposures", "noises")
    return rest[0] if of_frames else str(entry.get("of", ""))


def _fact(name: str, entry: Mapping[str, Any], sizes: Mapping[str | int, int]) -> Column:
    """Return a column of `columns.toml`; `sizes` are the lengths that its shape names."""
    kind, unit = entry["type"], entry.get("unit", "")
    return Column(
        name,
        _TYPES.get(kind) or pa.type_for_alias(kind),
        entry["description"],
        _UNITS.get(unit, unit),
        tuple(sizes.get(length, length) for length in entry.get("shape", ())),
        partial(_value, entry.get("value", name), entry.get("null_unless"), kind == "json"),
    )


def _value(path: str, condition: str | None, as_json: bool, source: object) -> Any:
    """Return the value at a path of attributes and keys, such as `facts.color.spp`, or None."""
    if condition and not _value(condition, None, False, source):
        return None
    for name in path.split("."):
        source = source.get(name) if isinstance(source, dict) else getattr(source, name)
    return json_text(source) if as_json else source


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
                partial(_value, f"images.{channel.name}", None, False),
            )
        )
    return tuple(columns)


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
