"""Position of the sun over a home, and the emitter for sun and sky.

Position by the low-precision formulas of the Astronomical Almanac (Michalsky 1988), good to
about 0.01 degrees between 1950 and 2050.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from datetime import UTC, datetime, timedelta, timezone, tzinfo
from xml.etree.ElementTree import Element
from zoneinfo import ZoneInfo

from pbrnet.scenes.contract import Light
from pbrnet.scenes.errors import ParameterError
from pbrnet.scenes.importing.changes import Changes
from pbrnet.scenes.importing.xml_elements import number, plugin, prop
from pbrnet.scenes.photometry import LUMEN
from pbrnet.scenes.sweethome.home import Home

TURBIDITY = 3.5
_EPOCH = datetime(2000, 1, 1, 12, tzinfo=UTC)
_NIGHT = -6.0  # degrees: elevation of the sun below which it is night (civil twilight)
_LOWEST = 1.5  # degrees: lowest elevation of the sun in `sunsky`
_NIGHT_LUX = 1.0
_PARIS = (0.8529, 0.0407)  # latitude, longitude, radians: default of homes without a location


@dataclass(frozen=True)
class Sky:
    """Emitter for sun and sky, its lights in `scene.json`, and the position of the sun."""

    emitter: Element
    lights: tuple[Light, ...]
    elevation: float  # degrees
    azimuth: float  # degrees, clockwise from north
    direction: tuple[float, float, float]  # towards the sun, world
    when: str  # local time

    @property
    def is_day(self) -> bool:
        """True if the sun is above the horizon."""
        return any(light.kind == "sun" for light in self.lights)

    @property
    def is_night(self) -> bool:
        """True if windows give no light to see by."""
        return self.elevation < _NIGHT

    def beside(self, lamp_weight: float) -> Sky:
        """The sky whose emitter is sampled as often as lamps of this sum of sampling weights."""
        emitter, _ = _emitter(self.elevation, self.direction, max(1.0, lamp_weight))
        return replace(self, emitter=emitter)


def sun_position(when: datetime, latitude: float, longitude: float) -> tuple[float, float]:
    """Return elevation and azimuth (clockwise from north) of the sun, radians; no refraction.

    `when` has a time zone; latitude and longitude (east positive) are radians.
    """
    days = (when - _EPOCH).total_seconds() / 86400
    mean = math.radians(280.460 + 0.9856474 * days)
    anomaly = math.radians(357.528 + 0.9856003 * days)
    ecliptic = mean + math.radians(1.915 * math.sin(anomaly) + 0.020 * math.sin(2 * anomaly))
    obliquity = math.radians(23.439 - 0.0000004 * days)
    right_ascension = math.atan2(math.cos(obliquity) * math.sin(ecliptic), math.cos(ecliptic))
    declination = math.asin(math.sin(obliquity) * math.sin(ecliptic))
    sidereal = 18.697374558 + 24.06570982441908 * days  # hours, at Greenwich
    hour_angle = math.radians(15 * (sidereal % 24)) + longitude - right_ascension
    height = math.asin(
        math.sin(declination) * math.sin(latitude)
        + math.cos(declination) * math.cos(latitude) * math.cos(hour_angle)
    )
    azimuth = math.atan2(
        -math.sin(hour_angle),
        math.tan(declination) * math.cos(latitude) - math.sin(latitude) * math.cos(hour_angle),
    )
    return height, azimuth % (2 * math.pi)


def local_time(milliseconds: int, zone: tzinfo) -> datetime:
    """Return the local time of a home; the file stores it as milliseconds as if it were UTC."""
    reading = datetime(1970, 1, 1) + timedelta(milliseconds=milliseconds)
    return reading.replace(tzinfo=zone)


def make_sky(home: Home, time: str | None, changes: Changes) -> Sky:
    """Return the sky at the time of the home, or at local `time` ("HH:MM") on its day.

    Raises `ParameterError` for an invalid time.
    """
    latitude, longitude = home.compass.latitude, home.compass.longitude
    if latitude is None or longitude is None:
        latitude, longitude = _PARIS
        changes.note("the home does not say where it stands; Paris was taken")
    when = _local_datetime(home, time, longitude, changes)
    height, azimuth = sun_position(when, latitude, longitude)
    # `north` is the direction of north on the plan, clockwise from up.
    angle = azimuth + home.compass.north - math.pi / 2
    flat = math.cos(height)
    direction = (flat * math.cos(angle), -flat * math.sin(angle), math.sin(height))
    emitter, kinds = _emitter(math.degrees(height), direction, 1.0)
    if home.environment.sky_texture is not None:
        changes.note("the picture of a sky gave way to a physical sky")
    return Sky(
        emitter=emitter,
        lights=tuple(Light(kind, kind) for kind in kinds),  # type: ignore[arg-type]
        elevation=math.degrees(height),
        azimuth=math.degrees(azimuth),
        direction=direction,
        when=when.strftime("%Y-%m-%d %H:%M %z"),
    )


def _emitter(
    elevation: float, direction: tuple[float, float, float], weight: float
) -> tuple[Element, tuple[str, ...]]:
    if elevation < _NIGHT:
        radiance = _NIGHT_LUX * LUMEN / math.pi
        made = plugin(
            "emitter", "constant",
            radiance=(0.75 * radiance, 0.95 * radiance, 1.65 * radiance),
            sampling_weight=0.15 * weight,
        )  # fmt: skip
        made.set("id", "sky")
        return made, ("environment",)
    up = math.radians(max(elevation, _LOWEST))
    flat = math.hypot(direction[0], direction[1]) or 1.0
    x, y = (math.cos(up) * value / flat for value in direction[:2])
    sun, sky = 1.0, 1.0
    if elevation < _LOWEST:
        # Dusk: no sun; the sky halves about every degree (civil twilight: 1/60 in six degrees).
        sun, sky = 0.0, 0.3 * 2.0 ** (elevation - _LOWEST)
    made = plugin("emitter", "sunsky", turbidity=TURBIDITY, sun_scale=sun, sky_scale=sky)
    made.set("id", "sky")
    values = {"name": "sun_direction", "x": number(x), "y": number(y), "z": number(math.sin(up))}
    made.append(Element("vector", values))
    made.append(prop("sampling_weight", float(weight)))
    return made, ("sky", "sun") if sun else ("sky",)


def _local_datetime(home: Home, time: str | None, longitude: float, changes: Changes) -> datetime:
    zone = _zone(home.compass.time_zone, longitude, changes)
    stamps = [
        camera.time
        for attribute in ("observerCamera", "topCamera", "storedCamera")
        for camera in home.cameras
        if camera.attribute == attribute and camera.time is not None
    ]
    try:
        if stamps:
            when = local_time(stamps[0], zone)
        else:
            when = datetime(2020, 6, 21, 12, tzinfo=zone)
            if time is None:
                changes.note("the home does not say the time; noon of a June day was taken")
        if time is not None:
            hours, _, minutes = time.partition(":")
            when = when.replace(hour=int(hours), minute=int(minutes or 0), second=0, microsecond=0)
        when.astimezone(UTC)
    except (ValueError, OverflowError):
        if time is not None:
            raise ParameterError(
                f"time: {time!r} is not a time of day; give it as HH:MM, such as 18:30"
            ) from None
        changes.note("the home's time cannot be read; noon of a June day was taken")
        when = datetime(2020, 6, 21, 12, tzinfo=zone)
    return when


def _zone(name: str, longitude: float, changes: Changes) -> tzinfo:
    try:
        return ZoneInfo(name)
    except (KeyError, ValueError, OSError):
        hours = round(math.degrees(longitude) / 15)
        if name:
            changes.note(
                f"the time zone {name!r} is not known on this machine; "
                f"UTC{hours:+d} was taken, by the longitude"
            )
        return timezone(timedelta(hours=hours))
