"""Changes of light that are possible and visible in a view."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from pbrnet.model.data.encoding import solid_angles
from pbrnet.model.studies.illumination.lamp_position import RADIUS, left_rear_position
from pbrnet.model.studies.illumination.relight import AddedLamp, LightChange, reason_impossible
from pbrnet.pipeline.passes.illumination import render_illumination
from pbrnet.pipeline.passes.settings import IlluminationParams
from pbrnet.pipeline.render.lights import Lights
from pbrnet.pipeline.render.scene import RenderScene
from pbrnet.pipeline.views import View
from pbrnet.scenes.arrays import BoolArray

_VISIBLE = 0.01  # share of the panorama's light above which a source counts as visible
_STRENGTH_DISTANCE = 2.0  # metres from the added lamp at which `strength` is defined


@dataclass(frozen=True)
class VisibleLight:
    """Light of visible sources at the camera position, in the panorama's unit x steradian."""

    lamps: float
    outdoors: float
    each: dict[str, float]  # by id, of lamps that have a shape and can be removed

    @property
    def brightest(self) -> str:
        """Id of the brightest of `each`; empty if none is visible."""
        found = max(self.each, key=lambda name: self.each[name], default="")
        return found if found and self.each[found] > 0 else ""


@dataclass(frozen=True)
class PossibleChanges:
    """Possible changes by name, and the reasons against the others."""

    changes: dict[str, LightChange]
    skipped: dict[str, str]


def possible_changes(
    scene: RenderScene,
    view: View,
    params: IlluminationParams,
    factor: float,
    lamp_radiance: float,
) -> PossibleChanges:
    """Return every change that is visible in the view's panorama; `scene` is unchanged."""
    changes: dict[str, LightChange] = {}
    skipped: dict[str, str] = {}
    seen = visible_light(scene, view, params)
    total = seen.lamps + seen.outdoors

    place = left_rear_position(scene, view)
    if place is not None:
        changes["added"] = LightChange(added=AddedLamp(place, RADIUS, lamp_radiance))
    else:
        skipped["added"] = "no free place at the left rear of the camera"
    if seen.lamps > _VISIBLE * total:
        changes["lamps"] = LightChange(lamps=factor)
    else:
        skipped["lamps"] = "no lamp in the panorama"
    if seen.outdoors > _VISIBLE * total:
        changes["outdoors"] = LightChange(outdoors=1 / factor)
    else:
        skipped["outdoors"] = "no sky or sun in the panorama"
    out = seen.brightest
    if not out or seen.each[out] <= _VISIBLE * total:
        skipped["without"] = "no lamp in the panorama that could be put out"
    elif total - seen.each[out] <= _VISIBLE * total:
        skipped["without"] = "the lamp is the only light in the panorama"
    else:
        changes["without"] = LightChange(without=out)
    for name, change in list(changes.items()):
        reason = reason_impossible(scene.scene, change)
        if reason:
            skipped[name] = reason
            del changes[name]
    return PossibleChanges(changes, skipped)


def lamp_radiance(log_average: float, albedo: float, strength: float) -> float:
    """Return the radiance of the added lamp.

    A grey surface that faces the lamp at 2 m then has the radiance `strength` x `log_average`; the
    log average is that of the view's shading. The strength is relative to the view, because scenes
    have different units, and daylight outshines lamps that are bright at night.

    A sphere of radiance L and radius r gives the irradiance pi L (r / d)^2 at the distance d, so a
    diffuse surface of reflectance `albedo` has the radiance albedo L (r / d)^2.
    """
    return strength * log_average * (_STRENGTH_DISTANCE / RADIUS) ** 2 / albedo


def visible_light(scene: RenderScene, view: View, params: IlluminationParams) -> VisibleLight:
    """Measure the visible light of every source at the camera position, with occlusion."""
    lights = scene.lights
    indoors = ~lights.distant
    names = [scene.geometry.shapes[index].id() if index >= 0 else "" for index in lights.shape]
    each = {}
    for light in scene.scene.lights:
        mine = np.array([bool(name) and name in light.shapes for name in names], dtype=bool)
        if mine.any():
            each[light.id] = _light(scene, view, params, _only(lights, mine, False))
    return VisibleLight(
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
