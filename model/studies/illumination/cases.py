"""Which changes of light a view can have: what it sees, and where a lamp can be added."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from model.data.encoding import solid_angles
from model.studies.illumination.lamp_position import RADIUS, left_rear
from model.studies.relight import AddedLamp, LightChange, why_not
from pipeline.params import IlluminationParams
from pipeline.passes.illumination import render_illumination
from pipeline.render.lights import Lights
from pipeline.render.scene import RenderScene
from pipeline.views import View
from scenes.arrays import BoolArray

_SEEN = 0.01  # share of the panorama's light from which on a source counts as seen
_REACH = 2.0  # metres: where the added lamp's strength is said


@dataclass(frozen=True)
class Sources:
    """Light that the camera position gets from what it sees, in the panorama's unit x steradian."""

    lamps: float
    outdoors: float
    each: dict[str, float]  # by id, of the lamps that have a shape and so can be put out

    @property
    def brightest(self) -> str:
        """The id of the brightest of `each`; empty if none of them is seen."""
        found = max(self.each, key=lambda name: self.each[name], default="")
        return found if found and self.each[found] > 0 else ""


@dataclass(frozen=True)
class Cases:
    """Changes by their names, and why a view has none of the others."""

    changes: dict[str, LightChange]
    skipped: dict[str, str]


def cases_of(
    scene: RenderScene,
    view: View,
    params: IlluminationParams,
    factor: float,
    lamp_radiance: float,
) -> Cases:
    """Every change that shows in the panorama of the view; `scene` is in its own light."""
    changes: dict[str, LightChange] = {}
    skipped: dict[str, str] = {}
    seen = sources_of(scene, view, params)
    total = seen.lamps + seen.outdoors

    place = left_rear(scene, view)
    if place is not None:
        changes["added"] = LightChange(added=AddedLamp(place, RADIUS, lamp_radiance))
    else:
        skipped["added"] = "no free place at the left rear of the camera"
    if seen.lamps > _SEEN * total:
        changes["lamps"] = LightChange(lamps=factor)
    else:
        skipped["lamps"] = "no lamp in the panorama"
    if seen.outdoors > _SEEN * total:
        changes["outdoors"] = LightChange(outdoors=1 / factor)
    else:
        skipped["outdoors"] = "no sky or sun in the panorama"
    out = seen.brightest
    if not out or seen.each[out] <= _SEEN * total:
        skipped["without"] = "no lamp in the panorama that could be put out"
    elif total - seen.each[out] <= _SEEN * total:
        skipped["without"] = "the lamp is the only light in the panorama"
    else:
        changes["without"] = LightChange(without=out)
    for name, change in list(changes.items()):
        reason = why_not(scene.scene, change)
        if reason:
            skipped[name] = reason
            del changes[name]
    return Cases(changes, skipped)


def lamp_radiance(log_average: float, albedo: float, strength: float) -> float:
    """Radiance of the added lamp by which a grey surface that faces it 2 m away gets the radiance
    `strength` times `log_average`, that of the view's shading.

    A sphere of radiance L and radius r gives the irradiance pi L (r / d)^2 at the distance d, and
    so a matte surface of reflectance `albedo` the radiance albedo L (r / d)^2. Relative to a view,
    since what is bright by night does not show by day, and scenes have units of their own.
    """
    return strength * log_average * (_REACH / RADIUS) ** 2 / albedo


def sources_of(scene: RenderScene, view: View, params: IlluminationParams) -> Sources:
    """What the camera position sees, each source by itself, hidden as in the panorama."""
    lights = scene.lights
    indoors = ~lights.distant
    names = [scene.geometry.shapes[index].id() if index >= 0 else "" for index in lights.shape]
    each = {}
    for light in scene.scene.lights:
        mine = np.array([bool(name) and name in light.shapes for name in names], dtype=bool)
        if mine.any():
            each[light.id] = _light(scene, view, params, _only(lights, mine, False))
    return Sources(
        _light(scene, view, params, _only(lights, indoors, False)),
        _light(scene, view, params, _only(lights, ~indoors, True)),
        each,
    )


def _light(scene: RenderScene, view: View, params: IlluminationParams, lights: Lights) -> float:
    if not lights.lamps and lights.environment is None:
        return 0.0
    panorama = render_illumination(replace(scene, lights=lights), view, params)["intensity.Y"]
    return float((panorama * solid_angles(panorama)).sum())


def _only(lights: Lights, chosen: BoolArray, environment: bool) -> Lights:
    return Lights(
        tuple(lamp for lamp, wanted in zip(lights.lamps, chosen, strict=True) if wanted),
        lights.shape[chosen],
        lights.centre[chosen],
        lights.radius[chosen],
        lights.distant[chosen],
        lights.environment if environment else None,
        lights.texel_angle,
    )
