"""Writer of an imported scene: meshes as binary PLY and `scene.xml` for plain Mitsuba 3."""

from __future__ import annotations

import copy
from pathlib import Path
from xml.etree.ElementTree import Element, ElementTree, indent

from pbrnet.scenes.arrays import Float64Array
from pbrnet.scenes.formats.ply import write_ply
from pbrnet.scenes.importing.names import numbered
from pbrnet.scenes.importing.shape import Emitter, Shape
from pbrnet.scenes.importing.xml_elements import plugin, prop


def write_scene_xml(
    folder: Path,
    shapes: list[Shape],
    area_emitters: dict[str, Element],
    emitters: list[Emitter],
    sensor: Element,
    max_depth: int,
) -> None:
    """Write meshes and `scene.xml` to `folder`; shared materials are written once."""
    root = Element("scene", {"version": "3.0.0"})
    root.append(plugin("integrator", "path", max_depth=max_depth))
    root.append(sensor)
    shared: dict[int, str] = {}
    taken = {shape.id.lower(): 1 for shape in shapes}
    for shape in shapes:
        element = shape.surface.element
        assert element is not None
        if id(shape.surface) in shared:
            continue
        name = _material_id(shape.surface.name, taken)
        shared[id(shape.surface)] = name
        written = copy.deepcopy(element)
        written.attrib.pop("name", None)
        written.set("id", name)
        root.append(written)
    for emitter in emitters:
        if not any(kind in ("sun", "sky", "environment") for kind in emitter.kinds):
            root.append(emitter.element)
        else:
            # The sky is one emitter among many lamps: half of the samples go to it.
            weight = float(max(1, len(area_emitters) + len(emitters) - 1))
            emitter.element.append(prop("sampling_weight", weight))
            root.append(emitter.element)
    for shape in shapes:
        if shape.sphere is not None:
            made = plugin("shape", "sphere", to_world=shape.sphere)
            if shape.inside_out:
                made.append(prop("flip_normals", True))
        else:
            name = f"meshes/{shape.id}.ply"
            write_ply(folder / name, shape.mesh)
            made = plugin("shape", "ply", filename=name)
            if shape.mesh.normals is None:
                made.append(prop("face_normals", True))
        made.set("id", shape.id)
        made.append(Element("ref", {"id": shared[id(shape.surface)]}))
        if shape.id in area_emitters:
            made.append(area_emitters[shape.id])
        root.append(made)
    indent(root, "  ")
    ElementTree(root).write(folder / "scene.xml", encoding="utf-8", xml_declaration=True)


def sensor_element(to_world: Float64Array, fov_x: float, width: int, height: int) -> Element:
    """A sensor for the `mitsuba` command; `fov_x` in degrees, `to_world` in Mitsuba's axes."""
    made = plugin("sensor", "perspective", fov=fov_x, fov_axis="x", to_world=to_world)
    made.append(prop("near_clip", 0.01))
    made.append(prop("far_clip", 10000.0))
    made.append(plugin("sampler", "multijitter", sample_count=64))
    film = plugin("film", "hdrfilm", width=width, height=height)
    film.append(plugin("rfilter", "box"))
    made.append(film)
    return made


def _material_id(name: str, taken: dict[str, int]) -> str:
    """A new id that resembles `name`."""
    stem = "".join(char if char.isascii() and char.isalnum() else "_" for char in name).strip("_")
    return numbered(f"material_{stem[:80]}" if stem else "material", "_", taken)
