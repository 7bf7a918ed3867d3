"""Table of image channels, and the unit in which radiance is stored.

`channels.toml` holds the table. Frame layouts, dataset columns, their cells, the checks, the
dataset card, `pbrnet inspect` and the images that networks take follow from it.

Radiance is stored in a unit that is a power of two per image, so that half floats hold it well. A
half float has 11 bits between 6e-5 and 65504 and loses them below. Rooms at night lie there, in the
unit of the renderer. Stored is radiance / scale; one multiplication by `radiance_scale` undoes it.
A power of two changes no bit of a mantissa.
"""

from __future__ import annotations

import math
import tomllib
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any, Literal, get_args

import numpy as np

from pbrnet.scenes.arrays import AnyArray

Kind = Literal[
    "inputs",
    "illumination",
    "visibility",
    "shading",
    "color",
    "noisy",
    "materials",
    "labels",
    "video",
    "environment",
    "light",
    "transport",
]
KINDS: tuple[Kind, ...] = get_args(Kind)
SURFACES: tuple[Kind, ...] = ("inputs", "materials", "labels", "video")  # of rays, without light
TRUTHS: tuple[Kind, ...] = ("shading", "color")
TRACED: tuple[Kind, ...] = (*TRUTHS, "light")  # by one trace of paths
ChannelSet = Literal[
    "paper",
    "materials",
    "light",
    "labels",
    "environment",
    "video",
    "transport",
    "all",
    "depth",
    "normal",
    "reflectance",
    "illumination",
    "shading",
    "color",
]
# Kinds of frames of each set of the parameter `channels`; `all` stands for every set.
SETS: dict[ChannelSet, tuple[Kind, ...]] = {
    "paper": ("inputs", "illumination", "shading", "color"),
    "materials": ("materials",),
    "labels": ("labels",),
    "video": ("video",),
    "environment": ("environment",),
    "light": ("light",),
    "transport": ("transport",),
}
# Parts of `paper` that may be named in its place, and the kinds of frames that hold them.
PARTS: dict[ChannelSet, Kind] = {
    "depth": "inputs",
    "normal": "inputs",
    "reflectance": "inputs",
    "illumination": "illumination",
    "shading": "shading",
    "color": "color",
}
RADIANCE = "W/(m^2 sr), relative"


@dataclass(frozen=True)
class Channel:
    """One image of a view.

    `name` is the dataset column, `kind` the frame that holds the image, `bands` its EXR channels
    there, each (H, W) of the NumPy type `dtype`. `description` and `unit` are published with the
    dataset. A view is rejected if a `nonnegative` channel holds a value below 0.
    """

    name: str
    kind: Kind
    bands: tuple[str, ...]
    dtype: type
    description: str
    unit: str = ""
    nonnegative: bool = False
    mask: bool = False  # 0 or 1, in the dataset a uint8
    in_dataset: bool = True  # False: in the frame only
    # In the dataset only, computed when it is packed: color less the product of these channels.
    remainder: tuple[str, ...] = ()

    @property
    def dataset_dtype(self) -> type:
        """NumPy type of the dataset's column; torch lacks most operations on unsigned integers."""
        if self.mask:
            return np.uint8
        return np.int32 if self.dtype is np.uint32 else self.dtype

    @property
    def is_panorama(self) -> bool:
        """True for images over the sphere, False for those in the camera's image plane."""
        return self.kind in ("illumination", "environment")

    @property
    def is_label(self) -> bool:
        """True for numbers of materials, objects or classes."""
        return np.issubdtype(self.dtype, np.integer)

    @property
    def is_direction(self) -> bool:
        """True for vectors in camera axes: x right, y down, z forward."""
        return self.bands in (NORMAL, BUMPED)

    @property
    def shape(self) -> tuple[int, ...]:
        """Shape of a pixel's value: () or (bands,); remainders are RGB."""
        count = 3 if self.remainder else len(self.bands)
        return (count,) if count > 1 else ()


