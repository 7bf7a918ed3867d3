"""Finishes of a home: materials of floors, walls, doors and windows, and moulding profiles."""

from __future__ import annotations

from dataclasses import dataclass, replace

from pbrnet.scenes.procedural.furniture.interiors import Interior
from pbrnet.scenes.procedural.furniture.style import Style, hex_color, scaled_color
from pbrnet.scenes.procedural.piece import Material
from pbrnet.scenes.seeds import Draw

CEILINGS = ("#e9e7e2", "#e6e4de", "#e9e9e6")
FACADES = ("#d9d3c6", "#c9b79b", "#b9b4aa", "#d6c4b0", "#a9533c", "#8d4a36", "#cfcfca")


@dataclass(frozen=True)
class RoomFinish:
    """Materials of one room's floor and walls."""

    floor: Material
    wall: Material
    accent: Material | None  # of a single accent wall
    wall_tiles: Material | None
    tile_height: float  # metres from the floor to the top of the wall tiles; 0: no tiles
    skirting: bool


@dataclass(frozen=True)
class Finishes:
    """Building materials and mouldings of a home."""

    ceiling: Material
    skirting: Material
    skirting_height: float  # metres
    cornice: float  # metres; 0: no cornice
    frame: Material  # of windows
    sill: Material
    door: Material
    door_panels: str  # "flat", "two", "four"
    casing: Material
    handle: Material
    facade: Material
    threshold: Material
    beam: Material
    glazing_bars: bool
    sash_width: float  # widest sash without a mullion, metres
    rooms: dict[str, RoomFinish]


def make_finishes(rng: Draw, style: Style, rooms: dict[str, str]) -> Finishes:
    """Draw finishes for `rooms` (id -> type) that match the furniture's `style`."""

    def pick(codes: tuple[str, ...]) -> str:
        return rng.pick(codes)

    def variant() -> int:
        return rng.variant()

    has = style.interior
    plank_color = hex_color(pick(has.floors))
    planks = Material(
        "planks",
        plank_color,
        roughness=rng.between(0.3, 0.55),
        accent=scaled_color(plank_color, 0.6),
        scale=rng.pick([0.8, 1.0, 1.3]),
        variant=variant(),
        family=pick(has.floor_families),
    )
    nap = pick(has.wall_families)
    carpet = Material("carpet", hex_color(pick(has.carpets)), 0.95, variant=variant())
    common_wall = Material(
        "plaster", hex_color(pick(has.walls)), 0.9, variant=variant(), family=nap
    )
    frame_code, door_code = pick(has.frames), pick(has.doors)
    frame = Material("paint", hex_color(frame_code), rng.between(0.25, 0.4))
    door_color = hex_color(door_code)
    wooden = max(door_color) / max(min(door_color), 1e-6) > 1.8
    door = (
        replace(
            style.wood, color=door_color, accent=scaled_color(door_color, 0.6), variant=variant()
        )
        if wooden
        else Material("paint", door_color, 0.35)
    )
    white = Material("paint", hex_color("#e8e6e0"), 0.4)
    metal_code, metal_roughness = rng.pick(has.metals)
    finishes = {}
    for room, kind in rooms.items():
        wet = kind in ("bathroom", "kitchen")
        floor = planks
        if wet or (kind in ("dining", "hall") and rng.chance(0.3)):
            color = hex_color(pick(has.floor_tiles))
            floor = Material(
                "tiles",
                color,
                roughness=rng.between(0.15, 0.45),
                accent=scaled_color(hex_color("#a09c94"), 0.8),
                scale=rng.pick([1.0, 1.0, 1.5, 2.0, 0.5 if kind == "bathroom" else 1.0]),
                variant=variant(),
                family=pick(has.floor_tile_families),
            )
            if kind == "kitchen" and rng.chance(0.35):
                floor = planks
        elif kind in ("bedroom", "study") and rng.chance(has.carpeted):
            floor = carpet
        wall = common_wall
        if rng.chance(0.4):
            wall = Material(
                "plaster", hex_color(pick(has.walls)), 0.9, variant=variant(), family=nap
            )
        accent = None
        if not wet and rng.chance(has.accent):
            accent = _accent_wall(rng, has, style, nap)
        tiles, tile_height = None, 0.0
        if kind == "bathroom":
            tiles = Material(
                "tiles",
                hex_color(pick(has.wall_tiles)),
                roughness=rng.between(0.1, 0.25),
                accent=hex_color("#c9c7c1"),
                scale=rng.pick([0.35, 0.5, 0.65, 1.0]),
                variant=variant(),
                family=pick(has.wall_tile_families),
            )
            tile_height = rng.pick([1.2, 1.5, 2.1, 9.0])
        finishes[room] = RoomFinish(
            floor=floor,
            wall=wall,
            accent=accent,
            wall_tiles=tiles,
            tile_height=tile_height,
            skirting=kind != "bathroom",
        )
    facade_color = hex_color(pick(FACADES))
    red = facade_color[0] > 2.2 * facade_color[2]
    return Finishes(
        ceiling=Material(
            "plaster", hex_color(pick(CEILINGS)), 0.95, variant=variant(), family="smooth"
        ),
        skirting=white if rng.chance(0.7) else replace(style.wood, variant=variant()),
        skirting_height=rng.between(*has.skirting),
        cornice=rng.pick(has.cornices),
        frame=frame,
        sill=white if rng.chance(0.5) else Material("stone", hex_color("#b9b4aa"), 0.35),
        door=door,
        door_panels=rng.pick(has.panels),
        casing=door if rng.chance(0.5) else white,
        handle=Material("metal", hex_color(metal_code), metal_roughness),
        facade=Material(
            "brick" if red else "plaster",
            facade_color,
            0.9,
            accent=hex_color("#a8a196") if red else None,
            variant=variant(),
            family=rng.pick(("running", "third")) if red else "render",
        ),
        threshold=replace(style.wood, variant=variant()),
        beam=_beam(rng, has, style),
        glazing_bars=rng.chance(has.glazing_bars),
        sash_width=rng.between(0.8, 1.15),
        rooms=finishes,
    )


