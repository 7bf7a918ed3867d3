"""Lighting of a home: sky models and lamps for each light setting."""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace

import numpy as np

from pbrnet.scenes.color import Color
from pbrnet.scenes.contract import Light
from pbrnet.scenes.geometry.mesh import face_areas
from pbrnet.scenes.photometry import LUMEN, PBRS_BULB, PBRS_ENVIRONMENT, PBRS_UNIT, lamp_radiance
from pbrnet.scenes.procedural.piece import PiecePart
from pbrnet.scenes.procedural.scene_item import SceneItem
from pbrnet.scenes.seeds import Draw

_DUSK = 0.2  # scale of the sky below which it is dusk


@dataclass(frozen=True)
class Sky:
    """The environment: a Mitsuba emitter element and its entries in `scene.json`."""

    xml: str
    lights: tuple[Light, ...]
    choices: dict[str, float]  # sampled parameters, recorded in `scene.json`
    sun: tuple[float, float, float] | None = None  # direction towards it, if it shines

    @property
    def is_dark(self) -> bool:
        """True at night and at dusk, when streets and windows outside are lit."""
        return "sky_lux" in self.choices or self.choices.get("sky_scale", 1.0) < _DUSK


@dataclass(frozen=True)
class Lamp:
    """Identity and luminous flux of a lamp, for the choice of lit lamps."""

    id: str
    room: str | None
    lumens: float


def draw_sky(rng: Draw, setting: str, lamp_weight: float) -> Sky:
    """Draw the sky of a `setting`; `lamp_weight` is the sum of the lit lamps' sampling weights.

    Day and mixed: the sun where it stands at some hour of the year in the temperate zones, at
    least 8 degrees up, in clear or hazy air or behind clouds. Evening: sun elevation 2-12 degrees,
    or dusk, in clear air. Night: a faint uniform sky, between that of a village and of a town.
    PBRS: white and uniform, as bright below the horizon as above; nothing is drawn.
    """
    # Give sky and lamps about the same share of the emitter samples, to lower the variance.
    weight = max(1.0, lamp_weight)
    if setting == "night":
        lux = float(np.exp(rng.uniform(np.log(0.05), np.log(2.0))))
        radiance = lux * LUMEN / math.pi
        night = (0.88 * radiance, 0.98 * radiance, 1.35 * radiance)
        return _uniform_sky(night, 0.15 * weight, {"sky_lux": round(lux, 4)})
    if setting == "pbrs":
        white = PBRS_ENVIRONMENT * PBRS_UNIT
        choices = {"environment": white, "bulbs": PBRS_BULB * PBRS_UNIT}
        return _uniform_sky((white, white, white), weight, choices)
    turbidity = rng.between(2.5, 6.0)
    azimuth = rng.between(0, 360)  # homes face anywhere
    if setting == "evening":
        dusk = rng.chance(0.45)
        # In haze the sky model turns deep yellow near a low sun (red to blue 5 to 1).
        turbidity = 2.0 + 0.4 * (turbidity - 2.5)
        elevation = 3.0 if dusk else draw_elevation(rng, 2.0, 12.0)
        sun_scale, sky_scale = (0.0, rng.between(0.02, 0.9 * _DUSK)) if dusk else (1.0, 1.0)
    else:
        overcast = rng.chance(0.35)
        elevation = draw_elevation(rng, 8.0, 75.0)
        sun_scale, sky_scale = 1.0, 1.0
        if overcast:
            # Under clouds the sky is grey and as bright as the sun's height allows, or darker.
            high = math.sin(math.radians(elevation))
            sun_scale, sky_scale = 0.0, rng.between(0.5, 1.2) * (0.3 + high)
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
    return Sky(xml, tuple(lights), choices, direction if sun_scale else None)


def _uniform_sky(radiance: Color, weight: float, choices: dict[str, float]) -> Sky:
    rgb = " ".join(f"{band:.6g}" for band in radiance)
    xml = (
        f'<emitter type="constant" id="sky"><rgb name="radiance" value="{rgb}"/>'
        f'<float name="sampling_weight" value="{weight:.4g}"/></emitter>'
    )
    return Sky(xml, (Light("sky", "environment"),), choices)


def draw_elevation(rng: Draw, least: float, most: float) -> float:
    """Draw an elevation of the sun in degrees, within bounds, as it occurs over days and hours.

    Latitudes of 35 to 60 degrees, all days of the year, all hours (Duffie and Beckman, *Solar
    Engineering of Thermal Processes*, equations 1.6.1a and 1.6.5).
    """
    for _ in range(1000):
        latitude = math.radians(rng.uniform(35, 60))
        declination = math.radians(23.45) * math.sin(2 * math.pi * rng.random())
        hour = math.radians(rng.uniform(-180, 180))
        sine = math.sin(latitude) * math.sin(declination)
        sine += math.cos(latitude) * math.cos(declination) * math.cos(hour)
        elevation = math.degrees(math.asin(sine))
        if least <= elevation <= most:
            return elevation
    return 0.5 * (least + most)


