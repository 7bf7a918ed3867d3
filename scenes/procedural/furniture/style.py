"""Styles: an interior style has choices that belong together, a home's style draws from them.

An `Interior` holds what a style draws from; `make_style` and `make_finishes` draw one home from it.
Repeated entries are as much more probable. The interior styles are in `style.yaml`; what one leaves
out is as in "eclectic".
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import Literal

from pbrnet.scenes.checked import build
from pbrnet.scenes.color import Color
from pbrnet.scenes.files import data_beside
from pbrnet.scenes.looks import STYLES, StyleName
from pbrnet.scenes.procedural.furniture import materials as m
from pbrnet.scenes.procedural.piece import Material
from pbrnet.scenes.seeds import Draw

Front = Literal["flat", "framed"]
Handle = Literal["bar", "knob", "edge"]
Legs = Literal["square", "tapered", "round", "metal"]


@dataclass(frozen=True)
class Interior:
    """Choices of a style: sRGB colours "#rrggbb", families of surfaces, shares of homes."""

    woods: tuple[str, ...]
    wood_families: tuple[str, ...]
    dark_woods: tuple[str, ...]
    lacquers: tuple[str, ...]
    wooden_cabinets: float
    kitchens: tuple[str, ...]
    wooden_kitchens: float
    stones: tuple[str, ...]
    stone_families: tuple[str, ...]
    stone_worktops: float
    metals: tuple[tuple[str, float], ...]  # colour, roughness
    upholstery: tuple[str, ...]
    cloths: tuple[str, ...]
    leathers: tuple[str, ...]
    leather: float  # share of homes whose sofa is of leather
    accents: tuple[str, ...]  # five or more
    cushion_cloths: tuple[str, ...]
    beddings: tuple[str, ...]
    bedding_cloths: tuple[str, ...]
    throw_cloths: tuple[str, ...]
    curtains: tuple[str, ...]
    curtain_cloths: tuple[str, ...]
    sheer_curtains: float
    curtained: float  # share of rooms whose windows have curtains
    rugs: tuple[str, ...]
    rug_families: tuple[str, ...]
    shades: tuple[str, ...]
    kelvins: tuple[float, ...]
    fronts: tuple[Front, ...]
    handles: tuple[Handle, ...]
    legs: tuple[Legs, ...]
    # Variants that the style has of a piece's feature; all of them where the feature is missing.
    shapes: dict[str, tuple[str, ...]]
    density: float  # things and optional furniture, relative to "eclectic"
    disorder: tuple[float, float]
    # Measured reflectances of paint: about 0.8 for fresh white, 0.5 to 0.7 for tints.
    walls: tuple[str, ...]
    wall_families: tuple[str, ...]
    accent_walls: tuple[str, ...]
    accent: float  # share of rooms with an accent wall
    papers: tuple[str, ...]
    papered: float  # share of accent walls that are papered
    bare: Literal["", "brick", "concrete", "boards"]  # what other accent walls are made of
    floors: tuple[str, ...]
    floor_families: tuple[str, ...]
    carpets: tuple[str, ...]
    carpeted: float  # share of bedrooms and studies
    floor_tiles: tuple[str, ...]
    floor_tile_families: tuple[str, ...]
    wall_tiles: tuple[str, ...]
    wall_tile_families: tuple[str, ...]
    frames: tuple[str, ...]
    doors: tuple[str, ...]
    panels: tuple[Literal["flat", "two", "four"], ...]
    glazing_bars: float
    cornices: tuple[float, ...]  # metres
    skirting: tuple[float, float]  # least and greatest height, metres
    beams: tuple[Literal["wood", "dark", "paint", "steel"], ...]


def _read() -> Mapping[StyleName, Interior]:
    """Read the styles from their file; `ParameterError` names a wrong or missing key."""
    found = data_beside(__file__)
    common = found["eclectic"]
    return MappingProxyType({name: build(Interior, common | found[name], name) for name in STYLES})


INTERIORS = _read()


_BOOKS = ("#e7e1d5", "#2a2d33", "#7a2f2c", "#1f3d4f", "#c9b27c", "#355070")
_PLAIN = ("#d8d6d0", "#3a3d44", "#41546e", "#7a7d80")
_CLOTHS = ("cotton", "denim", "knit", "twill", "striped", "checked", "linen")


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

    def shape(self, draw: Draw, feature: str, variants: Sequence[str]) -> str:
        """Draw a variant of a piece's feature among those that the style has, else among all."""
        return draw.pick(self.interior.shapes.get(feature, tuple(variants)))

    @property
    def accent(self) -> Material:
        """The first accent."""
        return self.accents[0]

    def picture(self, draw: Draw) -> Material:
        """Draw the material of an abstract picture."""
        return Material("picture", m.hex_color("#9a938a"), 0.6, variant=draw.variant())

    def tinted(self, draw: Draw) -> Material:
        """Draw one of the home's small colours, in plastic."""
        return Material("plastic", draw.pick(self.accents).color, 0.35)

    def glazed(self, draw: Draw) -> Material:
        """Draw the home's white or one of its coloured glazes."""
        return m.CERAMIC if draw.chance(0.5) else draw.pick(self.accents)

    def garment(self, draw: Draw) -> Material:
        """Draw the cloth of a garment, in a small colour of the home or in white, grey or blue."""
        color = draw.pick(self.accents).color if draw.chance(0.5) else _color(draw, _PLAIN)
        return Material("fabric", color, 0.95, family=draw.pick(_CLOTHS), variant=draw.whole(4) + 1)