def _beam(rng: Draw, has: Interior, style: Style) -> Material:
    """Draw the material of beams: old timber, steel or paint."""
    kind = rng.pick(has.beams)
    variant = rng.variant()
    if kind == "steel":
        return Material("metal", hex_color("#3a3a3b"), 0.5)
    if kind == "paint":
        return Material("paint", hex_color("#e6e4df"), 0.5)
    return replace(style.wood if kind == "wood" else style.dark_wood, variant=variant, wear=0.8)


def _accent_wall(rng: Draw, has: Interior, style: Style, nap: str) -> Material:
    """Draw the material of an accent wall: paper, paint, or what the style leaves bare."""
    color = hex_color(rng.pick(has.accent_walls))
    variant = rng.variant()
    papered, bare = rng.random(2)
    if papered < has.papered:
        codes = (*has.walls, *has.accent_walls)
        base = hex_color(rng.pick(codes))
        paper = rng.pick(has.papers)
        accent = scaled_color(base, 0.62)
        return Material("wallpaper", base, 0.9, accent=accent, variant=variant, family=paper)
    if has.bare and bare < 0.6:
        if has.bare == "brick":
            joints = hex_color("#a8a196")
            red = hex_color(("#8d4a38", "#9a5a44", "#b5aca0")[rng.whole(3)])
            return Material("brick", red, 0.9, accent=joints, variant=variant, family="running")
        if has.bare == "concrete":
            return Material("stone", hex_color("#a3a19c"), 0.7, variant=variant, family="concrete")
        return replace(style.wood, variant=variant)
    return Material("plaster", color, 0.9, variant=variant, family=nap)
