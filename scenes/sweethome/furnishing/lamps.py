"""Light sources of lamps as emitting spheres, or as emitting shades around them.

The application's renderer gives a source the radiance 5 p^2 / r^2 times its colour for power p
and radius r, so the flux goes with p^2 and the colour alone. Here a source of the catalogue's
usual colour at its usual power of 0.5 has `USUAL` lumens.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from shapely.geometry import Polygon

from pbrnet.scenes.arrays import Float64Array, as_triple
from pbrnet.scenes.assets.piece import LightSource
from pbrnet.scenes.color import REC709, Color
from pbrnet.scenes.contract import Room
from pbrnet.scenes.geometry.directions import fibonacci_sphere
from pbrnet.scenes.importing.changes import Changes
from pbrnet.scenes.importing.light.ceiling_lamps import ceiling_lamp, octahedron
from pbrnet.scenes.photometry import LUMEN
from pbrnet.scenes.reconstruction.raycast import RayCaster
from pbrnet.scenes.sweethome.furnishing.finishes import decode_clipped
from pbrnet.scenes.sweethome.furnishing.items import ItemPart, PlacedItem, SurfaceFinish, area
from pbrnet.scenes.sweethome.home import HomePiece

USUAL = 1000.0  # lumens of a source of colour AA9770 at power 0.5
_USUAL_COLOR = 0xAA9770
_SMALLEST, _LARGEST = 0.008, 0.05  # metres: radii of bulbs
_DEFAULT_RADIUS = 0.0325
_ENCLOSED = 0.1  # fraction of open directions below which the shade emits instead of the bulb
_DIRECTIONS = 256
_BLACK = SurfaceFinish(color=(0.0, 0.0, 0.0))


def lumens_of(bulb: LightSource, power: float) -> float:
    """Return the luminous flux (lm) of a light source at a power in [0, 1]."""
    return USUAL * (power / 0.5) ** 2 * _luminance(bulb.color) / _luminance(_USUAL_COLOR)


def lit_parts(
    piece: HomePiece, parts: tuple[ItemPart, ...], to_world: Float64Array, changes: Changes
) -> tuple[tuple[ItemPart, ...], float]:
    """Return the parts of a lamp that is on, and its luminous flux (lm).

    If the lamp has emissive materials, their parts emit the flux of all bulbs. The flux of an
    enclosed bulb is emitted by the parts around it. Glass around a bulb is left out because it
    would block shadow rays.
    """
    if any(part.emits for part in parts):
        return _emissive_parts(piece, parts)
    total, made = 0.0, list(parts)
    for bulb in piece.bulbs:
        lumens = lumens_of(bulb, piece.power)
        if lumens < 1.0:
            continue
        total += lumens
        centre, radius = _bulb_sphere(piece, bulb, to_world)
        clear = [part.finish.kind in ("glass", "sheer") for part in made]
        hit, nearest = _around(made, centre)
        if any(clear[number] for number in set(hit[hit >= 0].tolist())):
            changes.note("clear parts around bulbs were left out: {}", piece.name)
            made = [part for part, is_clear in zip(made, clear, strict=True) if not is_clear]
            hit, nearest = _around(made, centre)
        tint = _tint(bulb.color)
        if (hit < 0).mean() >= _ENCLOSED or not made:
            radius = max(min(radius, 0.9 * nearest), 0.5 * _SMALLEST)
            surface = 4 * np.pi * radius**2
            made.append(
                ItemPart(
                    octahedron(centre, radius),
                    _BLACK,
                    _radiance(lumens, surface, tint),
                    (as_triple(centre), radius),
                )
            )
        else:
            around = sorted(set(hit[hit >= 0].tolist()))
            surface = sum(area(made[number].mesh) for number in around)
            for number in around:
                glow = _radiance(lumens, surface, tint)
                before = made[number].radiance or (0.0, 0.0, 0.0)
                glow = (glow[0] + before[0], glow[1] + before[1], glow[2] + before[2])
                made[number] = replace(made[number], radiance=glow)
            changes.note("closed shades glow in place of the bulbs inside: {}", piece.name)
    return tuple(made), total


def hung_lamp(room: Room, number: int) -> PlacedItem:
    """The plain ceiling lamp of a room without light."""
    lamp = ceiling_lamp(Polygon(room.floor), room.ceiling_z)
    part = ItemPart(lamp.mesh, _BLACK, lamp.radiance, (lamp.centre, lamp.radius))
    name = f"ceiling-lamp-{number}"
    return PlacedItem(name, "ceiling lamp", "lamp", (part,), room=room.id, lumens=lamp.lumens)


def _emissive_parts(
    piece: HomePiece, parts: tuple[ItemPart, ...]
) -> tuple[tuple[ItemPart, ...], float]:
    bulbs = piece.bulbs or (LightSource(0.5, 0.5, 0.5, _USUAL_COLOR, None),)
    total = sum(lumens_of(bulb, piece.power) for bulb in bulbs)
    surface = sum(area(part.mesh) for part in parts if part.emits)
    if total < 1.0 or surface <= 0:
        return parts, 0.0
    glow = _radiance(total, surface, _tint(bulbs[0].color))
    return tuple(
        replace(part, finish=replace(part.finish, kind="matt", image=None), radiance=glow)
        if part.emits
        else part
        for part in parts
    ), total


def _bulb_sphere(
    piece: HomePiece, bulb: LightSource, to_world: Float64Array
) -> tuple[Float64Array, float]:
    inside = np.array([bulb.x - 0.5, bulb.z - 0.5, 0.5 - bulb.y, 1.0])
    centre = (to_world @ inside)[:3]
    radius = _DEFAULT_RADIUS
    if bulb.diameter is not None:
        radius = 0.005 * bulb.diameter * piece.width
    return centre, float(min(max(radius, _SMALLEST), _LARGEST))


def _radiance(lumens: float, surface: float, tint: Color) -> Color:
    luminance = lumens * LUMEN / (np.pi * surface)
    return (luminance * tint[0], luminance * tint[1], luminance * tint[2])


def _luminance(color: int) -> float:
    """Return the luminance of a light source's colour; like the application, treat it as linear."""
    return float(np.array([(color >> shift) & 255 for shift in (16, 8, 0)]) @ REC709) / 255


def _tint(color: int) -> Color:
    """Return the linear colour of a light source scaled to luminance 1; white for black."""
    bands = [decode_clipped(((color >> shift) & 255) / 255) for shift in (16, 8, 0)]
    luminance = float(np.array(bands) @ REC709)
    if luminance < 1e-6:
        return (1.0, 1.0, 1.0)
    return (bands[0] / luminance, bands[1] / luminance, bands[2] / luminance)


def _around(parts: list[ItemPart], centre: Float64Array) -> tuple[np.ndarray, float]:
    """Return the first part hit in each direction (-1: none), and the distance to the nearest."""
    solid = [(number, part) for number, part in enumerate(parts) if part.sphere is None]
    if not solid:
        return np.full(_DIRECTIONS, -1), np.inf
    owner = np.concatenate([np.full(len(part.mesh.faces), number) for number, part in solid])
    caster = RayCaster(np.concatenate([part.mesh.corners for _, part in solid]))
    distances, triangles = caster.cast(centre, fibonacci_sphere(_DIRECTIONS))
    return np.where(triangles >= 0, owner[triangles], -1), float(distances.min())
