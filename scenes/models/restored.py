"""Import of a scene that `pbrnet export-scene` wrote: as its file describes it, without guesses.

The file carries `scene.json`, the parameters of the sky and the depth of paths. Rooms, portals,
objects and categories are those described, as long as they fit the file's shapes.
"""

from __future__ import annotations

import math
import re
from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal
from xml.etree.ElementTree import Element

import numpy as np
from shapely.geometry import Polygon

from pbrnet.scenes.arrays import Float64Array, as_triple
from pbrnet.scenes.checked import build, param, within
from pbrnet.scenes.contract import Scene, SceneObject, save_scene
from pbrnet.scenes.errors import InputError
from pbrnet.scenes.geometry.mesh import Mesh
from pbrnet.scenes.importing.camera import (
    Camera,
    default_camera,
    sensor_of,
    transformed_camera,
)
from pbrnet.scenes.importing.changes import Changes
from pbrnet.scenes.importing.materials.textures import TextureStore
from pbrnet.scenes.importing.sandbox import Sandbox
from pbrnet.scenes.importing.shape import Emitter, Shape, bounds_of
from pbrnet.scenes.importing.writer import write_scene_xml
from pbrnet.scenes.importing.xml_elements import plugin
from pbrnet.scenes.models.model import Model
from pbrnet.scenes.opened_files import OpenedFiles
from pbrnet.scenes.photometry import LUMEN
from pbrnet.scenes.reconstruction.rooms import FoundRoom

_MOVED = 0.01  # metres that parts of the building may differ from their description
_IMAGE_TO_WORLD = np.array([[-1.0, 0, 0, 0], [0, 0, 1, 0], [0, 1, 0, 0], [0, 0, 0, 1]])
_SUN = "sun"  # name of the light that stands for the sun
LEAF_SUFFIX = ".leaf"  # of the name of a part of a shape that moves, before the joint's number
_LEAF = re.compile(rf"{re.escape(LEAF_SUFFIX)}\d*$")
PANE_PREFIX = "pane-"  # of the name of a sheet of glass in a portal, before the portal's


@dataclass(frozen=True)
class Sky:
    """Light of the scene from outdoors."""

    kind: Literal["sunsky", "constant", "image"]
    turbidity: float = param(3.0, "", within(1, 10))
    sun_scale: float = param(1.0, "", within(0, 1e6))
    sky_scale: float = param(1.0, "", within(0, 1e6))
    sun_direction: tuple[float, float, float] = (0.0, 0.0, 1.0)
    radiance: tuple[float, float, float] = (1.0, 1.0, 1.0)
    file: str = ""  # of an image, beside the scene's file; cd/m^2, its middle towards +Y


@dataclass(frozen=True)
class Description:
    """Description of its scene in an exported file."""

    version: Literal[1]
    scene: dict[str, Any]  # `scene.json`
    max_depth: int = param(17, "", within(1, 1000))
    sky: dict[str, Any] | None = None


def restore(
    folder: Path,
    scene_id: str,
    model: Model,
    frame: Float64Array,
    area: Mapping[str, Element],
    emitters: list[Emitter],
    textures: TextureStore,
    sandbox: Sandbox,
    path: Path,
    changes: Changes,
) -> bool:
    """Write the scene that `model.described` describes to `folder`; False if it no longer fits.

    `frame` (4, 4) takes the model to metres, Z up; `emitters` are those of `model.lights`. Raises
    `InputError` for a damaged description.
    """
    where = f"{path}: extras.pbrnet"
    described = build(Description, model.described, where, InputError)
    scene = build(Scene, described.scene, f"{where}.scene", InputError)
    labels = {shape.name: shape.id for shape in model.shapes}
    panes = {PANE_PREFIX + portal.id for portal in scene.portals if portal.panes > 0}
    shapes = _with_leaves(
        replace(shape.transformed(frame), id=_local_name(shape.name, shape.id))
        for shape in model.shapes
        if shape.name not in panes
    )
    if not _fits(scene, shapes):
        changes.note(
            "the description of the scene in the file no longer fits its shapes: rooms and objects "
            "were found anew"
        )
        return False
    by_id = {shape.id: shape for shape in shapes}
    lit = {shape.id: area[labels[shape.name]] for shape in shapes if labels[shape.name] in area}
    cameras = [transformed_camera(one, frame, changes) for one in model.cameras]
    sky = None
    if described.sky is not None:
        sky = build(Sky, described.sky, f"{where}.sky", InputError)
        if model.package is not None:
            sandbox = Sandbox(OpenedFiles(model.package))
        with_sun = sky.kind == "sunsky"
        emitters = [one for one, light in zip(emitters, model.lights, strict=True)
                    if not (with_sun and light.name == _SUN)]  # fmt: skip
        emitters = [*emitters, _sky_emitter(sky, textures, sandbox, where)]
    camera = _sensor(cameras, scene)
    write_scene_xml(folder, shapes, lit, emitters, sensor_of(camera), described.max_depth)
    objects = tuple(_bounded(thing, by_id) for thing in scene.objects)
    notes = (*scene.changes, *changes.sentences())
    stayed = {one.id for one, was in zip(objects, scene.objects, strict=True) if _is_at(one, was)}
    joints = tuple(joint for joint in scene.joints if joint.object in stayed)
    notes = tuple(dict.fromkeys(notes))
    made = replace(
        scene,
        scene_id=scene_id,
        source=scene.origin,
        objects=objects,
        joints=joints,
        changes=notes,
    )
    save_scene(folder, made)
    return True


