"""Content of a model file of any format: shapes, emission, lights, cameras and names.

This is the whole contract between a reader (`options.READERS`) and the import.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

import numpy as np

from pbrnet.scenes.arrays import Float64Array
from pbrnet.scenes.color import Color
from pbrnet.scenes.importing.camera import Camera
from pbrnet.scenes.importing.shape import Shape


@dataclass(frozen=True)
class Emission:
    """Emission of a surface in the file's unit: linear RGB, times an image if there is one."""

    color: Color
    image: Path | None = None
    to_uv: Float64Array | None = None  # (4, 4), transform of its texture coordinates


@dataclass(frozen=True)
class PunctualLight:
    """A light without extent that shines along -Z of `pose` (KHR_lights_punctual)."""

    kind: Literal["point", "spot", "directional"]
    color: Color  # linear RGB, a factor of the intensity
    intensity: float  # candela; lux for directional lights
    pose: Float64Array  # (4, 4), to the file's world
    inner: float = 0.0  # radians from the axis to the edge of the full intensity
    outer: float = 0.25 * np.pi  # radians from the axis to the edge of the cone
    name: str = ""


@dataclass
class Model:
    """Everything read from a file, in the file's axes and units."""

    shapes: list[Shape] = field(default_factory=list)
    emissions: dict[str, Emission] = field(default_factory=dict)  # by shape id
    lights: list[PunctualLight] = field(default_factory=list)
    cameras: list[Camera] = field(default_factory=list)
    # Shape id -> "number:name" of each node that contains the shape, outermost first.
    node_paths: dict[str, tuple[str, ...]] = field(default_factory=dict)
    up: Literal["", "x", "y", "z"] = ""  # axis that the file states as up; empty if it states none
    unit: float | None = None  # metres, if the file states a unit
    outdoors: bool = False  # whether sun and sky replace a light of the file
    kind: str = ""  # name of the format, for `scene.json`
    version: str = ""  # of the format
    author: str = ""  # empty if the file does not state it
    licence: str = ""
    package: Path | None = None  # folder to which a file with images inside was unpacked
    described: dict[str, Any] | None = None  # what `pbrnet export-scene` wrote of its scene
