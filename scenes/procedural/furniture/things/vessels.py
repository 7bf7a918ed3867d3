"""Bottles, jars, cups, pans and other bodies of revolution."""

from __future__ import annotations

import numpy as np

from pbrnet.scenes.procedural.furniture.parts.build import Builder, assembles
from pbrnet.scenes.procedural.furniture.parts.geometry import (
    BodyMesh,
    bar,
    box,
    cylinder,
    lathe,
    tube,
)
from pbrnet.scenes.procedural.furniture.style import (
    BLACK_PLASTIC,
    CERAMIC,
    GLASS,
    IRON,
    PAGES,
    STEEL,
    WHITE_PLASTIC,
    Style,
    hex_color,
)
from pbrnet.scenes.procedural.piece import Material
from pbrnet.scenes.seeds import Draw

Profile = list[tuple[float, float]]
Range = tuple[float, float]  # least and greatest, metres
_GREEN = Material("plastic", hex_color("#24402a"), 0.08)
_BROWN = Material("plastic", hex_color("#3a2312"), 0.08)
_ALUMINIUM = Material("metal", hex_color("#c4c5c6"), 0.35, family="brushed")


def tinted(draw: Draw, style: Style) -> Material:
    """One of the home's small colours, in plastic."""
    chosen = draw.pick(style.accents)
    return Material("plastic", chosen.color, 0.35)


def glazed(draw: Draw, style: Style) -> Material:
    """The home's white or one of its coloured glazes."""
    return CERAMIC if draw.chance(0.5) else draw.pick(style.accents)


def printed(draw: Draw, style: Style, mesh: BodyMesh) -> tuple[Material, BodyMesh]:
    """A printed paper of the home, and the mesh with uvs in a random part of the print."""
    low = mesh.uvs.min(axis=0)
    size = np.maximum(np.ptp(mesh.uvs, axis=0), 1e-6)
    part = draw.uniform(0.25, 0.6, 2)
    start = draw.uniform(0, 1 - part)
    uvs = start + (mesh.uvs - low) / size * part
    print_ = draw.pick(style.prints)
    return print_, BodyMesh(mesh.vertices, mesh.faces, uvs, mesh.smooth)


@assembles("bottle")
def bottle(
    b: Builder,
    draw: Draw,
    style: Style,
    radius: Range,
    height: Range,
    shoulder: float = 0.6,
    neck: float = 0.35,
    body: str = "any",
    label: bool = True,
) -> None:
    """A bottle: body, shoulder from `shoulder` of the height on, neck, cap, paper label."""
    r, h = draw.between(*radius), draw.between(*height)
    n = max(neck * r, 0.009)
    s, top = shoulder * h, h - 0.02
    profile = [
        (0.9 * r, 0.0), (r, 0.05 * h), (r, s), (0.85 * r, s + 0.25 * (top - s)),
        (1.15 * n, s + 0.6 * (top - s)), (n, top),
    ]  # fmt: skip
    choices = {
        "glass": [_GREEN, _BROWN, CERAMIC],
        "plastic": [WHITE_PLASTIC, tinted(draw, style), tinted(draw, style)],
        "any": [_GREEN, _BROWN, WHITE_PLASTIC, tinted(draw, style)],
        "metal": [_ALUMINIUM, style.metal, tinted(draw, style)],
    }[body]
    b.add(draw.pick(choices), lathe(profile, 20), name="body")
    cap = draw.pick([BLACK_PLASTIC, WHITE_PLASTIC, _ALUMINIUM])
    b.add(cap, cylinder(1.2 * n, top, h, 16, 0.001), name="cap")
    if label and s > 0.05:
        paper = lathe([(r + 0.0006, 0.22 * s), (r + 0.0006, 0.85 * s)], 20)
        b.add(*printed(draw, style, paper), name="label")


@assembles("box")
def jar(
    b: Builder,
    draw: Draw,
    style: Style,
    radius: Range,
    height: Range,
    body: str = "plastic",
    lid: bool = True,
    label: bool = True,
) -> None:
    """A jar, tin or can: straight body with a lid."""
    r, h = draw.between(*radius), draw.between(*height)
    top = 0.88 * h if lid else h
    material = {
        "plastic": tinted(draw, style),
        "ceramic": glazed(draw, style),
        "metal": _ALUMINIUM,
        "tin": draw.pick(style.books),
        "wood": style.wood,
        "white": WHITE_PLASTIC,
    }[body]
    b.add(material, cylinder(r, 0.0, top, 22, min(0.003, 0.1 * r)), name="body")
    if lid:
        cover = draw.pick([style.wood, BLACK_PLASTIC, _ALUMINIUM, material])
        b.add(cover, cylinder(1.03 * r, top, h, 22, 0.0015), name="lid")
    if label:
        paper = lathe([(r + 0.0006, 0.15 * top), (r + 0.0006, 0.8 * top)], 22)
        b.add(*printed(draw, style, paper), name="label")


