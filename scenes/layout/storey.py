"""The one storey of a layout that is built, with its floor at height 0."""

from __future__ import annotations

from dataclasses import replace

from shapely.geometry import Polygon

from pbrnet.scenes.errors import InputError
from pbrnet.scenes.layout.layout import Layout, LayoutObject

_STEP = 1.0  # metres between floors of one storey
_EVEN = 0.03  # metres; smaller steps are not named


def main_storey(layout: Layout) -> Layout:
    """The rooms on the level of the largest one, all at height 0, with what is in them.

    Rooms of other storeys are refused if the layout is strict, else left out and named.
    """
    base = max(layout.rooms, key=lambda room: Polygon(room.polygon).area).floor_z
    kept = [room for room in layout.rooms if abs(room.floor_z - base) <= _STEP]
    others = [k for k, room in enumerate(layout.rooms) if room not in kept]
    if others and layout.strict:
        raise InputError(
            f"rooms[{others[0]}].floor_z: on another level than the largest room; give each storey "
            "a layout of its own"
        )
    changes = list(layout.changes)
    if others:
        names = ", ".join(layout.rooms[k].id for k in others[:4])
        changes.append(f"rooms of other storeys were left out ({len(others)}): {names}")
    if any(abs(room.floor_z - base) > _EVEN for room in kept):
        changes.append("steps between rooms were left out: all floors are level")
    floors = {room.id: room.floor_z for room in kept}
    lost = {layout.rooms[k].id for k in others}
    return replace(
        layout,
        rooms=tuple(replace(room, floor_z=0.0) for room in kept),
        openings=tuple(
            replace(each, swing=None if each.swing in lost else each.swing)
            for each in layout.openings
            if each.room not in lost
        ),
        objects=_lowered(layout, floors, base, bool(others)),
        changes=tuple(changes),
    )


def _lowered(
    layout: Layout, floors: dict[str, float], base: float, several: bool
) -> tuple[LayoutObject, ...]:
    """Objects of the storey, their heights from the floor of their room."""
    made = []
    for each in layout.objects:
        inside = base - _STEP < each.center[2] < base + layout.height
        if each.room in floors or (each.room is None and (inside or not several)):
            x, y, z = each.center
            made.append(replace(each, center=(x, y, z - floors.get(each.room or "", base))))
    ids = {each.id for each in made}
    return tuple(replace(each, on=each.on if each.on in ids else None) for each in made)
