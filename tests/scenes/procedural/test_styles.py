"""Interior styles: homes of one style are alike, and differ from those of others."""

from collections.abc import Sequence
from dataclasses import fields, replace
from itertools import product

import numpy as np
import pytest

from pbrnet.scenes.color import Color
from pbrnet.scenes.looks import STYLES, StyleName
from pbrnet.scenes.procedural.finishes import make_finishes
from pbrnet.scenes.procedural.furnishing.placement import furnish
from pbrnet.scenes.procedural.furniture import FURNITURE_KINDS, make_style
from pbrnet.scenes.procedural.furniture.materials import hex_color
from pbrnet.scenes.procedural.furniture.style import INTERIORS, Style, draw_style_name
from pbrnet.scenes.procedural.piece import Material
from pbrnet.scenes.procedural.planning import make_plan
from pbrnet.scenes.procedural.textures.families import FAMILIES, family_of
from pbrnet.scenes.seeds import generator

ROOMS = {"a": "living", "b": "bedroom", "c": "kitchen", "d": "bathroom"}


def _lab(color: Color) -> list[float]:
    """CIE 1976 L*a*b* of a linear Rec. 709 colour, white at D65."""
    xyz = np.array([[0.4124, 0.3576, 0.1805], [0.2126, 0.7152, 0.0722], [0.0193, 0.1192, 0.9505]])
    x, y, z = np.cbrt(xyz @ color / [0.9505, 1.0, 1.089])
    return [116 * y - 16, 500 * (x - y), 200 * (y - z)]


def _features(name: StyleName, seed: int) -> np.ndarray:
    """Colours and materials of a home: L*a*b* in units of 25, one-hot shapes and families."""
    style = make_style(generator(seed, "style", name), name)
    made = make_finishes(generator(seed, "finishes", name), style, ROOMS)
    living, bath = made.rooms["a"], made.rooms["d"]
    assert bath.wall_tiles is not None
    materials = [
        style.wood, style.cabinet, style.kitchen, style.worktop, style.metal, style.upholstery,
        style.second_upholstery, style.rug, style.curtain, style.bedding, *style.accents[:3],
        living.floor, living.wall, living.accent or living.wall, bath.floor, bath.wall_tiles,
        made.door, made.frame,
    ]  # fmt: skip
    values = [value / 25 for one in materials for value in _lab(one.color)]
    for kind in ("wood", "planks", "fabric", "plaster", "stone", "tiles", "carpet"):
        shown = {family_of(one) for one in materials if one.kind == kind}
        values += [0.7 * (family in shown) for family in FAMILIES[kind]]
    for drawn, among in (
        (style.front, ("flat", "framed")),
        (style.handle, ("bar", "knob", "edge")),
        (style.legs, ("square", "tapered", "round", "metal")),
    ):
        values += [0.7 * (drawn == one) for one in among]
    return np.array([*values, made.glazing_bars, 10 * made.skirting_height, 10 * made.cornice])


def test_a_home_shows_its_style() -> None:
    """The nearest mean of colours and materials names the style of nine in ten unseen homes."""
    means = {
        name: np.mean([_features(name, seed) for seed in range(30)], axis=0) for name in STYLES
    }
    right = dict.fromkeys(STYLES, 0)
    for name in STYLES:
        for seed in range(100, 115):
            found = _features(name, seed)
            right[name] += name == min(
                STYLES, key=lambda one: float(np.sum((found - means[one]) ** 2))
            )
    assert sum(right.values()) >= 0.9 * 15 * len(STYLES), right
    assert min(right.values()) >= 10, right  # "eclectic" is anything


def test_styles_name_what_exists(monkeypatch: pytest.MonkeyPatch) -> None:
    assert len(STYLES) >= 8 and set(INTERIORS) == set(STYLES)
    features: dict[str, set[str]] = {}
    for name, interior in INTERIORS.items():
        assert len(interior.accents) >= 5, name
        for field in fields(interior):
            value = getattr(interior, field.name)
            if isinstance(value, tuple) and value and str(value[0]).startswith("#"):
                assert all(0 <= band <= 1 for code in value for band in hex_color(code))
        for kind, families in (
            ("wood", interior.wood_families),
            ("planks", interior.floor_families),
            ("tiles", (*interior.floor_tile_families, *interior.wall_tile_families)),
            ("fabric", (*interior.cloths, *interior.cushion_cloths, *interior.bedding_cloths,
                        *interior.throw_cloths, *interior.curtain_cloths)),
            ("carpet", interior.rug_families),
            ("stone", interior.stone_families),
            ("plaster", interior.wall_families),
            ("wallpaper", interior.papers),
        ):  # fmt: skip
            assert set(families) <= set(FAMILIES[kind]), (name, kind)
        for feature, variants in interior.shapes.items():
            features.setdefault(feature, set()).update(variants)
    assert {draw_style_name(generator(seed)) for seed in range(100)} == set(STYLES)
    assert features  # named variants that the pieces know:
    known: dict[str, set[str]] = {}

    def shape(self: Style, rng: np.random.Generator, name: str, among: Sequence[str]) -> str:
        known.setdefault(name, set()).update(among)
        return among[int(rng.integers(len(among)))]

    monkeypatch.setattr(Style, "shape", shape)
    style = make_style(generator(0))
    for kind in ("dining_chair", "sofa", "double_bed", "coffee_table", "round_table"):
        FURNITURE_KINDS[kind].make(generator(0), style)
    for kind, seed in product(("pendant_lamp", "floor_lamp"), range(30)):
        FURNITURE_KINDS[kind].make(generator(seed), style)
    assert all(variants <= known[feature] for feature, variants in features.items())


def test_dense_styles_fill_the_same_rooms_with_more() -> None:
    found = {}
    for name in ("minimal", "bohemian"):
        style = replace(make_style(generator(0), name), disorder=0.5)
        plans = [make_plan(generator(seed, "plan"), 1, 1) for seed in (5, 7, 8)]
        found[name] = sum(len(furnish(generator(0), plan, style)) for plan in plans)
    assert found["bohemian"] > 1.2 * found["minimal"], found


def test_a_style_s_materials_are_kept_in_its_finishes() -> None:
    brick = [
        made.accent
        for seed in range(40)
        for made in make_finishes(
            generator(seed, "f"), make_style(generator(seed), "industrial"), ROOMS
        ).rooms.values()
        if isinstance(made.accent, Material) and made.accent.kind == "brick"
    ]
    assert len(brick) > 10