def draw_style_name(draw: Draw) -> StyleName:
    """Draw the name of an interior style; all are equally probable."""
    return draw.pick(STYLES)


def make_style(draw: Draw, name: StyleName | None = None) -> Style:
    """Draw a home's style from an interior style, by default from any."""
    drawn = draw_style_name(draw)
    name = drawn if name is None else name
    has = INTERIORS[name]
    wood = _wood(draw, _color(draw, has.woods), has)
    dark = _color(draw, has.dark_woods)
    dark_wood = replace(wood, color=dark, accent=m.scaled_color(dark, 0.5), variant=draw.variant())
    lacquer = Material("paint", _color(draw, has.lacquers), draw.between(0.3, 0.5))
    kitchen = Material("paint", _color(draw, has.kitchens), draw.between(0.25, 0.5))
    if draw.chance(has.wooden_kitchens):
        kitchen = replace(wood, variant=draw.variant())
    worktop = _worktop(draw, wood, has)
    metal_code, metal_roughness = draw.pick(has.metals)
    if draw.chance(has.leather):
        upholstery = Material("leather", _color(draw, has.leathers), 0.45)
    else:
        upholstery = _cloth(draw, has.upholstery, has.cloths)
    accents = [m.hex_color(code) for code in draw.shuffled(has.accents)]
    books = draw.shuffled((*_BOOKS, *has.accents))[:8]
    rug = _color(draw, has.rugs)
    curtain = Material(
        "fabric",
        _color(draw, has.curtains),
        0.9,
        variant=draw.variant(),
        translucent=draw.chance(has.sheer_curtains),
        family=draw.pick(has.curtain_cloths),
    )
    return Style(
        name=name,
        wood=wood,
        dark_wood=dark_wood,
        lacquer=lacquer,
        cabinet=wood if draw.chance(has.wooden_cabinets) else lacquer,
        kitchen=kitchen,
        worktop=worktop,
        metal=Material("metal", m.hex_color(metal_code), roughness=metal_roughness),
        upholstery=upholstery,
        second_upholstery=_cloth(
            draw, has.upholstery if draw.chance(0.7) else has.accents, has.cloths
        ),
        cushions=tuple(
            _woven(draw, color, 0.9, has.cushion_cloths, m.hex_color("#d9d2c4"))
            for color in accents[:3]
        ),
        bedding=_cloth(draw, has.beddings, has.bedding_cloths),
        throw=_woven(draw, accents[3], 0.95, has.throw_cloths),
        curtain=curtain,
        rug=replace(
            Material("carpet", rug, 0.95, accent=_color(draw, has.rugs)),
            variant=draw.variant(),
            family=draw.pick(has.rug_families),
        ),
        towel=Material("fabric", accents[4], 0.95, variant=draw.variant(), family="terry"),
        shade=Material("paper", _color(draw, has.shades), 0.9),
        accents=tuple(Material("ceramic", color, 0.3) for color in accents[:5]),
        books=tuple(Material("paint", m.hex_color(code), 0.55) for code in books),
        front=draw.pick(has.fronts),
        handle=draw.pick(has.handles),
        legs=draw.pick(has.legs),
        worktop_height=draw.between(0.88, 0.94),
        kelvin=draw.pick(has.kelvins),
        prints=tuple(
            Material("picture", m.hex_color("#9a938a"), 0.45, variant=draw.variant())
            for _ in range(5)
        ),
        disorder=draw.between(*has.disorder),
    )


def _color(draw: Draw, codes: Sequence[str]) -> Color:
    return m.hex_color(draw.pick(codes))


def _wood(draw: Draw, color: Color, has: Interior) -> Material:
    roughness, variant = draw.between(0.35, 0.55), draw.variant()
    family = draw.pick(has.wood_families)
    accent = m.scaled_color(color, 0.55)
    return Material("wood", color, roughness, accent, 1.0, variant, family=family)


def _worktop(draw: Draw, wood: Material, has: Interior) -> Material:
    stone = _color(draw, has.stones)
    if draw.chance(has.stone_worktops):
        variant, family = draw.variant(), draw.pick(has.stone_families)
        accent = m.scaled_color(stone, 0.6)
        return Material("stone", stone, 0.3, accent, variant=variant, family=family)
    color, accent = m.hex_color("#b98a55"), m.hex_color("#8a6238")
    return replace(wood, color=color, accent=accent, variant=draw.variant())


def _cloth(draw: Draw, codes: Sequence[str], families: Sequence[str]) -> Material:
    color, family = _color(draw, codes), draw.pick(families)
    accent = m.scaled_color(color, 0.7)
    return Material("fabric", color, 0.9, accent, variant=draw.variant(), family=family)


def _woven(
    draw: Draw, color: Color, roughness: float, families: Sequence[str], accent: Color | None = None
) -> Material:
    variant, family = draw.variant(), draw.pick(families)
    return Material("fabric", color, roughness, accent, variant=variant, family=family)