def _local_name(name: str, id_: str) -> str:
    """The id that a shape had: its name, if that can be one."""
    valid = name.isascii() and name.replace("-", "").replace("_", "").replace(".", "").isalnum()
    return name if valid and not name.startswith(".") and len(name) <= 120 else id_


def _with_leaves(parts: Iterable[Shape]) -> list[Shape]:
    """The shapes of which an export parted what a joint moves, whole again."""
    shapes: dict[str, Shape] = {}
    doubled: list[Shape] = []
    for part in parts:
        name = _LEAF.sub("", part.id)
        if name not in shapes:
            shapes[name] = replace(part, id=name)
        elif name != part.id:
            shapes[name] = replace(shapes[name], mesh=_joined(shapes[name].mesh, part.mesh))
        else:
            doubled.append(part)
    return [*shapes.values(), *doubled]


def _joined(first: Mesh, second: Mesh) -> Mesh:
    def both(a: Float64Array | None, b: Float64Array | None) -> Float64Array | None:
        return None if a is None or b is None else np.concatenate([a, b])

    return Mesh(
        np.concatenate([first.vertices, second.vertices]),
        np.concatenate([first.faces, second.faces + len(first.vertices)]),
        both(first.normals, second.normals),
        both(first.uvs, second.uvs),
    )


def _fits(scene: Scene, shapes: list[Shape]) -> bool:
    """Test whether the file has each shape that the scene names once, the building in place."""
    counts = Counter(shape.id.lower() for shape in shapes)
    if not shapes or max(counts.values()) > 1:
        return False
    if any(shape.surface.element is None for shape in shapes):
        return False
    by_id = {shape.id: shape for shape in shapes}
    for thing in scene.objects:
        if not thing.shapes or not all(name in by_id for name in thing.shapes):
            return False
        if thing.is_structure:
            low, high = bounds_of([by_id[name] for name in thing.shapes])
            stated = np.array([thing.bbox_min, thing.bbox_max])
            if not np.allclose(np.stack([low, high]), stated, atol=_MOVED):
                return False
    return bool(scene.rooms)


def _bounded(thing: SceneObject, by_id: dict[str, Shape]) -> SceneObject:
    """The object with the bounds of its shapes."""
    low, high = bounds_of([by_id[name] for name in thing.shapes])
    return replace(thing, bbox_min=as_triple(low), bbox_max=as_triple(high))


def _is_at(thing: SceneObject, stated: SceneObject) -> bool:
    """Test whether an object has the place and size that its description states."""
    box, was = (np.array([one.bbox_min, one.bbox_max]) for one in (thing, stated))
    return bool(np.allclose(box, was, atol=_MOVED))


def _sensor(cameras: list[Camera], scene: Scene) -> Camera:
    named = [camera for camera in cameras if camera.name == "sensor"]
    if named or cameras:
        return (named or cameras)[0]
    room = scene.rooms[0]
    return default_camera(FoundRoom(Polygon(room.floor), room.floor_z, room.ceiling_z))


def _sky_emitter(sky: Sky, textures: TextureStore, sandbox: Sandbox, where: str) -> Emitter:
    if sky.kind == "constant":
        return Emitter(plugin("emitter", "constant", radiance=sky.radiance), ("environment",))
    if sky.kind == "sunsky":
        if not 0 < math.hypot(*sky.sun_direction) < math.inf:
            raise InputError(f"{where}.sky.sun_direction: no direction")
        made = plugin(
            "emitter",
            "sunsky",
            turbidity=sky.turbidity,
            sun_scale=sky.sun_scale,
            sky_scale=sky.sky_scale,
        )
        text = " ".join(f"{value:.9g}" for value in sky.sun_direction)
        made.append(Element("vector", {"name": "sun_direction", "value": text}))
        return Emitter(made, ("sky", "sun"))
    image = sandbox.find(sky.file, where, is_image=True) if sky.file else None
    if image is None:
        raise InputError(f"{where}.sky: the image {sky.file!r:.100} is missing beside the file")
    stored = textures.radiance(image, (LUMEN, LUMEN, LUMEN))
    made = plugin("emitter", "envmap", filename=stored, to_world=_IMAGE_TO_WORLD)
    return Emitter(made, ("environment",))
