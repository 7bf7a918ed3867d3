"""Furniture style of a home: matching materials and common shapes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from pbrnet.scenes.color import Color, decode_srgb_value
from pbrnet.scenes.params import STYLES, StyleName
from pbrnet.scenes.procedural.furniture.interiors import INTERIORS, Front, Handle, Interior, Legs
from pbrnet.scenes.procedural.piece import Material


def hex_color(code: str) -> Color:
    """Return linear Rec. 709 RGB of an sRGB colour written as "#rrggbb"."""
    channels = [int(code[start : start + 2], 16) / 255 for start in (1, 3, 5)]
    linear = [decode_srgb_value(channel) for channel in channels]
    return (linear[0], linear[1], linear[2])


def scaled_color(color: Color, factor: float) -> Color:
    """Return a linear RGB colour times `factor`."""
    return (color[0] * factor, color[1] * factor, color[2] * factor)


_BOOKS = ("#e7e1d5", "#2a2d33", "#7a2f2c", "#1f3d4f", "#c9b27c", "#355070")

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

    name: StyleName
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
    front: Front
    handle: Handle
    legs: Legs
    worktop_height: float  # metres
    kelvin: float  # of the home's lamps
    prints: tuple[Material, ...] = ()  # of packaging, magazines and photographs
    disorder: float = 0.5  # from tidy (0) to littered (1)

    @property
    def interior(self) -> Interior:
        """The interior style that the home was drawn from."""
        return INTERIORS[self.name]

    def shape(self, rng: np.random.Generator, feature: str, variants: Sequence[str]) -> str:
        """Draw a variant of a piece's feature among those that the style has, else among all."""
        fitting = self.interior.shapes.get(feature, tuple(variants))
        return fitting[int(rng.integers(len(fitting)))]

    def picture(self, rng: np.random.Generator) -> Material:
        """Draw the material of an abstract picture."""
        return Material("picture", hex_color("#9a938a"), 0.6, variant=int(rng.integers(1 << 30)))


def draw_style_name(rng: np.random.Generator) -> StyleName:
    """Draw the name of an interior style; all are equally probable."""
    return STYLES[int(rng.integers(len(STYLES)))]


def make_style(rng: np.random.Generator, name: StyleName | None = None) -> Style:
    """Draw a home's style from an interior style, by default from any."""
    drawn = draw_style_name(rng)
    name = drawn if name is None else name
    has = INTERIORS[name]

    def pick(codes: Sequence[str]) -> Color:
        return hex_color(codes[int(rng.integers(len(codes)))])

    def variant() -> int:
        return int(rng.integers(1 << 30))

    wood_color = pick(has.woods)
    wood = Material(
        "wood",
        wood_color,
        roughness=float(rng.uniform(0.35, 0.55)),
        accent=scaled_color(wood_color, 0.55),
        variant=variant(),
        family=has.wood_families[int(rng.integers(len(has.wood_families)))],
    )
    dark = pick(has.dark_woods)
    dark_wood = replace(wood, color=dark, accent=scaled_color(dark, 0.5), variant=variant())
    lacquer = Material("paint", pick(has.lacquers), roughness=float(rng.uniform(0.3, 0.5)))
    kitchen: Material = Material(
        "paint", pick(has.kitchens), roughness=float(rng.uniform(0.25, 0.5))
    )
    if rng.random() < has.wooden_kitchens:
        kitchen = replace(wood, variant=variant())
    stone = pick(has.stones)
    worktop = (
        Material(
            "stone",
            stone,
            0.3,
            accent=scaled_color(stone, 0.6),
            variant=variant(),
            family=has.stone_families[int(rng.integers(len(has.stone_families)))],
        )
        if rng.random() < has.stone_worktops
        else replace(
            wood, color=hex_color("#b98a55"), accent=hex_color("#8a6238"), variant=variant()
        )
    )
    metal_code, metal_roughness = has.metals[int(rng.integers(len(has.metals)))]

    def cloth(codes: Sequence[str], families: Sequence[str]) -> Material:
        color = pick(codes)
        family = families[int(rng.integers(len(families)))]
        return Material(
            "fabric", color, 0.9, scaled_color(color, 0.7), variant=variant(), family=family
        )

    upholstery = (
        Material("leather", pick(has.leathers), 0.45)
        if rng.random() < has.leather
        else cloth(has.upholstery, has.cloths)
    )
    accents = [has.accents[int(k)] for k in rng.permutation(len(has.accents))]
    book_colors = (*_BOOKS, *has.accents)
    books = [book_colors[int(k)] for k in rng.permutation(len(book_colors))[:8]]
    rug = pick(has.rugs)
    curtain = Material(
        "fabric",
        pick(has.curtains),
        0.9,
        variant=variant(),
        translucent=bool(rng.random() < has.sheer_curtains),
        family=has.curtain_cloths[int(rng.integers(len(has.curtain_cloths)))],
    )
    return Style(
        name=name,
        wood=wood,
        dark_wood=dark_wood,
        lacquer=lacquer,
        cabinet=wood if rng.random() < has.wooden_cabinets else lacquer,
        kitchen=kitchen,
        worktop=worktop,
        metal=Material("metal", hex_color(metal_code), roughness=metal_roughness),
        upholstery=upholstery,
        second_upholstery=cloth(has.upholstery if rng.random() < 0.7 else has.accents, has.cloths),
        cushions=tuple(
            Material(
                "fabric",
                hex_color(code),
                0.9,
                hex_color("#d9d2c4"),
                variant=variant(),
                family=has.cushion_cloths[int(rng.integers(len(has.cushion_cloths)))],
            )
            for code in accents[:3]
        ),
        bedding=cloth(has.beddings, has.bedding_cloths),
        throw=Material(
            "fabric",
            hex_color(accents[3]),
            0.95,
            variant=variant(),
            family=has.throw_cloths[int(rng.integers(len(has.throw_cloths)))],
        ),
        curtain=curtain,
        rug=Material(
            "carpet",
            rug,
            0.95,
            accent=pick(has.rugs),
            variant=variant(),
            family=has.rug_families[int(rng.integers(len(has.rug_families)))],
        ),
        towel=Material("fabric", hex_color(accents[4]), 0.95, variant=variant(), family="terry"),
        shade=Material("paper", pick(has.shades), 0.9),
        accents=tuple(Material("ceramic", hex_color(code), 0.3) for code in accents[:5]),
        books=tuple(Material("paint", hex_color(code), 0.55) for code in books),
        front=has.fronts[int(rng.integers(len(has.fronts)))],
        handle=has.handles[int(rng.integers(len(has.handles)))],
        legs=has.legs[int(rng.integers(len(has.legs)))],
        worktop_height=float(rng.uniform(0.88, 0.94)),
        kelvin=float(rng.choice(has.kelvins)),
        prints=tuple(
            Material("picture", hex_color("#9a938a"), 0.45, variant=variant()) for _ in range(5)
        ),
        disorder=float(rng.uniform(*has.disorder)),
    )
