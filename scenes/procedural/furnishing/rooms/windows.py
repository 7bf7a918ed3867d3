"""What belongs to windows: curtains, radiators, small things on sills."""

from __future__ import annotations

from scenes.procedural.furnishing.furnisher import Furnisher
from scenes.procedural.piece import Piece
from scenes.procedural.plan import WallEdge
from scenes.procedural.scene_item import Pose
from scenes.procedural.structure import pane_depth


def dress_windows(maker: Furnisher) -> None:
    """Radiators below windows; curtains at all of the room's windows, or at none."""
    dressed = maker.chance(0.75)
    for window in maker.space.windows():
        edge, width = window.edge, window.width
        if window.kind == "window" and window.z0 > 0.72 and maker.chance(0.65):
            low = max(0.5, min(width - 0.6, 1.4))
            radiator = maker.make("radiator", width=low)
            maker.space.hang("radiator", radiator, edge, width / 2, radiator.mount_height)
        if dressed:
            height = min(window.z1 + 0.12, maker.plan.height - 0.06)
            curtains = maker.make("curtains", width=width, height=height)
            _hang_curtains(maker, edge, width / 2, curtains)


def _hang_curtains(maker: Furnisher, edge: WallEdge, s: float, piece: Piece) -> None:
    """Curtains hang before their own window, so openings do not forbid them."""
    space = maker.space
    kept = space.without_blocks()
    space.hang("curtains", piece, edge, s, 0.0)
    space.restore_blocks(kept)


def fill_sills(maker: Furnisher) -> None:
    """Small things on window sills."""
    for window in maker.space.windows():
        deep = pane_depth(window) - 0.05
        if window.z0 <= 0 or deep < 0.14:
            continue
        for _ in range(int(maker.rng.integers(0, 3))):
            kind = str(maker.rng.choice(["small_plant", "small_plant", "vase", "candle"]))
            piece = maker.make(kind)
            low, high = piece.bounds
            size = float((high - low)[:2].max())
            if size > deep + 0.04 or high[2] > window.z1 - window.z0:
                continue
            s = float(maker.rng.uniform(size / 2 + 0.08, window.width - size / 2 - 0.08))
            centre = 0.5 * (low + high)
            # Mid-sill, but its back before the handles.
            x, y = window.edge.at(s, -min(deep / 2 - 0.03, deep - 0.06 - size / 2))
            pose = Pose(float(x - centre[0]), float(y - centre[1]), window.z0 + 0.022, 0.0)
            maker.space.place_on_sill(kind, piece, pose, window)


def hang_radiators(maker: Furnisher) -> None:
    """Radiators only: no cloth near water and fire."""
    for window in maker.space.windows():
        if window.z0 > 0.72 and maker.chance(0.6):
            radiator = maker.make("radiator", width=max(0.5, min(window.width, 1.0)))
            height = radiator.mount_height
            maker.space.hang("radiator", radiator, window.edge, window.width / 2, height)
