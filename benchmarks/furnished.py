"""Furnished homes that this project and Blender Cycles can show alike.

A home keeps its geometry, images, lamps, sun and sky. What the two renderers reflect differently is
left out of both: normal maps, sheen, clear glass, and the highlights of rough surfaces, where
Cycles' masking between microfacets is another. `write_furnished` writes the home as a scene of the
scene contract; a folder beside it has the files for `benchmarks/blender_program.py`.
"""

from __future__ import annotations

import json
import os
import shutil
import struct
from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path
from typing import Any
from xml.etree.ElementTree import Element, ElementTree, SubElement

import defusedxml.ElementTree
import numpy as np

from benchmarks.clay import camera_for_blender, windows_of
from pbrnet.pipeline.scene_export.export import export_scene
from pbrnet.pipeline.views import View
from pbrnet.scenes.contract import Scene, load_scene, save_scene, writing_scene
from pbrnet.scenes.files import write_json
from pbrnet.scenes.image_files import open_image

MATT = 0.65  # mean roughness from which on a surface has no highlight
_MAPS = ("normalmap", "bumpmap")
_CLEAR = ("thindielectric", "dielectric")
_PASSING = "KHR_materials_diffuse_transmission"


def write_furnished(scene: Scene, view: View, max_depth: int, folder: Path) -> Scene:
    """Write a home as both renderers show it; return the scene.

    `blender_folder` of the folder has one view of it for Cycles.
    """
    root = defusedxml.ElementTree.parse(scene.xml).getroot()
    named = {one.get("id", ""): one for one in root}
    for material in root.iter("bsdf"):
        _simplify(material, named, scene.folder)
    clear = {one.get("id") for one in root.iter("bsdf") if one.get("type") in _CLEAR}
    removed = set()
    for shape in root.findall("shape"):
        if any(one.get("id") in clear for one in shape.iter()):
            removed.add(shape.get("id", ""))
            root.remove(shape)
        elif shape.find("emitter") is not None and shape.find("*[@name='face_normals']") is None:
            SubElement(shape, "boolean", name="face_normals", value="true")
    with writing_scene(folder) as partial:
        for part in ("meshes", "textures"):
            shutil.copytree(scene.folder / part, partial / part, dirs_exist_ok=True)
        ElementTree(root).write(partial / "scene.xml")
        save_scene(partial, _without(scene, removed, folder.name))
    glb = blender_folder(folder) / "home.glb"
    glb.parent.mkdir(exist_ok=True)
    export_scene(folder, "glb", glb, panes=False)
    write_json(glb.with_name("cycles.json"), _description(scene, view, max_depth, glb))
    return load_scene(folder)


def blender_folder(folder: Path) -> Path:
    """Return the folder of a scene's files for Blender."""
    return folder.with_name(f"{folder.name}-blender")


def _without(scene: Scene, shapes: set[str], name: str) -> Scene:
    """Return the scene's description without some shapes, panes and joints."""
    objects = (
        replace(item, shapes=tuple(shape for shape in item.shapes if shape not in shapes))
        for item in scene.objects
    )
    return replace(
        scene,
        scene_id=name,
        objects=tuple(item for item in objects if item.shapes),
        portals=tuple(replace(portal, panes=0) for portal in scene.portals),
        joints=(),
    )


def _simplify(material: Element, named: dict[str, Element], folder: Path) -> None:
    """Change a material in place: no map of normals, no sheen; matt if it is rough."""
    while material.get("type") in _MAPS:
        (inner,) = material.findall("bsdf")
        _become(material, str(inner.get("type")), list(inner))
    if material.get("type") != "principled":
        return
    kept = [one for one in material if one.get("name") != "sheen"]
    given = {one.get("name"): one for one in kept}
    if "metallic" not in given and _roughness(given.get("roughness"), named, folder) >= MATT:
        color = given["base_color"]
        color.set("name", "reflectance")
        _become(material, "diffuse", [color])
    else:
        _become(material, "principled", kept)


def _become(material: Element, kind: str, children: Iterable[Element]) -> None:
    """Give a material another kind and other properties; it keeps its id."""
    for child in list(material):
        material.remove(child)
    material.set("type", kind)
    material.extend(children)


def _roughness(given: Element | None, named: dict[str, Element], folder: Path) -> float:
    """Return a mean roughness, Mitsuba's default where none is given."""
    if given is None:
        return 0.5
    if given.tag == "ref":
        given = named[given.get("id", "")]
    if given.tag != "texture":
        return float(given.get("value", ""))
    file = given.find("string[@name='filename']")
    assert file is not None
    return float(np.asarray(open_image(folder / file.get("value", "")).convert("L")).mean() / 255)


def _description(scene: Scene, view: View, max_depth: int, glb: Path) -> dict[str, Any]:
    sky = glb.with_name(f"{glb.stem}-sky.exr")
    return {
        "glb": str(glb),
        "thin": thin_sheets(glb.read_bytes()),
        "sky": str(sky) if sky.exists() else "",
        "camera": camera_for_blender(view),
        "windows": windows_of(scene.portals),
        "max_depth": max_depth,
        "threads": len(os.sched_getaffinity(0)),
    }


def thin_sheets(glb: bytes) -> dict[str, float]:
    """Return by material the share of diffuse light that passes; Blender does not read it."""
    (size,) = struct.unpack_from("<I", glb, 12)
    materials: list[dict[str, Any]] = json.loads(glb[20 : 20 + size]).get("materials", [])
    return {
        one["name"]: one["extensions"][_PASSING]["diffuseTransmissionFactor"]
        for one in materials
        if _PASSING in one.get("extensions", {})
    }
