"""Description of a furniture piece in its catalogue, in metres."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class LightSource:
    """A light source; x, y, z are fractions of the piece's width, depth and height.

    `color` is sRGB 0xRRGGBB; `diameter` is a fraction of the width, or None.
    """

    x: float
    y: float
    z: float
    color: int
    diameter: float | None


@dataclass(frozen=True)
class OpeningRule:
    """Position of a door or window in its wall, and its sashes."""

    cut_out: str | None  # SVG-like path in the unit square; None: the whole front
    wall_thickness: float = 1.0  # share of the piece's depth that lies in the wall
    wall_distance: float = 0.0  # share of its depth behind the wall
    # Each sash: axis x, y, width (shares of width and depth), first and last angle in degrees.
    sashes: tuple[tuple[float, float, float, float, float], ...] = ()


@dataclass(frozen=True)
class CataloguePiece:
    """A furniture piece as described by its catalogue, sizes in metres.

    `key` is "library/piece", the folder of the converted piece; `id` is the identifier in the
    catalogue.
    """

    key: str
    id: str
    name: str
    group: str  # the catalogue's category, such as "Living room"
    category: str  # of the project's own table: "chair", "lamp", ...
    tags: tuple[str, ...]
    creator: str
    licence: str  # SPDX identifier where it is known, else "unknown"
    model: str  # member of the catalogue file
    size: tuple[float, float, float]  # width, depth, height
    elevation: float  # of its lower end above the floor
    drop: float | None  # height at which other pieces stand on it; None: nothing stands on it
    movable: bool
    opening: OpeningRule | None
    rotation: tuple[tuple[float, ...], ...] | None
    lights: tuple[LightSource, ...]

    @property
    def words(self) -> str:
        """Name, tags and identifier in lower case, as text for `AssetRule.words`."""
        return " ".join((self.name, *self.tags, self.id.rpartition("#")[2])).lower()
