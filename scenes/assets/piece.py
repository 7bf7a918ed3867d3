"""A furniture piece as its catalogue describes it, in metres."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class LightSource:
    """A bulb: its place as fractions of width, depth and height, as the application counts them.

    `color` is sRGB 0xRRGGBB; `diameter` a fraction of the width, or None.
    """

    x: float
    y: float
    z: float
    color: int
    diameter: float | None


@dataclass(frozen=True)
class OpeningRule:
    """How a door or window sits in a wall."""

    cut_out: str | None  # SVG-like path in the unit square; None: the whole front
    wall_thickness: float = 1.0  # share of the piece's depth that lies in the wall
    wall_distance: float = 0.0  # share of its depth behind the wall
    # Each sash: axis x, y, width (shares of width and depth), first and last angle in degrees.
    sashes: tuple[tuple[float, float, float, float, float], ...] = ()


@dataclass(frozen=True)
class CataloguePiece:
    """A piece as its catalogue describes it. Sizes in metres.

    `key` is "library/piece", the folder it is converted to; `id` the catalogue's own name.
    """

    key: str
    id: str
    name: str
    group: str  # the catalogue's category, such as "Living room"
    category: str  # ours, shared by all scene sources: "chair", "lamp", ...
    tags: tuple[str, ...]
    creator: str
    licence: str  # SPDX identifier where it is known, else "unknown"
    model: str  # member of the catalogue file
    size: tuple[float, float, float]  # width, depth, height
    elevation: float  # of its foot above the floor
    drop: float | None  # where things put on top of it stand; None: nothing stands on it
    movable: bool
    opening: OpeningRule | None
    rotation: tuple[tuple[float, ...], ...] | None
    lights: tuple[LightSource, ...]

    @property
    def words(self) -> str:
        """Name, tags and identifier in lower case, to look for words in."""
        return " ".join((self.name, *self.tags, self.id.rpartition("#")[2])).lower()
