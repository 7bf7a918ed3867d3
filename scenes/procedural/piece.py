"""Furniture pieces: materials, parts with meshes and light sources, anchors and surfaces.

A piece has its own frame: metres, Z up. The origin is the centre of its footprint on the surface
that carries it (floor or table top; the ceiling for hanging pieces, where z <= 0; the wall for
mounted pieces, where the wall is the plane y = 0). Its back is towards +Y, its front faces -Y.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Literal

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from pbrnet.scenes.arrays import Float64Array, Int64Array
from pbrnet.scenes.assets.free_space import SupportSurface
from pbrnet.scenes.color import Color
from pbrnet.scenes.contract import Joint

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
    "glass",  # clear, for thin bodies and ornaments; windows have no panes
    "ceramic",
    "paper",  # book pages, pictures, lampshades
    "leaf",
    "grass",
    "soil",
    "picture",  # an abstract picture over uv [0, 1]
]
Anchor = Literal["wall", "corner", "centre", "free", "on_top", "on_wall", "ceiling"]
CREASE_COSINE = float(np.cos(np.radians(50)))  # edges that turn by more stay sharp


@dataclass(frozen=True)
class Trace:
    """A trace of use on a surface, along the line from `start` to `end`, (s, t) metres.

    `kind` is one of `pbrnet.scenes.procedural.textures.traces.LOOKS`; `strength` 1 is an old one's.
    """

    kind: str
    start: tuple[float, float]
    end: tuple[float, float]
    radius: float  # metres
    strength: float = 1.0


@dataclass(frozen=True)
class Use:
    """Use of one surface by place: it has images of its own over [`low`, `high`].

    (s, t) are metres in the surface, right-handed seen from its front. `panels` (s0, t0, s1, t1,
    du, dv) say which part of the pattern is where: at (s + du, t + dv) of its uvs.
    """

    low: tuple[float, float]
    high: tuple[float, float]
    panels: tuple[tuple[float, float, float, float, float, float], ...]
    traces: tuple[Trace, ...]
    seed: int = 0


@dataclass(frozen=True)
class Material:
    """A procedural material; `MaterialLibrary` makes a BSDF and textures from it.

    `color` is the mean reflectance, linear RGB in [0, 1] (F0 for metals). Textures are laid out
    in metres: one uv unit is one metre, except for "picture". `family` is a family of surfaces of
    the kind (`pbrnet.scenes.procedural.textures.families`); without one, `variant` chooses.
    """

    kind: MaterialKind
    color: Color
    roughness: float = 0.5  # perceptual, [0, 1]; GGX alpha is its square
    accent: Color | None = None  # colour of grout, second yarn or knots
    scale: float = 1.0  # size of the pattern relative to the default of its kind
    variant: int = 0  # seed of the pattern
    translucent: bool = False  # diffusely transmitting: lampshades, thin curtains
    family: str = ""
    wear: float | None = None  # from new (0) to old (1); None: as the home
    use: Use | None = None  # traces of use by place; None: the texture repeats


@dataclass(frozen=True)
class CatalogueMaterial:
    """A material of a catalogue piece.

    `color` is linear RGB; `texture` and `alpha` are image files. Texture coordinates follow
    Mitsuba: the unit square is the image, v = 0 is its top row.
    """

    kind: Literal["matt", "gloss", "metal", "mirror", "glass", "sheer"]
    color: Color
    roughness: float = 1.0
    opacity: float = 1.0  # "sheer": the share 1 - opacity of the light passes straight through
    texture: str | None = None
    alpha: str | None = None


@dataclass(frozen=True)
class CatalogueCredit:
    """Author, licence and origin of a catalogue piece."""

    author: str
    licence: str
    library: str
    source: str


@dataclass(frozen=True, eq=False)
class Contained:
    """A thing that a piece holds and that is an object of its own: books, a pillow, a coat."""

    name: str
    category: str


@dataclass(frozen=True)
class PiecePart:
    """One shape: a triangle mesh of one material.

    `vertices` float (V, 3) metres; `faces` int (F, 3), counter-clockwise seen from outside;
    `uvs` float (V, 2), in metres; `smooth`: shaded with `normals`, otherwise flat facets.
    """

    name: str
    vertices: Float64Array
    faces: Int64Array
    uvs: Float64Array
    material: Material | CatalogueMaterial
    smooth: bool = False
    lumens: float = 0.0  # above 0: the part emits while its lamp is on
    kelvin: float | None = 2800.0  # colour temperature of the emission; None: R = G = B
    given_normals: Float64Array | None = None  # (V, 3) unit vertex normals of a catalogue mesh
    # Of a screen: seed of what it shows while on, over uv [0, 1]; even: a scene, odd: text.
    picture: int | None = None
    own: Contained | None = None  # the object that the part belongs to, if not the piece

    @property
    def normals(self) -> Float64Array:
        """Unit vertex normals (V, 3): the given ones, else face normals weighted by area and angle.

        Vertices at one position are averaged where the surface turns by less than 50 degrees:
        uv seams stay invisible and creases stay sharp.
        """
        if self.given_normals is not None:
            return self.given_normals
        corners = self.vertices[self.faces]
        facets = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        doubled = np.linalg.norm(facets, axis=1)
        turned = []
        for corner in range(3):
            first = corners[:, (corner + 1) % 3] - corners[:, corner]
            second = corners[:, (corner + 2) % 3] - corners[:, corner]
            angle = np.arctan2(doubled, (first * second).sum(axis=1))
            turned.append(angle[:, None] * facets)
        own = _sums(self.faces.T.reshape(-1), np.concatenate(turned), len(self.vertices))
        unit = own / np.maximum(np.linalg.norm(own, axis=1, keepdims=True), 1e-30)
        labels = _position_labels(self.vertices, 1e-6)
        order = np.argsort(labels, kind="stable")
        shared = [own[:, axis].copy() for axis in range(3)]
        counts = np.bincount(labels)
        after = np.cumsum(counts)[labels[order]] - np.arange(1, len(order) + 1)
        pairs = np.arange(len(order))
        for step in range(1, int(counts.max(initial=1))):
            pairs = pairs[after[pairs] >= step]  # there are so many more at the same position
            one, other = order[pairs], order[pairs + step]
            alike = (unit[one] * unit[other]).sum(axis=1) > CREASE_COSINE
            one, other = one[alike], other[alike]
            for axis in range(3):
                np.add.at(shared[axis], one, own[other, axis])
                np.add.at(shared[axis], other, own[one, axis])
        summed = np.stack(shared, axis=1)
        length = np.linalg.norm(summed, axis=1, keepdims=True)
        return np.where(length > 0, summed / np.maximum(length, 1e-30), [0.0, 0.0, 1.0])


@dataclass(frozen=True)
class FurniturePiece:
    """A piece of furniture or a fitting in its own frame."""

    name: str
    category: str
    parts: tuple[PiecePart, ...]
    anchor: Anchor
    front_clearance: float = 0.0  # metres of free floor that its use needs in front
    side_clearance: float = 0.0
    surfaces: tuple[SupportSurface, ...] = ()
    mount_height: float = 0.0  # on_wall: height of the origin above the floor
    boxes: Float64Array | None = None  # (N, 2, 3), cover the piece; None: see `bodies`
    credit: CatalogueCredit | None = None  # None: generated
    joints: tuple[Joint, ...] = ()  # in its own frame, of no object yet

    @cached_property
    def bounds(self) -> Float64Array:
        """Axis-aligned bounds in its own frame, (2, 3) metres."""
        points = np.concatenate([part.vertices for part in self.parts])
        return np.stack([points.min(axis=0), points.max(axis=0)])

    @property
    def size(self) -> tuple[float, float, float]:
        """Extents along x, y and z of its own frame, metres."""
        x, y, z = np.ptp(self.bounds, axis=0).tolist()
        return x, y, z

    @cached_property
    def bodies(self) -> Float64Array:
        """Boxes (N, 2, 3) in its own frame that together cover the piece.

        The given `boxes`, else the axis-aligned bounds of each connected body of its meshes.
        """
        if self.boxes is not None:
            return self.boxes
        return np.concatenate([_body_bounds(part) for part in self.parts])


def shifted(joint: Joint, x: float, y: float = 0.0, z: float = 0.0) -> Joint:
    """The joint moved by metres."""
    return replace(joint, pivot=(joint.pivot[0] + x, joint.pivot[1] + y, joint.pivot[2] + z))


def _sums(places: Int64Array, values: Float64Array, count: int) -> Float64Array:
    """Sums (count, 3) of the values (N, 3) of each place (N,), added in their order."""
    columns = [np.bincount(places, values[:, axis], count) for axis in range(3)]
    return np.stack(columns, axis=1)


def _position_labels(points: Float64Array, spacing: float) -> Int64Array:
    """Label points (N, 3) so that those that round to the same multiple of `spacing` are equal."""
    # Sorting one hashed 64-bit key per point is ten times faster than sorting rows of three.
    cells = np.round(points / spacing).astype(np.int64).view(np.uint64)
    factors = np.array([0x9E3779B97F4A7C15, 0xC2B2AE3D27D4EB4F, 0x165667B19E3779F9], np.uint64)
    keys = (cells * factors).sum(axis=1, dtype=np.uint64)
    keys ^= keys >> np.uint64(29)
    return np.unique(keys, return_inverse=True)[1].reshape(-1)


def _body_bounds(part: PiecePart) -> Float64Array:
    # Vertices are split at creases: weld those within 0.1 mm, then label connected components.
    welded = _position_labels(part.vertices, 1e-4)
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
