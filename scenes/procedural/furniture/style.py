"""Furniture style of a home: matching materials and common shapes."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from scenes.color import Color, decode_srgb_value
from scenes.procedural.piece import Material


def hex_color(code: str) -> Color:
    """Return linear Rec. 709 RGB of an sRGB colour written as "#rrggbb"."""
    channels = [int(code[start : start + 2], 16) / 255 for start in (1, 3, 5)]
    linear = [decode_srgb_value(channel) for channel in channels]
    return (linear[0], linear[1], linear[2])


def scaled_color(color: Color, factor: float) -> Color:
    """Return a linear RGB colour times `factor`."""
    return (color[0] * factor, color[1] * factor, color[2] * factor)


WOODS = ("#c8a06a", "#b98a55", "#d9bb8b", "#8a5a36", "#5b3d2a", "#a06a3c", "#cfae84", "#6f4a30")
LACQUERS = ("#eeece6", "#e2ddd2", "#dfe3e4", "#b9c2c0", "#8d9a94", "#4f5b66", "#3b3d40", "#c9b9a4")
KITCHENS = (
    "#f0eeea",
    "#e9e4d8",
    "#7f8f8b",
    "#3f5361",
    "#51624f",
    "#b7b4ab",
    "#2f3437",
    "#a8b9c4",
    "#d3c7ae",
)
STONES = ("#d8d4cc", "#4a4a4c", "#8d8a85", "#b9a890", "#2c2b2b", "#c4c0ba")
UPHOLSTERY = (
    "#8f8a82",
    "#5a6470",
    "#b8ad9c",
    "#3d5a5f",
    "#7a4b3a",
    "#6a7556",
    "#c7bfb2",
    "#44506b",
    "#a35f45",
    "#757575",
)
ACCENTS = (
    "#c4573a",
    "#d9a13b",
    "#2f6f73",
    "#86a08b",
    "#b56576",
    "#355070",
    "#e3d5c0",
    "#8c4a5a",
    "#6b8fa3",
    "#4f7a4a",
)
BEDDINGS = ("#f2f0ec", "#dfe4e8", "#cfd8d3", "#e8dccb", "#aebccb", "#8a97a8", "#d8c2b8", "#b7c0a8")
CURTAINS = ("#e6e0d4", "#c9c3b8", "#9aa5a8", "#7d8a78", "#b5895f", "#dcd7cf", "#62707c", "#c7a9a0")
RUGS = ("#a89a86", "#8c3f3a", "#37475a", "#cbbfae", "#6d7a6e", "#b98b54", "#7b7f86", "#d6cdbf")
_UPHOLSTERY_CLOTHS = (
    "plain", "linen", "basket", "twill", "herringbone", "birdseye", "melange", "boucle",
    "velvet", "chenille", "corduroy", "felt",
)  # fmt: skip
_CUSHION_CLOTHS = (
    "plain", "linen", "basket", "birdseye", "velvet", "corduroy", "striped", "checked", "knit",
    "denim", "boucle",
)  # fmt: skip
METALS = (("#c9c7c2", 0.3), ("#2b2a29", 0.45), ("#c5a35c", 0.28), ("#8f7a66", 0.4))

CHROME = Material("metal", hex_color("#dcdde0"), roughness=0.08)
STEEL = Material("metal", hex_color("#bcbdbd"), roughness=0.32)
IRON = Material("metal", hex_color("#4a4a4b"), roughness=0.5)
BRASS = Material("metal", hex_color("#d0a85e"), roughness=0.25)
GLASS = Material("glass", (0.95, 0.97, 0.96), roughness=0.0)
MIRROR = Material("mirror", (0.92, 0.92, 0.92), roughness=0.0)
CERAMIC = Material("ceramic", hex_color("#efeeea"), roughness=0.12)
WHITE_PLASTIC = Material("plastic", hex_color("#e9e8e4"), roughness=0.35)
BLACK_PLASTIC = Material("plastic", hex_color("#1d1e20"), roughness=0.4)
SCREEN = Material("plastic", hex_color("#0b0c0e"), roughness=0.12)
RUBBER = Material("plastic", hex_color("#26262a"), roughness=0.7)
WHITE_PAINT = Material("paint", hex_color("#ece9e2"), roughness=0.4)
PAGES = Material("paper", hex_color("#e8dfc9"), roughness=0.9)
SOIL = Material("soil", hex_color("#3a2a1e"), roughness=0.95)
TERRACOTTA = Material("ceramic", hex_color("#b4683f"), roughness=0.8, family="earthenware")
WICKER = Material(
    "wood", hex_color("#b08a58"), roughness=0.6, accent=hex_color("#7d5c36"), family="wicker"
)


@dataclass(frozen=True)
class Style:
    """Materials and shapes that the furniture of one home shares."""

    wood: Material
    dark_wood: Material
    lacquer: Material  # of painted cabinets
    cabinet: Material  # of most cabinets: wood or lacquer
    kitchen: Material
    worktop: Material
    metal: Material  # handles, lamp stems, chair frames
    upholstery: Material
    second_upholstery: Material  # armchairs, dining seats
    cushions: tuple[Material, ...]
    bedding: Material
    throw: Material
    curtain: Material
    rug: Material
    towel: Material
    shade: Material
    accents: tuple[Material, ...]  # of small painted or glazed objects
    books: tuple[Material, ...]
    front: Literal["flat", "framed"]
    handle: Literal["bar", "knob", "edge"]
    legs: Literal["square", "tapered", "round", "metal"]
    worktop_height: float  # metres
    kelvin: float  # of the home's lamps
    prints: tuple[Material, ...] = ()  # of packaging, magazines and photographs
    disorder: float = 0.5  # from tidy (0) to littered (1)

    def picture(self, rng: np.random.Generator) -> Material:
        """Draw the material of an abstract picture."""
        return Material("picture", hex_color("#9a938a"), 0.6, variant=int(rng.integers(1 << 30)))


def make_style(rng: np.random.Generator) -> Style:
    """Draw a style."""

    def pick(codes: tuple[str, ...]) -> Color:
        return hex_color(codes[int(rng.integers(len(codes)))])

    def variant() -> int:
        return int(rng.integers(1 << 30))

    wood_color = pick(WOODS)
    wood = Material(
        "wood",
        wood_color,
        roughness=float(rng.uniform(0.35, 0.55)),
        accent=scaled_color(wood_color, 0.55),
        variant=variant(),
    )
    dark = hex_color(("#5b3d2a", "#3f2c20", "#6f4a30", "#4a3a2e")[int(rng.integers(4))])
    dark_wood = replace(wood, color=dark, accent=scaled_color(dark, 0.5), variant=variant())
    lacquer = Material("paint", pick(LACQUERS), roughness=float(rng.uniform(0.3, 0.5)))
    kitchen: Material = Material("paint", pick(KITCHENS), roughness=float(rng.uniform(0.25, 0.5)))
    if rng.random() < 0.25:
        kitchen = replace(wood, variant=variant())
    stone = pick(STONES)
    worktop = (
        Material("stone", stone, 0.3, accent=scaled_color(stone, 0.6), variant=variant())
        if rng.random() < 0.65
        else replace(
            wood, color=hex_color("#b98a55"), accent=hex_color("#8a6238"), variant=variant()
        )
    )
    metal_code, metal_roughness = METALS[int(rng.integers(len(METALS)))]

    def cloth(codes: tuple[str, ...], *families: str) -> Material:
        color = pick(codes)
        family = families[int(rng.integers(len(families)))]
        return Material(
            "fabric", color, 0.9, scaled_color(color, 0.7), variant=variant(), family=family
        )

    upholstery = (
        Material("leather", pick(("#5a3a26", "#2a2725", "#8a5a3a", "#b59a7c")), 0.45)
        if rng.random() < 0.2
        else cloth(UPHOLSTERY, *_UPHOLSTERY_CLOTHS)
    )
    accents = [ACCENTS[int(k)] for k in rng.permutation(len(ACCENTS))]
    book_colors = (*ACCENTS, "#e7e1d5", "#2a2d33", "#7a2f2c", "#1f3d4f", "#c9b27c")
    books = [book_colors[int(k)] for k in rng.permutation(len(book_colors))[:8]]
    rug = pick(RUGS)
    translucent = Material(
        "fabric",
        pick(CURTAINS),
        0.9,
        variant=variant(),
        translucent=bool(rng.random() < 0.6),
        family=("linen", "linen", "plain", "satin", "striped", "velvet")[int(rng.integers(6))],
    )
    return Style(
        wood=wood,
        dark_wood=dark_wood,
        lacquer=lacquer,
        cabinet=wood if rng.random() < 0.6 else lacquer,
        kitchen=kitchen,
        worktop=worktop,
        metal=Material("metal", hex_color(metal_code), roughness=metal_roughness),
        upholstery=upholstery,
        second_upholstery=cloth(UPHOLSTERY if rng.random() < 0.7 else ACCENTS, *_UPHOLSTERY_CLOTHS),
        cushions=tuple(
            Material(
                "fabric",
                hex_color(code),
                0.9,
                hex_color("#d9d2c4"),
                variant=variant(),
                family=_CUSHION_CLOTHS[int(rng.integers(len(_CUSHION_CLOTHS)))],
            )
            for code in accents[:3]
        ),
        bedding=cloth(BEDDINGS, "cotton", "cotton", "linen", "striped", "checked", "satin"),
        throw=Material(
            "fabric",
            hex_color(accents[3]),
            0.95,
            variant=variant(),
            family=("knit", "cable", "herringbone", "checked", "felt")[int(rng.integers(5))],
        ),
        curtain=translucent,
        rug=Material(
            "carpet",
            rug,
            0.95,
            accent=pick(RUGS),
            variant=variant(),
            family=("cut", "shag", "loop", "sisal", "rag", "kilim", "kilim")[int(rng.integers(7))],
        ),
        towel=Material("fabric", hex_color(accents[4]), 0.95, variant=variant(), family="terry"),
        shade=Material("paper", pick(("#efe6d4", "#e7dcc6", "#f2efe8", "#d8cdb8")), 0.9),
        accents=tuple(Material("ceramic", hex_color(code), 0.3) for code in accents[:5]),
        books=tuple(Material("paint", hex_color(code), 0.55) for code in books),
        front="flat" if rng.random() < 0.6 else "framed",
        handle=("bar", "knob", "edge")[int(rng.integers(3))],
        legs=("square", "tapered", "round", "metal")[int(rng.integers(4))],
        worktop_height=float(rng.uniform(0.88, 0.94)),
        kelvin=float(rng.choice([2700.0, 2800.0, 3000.0, 3300.0])),
        prints=tuple(
            Material("picture", hex_color("#9a938a"), 0.45, variant=variant()) for _ in range(5)
        ),
        disorder=float(rng.uniform(0.1, 1.0)),
    )
