"""Geometry that rays are traced against, and what a ray finds."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Literal, TypeVar

from pbrnet.scenes.arrays import BoolArray, Float32Array, Int32Array

T = TypeVar("T")
Way = Literal["eval_1", "eval", "eval_3", "eval_1_grad"]  # of evaluating a texture
Mirror = Literal["", "front", "both"]  # sides of a shape that are a perfect mirror
MAX_LAYERS = 16  # clear surfaces that one ray may pass: a glass cabinet, a glass door and so on

MAX_SURFACES = 512  # that one ray may meet where it goes on behind each


@dataclass(frozen=True)
class SceneGeometry:
    """Shapes of a loaded scene, with the properties that ray casting needs.

    `objects[i]` is the object index of shape i (-1: belongs to no object), `clear[i]` says that
    camera rays pass shape i undeviated, `masked[i]` that its BSDF has an alpha mask, `mirrors[i]`
    how it is a perfect mirror, `transmitted[i]` the part of its diffuse light that leaves on the
    other side, as through cloth.
    """

    scene: Any  # mi.Scene
    shapes: tuple[Any, ...]
    objects: Int32Array
    clear: BoolArray
    masked: BoolArray
    mirrors: tuple[Mirror, ...]
    transmitted: Float32Array
    reflectances: tuple[Any, ...]  # reflectance twin of each shape's BSDF

    def cached(self, key: str, make: Callable[[], T]) -> T:
        """Return what `make` returned when it was first called for this key."""
        if key not in self.__dict__:
            object.__setattr__(self, key, make())
        found: T = self.__dict__[key]
        return found


@dataclass(frozen=True)
class TextureSlot:
    """One texture of each shape's material, evaluated where rays hit.

    `way` is the texture's method, `bands` the number of values that it returns, `textures[i]` the
    texture of shape i or None.
    """

    way: Way
    bands: int
    textures: tuple[Any, ...]


@dataclass(frozen=True)
class Hits:
    """First visible surface along each of N rays; where `shape` is -1 all else is 0.

    `distance` is in metres along the ray (infinite: no surface), `position` (N, 3) in world
    metres. `geometric_normal` and `shading_normal` are unit vectors (N, 3) as modelled, not
    flipped towards the ray. `reflectance` (N, 3) is linear RGB in [0, 1].
    """

    shape: Int32Array
    distance: Float32Array
    position: Float32Array
    geometric_normal: Float32Array
    shading_normal: Float32Array
    reflectance: Float32Array
