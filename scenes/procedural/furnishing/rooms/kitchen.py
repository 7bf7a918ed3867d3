"""Kitchens: runs of units under cupboards and a hood, a splashback."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from scenes.procedural.finishes import WALL_TILES
from scenes.procedural.furnishing.furnisher import Furnisher, has_opening
from scenes.procedural.furnishing.rooms.tables import place_dining_group
from scenes.procedural.furnishing.rooms.windows import hang_radiators
from scenes.procedural.furnishing.space import GAP, Item
from scenes.procedural.furniture.geometry import Mesh, span
from scenes.procedural.furniture.style import tone
from scenes.procedural.piece import Material, Piece
from scenes.procedural.plan import WallEdge
from scenes.procedural.scene_item import part_of


def furnish_kitchen(maker: Furnisher) -> None:
    """All of a kitchen, in order."""
    rng, space = maker.rng, maker.space
    runs = _place_units(maker)
    for kind in ("hob_unit", "fridge"):
        if kind not in {item.kind for item in runs}:
            space.against_wall(rng, kind, maker.make(kind), tries=80)
    hang_radiators(maker)
    if maker.area > 9.0 and "dining" not in {room.type for room in maker.plan.rooms}:
        place_dining_group(maker, small=True)
    elif maker.chance(0.4):
        for _ in range(2):
            space.anywhere(rng, "stool", maker.make("stool"))
    if not runs or maker.chance(0.25):
        maker.along_wall("sideboard")
    if maker.chance(0.4):
        maker.put_plant()
    if maker.chance(0.6):
        maker.hang("wall_clock")
    maker.hang_pictures(int(rng.integers(0, 3)))
    if maker.chance(0.3):
        maker.hang("wall_shelf")


def _place_units(maker: Furnisher) -> list[Item]:
    """Units side by side along the wall that takes most of them, cupboards and hood above."""
    rng = maker.rng
    units: list[tuple[str, float]] = [("sink_unit", 0.8), ("drawer_unit", 0.6)]
    units.append(("hob_unit", 0.6))
    if maker.chance(0.5):
        units.reverse()
    extras = int(rng.integers(1, 4)) if maker.area > 8 else 1
    units += [("base_cupboard", float(rng.choice([0.4, 0.5, 0.6]))) for _ in range(extras)]
    units.insert(0 if maker.chance(0.6) else len(units), ("fridge", 0.61))
    pieces = [(kind, width, maker.make(kind, width=min(width, 0.8))) for kind, width in units]
    # Where doors and windows leave no wall for the whole run, sink and hob must do.
    core = [unit for unit in pieces if unit[0] in ("sink_unit", "hob_unit")]
    sink = [unit for unit in core if unit[0] == "sink_unit"]
    both = 1 + max(pieces.index(unit) for unit in core)
    for wanted, least, zone in (
        (pieces, both, True),
        (core, 2, True),
        (core, 2, False),
        (sink, 1, False),
    ):
        places = []
        for edge in maker.room.edges:
            for way in (1.0, -1.0):
                places += _run_places(maker, edge, way, wanted, least)
        places.sort(key=lambda place: -place[0])
        for _, edge, way, begin in places[:6]:
            run = _place_run(maker, edge, way, begin, wanted, least, zone)
            if run:
                if maker.area > 9 and maker.chance(0.5):
                    _place_second_run(maker)
                return run
    return []


def _run_places(
    maker: Furnisher,
    edge: WallEdge,
    way: float,
    pieces: Sequence[tuple[str, float, Piece]],
    least: int,
) -> list[tuple[float, WallEdge, float, float]]:
    """(how good, edge, way, first s) of runs of `least` units and more along a wall."""
    places = []
    for begin in np.arange(GAP, max(0.02, edge.length - 0.6), 0.2):
        s = float(begin) if way > 0 else edge.length - float(begin)
        count = 0
        for _, width, piece in pieces:
            end = s + way * width
            if not 0 <= end <= edge.length or not maker.space.fits(
                piece, maker.space.wall_pose(piece, edge, s + way * width / 2)
            ):
                break
            s, count = end, count + 1
        if count >= least:
            in_corner = 1.5 if begin < 0.05 else 0.0
            places.append((count + in_corner + maker.rng.random(), edge, way, float(begin)))
    return places


def _place_run(
    maker: Furnisher,
    edge: WallEdge,
    way: float,
    begin: float,
    pieces: Sequence[tuple[str, float, Piece]],
    least: int,
    zone: bool,
) -> list[Item]:
    space = maker.space
    placed: list[Item] = []
    s = begin if way > 0 else edge.length - begin
    for kind, width, piece in pieces:
        if not 0 <= s + way * width <= edge.length:
            break
        item = space.try_place(
            kind,
            piece,
            space.wall_pose(piece, edge, s + way * width / 2),
            allow=[item.id for item in placed],
            zone=zone,
        )
        if item is None:
            break
        placed.append(item)
        s += way * (width + 0.001)
    if len(placed) < least:
        for _ in placed:
            space.remove_last()
        return []
    _tile_behind(maker, edge, placed)
    for item in placed:
        _hang_above(maker, edge, item)
    return placed


def _tile_behind(maker: Furnisher, edge: WallEdge, run: Sequence[Item]) -> None:
    """A band of tiles on the wall behind the worktops, below window sills."""
    units = [item for item in run if item.kind != "fridge"]
    ends = [
        maker.space.position_on(edge, np.array([item.pose.x, item.pose.y]))
        + side * 0.5 * float(np.ptp(item.piece.bounds[:, 0]))
        for item in units
        for side in (-1, 1)
    ]
    s0, s1 = max(0.0, min(ends)), min(edge.length, max(ends))
    low = maker.style.worktop_height + 0.002
    high = low + 0.5
    for window in maker.space.windows():
        at = maker.space.position_on(edge, np.array(window.start))
        if has_opening(edge, window) and at < s1 and at + window.width > s0:
            high = min(high, window.z0 - 0.02)
    if high - low < 0.08:
        return
    tile = Material(
        "tiles",
        tone(WALL_TILES[int(maker.rng.integers(len(WALL_TILES)))]),
        0.15,
        accent=(0.6, 0.59, 0.57),
        scale=float(maker.rng.choice([0.35, 0.5])),
        variant=int(maker.rng.integers(1 << 30)),
    )
    half = 0.5 * (s1 - s0)
    panel = span((-half, -0.008, 0.0), (half, 0.0, high - low))
    flat = Mesh(panel.vertices, panel.faces, panel.vertices[:, [0, 2]].copy())
    piece = Piece("splashback", "splashback", (part_of("tiles", tile, flat),), "on_wall")
    maker.space.hang("splashback", piece, edge, 0.5 * (s0 + s1), low)


def _hang_above(maker: Furnisher, edge: WallEdge, item: Item) -> None:
    space = maker.space
    width = float(np.ptp(item.piece.bounds[:, 0]))
    s = space.position_on(edge, np.array([item.pose.x, item.pose.y]))
    if item.kind == "fridge":
        return
    if item.kind == "hob_unit":
        hood = maker.make("extractor_hood", width=0.6, height=maker.plan.height - 1.58)
        space.hang("extractor_hood", hood, edge, s, 1.58)
    elif maker.chance(0.85):
        cupboard = maker.make("wall_cupboard", width=width)
        if cupboard.mount_height + 0.7 < maker.plan.height:
            space.hang("wall_cupboard", cupboard, edge, s, cupboard.mount_height)


def _place_second_run(maker: Furnisher) -> None:
    """A few more units along another wall."""
    rng, space = maker.rng, maker.space
    unit = maker.make("base_cupboard", width=0.6)
    item = space.against_wall(rng, "base_cupboard", unit, where="corner", tries=40)
    if item is None:
        return
    edge = maker.edge_behind(item)
    if edge is not None:
        s = space.position_on(edge, np.array([item.pose.x, item.pose.y]))
        for side in (-1.0, 1.0):
            nxt = maker.make("drawer_unit", width=0.6)
            pose = space.wall_pose(nxt, edge, s + side * 0.601)
            if space.try_place("drawer_unit", nxt, pose, allow=(item.id,)):
                return
    space.remove_last()  # one cupboard alone looks lost
