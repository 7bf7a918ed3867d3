"""Finishes of converted pieces from the surfaces of a model's reader."""

from __future__ import annotations

import io
from pathlib import Path
from typing import Literal
from xml.etree.ElementTree import Element

import numpy as np

from pbrnet.scenes.arrays import Float64Array
from pbrnet.scenes.color import Color
from pbrnet.scenes.image_files import eight_bits, open_image
from pbrnet.scenes.importing.changes import Changes
from pbrnet.scenes.importing.materials.surface import Surface
from pbrnet.scenes.sweethome.furnishing.items import SurfaceFinish

_WRAPPERS = ("twosided", "mask", "normalmap", "bumpmap")
_COLORS = ("base_color", "reflectance", "diffuse_reflectance", "specular_reflectance")
_ROUGHNESS = ("roughness", "alpha")
_USUAL_ROUGHNESS = 0.6  # of a surface whose roughness is an image
_GLOSSY = 0.95  # roughness below which a surface is glossy
_MASK = "|"  # between the image of a finish and that of its opacity


def finish_of(surface: Surface, changes: Changes) -> SurfaceFinish | None:
    """Return the finish of a surface; None for one without effect on light.

    `image` is the path of the colour below the reader's folder, with that of an opacity behind
    a "|", as `read_image` takes it.
    """
    if surface.invisible or surface.element is None:
        return None
    if surface.see_through:
        return SurfaceFinish("glass", (1.0, 1.0, 1.0), roughness=0.0)
    element, opacity = _unwrapped(surface.element)
    color, image = _color(element, surface.name, changes)
    if image is not None and opacity is not None:
        image += _MASK + opacity
    roughness = next((_float(each) for name in _ROUGHNESS if (each := _named(element, name))), 1.0)
    metallic = _named(element, "metallic")
    is_metal = "conductor" in element.get("type", "")
    is_metal |= metallic is not None and _float(metallic) > 0.5
    kind: Literal["matt", "gloss", "metal"] = "gloss" if roughness < _GLOSSY else "matt"
    if is_metal:
        kind = "metal"
    return SurfaceFinish(kind, color, image, round(roughness, 4))


def image_transform(surface: Surface) -> Float64Array | None:
    """Return the transform (4, 4) of the texture coordinates of a surface's colour, or None."""
    if surface.element is None:
        return None
    element, _ = _unwrapped(surface.element)
    found = next((each for name in _COLORS if (each := _named(element, name)) is not None), None)
    stated = found.find("transform/matrix") if found is not None else None
    if stated is None:
        return None
    return np.array(stated.get("value", "").split(), dtype=np.float64).reshape(4, 4)


def read_image(folder: Path, name: str) -> bytes:
    """Return an image file of a finish below `folder`; an opacity becomes its alpha."""
    color, _, opacity = name.partition(_MASK)
    if not opacity:
        return (folder / color).read_bytes()
    both = eight_bits(open_image(folder / color)).convert("RGB")
    mask = eight_bits(open_image(folder / opacity)).convert("L")
    both.putalpha(mask.resize(both.size))
    stream = io.BytesIO()
    both.save(stream, "PNG")
    return stream.getvalue()


def _unwrapped(element: Element) -> tuple[Element, str | None]:
    """The BSDF inside its wrappers, and the image of its opacity."""
    opacity = None
    while element.get("type") in _WRAPPERS:
        if element.get("type") == "mask" and opacity is None:
            opacity = _bitmap(_named(element, "opacity"))
        inner = element.find("bsdf")
        if inner is None:
            break
        element = inner
    return element, opacity


def _color(element: Element, name: str, changes: Changes) -> tuple[Color, str | None]:
    found = next((each for key in _COLORS if (each := _named(element, key)) is not None), None)
    if found is None:
        return (0.5, 0.5, 0.5), None
    if image := _bitmap(found):
        return (1.0, 1.0, 1.0), image
    values = [float(word) for word in found.get("value", "").split()]
    if len(values) not in (1, 3):
        changes.note("a material became grey: {}", name)
        return (0.5, 0.5, 0.5), None
    red, green, blue = values * 3 if len(values) == 1 else values
    return (red, green, blue), None


def _named(element: Element, name: str) -> Element | None:
    return next((child for child in element if child.get("name") == name), None)


def _bitmap(element: Element | None) -> str | None:
    """File of an image, also of one inside another texture."""
    if element is None:
        return None
    stated = next((each for each in element.iter() if each.get("name") == "filename"), None)
    return stated.get("value") if stated is not None else None


def _float(element: Element) -> float:
    value = element.get("value", "")
    return float(value) if element.tag == "float" else _USUAL_ROUGHNESS
