"""New lighting for an imported scene: sky, lit lamps and their colour temperature."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any
from xml.etree.ElementTree import Element

import defusedxml.ElementTree
import numpy as np

from pbrnet.scenes.color import REC709
from pbrnet.scenes.contract import Light, Scene
from pbrnet.scenes.looks import LightSetting
from pbrnet.scenes.photometry import PBRS_BULB, PBRS_UNIT, blackbody
from pbrnet.scenes.procedural.lighting import Lamp, choose_lit_lamps, draw_kelvin_offset, draw_sky
from pbrnet.scenes.seeds import Draw, generator

_OUTSIDE = ("sunsky", "sky", "sun", "constant", "envmap")
_OUTDOORS = ("sun", "sky", "environment")
_POINT_KINDS = ("point", "spot")  # lamps without a surface: top-level emitters
_BULB_DISC = math.pi * 0.03**2  # square metres of a bulb of 60 mm, for points and spots
_KELVIN = (2700.0, 2800.0, 3000.0, 3300.0)  # colour temperatures of household lamps


@dataclass(frozen=True)
class RelightResult:
    """Lights, light setting and sampled parameters of a variant."""

    lights: tuple[Light, ...]
    lighting: str
    choices: dict[str, Any]
    sky: bool = False  # True if the sky was replaced


def relight(
    root: Element, scene: Scene, settings: tuple[LightSetting, ...], seed: int, variant: int
) -> RelightResult:
    """Change sky and lamps in `root` (of `scene.xml`) to the variant's setting.

    Variants cycle through the settings that the scene supports: night needs lamps, day needs a
    sky. If none is supported, the light does not change. Only lamps that are on in `scene` can be
    on. They keep their power, but in PBRS' light, where all have the same radiance. Directional
    lights do not change.
    """
    point_emitters = _point_emitters(root, scene)
    lamps = [light for light in scene.lights if light.kind == "area" or light.id in point_emitters]
    outside = any(light.kind in _OUTDOORS for light in scene.lights)
    others = tuple(light for light in scene.lights
                   if light not in lamps and light.kind not in _OUTDOORS)  # fmt: skip
    setting = _setting(settings, bool(lamps), outside, variant)
    if setting is None:
        return RelightResult(scene.lights, scene.lighting, {"setting": "as it was"})

    def rng(name: str) -> Draw:
        return generator(seed, "variant", variant, "light", name)

    with_window = {portal.room for portal in scene.portals if portal.clear}
    windowless = [room.id for room in scene.rooms if room.id not in with_window]
    lit = choose_lit_lamps(
        rng("lamps"),
        setting,
        [Lamp(light.id, light.room, light.lumens or 1.0) for light in lamps],
        windowless,
    )
    kelvin: float | None = None
    if setting != "pbrs":
        kelvin = rng("colour").pick(_KELVIN) + draw_kelvin_offset(rng("cooler"))
    lit_lights = tuple(light for light in lamps if light.id in lit)
    weight = _switch_lamps(
        root, lamps, {name for light in lit_lights for name in light.shapes}, kelvin
    )
    for name, emitter in point_emitters.items():
        if name in lit:
            weight += _set_color(emitter, "intensity", kelvin)
        else:
            root.remove(emitter)
    choices: dict[str, Any] = {"setting": setting, "lamps_lit": sorted(lit)}
    if kelvin is not None:
        choices["lamps_kelvin"] = kelvin
    else:
        lit_lights = tuple(replace(light, lumens=None) for light in lit_lights)
    lights = lit_lights + others
    if outside:
        sky = draw_sky(rng("sky"), setting, weight)
        for old in root.findall("emitter"):
            if old.get("type") in _OUTSIDE:
                root.remove(old)
        sky_emitter = defusedxml.ElementTree.fromstring(sky.xml)
        sky_emitter.set("id", _unused_id("sky", root))
        root.insert(_first_shape(root), sky_emitter)
        lights += sky.lights
        choices |= sky.choices
    return RelightResult(lights, setting, choices, outside)


def _setting(
    settings: tuple[LightSetting, ...], lamps: bool, outside: bool, variant: int
) -> LightSetting | None:
    needs: dict[LightSetting, bool] = dict.fromkeys(("day", "evening", "pbrs"), outside)
    needs |= {"night": lamps, "mixed": lamps and outside}
    possible = [setting for setting in settings if needs[setting]]
    return possible[variant % len(possible)] if possible else None


def _switch_lamps(root: Element, lamps: list[Light], lit: set[str], kelvin: float | None) -> float:
    """Switch off all lamps except the shapes `lit`, and set the colour of these.

    Returns the sum of their sampling weights.
    """
    of_lamps = {name for light in lamps for name in light.shapes}
    weight = 0.0
    for shape in root.findall("shape"):
        emitter = shape.find("emitter")
        if shape.get("id") not in of_lamps or emitter is None:
            continue
        if shape.get("id") not in lit:
            shape.remove(emitter)
            continue
        weight += _set_color(emitter, "radiance", kelvin)
    return weight


def _set_color(emitter: Element, name: str, kelvin: float | None) -> float:
    """Set the colour of an emitter's `name` to `kelvin`, keeping its luminance.

    Without `kelvin` it becomes one of PBRS' bulbs. Returns its sampling weight.
    """
    for item in [item for item in emitter if item.get("name") == name]:
        if kelvin is None:
            emitter.remove(item)
        elif item.tag == "rgb":
            old = np.array([float(word) for word in item.get("value", "").split()])
            luminance = float(old @ REC709) if old.size == 3 else float(old.mean())
            tint = luminance * np.array(blackbody(kelvin))
            item.set("value", " ".join(f"{value:.9g}" for value in tint))
    if kelvin is None:
        white = PBRS_BULB * PBRS_UNIT * (_BULB_DISC if name == "intensity" else 1.0)
        emitter.append(Element("rgb", {"name": name, "value": " ".join([f"{white:.9g}"] * 3)}))
    weights = [item for item in emitter.findall("float") if item.get("name") == "sampling_weight"]
    return float(weights[0].get("value", 1)) if weights else 1.0


def _point_emitters(root: Element, scene: Scene) -> dict[str, Element]:
    """Point and spot emitters by the id of their light; both lists have the same order.

    Empty if they do not match, as in an edited scene; these lamps then stay on.
    """
    lights = [light for light in scene.lights if light.kind in _POINT_KINDS]
    emitters = [item for item in root.findall("emitter") if item.get("type") in _POINT_KINDS]
    if [light.kind for light in lights] != [item.get("type") for item in emitters]:
        return {}
    return {light.id: emitter for light, emitter in zip(lights, emitters, strict=True)}


def _unused_id(name: str, root: Element) -> str:
    taken = {item.get("id") for item in root.iter()}
    while name in taken:
        name += "_"
    return name


def _first_shape(root: Element) -> int:
    return next((number for number, item in enumerate(root) if item.tag == "shape"), len(root))
