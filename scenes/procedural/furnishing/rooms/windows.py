"""Curtains, radiators and objects on window sills."""

from __future__ import annotations

from pbrnet.scenes.procedural.furnishing.furnisher import Furnisher
from pbrnet.scenes.procedural.furniture.textiles import SHAPES
from pbrnet.scenes.procedural.furniture.things.kinds import BY_PLACE
from pbrnet.scenes.procedural.scene_item import Pose
from pbrnet.scenes.procedural.structure import pane_depth

_ABOVE_FLOOR, _BELOW_SILL = 0.015, 0.04  # metres, hems of curtains
_SHORT = 0.7  # share of the curtains at radiators that end there


def furnish_windows(furnisher: Furnisher) -> None:
    """Add radiators below windows, and curtains at all windows of the room or at none."""
    _hang_below_roof(furnisher)
    curtained = furnisher.chance(furnisher.style.interior.curtained)
    for window in furnisher.space.windows():
        edge, width = window.edge, window.width
        radiator = None
        if window.kind == "window" and window.z0 > 0.72 and furnisher.chance(0.65):
            low = max(0.5, min(width - 0.6, 1.4))
            made = furnisher.make("radiator", width=low)
            radiator = furnisher.space.hang("radiator", made, edge, width / 2, made.mount_height)
        if curtained:
            height = min(window.z1 + 0.12, furnisher.plan.height - 0.06)
            # Where there is a radiator most end above it, below the sill.
            short = radiator is not None and furnisher.chance(_SHORT)
            hem = window.z0 - _BELOW_SILL if short else _ABOVE_FLOOR
            shape = round(1000 * window.z1 + 10 * furnisher.plan.height) % SHAPES  # of the home
            curtains = furnisher.make(
                "curtains", width=width, height=height, hem=hem, shape=shape, sill=window.z0
            )
            # Curtains hang in front of the window.
            with furnisher.space.openings_unblocked():
                furnisher.space.hang("curtains", curtains, edge, width / 2, 0.0)


def _hang_below_roof(furnisher: Furnisher) -> None:
    """Add radiators to the knee wall below roof windows."""
    for window in furnisher.space.plan.roof_windows:
        if window.room != furnisher.room.id or not furnisher.chance(0.65):
            continue
        radiator = furnisher.make("radiator", width=max(0.5, window.s1 - window.s0))
        below = window.slope.edge.at(0.5 * (window.s0 + window.s1))
        for edge in furnisher.room.edges:
            s, depth = edge.coordinates(below)
            if abs(depth) < 1e-3 and 0 < s < edge.length and edge.faces_like(window.slope.edge):
                furnisher.space.hang("radiator", radiator, edge, s, radiator.mount_height)


def fill_sills(furnisher: Furnisher) -> None:
    """Place small objects on window sills."""
    for window in furnisher.space.windows():
        depth = pane_depth(window) - 0.05
        if window.z0 <= 0 or depth < 0.14:
            continue
        for _ in range(furnisher.rng.whole(0, 5)):
            things = [one for one in BY_PLACE["sill"] if one not in furnisher.left]
            kinds = list(filter(furnisher.may_leave, ["small_plant", "small_plant", *things]))
            if not kinds:
                break
            kind = furnisher.rng.pick(kinds)
            furnisher.left.add(kind)
            piece = furnisher.make(kind)
            low, high = piece.bounds
            size = float((high - low)[:2].max())
            if size > depth + 0.04 or high[2] > window.z1 - window.z0:
                continue
            s = furnisher.rng.between(size / 2 + 0.08, window.width - size / 2 - 0.08)
            centre = 0.5 * (low + high)
            # Centred on the sill, but in front of the window handles.
            x, y = window.edge.at(s, -min(depth / 2 - 0.03, depth - 0.06 - size / 2))
            pose = Pose(float(x - centre[0]), float(y - centre[1]), window.z0 + 0.022, 0.0)
            furnisher.space.place_on_sill(kind, piece, pose, window)


def hang_radiators(furnisher: Furnisher) -> None:
    """Add radiators without curtains, for kitchens and bathrooms."""
    _hang_below_roof(furnisher)
    for window in furnisher.space.windows():
        if window.z0 > 0.72 and furnisher.chance(0.6):
            radiator = furnisher.make("radiator", width=max(0.5, min(window.width, 1.0)))
            height = radiator.mount_height
            furnisher.space.hang("radiator", radiator, window.edge, window.width / 2, height)
