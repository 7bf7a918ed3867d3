"""Kitchens: runs of base units with wall cupboards, extractor hood and splashback."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from pbrnet.scenes.procedural.furnishing.furnisher import Furnisher, has_opening
from pbrnet.scenes.procedural.furnishing.rooms.dining import place_dining_group
from pbrnet.scenes.procedural.furnishing.rooms.windows import hang_radiators
from pbrnet.scenes.procedural.furnishing.space import GAP, PlacedPiece
from pbrnet.scenes.procedural.furniture.materials import hex_color
from pbrnet.scenes.procedural.furniture.parts.geometry import BodyMesh, span
from pbrnet.scenes.procedural.piece import FurniturePiece, Material
from pbrnet.scenes.procedural.plan import WallEdge
from pbrnet.scenes.procedural.scene_item import make_part


def furnish_kitchen(furnisher: Furnisher) -> None:
    """Furnish a kitchen."""
    rng, space = furnisher.rng, furnisher.space
    runs = _place_units(furnisher)
    for kind in ("hob_unit", "fridge"):
        if kind not in {item.kind for item in runs}:
            space.against_wall(rng, kind, furnisher.make(kind), tries=80)
    hang_radiators(furnisher)
    if furnisher.area > 9.0 and "dining" not in {room.type for room in furnisher.plan.rooms}:
        place_dining_group(furnisher, small=True)
    elif furnisher.chance(0.4):
        for _ in range(2):
            furnisher.on_floor("stool")
    if not runs or furnisher.chance(0.25):
        furnisher.along_wall("sideboard")
    if furnisher.chance(0.4):
        furnisher.in_corner("plant")
    furnisher.hang_clock()
    furnisher.hang_pictures(furnisher.number(1, 2))
    for _ in range(furnisher.number(0, 2)):
        furnisher.hang("wall_shelf" if furnisher.chance(0.4) else "wall_board")
    furnisher.along_wall("rack", wanted=0.2)


def _place_units(furnisher: Furnisher) -> list[PlacedPiece]:
    """Place a run of units along the wall where most of them fit, with cupboards above."""
    rng = furnisher.rng
    units: list[tuple[str, float]] = [("sink_unit", 0.8), ("drawer_unit", 0.6)]
    units.append(("hob_unit", 0.6))
    if furnisher.chance(0.5):
        units.reverse()
    extras = rng.whole(1, 4) if furnisher.area > 8 else 1
    units += [("base_cupboard", rng.pick([0.4, 0.5, 0.6])) for _ in range(extras)]
    units.insert(0 if furnisher.chance(0.6) else len(units), ("fridge", 0.61))
    pieces = [(kind, width, furnisher.make(kind, width=min(width, 0.8))) for kind, width in units]
    # If doors and windows leave no wall for the whole run, place sink and hob alone.
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
        for edge in furnisher.room.edges:
            for direction in (1.0, -1.0):
                places += _run_places(furnisher, edge, direction, wanted, least)
        places.sort(key=lambda place: -place[0])
        for _, edge, direction, begin in places[:6]:
            run = _place_run(furnisher, edge, direction, begin, wanted, least, zone)
            if run:
                if furnisher.area > 9 and furnisher.chance(0.5):
                    _place_second_run(furnisher)
                return run
    return []


def _run_places(
    furnisher: Furnisher,
    edge: WallEdge,
    direction: float,
    pieces: Sequence[tuple[str, float, FurniturePiece]],
    least: int,
) -> list[tuple[float, WallEdge, float, float]]:
    """Positions of runs of at least `least` units: (score, edge, direction, start).

    `direction` is 1 along the wall or -1 against it; `start` is the distance in metres from the
    wall's start or end.
    """
    places = []
    for begin in np.arange(GAP, max(0.02, edge.length - 0.6), 0.2):
        s = float(begin) if direction > 0 else edge.length - float(begin)
        count = 0
        for _, width, piece in pieces:
            end = s + direction * width
            if not 0 <= end <= edge.length or not furnisher.space.fits(
                piece, furnisher.space.wall_pose(piece, edge, s + direction * width / 2)
            ):
                break
            s, count = end, count + 1
        if count >= least:
            in_corner = 1.5 if begin < 0.05 else 0.0
            places.append(
                (count + in_corner + furnisher.rng.random(), edge, direction, float(begin))
            )
    return places


def _place_run(
    furnisher: Furnisher,
    edge: WallEdge,
    direction: float,
    begin: float,
    pieces: Sequence[tuple[str, float, FurniturePiece]],
    least: int,
    zone: bool,
) -> list[PlacedPiece]:
    space = furnisher.space
    place_piece: list[PlacedPiece] = []
    s = begin if direction > 0 else edge.length - begin
    for kind, width, piece in pieces:
        if not 0 <= s + direction * width <= edge.length:
            break
        item = space.try_place(
            kind,
            piece,
            space.wall_pose(piece, edge, s + direction * width / 2),
            allow=[item.id for item in place_piece],
            zone=zone,
        )
        if item is None:
            break
        place_piece.append(item)
        s += direction * (width + 0.001)
    if len(place_piece) < least:
        for _ in place_piece:
            space.remove_last()
        return []
    _tile_behind(furnisher, edge, place_piece)
    for item in place_piece:
        _hang_above(furnisher, edge, item)
    return place_piece


def _tile_behind(furnisher: Furnisher, edge: WallEdge, run: Sequence[PlacedPiece]) -> None:
    """Hang a splashback of tiles behind the worktops, below window sills."""
    units = [item for item in run if item.kind != "fridge"]
    ends = [
        item.along(edge) + side * 0.5 * item.piece.size[0] for item in units for side in (-1, 1)
    ]
    s0, s1 = max(0.0, min(ends)), min(edge.length, max(ends))
    low = furnisher.style.worktop_height + 0.002
    high = low + 0.5
    for window in furnisher.space.windows():
        at = edge.coordinates(window.start)[0]
        if has_opening(edge, window) and at < s1 and at + window.width > s0:
            high = min(high, window.z0 - 0.02)
    if high - low < 0.08:
        return
    has = furnisher.style.interior
    tile = Material(
        "tiles",
        hex_color(furnisher.rng.pick(has.wall_tiles)),
        0.15,
        accent=(0.6, 0.59, 0.57),
        scale=furnisher.rng.pick([0.35, 0.5]),
        variant=furnisher.rng.variant(),
        family=furnisher.rng.pick(has.wall_tile_families),
    )
    half = 0.5 * (s1 - s0)
    panel = span((-half, -0.008, 0.0), (half, 0.0, high - low))
    flat = BodyMesh(panel.vertices, panel.faces, panel.vertices[:, [0, 2]].copy())
    piece = FurniturePiece("splashback", "splashback", (make_part("tiles", tile, flat),), "on_wall")
    furnisher.space.hang("splashback", piece, edge, 0.5 * (s0 + s1), low)


def _hang_above(furnisher: Furnisher, edge: WallEdge, item: PlacedPiece) -> None:
    space = furnisher.space
    width = item.piece.size[0]
    s = item.along(edge)
    if item.kind == "fridge":
        return
    if item.kind == "hob_unit":
        hood = furnisher.make("extractor_hood", width=0.6, height=furnisher.plan.height - 1.58)
        space.hang("extractor_hood", hood, edge, s, 1.58)
    elif furnisher.chance(0.85):
        cupboard = furnisher.make("wall_cupboard", width=width)
        if cupboard.mount_height + 0.7 < furnisher.plan.height:
            space.hang("wall_cupboard", cupboard, edge, s, cupboard.mount_height)


def _place_second_run(furnisher: Furnisher) -> None:
    """Place two units along another wall."""
    rng, space = furnisher.rng, furnisher.space
    unit = furnisher.make("base_cupboard", width=0.6)
    item = space.against_wall(rng, "base_cupboard", unit, where="corner", tries=40)
    if item is None:
        return
    edge = furnisher.edge_behind(item)
    if edge is not None:
        s = item.along(edge)
        for side in (-1.0, 1.0):
            nxt = furnisher.make("drawer_unit", width=0.6)
            pose = space.wall_pose(nxt, edge, s + side * 0.601)
            if space.try_place("drawer_unit", nxt, pose, allow=(item.id,)):
                return
    space.remove_last()  # no single cupboards
