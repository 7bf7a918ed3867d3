"""Finishes of a home: materials of floors, walls, doors and windows, and moulding profiles."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from scenes.procedural.furniture.style import METALS, Style, hex_color, scaled_color
from scenes.procedural.piece import Material

# Measured reflectances of paint: about 0.8 for fresh white, 0.5 to 0.7 for tints.
WALLS = (
    "#e6e1d6",
    "#e9e6df",
    "#e2dccf",
    "#d9d8d2",
    "#dcd3c2",
    "#cfd6d2",
    "#d5dbe0",
    "#e3d6cb",
    "#d3d4c6",
    "#e5dcc3",
    "#c9ccd0",
    "#d8c8b8",
)
ACCENTS = (
    "#8fa39a",
    "#a7b7c2",
    "#b89a83",
    "#7f8b96",
    "#c2a58f",
    "#9aa584",
    "#6f8089",
    "#b7a2a0",
    "#c9b68f",
    "#a5745c",
    "#5f7381",
)
CEILINGS = ("#e9e7e2", "#e6e4de", "#e9e9e6")
FLOOR_WOODS = (
    "#b58a5c",
    "#c9a576",
    "#94683f",
    "#6f4b30",
    "#d2b58c",
    "#a98763",
    "#8b7355",
    "#bda98c",
)
FLOOR_TILES = (
    "#b9b2a6",
    "#8f8c87",
    "#cfc8bb",
    "#6d6e70",
    "#b79f86",
    "#a9503a",
    "#dad6cd",
    "#4e5256",
)
WALL_TILES = (
    "#e6e5e0",
    "#d5dde0",
    "#cfdcd4",
    "#e5dccb",
    "#a9bcc4",
    "#dfe3e5",
    "#8fa7a0",
    "#c7d2da",
)
CARPETS = ("#a39887", "#8a8f96", "#b9ab96", "#6f7a7f", "#9c8a7c")
FRAMES = ("#e9e8e4", "#e9e8e4", "#e4e1d8", "#4a4d50", "#6b4a31", "#8a6a48")
DOORS = ("#e8e5de", "#e8e5de", "#e3ded2", "#c9a476", "#8a5f3c", "#5f4330", "#9aa39d")
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
    glazing_bars: bool
    sash_width: float  # widest sash without a mullion, metres
    rooms: dict[str, RoomFinish]


def make_finishes(rng: np.random.Generator, style: Style, rooms: dict[str, str]) -> Finishes:
    """Draw finishes for `rooms` (id -> type) that match the furniture's `style`."""

    def pick(codes: tuple[str, ...]) -> str:
        return codes[int(rng.integers(len(codes)))]

    def variant() -> int:
        return int(rng.integers(1 << 30))

    plank_color = hex_color(pick(FLOOR_WOODS))
    planks = Material(
        "planks",
        plank_color,
        roughness=float(rng.uniform(0.3, 0.55)),
        accent=scaled_color(plank_color, 0.6),
        scale=float(rng.choice([0.8, 1.0, 1.3])),
        variant=variant(),
    )
    nap = ("rolled", "rolled", "smooth", "coarse", "trowelled", "woodchip", "brushed")[
        int(rng.integers(7))
    ]
    carpet = Material("carpet", hex_color(pick(CARPETS)), 0.95, variant=variant())
    common_wall = Material("plaster", hex_color(pick(WALLS)), 0.9, variant=variant(), family=nap)
    frame_code, door_code = pick(FRAMES), pick(DOORS)
    frame = Material("paint", hex_color(frame_code), float(rng.uniform(0.25, 0.4)))
    door_color = hex_color(door_code)
    wooden = max(door_color) / max(min(door_color), 1e-6) > 1.8
    door = (
        Material("wood", door_color, 0.4, accent=scaled_color(door_color, 0.6), variant=variant())
        if wooden
        else Material("paint", door_color, 0.35)
    )
    white = Material("paint", hex_color("#e8e6e0"), 0.4)
    metal_code, metal_roughness = METALS[int(rng.integers(len(METALS)))]
    finishes = {}
    for room, kind in rooms.items():
        wet = kind in ("bathroom", "kitchen")
        floor = planks
        if wet or (kind == "dining" and rng.random() < 0.3):
            color = hex_color(pick(FLOOR_TILES))
            floor = Material(
                "tiles",
                color,
                roughness=float(rng.uniform(0.15, 0.45)),
                accent=scaled_color(hex_color("#a09c94"), 0.8),
                scale=float(rng.choice([1.0, 1.0, 1.5, 2.0, 0.5 if kind == "bathroom" else 1.0])),
                variant=variant(),
            )
            if kind == "kitchen" and rng.random() < 0.35:
                floor = planks
        elif kind in ("bedroom", "study") and rng.random() < 0.35:
            floor = carpet
        wall = common_wall
        if rng.random() < 0.4:
            wall = Material("plaster", hex_color(pick(WALLS)), 0.9, variant=variant(), family=nap)
        accent = None
        if not wet and rng.random() < 0.4:
            accent = Material(
                "plaster", hex_color(pick(ACCENTS)), 0.9, variant=variant(), family=nap
            )
            if rng.random() < 0.5:
                base = hex_color(pick(WALLS + ACCENTS))
                accent = Material(
                    "wallpaper", base, 0.9, accent=scaled_color(base, 0.62), variant=variant()
                )
        tiles, tile_height = None, 0.0
        if kind == "bathroom":
            tiles = Material(
                "tiles",
                hex_color(pick(WALL_TILES)),
                roughness=float(rng.uniform(0.1, 0.25)),
                accent=hex_color("#c9c7c1"),
                scale=float(rng.choice([0.35, 0.5, 0.65, 1.0])),
                variant=variant(),
            )
            tile_height = float(rng.choice([1.2, 1.5, 2.1, 9.0]))
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
        skirting=white if rng.random() < 0.7 else replace(style.wood, variant=variant()),
        skirting_height=float(rng.uniform(0.06, 0.12)),
        cornice=float(rng.choice([0.0, 0.0, 0.05, 0.07])),
        frame=frame,
        sill=white if rng.random() < 0.5 else Material("stone", hex_color("#b9b4aa"), 0.35),
        door=door,
        door_panels=("flat", "two", "four")[int(rng.integers(3))],
        casing=door if rng.random() < 0.5 else white,
        handle=Material("metal", hex_color(metal_code), metal_roughness),
        facade=Material(
            "brick" if red else "plaster",
            facade_color,
            0.9,
            accent=hex_color("#a8a196") if red else None,
            variant=variant(),
            family=("running", "third")[int(rng.integers(2))] if red else "render",
        ),
        threshold=replace(style.wood, variant=variant()),
        glazing_bars=bool(rng.random() < 0.3),
        sash_width=float(rng.uniform(0.8, 1.15)),
        rooms=finishes,
    )
