"""Writer of the scene folder of a home: meshes as PLY, `scene.xml`, and the list of objects."""

from __future__ import annotations

import math
from pathlib import Path
from xml.etree.ElementTree import Element, ElementTree, indent

import numpy as np

from pbrnet.scenes.contract import Point3, SceneObject
from pbrnet.scenes.formats.ply import write_ply
from pbrnet.scenes.importing.writer import sensor_element
from pbrnet.scenes.importing.xml_elements import number, plugin, prop
from pbrnet.scenes.sweethome.furnishing.finishes import BsdfWriter
from pbrnet.scenes.sweethome.furnishing.items import ItemPart, PlacedItem
from pbrnet.scenes.sweethome.sun import Sky
from pbrnet.scenes.sweethome.views import Camera

_MAX_DEPTH = 11


def write_scene(
    folder: Path,
    items: list[PlacedItem],
    finishes: BsdfWriter,
    sky: Sky,
    camera: Camera,
) -> list[SceneObject]:
    """Write `scene.xml` and its meshes; returns one object for each item, in order."""
    shapes, objects = [], []
    for item in items:
        names = []
        for count, part in enumerate(item.parts):
            name = f"{item.id}.{count}"
            names.append(name)
            finish = finishes.bsdf(part.finish)
            shapes.append(_shape(folder, name, part, finish, item.sampling_weight))
        low, high = np.round(item.bounds, 5).tolist()
        objects.append(
            SceneObject(
                id=item.id,
                name=item.name,
                category=item.category,
                shapes=tuple(names),
                bbox_min=_triple(low),
                bbox_max=_triple(high),
                is_structure=item.is_structure,
                room=item.room,
            )
        )
    root = Element("scene", {"version": "3.0.0"})
    root.append(plugin("integrator", "path", max_depth=_MAX_DEPTH))
    fov = math.degrees(2 * camera.half_fov_x)
    root.append(sensor_element(camera.mitsuba_pose, fov, camera.width, camera.height))
    root.append(sky.emitter)
    for element in (*finishes.elements, *shapes):
        root.append(element)
    indent(root, "  ")
    ElementTree(root).write(folder / "scene.xml", encoding="utf-8", xml_declaration=True)
    return objects


def _shape(folder: Path, name: str, part: ItemPart, bsdf: str, weight: float) -> Element:
    if part.sphere is not None:
        centre, radius = part.sphere
        made = plugin("shape", "sphere", radius=float(radius))
        x, y, z = (number(value) for value in centre)
        made.append(Element("point", {"name": "center", "x": x, "y": y, "z": z}))
    else:
        file = f"meshes/{name}.ply"
        write_ply(folder / file, part.mesh)
        made = plugin("shape", "ply", filename=file)
        if part.mesh.normals is None:
            made.append(prop("face_normals", True))
    made.set("id", name)
    made.append(Element("ref", {"id": bsdf}))
    if part.radiance is not None:
        glow = plugin("emitter", "area", radiance=part.radiance)
        glow.append(prop("sampling_weight", float(max(weight, 0.01))))
        made.append(glow)
    return made


def _triple(values: list[float]) -> Point3:
    return (values[0], values[1], values[2])
