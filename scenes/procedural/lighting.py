"""Light of a home: sun and sky by day and evening, lamps by night, mixes."""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence
from dataclasses import dataclass

import numpy as np

from scenes.contract import Light
from scenes.photometry import LUMEN, lamp_radiance
from scenes.procedural.piece import Part
from scenes.procedural.scene_item import Thing


@dataclass(frozen=True)
class Sky:
    """What lies behind the windows: a Mitsuba emitter and its place in `scene.json`."""

    xml: str
    lights: tuple[Light, ...]
    choices: dict[str, float]  # what was drawn, for the record


@dataclass(frozen=True)
class Lamp:
    """Something that can be lit."""

    id: str
    room: str | None
    lumens: float


def draw_sky(rng: np.random.Generator, setting: str, lamp_weight: float) -> Sky:
    """The sky of a `setting`; `lamp_weight` is the sum of the lit lamps' sampling weights.

    Day and mixed: sun 18-62 degrees up, or an overcast sky without sun. Evening: a sun 6-14
    degrees up, or dusk, in clear air. Night: a faint uniform sky, as above a lit town.
    """
    # Sky and lamps share the samples evenly where both matter (see FIELD-NOTES on variance).
    weight = max(1.0, lamp_weight)
    if setting == "night":
        lux = float(rng.uniform(0.3, 3.0))
        radiance = lux * LUMEN / math.pi
        rgb = " ".join(f"{radiance * band:.6g}" for band in (0.75, 0.95, 1.65))
        xml = (
            f'<emitter type="constant" id="sky"><rgb name="radiance" value="{rgb}"/>'
            f'<float name="sampling_weight" value="{0.15 * weight:.4g}"/></emitter>'
        )
        return Sky(xml, (Light("sky", "environment"),), {"sky_lux": round(lux, 4)})
    turbidity = float(rng.uniform(2.5, 6.0))
    azimuth = float(rng.uniform(0, 360))
    if setting == "evening":
        dusk = rng.random() < 0.45
        # In haze the sky model turns deep yellow towards a low sun (red to blue 5 to 1).
        turbidity = 2.0 + 0.4 * (turbidity - 2.5)
        elevation = 4.0 if dusk else float(rng.uniform(6, 14))
        sun_scale, sky_scale = (0.0, float(rng.uniform(0.05, 0.3))) if dusk else (1.0, 1.0)
    else:
        overcast = rng.random() < 0.25
        elevation = float(rng.uniform(18, 62))
        sun_scale, sky_scale = (0.0, float(rng.uniform(0.7, 1.2))) if overcast else (1.0, 1.0)
        if overcast:
            turbidity, elevation = 9.0, 50.0
    flat = math.cos(math.radians(elevation))
    direction = (
        flat * math.cos(math.radians(azimuth)),
        flat * math.sin(math.radians(azimuth)),
        math.sin(math.radians(elevation)),
    )
    x, y, z = (f"{value:.6g}" for value in direction)
    xml = (
        '<emitter type="sunsky" id="sky">'
        f'<vector name="sun_direction" x="{x}" y="{y}" z="{z}"/>'
        f'<float name="turbidity" value="{turbidity:.4g}"/>'
        f'<float name="sun_scale" value="{sun_scale:.4g}"/>'
        f'<float name="sky_scale" value="{sky_scale:.4g}"/>'
        f'<float name="sampling_weight" value="{weight:.4g}"/></emitter>'
    )
    lights = [Light("sky", "sky")] + ([Light("sun", "sun")] if sun_scale else [])
    choices = {
        "sun_elevation": round(elevation, 2),
        "sun_azimuth": round(azimuth, 2),
        "turbidity": round(turbidity, 3),
        "sun_scale": round(sun_scale, 3),
        "sky_scale": round(sky_scale, 3),
    }
    return Sky(xml, tuple(lights), choices)


def lamps_of(things: Sequence[Thing]) -> list[Thing]:
    """Things that can be lit."""
    return [thing for thing in things if any(part.lumens > 0 for part in thing.parts)]


def as_lamps(things: Sequence[Thing]) -> list[Lamp]:
    """What matters of `lamps_of(things)` when some are chosen to burn."""
    return [Lamp(thing.id, thing.room, _lumens(thing)) for thing in lamps_of(things)]


def choose_lit(
    rng: np.random.Generator, setting: str, lamps: Sequence[Lamp], windowless: Collection[str]
) -> set[str]:
    """Ids of the lamps that burn.

    By night and in the evening at least one in each room that has any; by day none, except in
    the rooms without a window.
    """
    share = {"day": 0.0, "evening": 0.6, "night": 0.75, "mixed": 0.55}[setting]
    lit: set[str] = set()
    by_room: dict[str | None, list[Lamp]] = {}
    for lamp in lamps:
        by_room.setdefault(lamp.room, []).append(lamp)
    for room in sorted(by_room, key=str):
        here = by_room[room]
        draws = rng.random(len(here))
        chosen = {lamp.id for lamp, draw in zip(here, draws, strict=True) if draw < share}
        if not chosen and (setting in ("night", "evening") or room in windowless):
            chosen = {max(here, key=lambda lamp: lamp.lumens).id}
        lit |= chosen
    return lit


def draw_cooler(rng: np.random.Generator) -> float:
    """Kelvins by which a home's lamps look cooler than their nominal colour temperature.

    Frames are not white-balanced but for daylight; eyes and cameras adapt at least in part to
    lamplight, and some lamps are white LEDs.
    """
    return float(rng.choice([800.0, 1500.0, 2200.0, 3000.0], p=[0.25, 0.3, 0.3, 0.15]))


def sampling_weight(part: Part) -> float:
    """How often a lamp is sampled beside others: by its flux, a strong one not too often."""
    return round(math.sqrt(part.lumens / 800.0), 4)


def emitter(part: Part, cooler: float = 0.0) -> str:
    """The area light of a part that burns: its flux spread over its surface.

    `cooler` kelvins are added to its colour temperature.
    """
    a, b, c = (part.vertices[part.faces[:, corner]] for corner in range(3))
    area = 0.5 * float(np.linalg.norm(np.cross(b - a, c - a), axis=1).sum())
    radiance = " ".join(
        f"{value:.6g}" for value in lamp_radiance(part.lumens, area, part.kelvin + cooler)
    )
    return (
        f'<emitter type="area"><rgb name="radiance" value="{radiance}"/>'
        f'<float name="sampling_weight" value="{sampling_weight(part):.4g}"/></emitter>'
    )


def _lumens(thing: Thing) -> float:
    return sum(part.lumens for part in thing.parts)
