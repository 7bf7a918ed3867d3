"""Sky and sun of a scene: an image of all directions, and the sun as a directional light.

The image is equirectangular, linear RGB in cd/m^2: its top row is up (Z of the scene), its middle
column +Y, and right of that is +X. The sun is not in it.
"""

from __future__ import annotations

import math
from copy import deepcopy
from dataclasses import dataclass
from typing import Any
from xml.etree.ElementTree import Element, tostring

import mitsuba as mi
import numpy as np
import OpenEXR

from pbrnet.pipeline.render import raycast
from pbrnet.pipeline.render.scene import set_variant
from pbrnet.pipeline.scene_export.content import Content
from pbrnet.pipeline.scene_export.looks import numbers, triple
from pbrnet.scenes.arrays import Float32Array, Float64Array, as_triple
from pbrnet.scenes.color import Color
from pbrnet.scenes.errors import InputError
from pbrnet.scenes.geometry.transforms import frame_along
from pbrnet.scenes.importing.xml_elements import prop
from pbrnet.scenes.photometry import LUMEN

SKY = "sky-image.exr"  # among the textures of a stage
HEIGHT = 512  # pixels; twice as wide
_SAMPLES = 4  # a side of each pixel
_SUN_SIDE = 96  # samples a side of a square around the sun
_SUN_RADIUS = math.radians(0.5)  # half of the square's side; the disc's radius is 0.27 degrees
_NUMBERS = ("turbidity", "sun_scale", "sky_scale")


@dataclass(frozen=True)
class Outdoors:
    """Luminance of the sky (H, W, 3), the sun, and what an import needs to make both again."""

    sky: Float32Array
    direction: Float64Array | None  # (3,), in which the sun shines
    illuminance: Color  # lux, RGB, on a surface that faces the sun
    stated: dict[str, Any]


Lit = tuple[Content, Outdoors | None]  # a scene with its sky and sun


def outdoors_of(content: Content) -> Outdoors | None:
    """Return sky and sun of a scene; None for a scene without any."""
    if not content.environments:
        return None
    element = content.environments[0]
    set_variant("auto")
    emitter = _emitter(content, element, sun=False)
    sky = _image(emitter)
    if element.get("type") not in ("sunsky", "sun"):
        stated = {"kind": "constant", "radiance": _constant(element)}
        if element.get("type") != "constant" or not stated["radiance"]:
            stated = {"kind": "image"}
        return Outdoors(sky, None, (0.0, 0.0, 0.0), stated)
    sun = _emitter(content, element, sun=True)
    towards = np.array(mi.traverse(sun)["sun_direction"], dtype=np.float64).ravel()
    place = element.find("transform[@name='to_world']")
    if place is not None:
        matrix = np.array(sun.world_transform().matrix, np.float64).reshape(4, 4)
        towards = matrix[:3, :3] @ towards
    towards /= np.linalg.norm(towards)
    illuminance = as_triple(_irradiance(sun, towards) / LUMEN)
    stated = _sunsky(element) if place is None else {"kind": "image"}
    return Outdoors(sky, -towards if max(illuminance) > 0 else None, illuminance, stated)


def save_sky(path: Any, sky: Float32Array) -> None:
    """Write the image of the sky as OpenEXR."""
    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    with OpenEXR.File(header, {"RGB": np.ascontiguousarray(sky)}) as file:
        file.write(str(path))


def _emitter(content: Content, element: Element, sun: bool) -> Any:
    """The emitter alone, with the sun or all but the sun."""
    made = deepcopy(element)
    for file in made.iter("string"):
        if file.get("name") == "filename":
            file.set("value", str((content.scene.folder / file.get("value", "")).resolve()))
    if made.get("type") == "sunsky":
        off = "sky_scale" if sun else "sun_scale"
        for child in [one for one in made if one.get("name") == off]:
            made.remove(child)
        made.append(prop(off, 0.0))
    scene = Element("scene", {"version": "3.0.0"})
    scene.append(made)
    try:
        loaded = mi.load_string(tostring(scene, "unicode"))
    except RuntimeError as error:
        line = str(error).strip().splitlines()[-1].strip()[:300]
        raise InputError(f"{content.scene.xml}: its sky cannot be made ({line})") from None
    return loaded.environment()


def _image(emitter: Any) -> Float32Array:
    """Mean radiance of each pixel, in cd/m^2."""
    height, width = HEIGHT * _SAMPLES, 2 * HEIGHT * _SAMPLES
    rows = []
    for start in range(0, height, height // 8):
        v = (start + np.arange(height // 8) + 0.5) / height
        u = (np.arange(width) + 0.5) / width
        polar, azimuth = np.meshgrid(np.pi * v, 2 * np.pi * (u - 0.5), indexing="ij")
        directions = np.stack(
            [np.sin(polar) * np.sin(azimuth), np.sin(polar) * np.cos(azimuth), np.cos(polar)], -1
        )
        found = _radiance(emitter, directions.reshape(-1, 3))
        shape = (height // 8 // _SAMPLES, _SAMPLES, width // _SAMPLES, _SAMPLES, 3)
        rows.append(found.reshape(shape).mean(axis=(1, 3)))
    return (np.concatenate(rows) / LUMEN).astype(np.float32)


def _irradiance(sun: Any, towards: Float64Array) -> Float64Array:
    """Irradiance (3,) by the sun's disc on a surface that faces it."""
    side, across = frame_along(np.zeros(3), towards)[:3, :2].T
    steps = _SUN_RADIUS * (2 * (np.arange(_SUN_SIDE) + 0.5) / _SUN_SIDE - 1)
    x, y = (grid.reshape(-1, 1) for grid in np.meshgrid(steps, steps))
    directions = towards + x * side + y * across
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    total: Float64Array = _radiance(sun, directions).mean(axis=0) * (2 * _SUN_RADIUS) ** 2
    return total


def _radiance(emitter: Any, directions: Float64Array) -> Float64Array:
    """Radiance (N, 3) from unit directions (N, 3); what is not finite counts as 0."""
    found = raycast.environment_radiance(emitter, directions)
    return np.where(np.isfinite(found), found, 0)


def _constant(element: Element) -> list[float]:
    found = element.find("*[@name='radiance']")
    values = [] if found is None else numbers(found.get("value", ""))
    return values * 3 if len(values) == 1 else values if len(values) == 3 else []


def _sunsky(element: Element) -> dict[str, Any]:
    """Parameters of a `sunsky` that is given by numbers alone; else its image is needed."""
    found: dict[str, Any] = {"kind": "sunsky"}
    for child in element:
        name = child.get("name", "")
        if name in _NUMBERS and child.tag in ("float", "integer"):
            found[name] = (numbers(child.get("value", "")) or [1.0])[0]
        elif name == "sun_direction":
            found[name] = triple(child)
        elif name != "sampling_weight":
            return {"kind": "image"}
    return found if "sun_direction" in found else {"kind": "image"}