def _read_table() -> tuple[Channel, ...]:
    """Channels of `channels.toml`, in its order."""
    table = tomllib.loads(Path(__file__).with_name("channels.toml").read_text(encoding="utf-8"))
    return tuple(
        Channel(
            name,
            kind,  # type: ignore[arg-type]
            tuple(entry.pop("bands", ())),
            getattr(np, entry.pop("type", "float16")),
            unit=entry.pop("unit", "").replace("radiance", RADIANCE),
            remainder=tuple(entry.pop("remainder", ())),
            **entry,
        )
        for kind, entries in table.items()
        for name, entry in entries.items()
    )


CHANNELS = _read_table()
_BANDS = {(channel.kind, channel.name): channel.bands for channel in CHANNELS}
RGB = _BANDS["color", "color"]
NORMAL, ALBEDO = _BANDS["inputs", "normal"], _BANDS["inputs", "reflectance"]
TINT = _BANDS["illumination", "tint"]
BUMPED = _BANDS["materials", "normal_bump"]
SPECULAR = _BANDS["materials", "specular_color"]
HALF, NOISY_SHADING = _BANDS["noisy", "noisy_half"], _BANDS["noisy", "noisy_shading"]
DENOISED, DENOISED_SHADING = (
    _BANDS["noisy", "denoised_color"],
    _BANDS["noisy", "denoised_shading"],
)
DIRECT, DIFFUSE = _BANDS["light", "direct"], _BANDS["light", "diffuse"]
IRRADIANCE = _BANDS["light", "irradiance"]
TRANSPORT_DIRECT = _BANDS["transport", "transport_direct"]
TRANSPORT_INDIRECT = _BANDS["transport", "transport_indirect"]
# Of each direction in time: flow along columns and rows, occlusion, and outside of the image.
VIDEO_BANDS = {
    way: (
        *_BANDS["video", f"flow_{way}"],
        *_BANDS["video", f"occluded_{way}"],
        *_BANDS["video", f"outside_{way}"],
    )
    for way in ("forward", "backward")
}


def channels_of(*kinds: str) -> tuple[Channel, ...]:
    """Return the channels of these kinds of frames, in the order of the table."""
    return tuple(c for c in CHANNELS if c.kind in kinds and not c.remainder)


def dataset_channels(kinds: Sequence[str] = KINDS) -> tuple[Channel, ...]:
    """Return the channels of these kinds that are columns of the dataset.

    An image that two kinds of frames hold (`material`) is a column once, from the first.
    """
    columns: dict[str, Channel] = {}
    for channel in CHANNELS:
        if channel.kind in kinds and channel.in_dataset:
            columns.setdefault(channel.name, channel)
    return tuple(columns.values())


def column_channel(name: str) -> Channel:
    """Return the channel of an image column; raises `KeyError` for any other name."""
    for channel in CHANNELS:
        if channel.name == name and channel.in_dataset:
            return channel
    raise KeyError(name)


def remedy(column: str) -> str:
    """Return what adds a missing column to a dataset: parameters to set, then stages to run."""
    kinds = {channel.name: channel.kind for channel in dataset_channels()}
    kinds |= {"noisy_spp": "noisy", "instances": "labels", "layout": "labels", "lights": "light"}
    kind = kinds.get(column)
    if column in ("trajectory", "frame"):
        setting = "set cameras.walks"
    elif kind == "noisy":
        setting = "set noisy.spp to 1 to 8"
    elif kind == "visibility":
        setting = "set illumination.shadow_rays"
    elif kind is None or kind in SETS["paper"]:
        return "with 'paper' in channels, pack the dataset again with: pbrnet dataset"
    else:
        setting = f"add {kind!r} to channels"
    return f"{setting} in params.yaml, then run: dvc repro dataset"


