"""Clay scenes for the comparison with Blender Cycles: diffuse meshes under a constant sky.

Every shape becomes its triangles, flat-shaded, with one diffuse colour drawn from a seed. Lamps and
panes are removed, and all light comes from a white sky through the windows. The folder is a scene
of the scene contract, with `cycles.json` beside it for `benchmarks/blender_program.py`.
"""

from __future__ import annotations

import math
import os
from dataclasses import replace
from pathlib import Path
from typing import Any

import mitsuba as mi
import numpy as np

from pbrnet.pipeline.pathtrace.portals import portal_rectangles
from pbrnet.pipeline.render.scene import RenderScene
from pbrnet.pipeline.views import View
from pbrnet.scenes.arrays import Float64Array
from pbrnet.scenes.contract import Light, Portal, Scene, load_scene, save_scene, writing_scene
from pbrnet.scenes.files import write_json
from pbrnet.scenes.formats.ply import write_ply
from pbrnet.scenes.geometry.mesh import Mesh
from pbrnet.scenes.seeds import generator

SKY = 1.0  # radiance
_SHAPE = (
    '<shape type="ply" id="{name}"><string name="filename" value="meshes/{name}.ply"/>'
    '<boolean name="face_normals" value="true"/><bsdf type="twosided"><bsdf type="diffuse">'
    '<rgb name="reflectance" value="{color}"/></bsdf></bsdf></shape>'
)


def write_clay(scene: RenderScene, view: View, max_depth: int, folder: Path) -> Scene:
    """Write the clay scene and, for Cycles, one view of it; return the scene."""
    kept: list[tuple[str, list[float]]] = []
    with writing_scene(folder) as partial:
        for shape, clear in zip(scene.geometry.shapes, scene.geometry.clear, strict=True):
            if clear or not isinstance(shape, mi.Mesh):
                continue
            name = shape.id()
            write_ply(partial / "meshes" / f"{name}.ply", _triangles(shape))
            color = generator(0, "clay", name).uniform(0.3, 0.8, 3)
            kept.append((name, [round(float(band), 4) for band in color]))
        lines = [_SHAPE.format(name=name, color=" ".join(map(str, color))) for name, color in kept]
        sky = f'<emitter type="constant"><rgb name="radiance" value="{SKY}"/></emitter>'
        text = "\n".join(['<scene version="3.0.0">', sky, *lines, "</scene>"])
        (partial / "scene.xml").write_text(text, encoding="utf-8")
        save_scene(partial, _bare(scene.scene, folder.name, {name for name, _ in kept}))
        write_json(partial / "cycles.json", _description(scene, view, max_depth, kept))
    return load_scene(folder)


def _triangles(mesh: Any) -> Mesh:
    """Return the mesh of a Mitsuba shape in world space."""
    parameters = mi.traverse(mesh)
    vertices = np.array(parameters["vertex_positions"], dtype=np.float64).reshape(-1, 3)
    return Mesh(vertices, np.array(parameters["faces"], dtype=np.int64).reshape(-1, 3))


def _bare(scene: Scene, name: str, shapes: set[str]) -> Scene:
    """Return the scene's description with the remaining shapes and the sky as the only light.

    Windows stay as openings without panes, which Cycles would not see.
    """
    objects = [
        replace(item, shapes=tuple(shape for shape in item.shapes if shape in shapes))
        for item in scene.objects
    ]
    return replace(
        scene,
        scene_id=name,
        objects=tuple(objects),
        lights=(Light("sky", "environment"),),
        portals=tuple(replace(portal, panes=0) for portal in scene.portals),
    )


def _description(
    scene: RenderScene, view: View, max_depth: int, kept: list[tuple[str, list[float]]]
) -> dict[str, Any]:
    return {
        "meshes": [
            {"name": name, "file": f"meshes/{name}.ply", "reflectance": color}
            for name, color in kept
        ],
        "sky": SKY,
        "camera": camera_for_blender(view),
        "windows": windows_of(scene.scene.portals),
        "max_depth": max_depth,
        "threads": len(os.sched_getaffinity(0)),
    }


def camera_for_blender(view: View) -> dict[str, Any]:
    """Return image size, horizontal field of view (radians) and pose, in OpenCV axes."""
    return {
        "width": view.width,
        "height": view.height,
        "fov_x": 2 * math.atan(0.5 * view.width / view.K[0][0]),
        "camera_to_world": [list(row) for row in view.camera_to_world],
    }


def windows_of(portals: tuple[Portal, ...]) -> list[list[list[float]]]:
    """Return rectangles around the portals: a corner, its two neighbours, the inward normal."""
    rectangles = portal_rectangles(portals)
    rows: list[list[Float64Array]] = [
        [corner, corner + first, corner + second, -normal]
        for corner, first, second, normal in zip(
            rectangles.corner, *rectangles.edges, rectangles.normal, strict=True
        )
    ]
    return [[[float(value) for value in point] for point in row] for row in rows]
