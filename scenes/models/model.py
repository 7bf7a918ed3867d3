"""What a model file holds, whatever its format: shapes, what shines, cameras, and names."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

import numpy as np

from scenes.arrays import Float64Array
from scenes.color import Color
from scenes.importing.assembly import Camera
from scenes.importing.shape import Shape


@dataclass(frozen=True)
class Glow:
    """Emission of a surface, in the file's own unit: linear RGB, times an image if there is one."""

    color: Color
    image: Path | None = None
    to_uv: Float64Array | None = None


@dataclass(frozen=True)
class Punctual:
    """A light without extent; it shines along -Z of `pose` (KHR_lights_punctual).

    `intensity` is candela, of a directional light lux; `color` linear RGB; angles radians from
    the axis.
    """

    kind: Literal["point", "spot", "directional"]
    color: Color
    intensity: float
    pose: Float64Array  # (4, 4), file's world
    inner: float = 0.0
    outer: float = 0.25 * np.pi


@dataclass
class Model:
    """Everything read from a file, in its own axes and units."""

    shapes: list[Shape] = field(default_factory=list)
    glows: dict[str, Glow] = field(default_factory=dict)  # by shape id
    lights: list[Punctual] = field(default_factory=list)
    cameras: list[Camera] = field(default_factory=list)
    # Shape id -> the names of the things it is part of, outermost first, made unique.
    owners: dict[str, tuple[str, ...]] = field(default_factory=dict)
    metres: bool = False  # whether the format says that lengths are metres
    y_up: bool = False  # whether the format says that +Y is up
    kind: str = ""
    version: str = ""
    author: str = ""  # as far as the file says
    licence: str = ""
