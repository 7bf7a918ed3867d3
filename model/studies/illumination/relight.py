"""Relighting of a scene: lamps or outdoor light scaled, a lamp removed, a lamp added.

The scene's folder is not modified. A temporary folder holds the changed `scene.xml` and links to
meshes and textures. It is opened like every other scene, so that panoramas and ground truth are
rendered by the same code as those of the dataset.
"""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from xml.etree.ElementTree import Element, ElementTree, ParseError, SubElement

import defusedxml.ElementTree
import numpy as np
from defusedxml import DefusedXmlException

from pbrnet.pipeline.render.scene import RenderScene, free_memory, open_scene
from pbrnet.scenes.contract import Light, Point3, Scene, SceneObject, load_scene, save_scene
from pbrnet.scenes.errors import InputError
from pbrnet.scenes.files import copy_files

ADDED_LAMP_ID = "study-lamp"  # of the added object, shape and light
# Strength properties by type of emitter; a missing property that ends in "scale" is 1.
_OUTDOORS = {
    "sunsky": ("sun_scale", "sky_scale"),
    "timed_sunsky": ("sun_scale", "sky_scale"),
    "constant": ("radiance",),
    "envmap": ("scale",),
    "directional": ("irradiance",),
    "directionalarea": ("radiance",),
}
_LAMPS = {"area": ("radiance",), "point": ("intensity",), "spot": ("intensity",)}
_STRENGTHS = {**_OUTDOORS, **_LAMPS}


@dataclass(frozen=True)
class AddedLamp:
    """Spherical area light: centre and radius in metres, grey radiance in the scene's unit."""

    centre: Point3
    radius: float
    radiance: float


@dataclass(frozen=True)
class LightChange:
    """Change of a scene's light; the defaults change nothing."""

    lamps: float = 1.0  # factor of the radiance of every lamp
    outdoors: float = 1.0  # factor of sky, sun and environment
    without: str = ""  # id of an area light to remove
    added: AddedLamp | None = None


@contextmanager
def open_relit(scene: Scene, change: LightChange) -> Iterator[RenderScene]:
    """Open the scene for rendering under the changed light.

    Raises `InputError` if the scene cannot be read or the change is impossible: there is no light
    with that id, or the strength of an emitter is an image.
    """
    root, changed = _changed(scene, change)
    with tempfile.TemporaryDirectory(prefix="pbrnet-relit-") as parent:
        folder = Path(parent) / scene.scene_id
        copy_files(scene.folder, folder)
        ElementTree(root).write(folder / "scene.xml", encoding="utf-8", xml_declaration=True)
        save_scene(folder, changed)
        try:
            yield open_scene(load_scene(folder))
        finally:
            free_memory()


def reason_impossible(scene: Scene, change: LightChange) -> str:
    """Return why a change is impossible; an empty string if it is possible."""
    try:
        _changed(scene, change)
    except InputError as error:
        return str(error)
    return ""


def _changed(scene: Scene, change: LightChange) -> tuple[Element, Scene]:
    """Return the changed `scene.xml` and the scene that describes it."""
    try:
        root: Element = defusedxml.ElementTree.parse(scene.xml).getroot()
    except (ParseError, DefusedXmlException) as error:
        raise InputError(f"{scene.xml}: not valid XML ({error})") from None
    return root, change_light(root, scene, change)


def change_light(root: Element, scene: Scene, change: LightChange) -> Scene:
    """Change the emitters in `root`, the root of `scene.xml`; return the scene that describes it.

    Raises `InputError` as `open_relit`.
    """
    objects, lights = scene.objects, scene.lights
    for emitter in _emitters(root):
        factor = change.outdoors if emitter.get("type") in _OUTDOORS else change.lamps
        if factor != 1:
            _scale(emitter, factor, scene.xml)
    if change.without:
        light = next((light for light in lights if light.id == change.without), None)
        if light is None or not light.shapes:
            raise InputError(f"{scene.folder}: no light {change.without!r} with a shape to remove")
        for shape in root.iter("shape"):
            if shape.get("id") in light.shapes:
                for emitter in shape.findall("emitter"):
                    shape.remove(emitter)
        lights = tuple(other for other in lights if other is not light)
    if change.added is not None:
        _add(root, change.added)
        centre, radius = np.array(change.added.centre), change.added.radius
        low, high = (tuple(map(float, centre + side * radius)) for side in (-1, 1))
        lamp = SceneObject(ADDED_LAMP_ID, "lamp", "lamp", (ADDED_LAMP_ID,), low, high, False)  # type: ignore[arg-type]
        objects = (*objects, lamp)
        lights = (*lights, Light(ADDED_LAMP_ID, "area", (ADDED_LAMP_ID,)))
    return replace(scene, objects=objects, lights=lights)


def _emitters(root: Element) -> list[Element]:
    """Return the emitters of the scene itself and of its shapes."""
    return root.findall("emitter") + [
        e for shape in root.iter("shape") for e in shape.findall("emitter")
    ]


def _scale(emitter: Element, factor: float, xml: Path) -> None:
    kind = emitter.get("type", "")
    if kind not in _STRENGTHS:
        raise InputError(f"{xml}: emitters of type {kind!r} cannot be scaled")
    for name in _STRENGTHS[kind]:
        item = next((item for item in emitter if item.get("name") == name), None)
        if item is None and name.endswith("scale"):
            item = SubElement(emitter, "float", name=name, value="1")
        try:
            if item is None or item.tag not in ("rgb", "float"):
                raise ValueError
            values = [
                factor * float(word) for word in item.get("value", "").replace(",", " ").split()
            ]
        except ValueError:
            raise InputError(
                f"{xml}: the {name} of an emitter of type {kind!r} is not a number or colour, "
                "so it cannot be scaled"
            ) from None
        item.set("value", " ".join(f"{value:.9g}" for value in values))


def _add(root: Element, lamp: AddedLamp) -> None:
    """Add a spherical area light, with the largest sampling weight of the other emitters."""
    given = [
        float(item.get("value", 1))
        for emitter in _emitters(root)
        for item in emitter.findall("float")
        if item.get("name") == "sampling_weight"
    ]
    shape = SubElement(root, "shape", type="sphere", id=ADDED_LAMP_ID)
    x, y, z = (f"{value:.9g}" for value in lamp.centre)
    SubElement(shape, "point", name="center", x=x, y=y, z=z)
    SubElement(shape, "float", name="radius", value=f"{lamp.radius:.9g}")
    SubElement(shape, "bsdf", type="diffuse")
    emitter = SubElement(shape, "emitter", type="area")
    SubElement(emitter, "rgb", name="radiance", value=f"{lamp.radiance:.9g}")
    SubElement(emitter, "float", name="sampling_weight", value=f"{max(given, default=1.0):.9g}")
