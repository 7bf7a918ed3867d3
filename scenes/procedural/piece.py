"""What furniture is made of: materials asked for, parts, lamps, and how a piece wants to stand.

A piece lives in its own frame: metres, Z up, origin at the centre of its footprint on the
surface that carries it (floor, table top; the ceiling for hanging pieces, where z <= 0; the
wall for mounted pieces, where the wall is the plane y = 0). Its back is towards +Y, its front
faces -Y.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from scenes.arrays import Float64Array, Int64Array
from scenes.color import Color

MaterialKind = Literal[
    "wood",  # grain along u
    "planks",  # floor boards, laid along u
    "tiles",
    "brick",
    "fabric",  # woven; sofas, curtains, bedding
    "carpet",
    "leather",
    "plaster",  # walls and ceilings
    "wallpaper",
    "stone",  # worktops, sills
    "paint",  # smooth coat, no texture
    "plastic",
    "metal",
    "mirror",
    "glass",  # clear, thin or solid ornament, never window panes
    "ceramic",
    "paper",  # book pages, pictures, lampshades
    "leaf",
    "grass",
    "soil",
    "picture",  # an abstract picture over uv [0, 1]
]
Anchor = Literal["wall", "corner", "centre", "free", "on_top", "on_wall", "ceiling"]
CREASE = float(np.cos(np.radians(50)))


@dataclass(frozen=True)
class Material:
    """A material asked for; `materials` turns it into a BSDF and its textures.

    `color` is the mean reflectance, linear RGB in [0, 1] (F0 for metals). Textures are laid out
    in metres: one uv unit is one metre, except for "picture".
    """

    kind: MaterialKind
    color: Color
    roughness: float = 0.5  # perceptual, [0, 1]; GGX alpha is its square
    accent: Color | None = None  # grout, second yarn, knots
    scale: float = 1.0  # size of the pattern, 1 is the usual one of its kind
    variant: int = 0  # seed of the pattern
    translucent: bool = False  # lets light through, as lampshades and thin curtains do


@dataclass(frozen=True)
class BoughtMaterial:
    """A material of a catalogue piece. `color` is linear RGB; `texture`, `alpha` are image files.

    Texture coordinates are Mitsuba's: the unit square is the image, v = 0 its top row.
    """

    kind: Literal["matt", "gloss", "metal", "mirror", "glass", "sheer"]
    color: Color
    roughness: float = 1.0
    opacity: float = 1.0  # "sheer": the rest of the light goes straight through
    texture: str | None = None
    alpha: str | None = None


@dataclass(frozen=True)
class Credit:
    """Whose work a catalogue piece is, on what terms, and where it came from."""

    author: str
    licence: str
    library: str
    source: str


@dataclass(frozen=True)
class Part:
    """One shape: a triangle mesh of one material.

    `vertices` float (V, 3) metres; `faces` int (F, 3), counter-clockwise seen from outside;
    `uvs` float (V, 2), in metres; `smooth` asks for the vertex normals of `normals`, else facets.
    """

    name: str
    vertices: Float64Array
    faces: Int64Array
    uvs: Float64Array
    material: Material | BoughtMaterial
    smooth: bool = False
    lumens: float = 0.0  # above 0: this part emits, lit when the home's lamps are on
    kelvin: float = 2800.0  # colour temperature of what it emits
    given: Float64Array | None = None  # unit vertex normals that came with the mesh

    @property
    def normals(self) -> Float64Array:
        """Unit vertex normals (V, 3): those given, else weighted by area and angle.

        Vertices at one place share theirs where the surface turns by less than 50 degrees, so
        seams of the uvs stay invisible and creases stay sharp.
        """
        if self.given is not None:
            return self.given
        corners = self.vertices[self.faces]
        facets = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        doubled = np.linalg.norm(facets, axis=1)
        own = np.zeros_like(self.vertices)
        for corner in range(3):
            first = corners[:, (corner + 1) % 3] - corners[:, corner]
            second = corners[:, (corner + 2) % 3] - corners[:, corner]
            angle = np.arctan2(doubled, (first * second).sum(axis=1))
            np.add.at(own, self.faces[:, corner], angle[:, None] * facets)
        unit = own / np.maximum(np.linalg.norm(own, axis=1, keepdims=True), 1e-30)
        places = _places(self.vertices, 1e-6)
        order = np.argsort(places, kind="stable")
        shared = own.copy()
        sorted_places = places[order]
        for step in range(1, int(np.bincount(places).max(initial=1))):
            pairs = np.flatnonzero(sorted_places[:-step] == sorted_places[step:])
            one, other = order[pairs], order[pairs + step]
            alike = (unit[one] * unit[other]).sum(axis=1) > CREASE
            one, other = one[alike], other[alike]
            np.add.at(shared, one, own[other])
            np.add.at(shared, other, own[one])
        length = np.linalg.norm(shared, axis=1, keepdims=True)
        return np.where(length > 0, shared / np.maximum(length, 1e-30), [0.0, 0.0, 1.0])


@dataclass(frozen=True)
class Surface:
    """A horizontal rectangle other pieces may stand on: centre x, y, height z, half sizes."""

    x: float
    y: float
    z: float
    half_x: float
    half_y: float
    headroom: float = 10.0  # metres free above it


@dataclass(frozen=True)
class Piece:
    """A piece of furniture or a fitting, ready to be placed."""

    name: str
    category: str
    parts: tuple[Part, ...]
    anchor: Anchor
    front_clearance: float = 0.0  # metres to keep free before it, for use
    side_clearance: float = 0.0
    surfaces: tuple[Surface, ...] = ()
    mount_height: float = 0.0  # on_wall: height of the origin above the floor
    boxes: Float64Array | None = None  # (N, 2, 3): hold all of it; None: see `bodies`
    credit: Credit | None = None  # of a piece from a catalogue

    @cached_property
    def bounds(self) -> Float64Array:
        """Axis-aligned bounds in its own frame, (2, 3) metres."""
        points = np.concatenate([part.vertices for part in self.parts])
        return np.stack([points.min(axis=0), points.max(axis=0)])

    @cached_property
    def bodies(self) -> Float64Array:
        """Boxes (N, 2, 3) in its own frame that hold all of it, apart where it leaves room.

        Those given, else the axis-aligned bounds of each connected body of its meshes.
        """
        if self.boxes is not None:
            return self.boxes
        return np.concatenate([_body_bounds(part) for part in self.parts])


def _places(points: Float64Array, apart: float) -> Int64Array:
    """A number for each point (N, 3), equal for those that round to one multiple of `apart`."""
    # One well-mixed 64-bit key a point sorts ten times faster than rows of three.
    cells = np.round(points / apart).astype(np.int64).view(np.uint64)
    factors = np.array([0x9E3779B97F4A7C15, 0xC2B2AE3D27D4EB4F, 0x165667B19E3779F9], np.uint64)
    keys = (cells * factors).sum(axis=1, dtype=np.uint64)
    keys ^= keys >> np.uint64(29)
    return np.unique(keys, return_inverse=True)[1].reshape(-1)


def _body_bounds(part: Part) -> Float64Array:
    # Vertices are split at creases: weld what lies within 0.1 mm, then follow the triangles.
    welded = _places(part.vertices, 1e-4)
    a, b, c = (welded[part.faces[:, k]] for k in range(3))
    count = int(welded.max()) + 1
    links = coo_array(
        (np.ones(2 * len(a), dtype=bool), (np.concatenate([a, b]), np.concatenate([b, c]))),
        shape=(count, count),
    )
    number, labels = connected_components(links, directed=False)
    of_vertex = labels[welded]
    order = np.argsort(of_vertex, kind="stable")
    starts = np.searchsorted(of_vertex[order], np.arange(number))
    points = part.vertices[order]
    return np.stack(
        [np.minimum.reduceat(points, starts), np.maximum.reduceat(points, starts)], axis=1
    )
