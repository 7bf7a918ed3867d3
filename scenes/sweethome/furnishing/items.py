"""Data types of an imported home: surface finishes, parts and placed items."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from pbrnet.scenes.arrays import Float64Array
from pbrnet.scenes.color import Color
from pbrnet.scenes.contract import Joint
from pbrnet.scenes.geometry.mesh import Mesh, face_areas, join_meshes


@dataclass(frozen=True)
class SurfaceFinish:
    """Material of a surface. `image` is a file inside the home, in place of `color`.

    `glass` transmits light without refraction, `sheer` a fraction 1 - `opacity` of it.
    """

    kind: Literal["matt", "gloss", "metal", "mirror", "glass", "sheer"] = "matt"
    color: Color = (0.8, 0.8, 0.8)
    image: str | None = None
    roughness: float = 1.0
    opacity: float = 1.0


@dataclass(frozen=True)
class ItemPart:
    """A mesh of one finish in world coordinates; uvs are Mitsuba's (v = 0 at the image's top).

    `radiance` makes it an area light. `ball` (centre, radius) stands for a sphere instead of
    the mesh, which then only tells its bounds.
    """

    mesh: Mesh
    finish: SurfaceFinish
    radiance: Color | None = None
    sphere: tuple[tuple[float, float, float], float] | None = None
    pane: bool = False  # a pane of a window
    emits: bool = False  # its material is a light source of the lamp


@dataclass(frozen=True)
class PlacedItem:
    """One object of the scene, such as a wall or a chair."""

    id: str
    name: str
    category: str
    parts: tuple[ItemPart, ...]
    is_structure: bool = False
    room: str | None = None
    lumens: float = 0.0
    level: int = 0
    joints: tuple[Joint, ...] = ()

    @property
    def bounds(self) -> Float64Array:
        """Axis-aligned bounds (2, 3), metres."""
        bounds = np.array([part.mesh.bounds for part in self.parts])
        return np.stack([bounds[:, 0].min(axis=0), bounds[:, 1].max(axis=0)])

    @property
    def centre(self) -> Float64Array:
        """Centre of the bounds (3,), metres."""
        return self.bounds.mean(axis=0)

    @property
    def sampling_weight(self) -> float:
        """Sampling weight of a lamp: the square root of its flux over 800 lm."""
        return round(math.sqrt(self.lumens / 800.0), 4)


def merge_parts(parts: tuple[ItemPart, ...]) -> list[ItemPart]:
    """Merge parts of equal finish into one mesh each; emitters stay separate."""
    groups: dict[tuple, list[ItemPart]] = {}
    kept: list[ItemPart] = []
    for part in parts:
        if part.radiance is not None or part.sphere is not None:
            kept.append(part)
            continue
        key = (part.finish, part.mesh.normals is None, part.mesh.uvs is None)
        groups.setdefault(key, []).append(part)
    return [_merged_group(group) for group in groups.values()] + kept


def area(mesh: Mesh) -> float:
    """Return the surface area of a mesh, square metres."""
    return float(face_areas(mesh.corners)[0].sum())


def _merged_group(group: list[ItemPart]) -> ItemPart:
    if len(group) == 1:
        return group[0]
    return replace(group[0], mesh=join_meshes([part.mesh for part in group]))
