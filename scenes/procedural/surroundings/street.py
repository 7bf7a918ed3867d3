"""Streets outside the windows: road, pavements, parked cars, lamps, fences."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from pbrnet.scenes.arrays import Float64Array
from pbrnet.scenes.procedural.furniture.materials import hex_color
from pbrnet.scenes.procedural.furniture.parts.geometry import (
    BodyMesh,
    bar,
    box,
    cylinder,
    loft,
    merge,
    span,
    superellipse,
    tube,
)
from pbrnet.scenes.procedural.piece import Material, PiecePart
from pbrnet.scenes.procedural.scene_item import SceneItem, make_part, outdoor_item
from pbrnet.scenes.seeds import Draw

ROAD, PAVEMENT = 6.5, 2.2  # metres, widths
_PAINTS = ("#b9bcc0", "#1d1f22", "#e4e4e2", "#3a4a63", "#6a1f22", "#55595c", "#7a8288")
_LAMP_LUMENS, _LAMP_KELVIN = 1400.0, 2700.0


def street(rng: Draw, near: float, length: float, turn: float, ground: float) -> list[SceneItem]:
    """Return a street along X at y = -near, before it is turned about the origin by `turn` degrees.

    `near` is the distance to its first kerb, metres. Cars are parked along both kerbs, with gaps.
    """
    dark, chips, grey, joints = map(hex_color, ("#4a4a4c", "#6b6a68", "#8d8a86", "#6d6a66"))
    asphalt = Material("soil", dark, 0.9, chips, variant=rng.variant(), family="asphalt")
    stone = Material("tiles", grey, 0.85, joints, scale=1.2, variant=rng.variant())
    far = near + ROAD
    half = length / 2
    road = span((-half, -far, -0.3), (half, -near, 0.03))
    pavements = [
        span((-half, -near, -0.3), (half, -near + PAVEMENT, 0.14)),
        span((-half, -far - PAVEMENT, -0.3), (half, -far, 0.14)),
    ]
    surfaces = [("asphalt", asphalt, [road]), ("pavement", stone, pavements)]
    parts = [
        make_part(label, material, *(m.turned("z", turn).moved(z=ground) for m in meshes))
        for label, material, meshes in surfaces
    ]
    items = [outdoor_item("street", "ground", *parts)]
    number = 0
    for y, facing in ((-near - 1.1, 0.0), (-far + 1.1, 180.0)):
        x = -half + rng.between(0, 4)
        while x < half - 5:
            if abs(x) < 45 and rng.chance(0.6):
                flip = facing + (180.0 if rng.chance(0.15) else 0.0)
                car, name = _draw_car(rng), f"car-{number}"
                items.append(_parked(car, name, (x + 2.2, y), flip, turn, ground + 0.03))
                number += 1
            x += rng.between(5.2, 7.5)
    items.append(_lamps(rng, near, half, turn, ground))
    return items


def fence(rng: Draw, centre: Float64Array, half: float, ground: float) -> SceneItem:
    """Return a fence of boards or pickets around a square of `half` metres, with one open side."""
    high = rng.between(0.9, 1.8)
    wide = 0.09 if high < 1.3 else 0.14
    open_side = rng.whole(4)
    boards = []
    for side in range(4):
        if side == open_side:
            continue
        run = [
            box((wide, 0.02, high * rng.between(0.98, 1.02)), (x, -half, 0.04))
            for x in np.arange(-half, half, 1.35 * wide)
        ]
        step = 0.01 * (side % 2)  # rails that meet in a corner share no plane
        run += [box((2 * half, 0.04, 0.08), (0, -half + 0.03, z * high + step)) for z in (0.2, 0.8)]
        boards.append(merge(run).turned("z", 90.0 * side))
    color = hex_color(rng.pick(("#8a7358", "#6f6252", "#b8b2a6", "#5a5650")))
    wood = Material("wood", color, 0.8, variant=rng.variant())
    mesh = merge(boards).moved(float(centre[0]), float(centre[1]), ground)
    return outdoor_item("fence", "railing", make_part("boards", wood, mesh))


def _lamps(rng: Draw, near: float, half: float, turn: float, ground: float) -> SceneItem:
    """Return street lamps along the far pavement; their heads shine while they are lit."""
    poles, heads = [], []
    spacing = rng.between(18, 28)
    high = rng.between(4.5, 6.5)
    first = rng.between(-0.5, 0.5) * spacing
    y = -near - ROAD - 0.5
    count = max(1, int(min(half, 40) / spacing))
    for x in first + spacing * np.arange(-count, count + 1):
        path = [(x, y, 0), (x, y, high - 0.5), (x, y + 0.3, high), (x, y + 1.2, high + 0.1)]
        poles.append(tube(np.array(path), [0.07, 0.05, 0.04, 0.03], 8))
        poles.append(box((0.24, 0.62, 0.06), (x, y + 1.35, high + 0.09)))
        heads.append(box((0.18, 0.5, 0.02), (x, y + 1.35, high + 0.065)))
    metal = Material("paint", hex_color("#4c5053"), 0.5)
    glass = Material("plastic", hex_color("#d8d8d4"), 0.3)

    def part(label: str, material: Material, meshes: list[BodyMesh], lumens: float) -> PiecePart:
        moved = [mesh.turned("z", turn).moved(z=ground) for mesh in meshes]
        kelvin = _LAMP_KELVIN + (1300.0 if rng.chance(0.3) else 0.0)
        return replace(make_part(label, material, *moved), lumens=lumens, kelvin=kelvin)

    lumens = min(5600.0, _LAMP_LUMENS * len(heads))
    parts = (part("poles", metal, poles, 0.0), part("heads", glass, heads, lumens))
    return outdoor_item("street lamps", "lamp", *parts)


@dataclass(frozen=True)
class _Car:
    """Size of a car in metres, how far its cabin reaches back, and its colour."""

    length: float
    width: float
    height: float
    estate: float
    paint: str


def _draw_car(rng: Draw) -> _Car:
    length, width, height = rng.between(3.7, 4.7), rng.between(1.68, 1.85), rng.between(1.4, 1.62)
    return _Car(length, width, height, estate=rng.between(0.0, 0.35), paint=rng.pick(_PAINTS))


def _parked(
    car: _Car, name: str, at: tuple[float, float], facing: float, turn: float, ground: float
) -> SceneItem:
    """A car at a place of a street that is then turned, degrees, and put on the ground."""
    parts = []
    for label, material, meshes, smooth in _build_car(car):
        placed = [
            mesh.turned("z", facing).moved(at[0], at[1]).turned("z", turn).moved(z=ground)
            for mesh in meshes
        ]
        parts.append(make_part(label, material, *placed, smooth=smooth))
    return outdoor_item(name, "vehicle", *parts)


def _build_car(car: _Car) -> list[tuple[str, Material, list[BodyMesh], bool]]:
    """Body, cabin, wheels and lights along X: (name, material, meshes, smooth)."""
    wide, high = car.width, car.height

    def ring(x0: float, x1: float, half: float, z: float, power: float = 5.0) -> Float64Array:
        return superellipse((x1 - x0) / 2, half, z, power, 40, x=(x0 + x1) / 2)

    a, b = -car.length / 2, car.length / 2
    body = [
        ring(a + 0.15, b - 0.15, 0.44 * wide, 0.22),
        ring(a + 0.02, b - 0.04, 0.49 * wide, 0.4),
        ring(a, b, 0.5 * wide, 0.6),
        ring(a + 0.05, b - 0.06, 0.49 * wide, 0.78),
        ring(a + 0.18, b - 0.5, 0.46 * wide, 0.9),
    ]
    back, front = a + 0.75 - car.estate, b - 1.35
    cabin = [
        ring(back - 0.25, front + 0.35, 0.45 * wide, 0.86),
        ring(back + 0.12, front - 0.35, 0.38 * wide, high - 0.09),
    ]
    roof = [
        ring(back + 0.1, front - 0.33, 0.385 * wide, high - 0.1),
        ring(back + 0.2, front - 0.45, 0.35 * wide, high - 0.03),
        ring(back + 0.5, front - 0.7, 0.25 * wide, high),
    ]
    wheels, rims = [], []
    for x in (a + 0.78, b - 0.8):
        for side in (-1, 1):
            y = side * (0.5 * wide - 0.1)
            wheels.append(cylinder(0.31, -0.11, 0.11, 24, 0.03).turned("x", 90).moved(x, y, 0.31))
            rims.append(
                cylinder(0.2, -0.012, 0.012, 16).turned("x", 90).moved(x, y + side * 0.11, 0.31)
            )
    lights = [box((0.1, 0.32, 0.12), (b - 0.1, y * wide, 0.58)) for y in (-0.32, 0.32)]
    tails = [box((0.08, 0.28, 0.16), (a + 0.08, y * wide, 0.62)) for y in (-0.34, 0.34)]
    pillars = [
        bar((x, side * 0.445 * wide, 0.87), (x + lean, side * 0.385 * wide, high - 0.09), 0.03, 6)
        for side in (-1, 1)
        for x, lean in ((back - 0.05, 0.2), (0.5 * (back + front), 0.0), (front + 0.15, -0.45))
    ]
    paint = Material("plastic", hex_color(car.paint), 0.18)
    return [
        ("paint", paint, [loft(np.stack(body)), loft(np.stack(roof)), *pillars], True),
        ("glass", Material("plastic", hex_color("#14181b"), 0.06), [loft(np.stack(cabin))], True),
        ("tyres", Material("paint", hex_color("#1c1c1d"), 0.9), wheels, True),
        ("metal", Material("metal", hex_color("#b4b6b8"), 0.3), [*rims, *lights], False),
        ("tails", Material("plastic", hex_color("#6d1013"), 0.2), tails, False),
    ]
