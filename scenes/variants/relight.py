"""Another light for an imported scene: hour and weather, which lamps burn, how warm they are."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any
from xml.etree.ElementTree import Element

import defusedxml.ElementTree
import numpy as np

from scenes.color import REC709
from scenes.contract import Light, Scene
from scenes.params import LightSetting
from scenes.photometry import blackbody
from scenes.procedural.lighting import Lamp, choose_lit, draw_cooler, draw_sky
from scenes.seeds import generator

_OUTSIDE = ("sunsky", "sky", "sun", "constant", "envmap")
_OUTDOORS = ("sun", "sky", "environment")
_BARE = ("point", "spot")  # lamps without a surface: emitters of their own
_KELVIN = (2700.0, 2800.0, 3000.0, 3300.0)  # of lamps for homes


@dataclass(frozen=True)
class Relit:
    """The lights of the variant, its setting, and what was drawn."""

    lights: tuple[Light, ...]
    lighting: str
    choices: dict[str, Any]
    sky: bool = False  # whether there is another sky


def relight(
    root: Element, scene: Scene, settings: tuple[LightSetting, ...], seed: int, variant: int
) -> Relit:
    """Change sky and lamps in `root` (of `scene.xml`) to the variant's setting.

    Settings take turns; those that the scene cannot have are skipped: no night without lamps, no
    day without windows or sky. Where none is left the light stays as it is. Lamps keep their
    power; only those that burn in `scene` can burn. Directional lights stay as they are.
    """
    bare = _bare(root, scene)
    lamps = [light for light in scene.lights if light.kind == "area" or light.id in bare]
    outside = any(light.kind in _OUTDOORS for light in scene.lights)
    others = tuple(light for light in scene.lights
                   if light not in lamps and light.kind not in _OUTDOORS)  # fmt: skip
    setting = _setting(settings, bool(lamps), outside, variant)
    if setting is None:
        return Relit(scene.lights, scene.lighting, {"setting": "as it was"})

    def rng(name: str) -> np.random.Generator:
        return generator(seed, "variant", variant, "light", name)

    bright = {portal.room for portal in scene.portals if portal.clear}
    windowless = [room.id for room in scene.rooms if room.id not in bright]
    lit = choose_lit(
        rng("lamps"),
        setting,
        [Lamp(light.id, light.room, light.lumens or 1.0) for light in lamps],
        windowless,
    )
    kelvin = float(rng("colour").choice(_KELVIN)) + draw_cooler(rng("cooler"))
    burning = tuple(light for light in lamps if light.id in lit)
    weight = _switch(root, lamps, {name for light in burning for name in light.shapes}, kelvin)
    for name, emitter in bare.items():
        if name in lit:
            weight += _tinted(emitter, "intensity", kelvin)
        else:
            root.remove(emitter)
    choices: dict[str, Any] = {
        "setting": setting,
        "lamps_lit": sorted(lit),
        "lamps_kelvin": kelvin,
    }
    lights = burning + others
    if outside:
        sky = draw_sky(rng("sky"), setting, weight)
        for old in root.findall("emitter"):
            if old.get("type") in _OUTSIDE:
                root.remove(old)
        made = defusedxml.ElementTree.fromstring(sky.xml)
        made.set("id", _free("sky", root))
        root.insert(_first_shape(root), made)
        lights += sky.lights
        choices |= sky.choices
    return Relit(lights, setting, choices, outside)


def _setting(
    settings: tuple[LightSetting, ...], lamps: bool, outside: bool, variant: int
) -> LightSetting | None:
    needs = {"day": outside, "evening": outside, "night": lamps, "mixed": lamps and outside}
    possible = [setting for setting in settings if needs[setting]]
    return possible[variant % len(possible)] if possible else None


def _switch(root: Element, lamps: list[Light], burning: set[str], kelvin: float) -> float:
    """Put out all lamps but `burning` (shape ids), tint these; the sum of their weights."""
    of_lamps = {name for light in lamps for name in light.shapes}
    weight = 0.0
    for shape in root.findall("shape"):
        emitter = shape.find("emitter")
        if shape.get("id") not in of_lamps or emitter is None:
            continue
        if shape.get("id") not in burning:
            shape.remove(emitter)
            continue
        weight += _tinted(emitter, "radiance", kelvin)
    return weight


def _tinted(emitter: Element, name: str, kelvin: float) -> float:
    """Give an emitter's `name` the colour of `kelvin`, its luminance kept; its sampling weight."""
    for item in emitter.findall("rgb"):
        if item.get("name") == name:
            old = np.array([float(word) for word in item.get("value", "").split()])
            luminance = float(old @ REC709) if old.size == 3 else float(old.mean())
            tint = luminance * np.array(blackbody(kelvin))
            item.set("value", " ".join(f"{value:.9g}" for value in tint))
    weights = [item for item in emitter.findall("float") if item.get("name") == "sampling_weight"]
    return float(weights[0].get("value", 1)) if weights else 1.0


def _bare(root: Element, scene: Scene) -> dict[str, Element]:
    """The emitters of points and spots by their light's id: both come in the same order.

    Empty where they do not match, as in a scene that somebody edited; they then stay lit.
    """
    lights = [light for light in scene.lights if light.kind in _BARE]
    emitters = [item for item in root.findall("emitter") if item.get("type") in _BARE]
    if [light.kind for light in lights] != [item.get("type") for item in emitters]:
        return {}
    return {light.id: emitter for light, emitter in zip(lights, emitters, strict=True)}


def _free(name: str, root: Element) -> str:
    taken = {item.get("id") for item in root.iter()}
    while name in taken:
        name += "_"
    return name


def _first_shape(root: Element) -> int:
    return next((number for number, item in enumerate(root) if item.tag == "shape"), len(root))
