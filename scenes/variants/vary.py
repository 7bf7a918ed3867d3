"""Variants of imported scenes: copied folders with new finishes and lighting."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any
from xml.etree.ElementTree import Element, ElementTree, indent

import defusedxml.ElementTree
import numpy as np

from pbrnet.scenes.contract import Scene, SceneObject, load_scene, save_scene, writing_scene
from pbrnet.scenes.files import copy_files, temporary_folder
from pbrnet.scenes.formats.ply import write_ply
from pbrnet.scenes.importing.light.daylight import ground
from pbrnet.scenes.importing.xml_elements import plugin
from pbrnet.scenes.looks import Aspect, LightSetting
from pbrnet.scenes.opened_files import OpenedFiles
from pbrnet.scenes.params import SceneParams
from pbrnet.scenes.registry import import_scene
from pbrnet.scenes.variants.refinish import refinish
from pbrnet.scenes.variants.relight import relight

_VAST = 1000.0  # metres; the planes that importers add are wider


@dataclass(frozen=True)
class VariantSettings:
    """All that determines a variant beside its scene: what is in its fingerprint, by these names.

    `varied` is its number, from 1 on, and the aspects that vary.
    """

    seed: int
    lighting: tuple[LightSetting, ...]
    texture_size: int
    varied: tuple[int, *tuple[Aspect, ...]]

    @classmethod
    def of(cls, params: SceneParams, seed: int, number: int) -> VariantSettings:
        """Return the settings of a variant by the parameters of scenes."""
        return cls(seed, params.lighting, params.texture_size, (number, *sorted(params.vary)))


def import_variant(
    path: Path,
    out: Path,
    scene_id: str,
    settings: VariantSettings,
    of: str,
    opened: OpenedFiles,
    **options: Any,
) -> Scene:
    """Import the scene `of`, see `import_scene`, and write a variant of it alone."""
    with temporary_folder() as folder:
        import_scene(path, folder / of, of, opened, **options)
        return vary_scene(folder / of, out, scene_id, settings)


def vary_scene(base: Path, out: Path, scene_id: str, settings: VariantSettings) -> Scene:
    """Write a variant of the scene in `base` as the scene folder `out`.

    Of the aspects that vary, "finishes" (floors, walls, ceilings and fabrics) and "light" (hour,
    weather, lit lamps and their colour) apply to imports; "furniture" and "outdoors" do not. Plan,
    cameras, objects and portals do not change, except that PBRS' light removes ground planes of
    importers; the split is that of `base`. Equal arguments give equal bytes. Raises `InputError`
    if `base` is not a complete scene.
    """
    scene = load_scene(base)
    (variant, *aspects), seed = settings.varied, settings.seed
    varied = [aspect for aspect in ("finishes", "light") if aspect in aspects]
    record: dict[str, Any] = {"variant": variant, "varied": varied, "of": scene.scene_id}
    with writing_scene(Path(out)) as folder:
        copy_files(base, folder)
        root: Element = defusedxml.ElementTree.parse(folder / "scene.xml").getroot()
        lights, lighting, objects = scene.lights, scene.lighting, scene.objects
        if "finishes" in varied:
            record["finishes"] = refinish(folder, root, scene, settings.texture_size, seed, variant)
        if "light" in varied:
            relit = relight(root, scene, settings.lighting, seed, variant)
            lights, lighting, record["light"] = relit.lights, relit.lighting, relit.choices
            if lighting == "pbrs":
                objects = _without_ground(root, objects)
            elif relit.sky and not any(item.category == "ground" for item in objects):
                # An environment map shows the ground; a sky model does not.
                objects = (*objects, _with_ground(folder, root, scene))
        _remove_unused(folder, root)
        indent(root, "  ")
        ElementTree(root).write(folder / "scene.xml", encoding="utf-8", xml_declaration=True)
        save_scene(
            folder,
            replace(
                scene,
                scene_id=scene_id,
                source={**scene.source, **record},
                objects=objects,
                lights=lights,
                lighting=lighting,
                plan=scene.plan or scene.scene_id,
            ),
        )
    return load_scene(Path(out))


def _with_ground(folder: Path, root: Element, scene: Scene) -> SceneObject:
    """Add a ground plane below the scene; returns its object."""
    low = np.min([item.bbox_min for item in scene.objects], axis=0)
    high = np.max([item.bbox_max for item in scene.objects], axis=0)
    plane, item = ground(low, high)
    write_ply(folder / "meshes" / f"{plane.id}.ply", plane.mesh)
    shape = plugin("shape", "ply", filename=f"meshes/{plane.id}.ply", face_normals=True)
    shape.set("id", plane.id)
    if plane.surface.element is not None:
        shape.append(plane.surface.element)
    root.append(shape)
    return item


def _without_ground(root: Element, objects: tuple[SceneObject, ...]) -> tuple[SceneObject, ...]:
    """Remove ground planes that importers added; returns the other objects."""
    kept = tuple(
        item
        for item in objects
        if item.category != "ground" or item.bbox_max[0] - item.bbox_min[0] < _VAST
    )
    removed = {shape for item in objects if item not in kept for shape in item.shapes}
    for shape in root.findall("shape"):
        if shape.get("id") in removed:
            root.remove(shape)
    return kept


def _remove_unused(folder: Path, root: Element) -> None:
    """Remove materials that no shape refers to, and files that no element refers to."""
    used = {ref.get("id") for ref in root.iter("ref")}
    for bsdf in root.findall("bsdf"):
        if bsdf.get("id") not in used:
            root.remove(bsdf)
    named = {item.get("value") for item in root.iter("string") if item.get("name") == "filename"}
    for path in sorted([*(folder / "textures").rglob("*"), *(folder / "meshes").rglob("*")]):
        if path.is_file() and path.relative_to(folder).as_posix() not in named:
            path.unlink()