def _hollow(r: float, h: float, foot: float = 0.7, wall: float = 0.003) -> Profile:
    """An open vessel: from its foot outwards, over the rim, down inside."""
    t = np.linspace(0, 1, 6)
    outer = [(r * (foot + (1 - foot) * float(x) ** 0.5), float(x) * h) for x in t]
    inner = [(max(a - wall, 0.001), max(z, wall * 1.6)) for a, z in outer[::-1]]
    return [*outer, *inner[:-1], (inner[-1][0] - 0.001, wall * 1.6)]


@assembles("crockery")
def cup(
    b: Builder,
    draw: Draw,
    style: Style,
    radius: Range,
    height: Range,
    handle: bool = True,
    glass: bool = False,
    foot: float = 0.75,
) -> None:
    """A cup, mug, tumbler or bowl."""
    r, h = draw.between(*radius), draw.between(*height)
    material = GLASS if glass else glazed(draw, style)
    b.add(material, lathe(_hollow(r, h, foot), 24), name="body")
    if handle:
        turn = np.linspace(-0.5 * np.pi, 0.5 * np.pi, 9)
        ear = np.stack(
            [0.92 * r + 0.3 * h * np.cos(turn), 0 * turn, 0.52 * h + 0.3 * h * np.sin(turn)], axis=1
        )
        b.add(material, tube(ear, 0.0045, 8), name="handle")


@assembles("glass")
def stemmed(b: Builder, draw: Draw, style: Style, slim: bool) -> None:
    """A wine or champagne glass."""
    r = draw.between(0.024, 0.028) if slim else draw.between(0.034, 0.042)
    h = draw.between(0.19, 0.23)
    bowl = 0.42 * h if not slim else 0.36 * h
    profile = [
        (0.034, 0.0), (0.034, 0.0015), (0.005, 0.006), (0.0035, bowl), (0.55 * r, bowl + 0.012),
        (r, bowl + 0.35 * (h - bowl)), (0.8 * r, h), (0.8 * r - 0.0014, h),
        (r - 0.0014, bowl + 0.35 * (h - bowl)), (0.55 * r, bowl + 0.0145), (0.001, bowl + 0.006),
    ]  # fmt: skip
    b.add(GLASS, lathe(profile, 24), name="glass")


@assembles("clutter")
def filled_cup(b: Builder, draw: Draw, style: Style, what: str) -> None:
    """A beaker with pens, brushes, spoons or toothbrushes in it."""
    kinds = {"pens": "clutter", "brushes": "clutter", "spoons": "crockery"}
    b.category = kinds.get(what, "fitting")
    r = draw.between(0.035, 0.045) if what != "spoons" else draw.between(0.055, 0.065)
    h = draw.between(0.09, 0.11) if what != "spoons" else draw.between(0.14, 0.17)
    b.add(glazed(draw, style), lathe(_hollow(r, h, 0.92), 20), name="beaker")
    long, thick = {"pens": (0.15, 0.004), "brushes": (0.2, 0.004), "spoons": (0.3, 0.005)}.get(
        what, (0.18, 0.005)
    )
    for k in range(draw.whole(2, 7)):
        turn = 2 * np.pi * (k / 7 + draw.between(0, 0.1))
        foot = 0.3 * r * np.array([np.cos(turn), np.sin(turn)])
        lean = 0.72 * r * np.array([np.cos(turn), np.sin(turn)])
        reach = long * draw.between(0.85, 1.1) / h
        end = foot + (lean - foot) * reach
        body = bar((*foot.tolist(), 0.006), (*end.tolist(), reach * h), thick, 8)
        stick = draw.pick([style.wood, tinted(draw, style), BLACK_PLASTIC])
        b.add(stick, body, name="sticks")


@assembles("pot")
def pan(b: Builder, draw: Draw, style: Style, deep: float) -> None:
    """A pan or saucepan with a straight handle."""
    r = draw.between(0.1, 0.14) if deep < 0.08 else draw.between(0.075, 0.1)
    metal = draw.pick([IRON, STEEL, BLACK_PLASTIC])
    b.add(metal, lathe(_hollow(r, deep, 0.82), 32), name="pan")
    grip = BLACK_PLASTIC if draw.chance(0.6) else style.wood
    b.add(grip, box((0.17, 0.022, 0.016), (r + 0.075, 0, 0.75 * deep), 0.005), name="handle")


@assembles("crockery")
def plate(b: Builder, draw: Draw, style: Style, crumbs: bool) -> None:
    """A plate with crumbs, or two plates with a fork and a knife on them."""
    r = draw.between(0.095, 0.135)
    glaze = glazed(draw, style)
    profile = [
        (0.58 * r, 0.0), (0.66 * r, 0.003), (r, 0.017), (r, 0.02), (0.66 * r, 0.0075),
        (0.0, 0.0065),
    ]  # fmt: skip
    b.add(glaze, lathe(profile, 36), name="plate")
    if crumbs:
        for _ in range(draw.whole(4, 9)):
            x, y = draw.uniform(-0.4 * r, 0.4 * r, 2)
            crumb = box(
                draw.uniform(0.003, 0.009, 3).tolist(), (float(x), float(y), 0.0066), 0.0008
            )
            b.add(Material("paper", hex_color("#8a5a30"), 0.9), crumb, name="crumbs")
    else:
        for y in (-0.012, 0.012):
            b.add(STEEL, box((1.35 * r, 0.009, 0.002), (0.0, y, 0.0202), 0.0006), name="cutlery")