def lamp_items(items: Sequence[SceneItem]) -> list[SceneItem]:
    """Return the items with a light source, other than screens."""
    return [
        item
        for item in items
        if any(part.lumens > 0 and part.picture is None for part in item.parts)
    ]


def draw_screen_states(rng: Draw, setting: str, items: Sequence[SceneItem]) -> dict[str, LampState]:
    """Draw which screens are on, but by day and in PBRS' light, and how bright they are."""
    share = {"day": 0.0, "evening": 0.35, "night": 0.4, "mixed": 0.25, "pbrs": 0.0}[setting]
    states = {}
    for item in items:
        on, bright = rng.random(2)
        if any(part.picture is not None for part in item.parts) and on < share:
            states[item.id] = LampState(round(0.4 + 0.6 * float(bright), 3), 0.0)
    return states


def lamp_descriptions(items: Sequence[SceneItem]) -> list[Lamp]:
    """Return a `Lamp` for each item with a light source."""
    return [
        Lamp(item.id, item.room, sum(part.lumens for part in item.parts))
        for item in lamp_items(items)
    ]


def choose_lit_lamps(
    rng: Draw, setting: str, lamps: Sequence[Lamp], windowless: Collection[str]
) -> set[str]:
    """Choose the lamps that are on; returns their ids.

    At night and in the evening at least one lamp is on in every room that has lamps; by day
    only rooms without a window have one on; in PBRS' light all are.
    """
    share = {"day": 0.0, "evening": 0.5, "night": 0.55, "mixed": 0.45, "pbrs": 1.0}[setting]
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


def draw_kelvin_offset(rng: Draw) -> float:
    """Draw the kelvins added to the nominal colour temperature of all lamps of a home.

    Most homes have warm white lamps of 2700 to 3300 K, some have neutral or cool white ones.
    """
    return rng.weighted([0.0, 300.0, 1000.0, 2200.0], [0.5, 0.25, 0.2, 0.05])


@dataclass(frozen=True)
class LampState:
    """A lit lamp: the share of its full light, and kelvins added to its colour temperature.

    A `radiance` replaces both: white, equal on all that shines.
    """

    dimmed: float
    kelvin_offset: float
    radiance: float | None = None


PBRS_LAMP = LampState(1.0, 0.0, PBRS_BULB * PBRS_UNIT)


def draw_lamp_states(rng: Draw, lit: Collection[str], kelvin_offset: float) -> dict[str, LampState]:
    """Draw the state of each lit lamp.

    Two in three are at full power, the others dimmed; bulbs of one home differ a little in colour,
    and one in twelve is of another kind. Dimming leaves the colour, as that of LED lamps does.
    """
    states = {}
    for lamp in sorted(lit):
        full, share, odd, shift = rng.random(4)
        dimmed = 1.0 if full < 2 / 3 else 0.2 + 0.7 * share
        offset = kelvin_offset + (1500.0 * shift if odd < 1 / 12 else 240.0 * (shift - 0.5))
        states[lamp] = LampState(round(float(dimmed), 3), round(float(offset), 1))
    return states


def in_state(part: PiecePart, state: LampState | None) -> PiecePart:
    """Return a part of a lamp in its state; without a state the lamp is off."""
    if part.lumens <= 0:
        return part
    if state is None:
        return replace(part, lumens=0.0)
    if state.radiance is not None:
        lumens = math.pi * _area(part) * state.radiance / LUMEN
        return replace(part, lumens=lumens, kelvin=None)
    kelvin = None if part.kelvin is None else part.kelvin + state.kelvin_offset
    return replace(part, lumens=part.lumens * state.dimmed, kelvin=kelvin)


def sampling_weight(part: PiecePart) -> float:
    """Sampling weight of a lamp's emitter: the square root of its flux relative to 800 lm."""
    return round(math.sqrt(part.lumens / 800.0), 4)


def mean_radiance(part: PiecePart) -> Color:
    """Return the mean RGB radiance of a lit part's surface."""
    return lamp_radiance(part.lumens, _area(part), part.kelvin)


def _area(part: PiecePart) -> float:
    return float(face_areas(part.vertices[part.faces])[0].sum())


def area_emitter(part: PiecePart, weight: float = 1.0, image: str = "") -> str:
    """Return the `<emitter>` element of a lit part: its flux spread evenly over its surface.

    `weight` scales its sampling weight: little light from outside reaches a room. `image` is the
    file of a screen's radiance.
    """
    radiance = " ".join(f"{value:.6g}" for value in mean_radiance(part))
    emission = f'<rgb name="radiance" value="{radiance}"/>'
    if image:
        emission = (
            f'<texture type="bitmap" name="radiance"><string name="filename" value="{image}"/>'
            '<boolean name="raw" value="true"/></texture>'
        )
    return (
        f'<emitter type="area">{emission}'
        f'<float name="sampling_weight" value="{weight * sampling_weight(part):.4g}"/></emitter>'
    )
