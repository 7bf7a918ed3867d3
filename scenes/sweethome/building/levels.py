"""Storeys of a home: the levels to import, their heights and contents."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import TypeVar

from pbrnet.scenes.errors import InputError
from pbrnet.scenes.importing.changes import Changes
from pbrnet.scenes.sweethome.home import Home, HomePiece, Level, RoomShape, Wall

_Item = TypeVar("_Item", Wall, RoomShape, HomePiece)


@dataclass(frozen=True)
class Storey:
    """A level with its walls, rooms and pieces; heights in centimetres above the ground.

    `base` is the height at which walls start: the underside of the floor; on the lowest level
    its top.
    """

    number: int
    name: str
    elevation: float
    base: float
    floor_thickness: float
    height: float
    is_lowest: bool
    is_highest: bool
    above: float | None  # elevation of the next level that lies higher
    walls: tuple[Wall, ...]
    rooms: tuple[RoomShape, ...]
    pieces: tuple[HomePiece, ...]


def storeys(home: Home, wanted: tuple[str, ...], changes: Changes) -> list[Storey]:
    """Return the storeys of a home, lowest first; only the levels named in `wanted` if any are.

    Raises `InputError` for a name that no level has.
    """
    if not home.levels:
        if wanted:
            raise InputError(f"this home has no levels; leave out {', '.join(map(repr, wanted))}")
        height = home.wall_height
        return [Storey(0, "", 0, 0, 0, height, True, True, None,
                       _without_copies(home.walls, changes), home.rooms, home.pieces)]  # fmt: skip
    levels = sorted(home.levels, key=lambda level: (level.elevation, level.index))
    names = [level.name for level in levels]
    unknown = [name for name in wanted if name not in names]
    if unknown:
        raise InputError(f"no level is called {unknown[0]!r}; there are {', '.join(names)}")
    lowest, highest = levels[0].elevation, levels[-1]
    walls, rooms = _by_level(home.walls, levels), _by_level(home.rooms, levels)
    pieces = _by_level(home.pieces, levels)
    made = []
    for number, level in enumerate(levels):
        if wanted and level.name not in wanted:
            changes.note("levels that were not asked for were left out: {}", level.name)
            continue
        if not wanted and not level.viewable:
            changes.note("levels that the home never shows in 3D were left out: {}", level.name)
            continue
        if not level.visible:
            changes.note("levels that are hidden in the home were brought in: {}", level.name)
        above = [other.elevation for other in levels if other.elevation > level.elevation + 1.0]
        thickness = 0.0 if level.elevation == lowest else level.floor_thickness
        made.append(
            Storey(
                number=number,
                name=level.name,
                elevation=level.elevation,
                base=level.elevation - thickness,
                floor_thickness=thickness,
                height=level.height,
                is_lowest=level.elevation == lowest,
                is_highest=level is highest,
                above=min(above, default=None),
                walls=_without_copies(walls[number], changes),
                rooms=tuple(rooms[number]),
                pieces=tuple(pieces[number]),
            )
        )
    if not made:
        raise InputError("no level is left to import")
    return made


def _by_level(items: Iterable[_Item], levels: list[Level]) -> list[list[_Item]]:
    """Return the items of each level; those that name none, or an unknown one, at the lowest."""
    numbers: dict[str | None, int] = {
        level.id: number for number, level in reversed(list(enumerate(levels)))
    }
    made: list[list[_Item]] = [[] for _ in levels]
    for item in items:
        made[numbers.get(item.level, 0)].append(item)
    return made


def _without_copies(walls: Iterable[Wall], changes: Changes) -> tuple[Wall, ...]:
    """Return the walls without exact copies, which change nothing but take time."""
    made: dict[Wall, None] = {}
    for wall in walls:
        if wall in made:
            changes.note("exact copies of walls were left out: {}", wall.id)
        made[wall] = None
    return tuple(made)