@assembles("crockery")
def teapot(b: Builder, draw: Draw, style: Style) -> None:
    """A teapot with a spout, a handle and a lid."""
    r = draw.between(0.065, 0.085)
    glaze = glazed(draw, style)
    body = [
        (0.6 * r, 0.0), (0.9 * r, 0.3 * r), (r, 0.7 * r), (0.85 * r, 1.2 * r), (0.4 * r, 1.5 * r),
        (0.36 * r, 1.56 * r), (0.12 * r, 1.66 * r), (0.14 * r, 1.8 * r), (0.0, 1.86 * r),
    ]  # fmt: skip
    b.add(glaze, lathe(body, 28), name="body")
    spout = np.array([[0.9 * r, 0, 0.55 * r], [1.3 * r, 0, 0.8 * r], [1.65 * r, 0, 1.35 * r]])
    b.add(glaze, tube(spout, [0.18 * r, 0.13 * r, 0.1 * r], 12), name="spout")
    turn = np.linspace(-0.5 * np.pi, 0.5 * np.pi, 9)
    ear = np.stack(
        [-0.85 * r - 0.5 * r * np.cos(turn), 0 * turn, 0.8 * r + 0.45 * r * np.sin(turn)], 1
    )
    b.add(glaze, tube(ear, 0.007, 8), name="handle")


@assembles("clutter")
def mill(b: Builder, draw: Draw, style: Style) -> None:
    """A pepper mill."""
    h = draw.between(0.14, 0.26)
    profile = [
        (0.026, 0.0), (0.028, 0.1 * h), (0.018, 0.5 * h), (0.026, 0.74 * h), (0.012, 0.78 * h),
        (0.025, 0.86 * h), (0.012, 0.97 * h), (0.0, h),
    ]  # fmt: skip
    b.add(style.dark_wood if draw.chance(0.5) else style.wood, lathe(profile, 20), name="mill")


@assembles("paper")
def roll(b: Builder, draw: Draw, style: Style, radius: float, height: float, spike: bool) -> None:
    """A roll of paper standing, with its core; kitchen rolls on a stand."""
    core = 0.021
    z = 0.012 if spike else 0.0
    tube_ = [(core, z), (radius, z), (radius, z + height), (core, z + height), (core - 0.001, z)]
    paper = lathe(tube_[:-1], 28)
    b.add(Material("paper", hex_color("#efece6"), 0.95, family="creased"), paper, name="paper")
    if spike:
        b.add(style.wood, cylinder(0.075, 0.0, 0.0115, 28, 0.002), name="stand")
        b.add(style.wood, cylinder(0.01, 0.0118, height + 0.05, 14, 0.002), name="stand")
    else:
        b.add(PAGES, cylinder(core - 0.0015, 0.0006, height - 0.0006, 18), name="core")


@assembles("bin", "free")
def bucket(b: Builder, draw: Draw, style: Style, size: float) -> None:
    """A bucket, basket or planter on the floor."""
    r = size * draw.between(0.9, 1.1)
    materials = [tinted(draw, style), style.metal, WHITE_PLASTIC]
    body = draw.pick(materials)
    b.add(body, lathe(_hollow(r, 1.7 * r, 0.75, 0.004), 28), name="bucket")


@assembles("food")
def wrapped_food(
    b: Builder,
    draw: Draw,
    style: Style,
    color: str,
    radius: float,
    flat: float,
    long: float = 1.0,
    peel: bool = False,
    stalk: bool = False,
) -> None:
    """A loaf of bread, an onion, a lemon or a pumpkin."""
    r = radius * draw.between(0.9, 1.12)
    turn = np.linspace(-0.5 * np.pi, 0.5 * np.pi, 12)
    profile = [(max(r * float(np.cos(t)), 0.0), r * flat * (1 + float(np.sin(t)))) for t in turn]
    profile[0], profile[-1] = (0.0, 0.0), (0.0, profile[-1][1])
    body = lathe(profile, 24)
    if long > 1:
        body = BodyMesh(body.scaled(x=long).vertices, body.faces, body.uvs * long**0.5)
    family = "nappa" if peel else "creased"
    skin = Material("leather" if peel else "paper", hex_color(color), 0.6, family=family)
    b.add(skin, body, name="food")
    if stalk:
        high = profile[-1][1]
        stem = bar((0, 0, 0.9 * high), (0.004, 0, 1.12 * high), 0.04 * r + 0.001, 6)
        b.add(style.dark_wood, stem, name="stalk")
