"""Finishes of a home: materials of floors, walls, doors and windows, and moulding profiles."""

from __future__ import annotations

from dataclasses import dataclass, replace

from pbrnet.scenes.color import Color
from pbrnet.scenes.procedural.furniture.materials import hex_color, scaled_color
from pbrnet.scenes.procedural.furniture.style import Interior, Style
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
    has = style.interior
    planks = _planks(rng, has)
    nap = rng.pick(has.wall_families)
    carpet = Material("carpet", hex_color(rng.pick(has.carpets)), 0.95, variant=rng.variant())
    wall = _plaster(rng, has.walls, nap)
    frame_code, door_color = rng.pick(has.frames), hex_color(rng.pick(has.doors))
    frame = Material("paint", hex_color(frame_code), rng.between(0.25, 0.4))
    door = Material("paint", door_color, 0.35)
    if max(door_color) / max(min(door_color), 1e-6) > 1.8:  # a wooden one
        grain = scaled_color(door_color, 0.6)
        door = replace(style.wood, color=door_color, accent=grain, variant=rng.variant())
    white = Material("paint", hex_color("#e8e6e0"), 0.4)
    metal_code, metal_roughness = rng.pick(has.metals)
    finished = {}
    for room, kind in rooms.items():
        floor = _floor(rng, has, kind, planks, carpet)
        finished[room] = _room_finish(rng, style, kind, floor, wall, nap)
    facade_color = hex_color(rng.pick(FACADES))
    return Finishes(
        ceiling=_plaster(rng, CEILINGS, "smooth", 0.95),
        skirting=white if rng.chance(0.7) else replace(style.wood, variant=rng.variant()),
        skirting_height=rng.between(*has.skirting),
        cornice=rng.pick(has.cornices),
        frame=frame,
        sill=white if rng.chance(0.5) else Material("stone", hex_color("#b9b4aa"), 0.35),
        door=door,
        door_panels=rng.pick(has.panels),
        casing=door if rng.chance(0.5) else white,
        handle=Material("metal", hex_color(metal_code), metal_roughness),
        facade=_facade(rng, facade_color),
        threshold=replace(style.wood, variant=rng.variant()),
        beam=_beam(rng, has, style),
        glazing_bars=rng.chance(has.glazing_bars),
        sash_width=rng.between(0.8, 1.15),
        rooms=finished,
    )


def _planks(rng: Draw, has: Interior) -> Material:
    color = hex_color(rng.pick(has.floors))
    return Material(
        "planks",
        color,
        roughness=rng.between(0.3, 0.55),
        accent=scaled_color(color, 0.6),
        scale=rng.pick((0.8, 1.0, 1.3)),
        variant=rng.variant(),
        family=rng.pick(has.floor_families),
    )


def _plaster(rng: Draw, codes: tuple[str, ...], nap: str, roughness: float = 0.9) -> Material:
    color = hex_color(rng.pick(codes))
    return Material("plaster", color, roughness, variant=rng.variant(), family=nap)


def _floor(rng: Draw, has: Interior, kind: str, planks: Material, carpet: Material) -> Material:
    """Draw the floor of a room: tiles, the home's planks or its carpet."""
    if kind in ("bathroom", "kitchen") or (kind in ("dining", "hall") and rng.chance(0.3)):
        tiles = Material(
            "tiles",
            hex_color(rng.pick(has.floor_tiles)),
            roughness=rng.between(0.15, 0.45),
            accent=scaled_color(hex_color("#a09c94"), 0.8),
            scale=rng.pick((1.0, 1.0, 1.5, 2.0, 0.5 if kind == "bathroom" else 1.0)),
            variant=rng.variant(),
            family=rng.pick(has.floor_tile_families),
        )
        return planks if kind == "kitchen" and rng.chance(0.35) else tiles
    return carpet if kind in ("bedroom", "study") and rng.chance(has.carpeted) else planks


def _room_finish(
    rng: Draw, style: Style, kind: str, floor: Material, wall: Material, nap: str
) -> RoomFinish:
    """Draw the walls of a room; most have the home's common `wall`."""
    has = style.interior
    if rng.chance(0.4):
        wall = _plaster(rng, has.walls, nap)
    accent, tiles, tile_height = None, None, 0.0
    if kind not in ("bathroom", "kitchen") and rng.chance(has.accent):
        accent = _accent_wall(rng, has, style, nap)
    if kind == "bathroom":
        tiles = Material(
            "tiles",
            hex_color(rng.pick(has.wall_tiles)),
            roughness=rng.between(0.1, 0.25),
            accent=hex_color("#c9c7c1"),
            scale=rng.pick((0.35, 0.5, 0.65, 1.0)),
            variant=rng.variant(),
            family=rng.pick(has.wall_tile_families),
        )
        tile_height = rng.pick((1.2, 1.5, 2.1, 9.0))
    return RoomFinish(floor, wall, accent, tiles, tile_height, skirting=kind != "bathroom")


def _facade(rng: Draw, color: Color) -> Material:
    """Draw the facade in a colour: brick if that is red, else render."""
    variant = rng.variant()
    if color[0] <= 2.2 * color[2]:
        return Material("plaster", color, 0.9, variant=variant, family="render")
    bond = rng.pick(("running", "third"))
    joints = hex_color("#a8a196")
    return Material("brick", color, 0.9, accent=joints, variant=variant, family=bond)


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
        base = hex_color(rng.pick((*has.walls, *has.accent_walls)))
        paper, accent = rng.pick(has.papers), scaled_color(base, 0.62)
        return Material("wallpaper", base, 0.9, accent=accent, variant=variant, family=paper)
    if not has.bare or bare >= 0.6:
        return Material("plaster", color, 0.9, variant=variant, family=nap)
    if has.bare == "brick":
        red = hex_color(rng.pick(("#8d4a38", "#9a5a44", "#b5aca0")))
        joints = hex_color("#a8a196")
        return Material("brick", red, 0.9, accent=joints, variant=variant, family="running")
    if has.bare == "concrete":
        return Material("stone", hex_color("#a3a19c"), 0.7, variant=variant, family="concrete")
    return replace(style.wood, variant=variant)