def kinds_of_sets(sets: Sequence[ChannelSet]) -> tuple[Kind, ...]:
    """Return the kinds of frames of these sets and of `paper`, in the order of `SETS`.

    Of `paper` only inputs and the kinds of its `parts`, if the sets name any.
    """
    chosen = [name for name in SETS if name == "paper" or name in sets or "all" in sets]
    kinds = dict.fromkeys(kind for name in chosen for kind in SETS[name])
    named = {PARTS[name] for name in parts(sets)}
    left_out = {*SETS["paper"]} - {"inputs"} - named if named else set()
    return tuple(kind for kind in kinds if kind not in left_out)


def parts(sets: Sequence[ChannelSet]) -> tuple[ChannelSet, ...]:
    """Return the parts of `paper` that sets name in its place; () stands for all of it."""
    return () if {"paper", "all"} & {*sets} else tuple(name for name in PARTS if name in sets)


def paper_columns(sets: Sequence[ChannelSet]) -> tuple[str, ...]:
    """Return the image columns of `paper` that a dataset of these sets has."""
    named = parts(sets)
    return tuple(
        channel.name
        for channel in dataset_channels(SETS["paper"])
        if not named
        or channel.name in ("valid", *named)
        or (channel.kind != "inputs" and channel.kind in named)
    )


def layout(kind: str, lights: int = 0) -> dict[str, type]:
    """Return the NumPy type of each EXR channel of a kind of frame.

    `lights` is the number of light groups that a `light` frame holds.
    """
    bands = {band: channel.dtype for channel in channels_of(kind) for band in channel.bands}
    return bands | {band: np.float16 for number in range(lights) for band in light_bands(number)}


def light_bands(number: int) -> tuple[str, ...]:
    """Return the EXR channels of a light group."""
    return tuple(f"light{number:02d}.{band}" for band in RGB)


HALF_MAX = float(np.finfo(np.float16).max)
_HEADROOM = 6  # stops that an image may lie below its typical exposure to save its highlights
_LARGEST = 100  # exponent of a scale, so that scales and products fit float32
# Column of the unit of a row's images of radiance; absent from older datasets, where it is 1.
RADIANCE_SCALE = "radiance_scale"
RADIANCES = frozenset(c.name for c in dataset_channels() if c.unit == RADIANCE)


@cache
def radiance_halves(kind: str, lights: int = 0) -> tuple[str, ...]:
    """Return the bands of a kind of frame that hold radiance as half floats.

    `lights` is the number of light groups of a `light` frame.
    """
    other = {
        band for channel in channels_of(kind) if channel.unit != RADIANCE for band in channel.bands
    }
    types = layout(kind, lights)
    return tuple(band for band, dtype in types.items() if dtype is np.float16 and band not in other)


def scale_for(images: Iterable[AnyArray]) -> float:
    """Return the unit of an image, a power of two, from its bands, any shape, radiance.

    The geometric mean of the values above 0 becomes about 0.2, the largest value at most 2^15. An
    image whose highlights would need more than 64 times that mean is clamped at 65504, but never
    below 65504 in the renderer's unit. Black: 1. From exponents alone, in integers: the logarithm
    differs between processors.
    """
    lit = [values[values > 0] for values in map(np.asarray, images)]
    exponents = np.frexp(np.concatenate([values.ravel() for values in lit]))[1].astype(np.int64)
    if not exponents.size:
        return 1.0
    # A value is 2^(exponent - 1/2) on average, and 0.2 is about 2^(-9/4).
    count = exponents.size
    typical = (4 * int(exponents.sum()) + 9 * count) // (4 * count)
    fitting = int(exponents.max()) - 15
    exponent = max(typical, min(fitting, max(0, typical + _HEADROOM)))
    return 2.0 ** max(-_LARGEST, min(_LARGEST, exponent))


def fitting_scale(scale: float, largest: float) -> float:
    """Return the smallest unit from `scale` on in which `largest` fits a half float."""
    while largest > HALF_MAX * scale:
        scale *= 2
    return scale


def is_scale(value: Any) -> bool:
    """Test whether a value can be the unit of an image: a power of two within its bounds."""
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        return False
    if not 2.0**-_LARGEST <= value <= 2.0**_LARGEST:
        return False
    return math.frexp(value)[0] == 0.5
