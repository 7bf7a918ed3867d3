"""Lighting of a home: sky models and lamps for each light setting."""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence
from dataclasses import dataclass

import numpy as np

from scenes.contract import Light
from scenes.geometry.mesh import face_areas
from scenes.photometry import LUMEN, lamp_radiance
from scenes.procedural.piece import PiecePart
from scenes.procedural.scene_item import SceneItem


@dataclass(frozen=True)
class Sky:
    """The environment: a Mitsuba emitter element and its entries in `scene.json`."""

    xml: str
    lights: tuple[Light, ...]
    choices: dict[str, float]  # sampled parameters, recorded in `scene.json`


@dataclass(frozen=True)
class Lamp:
    """Identity and luminous flux of a lamp, for the choice of lit lamps."""

    id: str
    room: str | None
    lumens: float


def draw_sky(rng: np.random.Generator, setting: str, lamp_weight: float) -> Sky:
    """Draw the sky of a `setting`; `lamp_weight` is the sum of the lit lamps' sampling weights.

    Day and mixed: sun elevation 18-62 degrees, or an overcast sky without sun. Evening: sun
    elevation 6-14 degrees, or dusk, in clear air. Night: a faint uniform sky, as above a town.
    """
    # Give sky and lamps about the same share of the emitter samples, to lower the variance.
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
        # In haze the sky model turns deep yellow near a low sun (red to blue 5 to 1).
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


def lamp_items(items: Sequence[SceneItem]) -> list[SceneItem]:
    """Return the items with a light source."""
    return [item for item in items if any(part.lumens > 0 for part in item.parts)]


def lamp_descriptions(items: Sequence[SceneItem]) -> list[Lamp]:
    """Return a `Lamp` for each item with a light source."""
    return [Lamp(item.id, item.room, _lumens(item)) for item in lamp_items(items)]


def choose_lit_lamps(
    rng: np.random.Generator, setting: str, lamps: Sequence[Lamp], windowless: Collection[str]
) -> set[str]:
    """Choose the lamps that are on; returns their ids.

    At night and in the evening at least one lamp is on in every room that has lamps; by day
    only rooms without a window have one on.
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


def draw_kelvin_offset(rng: np.random.Generator) -> float:
    """Draw the kelvins added to the nominal colour temperature of all lamps of a home.

    Frames are white-balanced for daylight only; the offset stands for the partial adaptation of
    eyes and cameras to lamplight, and for white LEDs.
    """
    return float(rng.choice([800.0, 1500.0, 2200.0, 3000.0], p=[0.25, 0.3, 0.3, 0.15]))


def sampling_weight(part: PiecePart) -> float:
    """Sampling weight of a lamp's emitter: the square root of its flux relative to 800 lm."""
    return round(math.sqrt(part.lumens / 800.0), 4)


def area_emitter(part: PiecePart, kelvin_offset: float = 0.0) -> str:
    """Return the `<emitter>` element of a lit part: its flux spread evenly over its surface.

    `kelvin_offset` is added to its colour temperature.
    """
    area = float(face_areas(part.vertices[part.faces])[0].sum())
    radiance = " ".join(
        f"{value:.6g}" for value in lamp_radiance(part.lumens, area, part.kelvin + kelvin_offset)
    )
    return (
        f'<emitter type="area"><rgb name="radiance" value="{radiance}"/>'
        f'<float name="sampling_weight" value="{sampling_weight(part):.4g}"/></emitter>'
    )


def _lumens(item: SceneItem) -> float:
    return sum(part.lumens for part in item.parts)
