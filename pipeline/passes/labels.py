"""Labels of what a view sees: id images, and a description of each instance and light.

The rays are those of the inputs: one through each pixel centre, past clear glass. An instance is
an object of `scene.json`. Its pixels if it were alone come from the same rays, followed through
every surface (`raycast.objects_along`), so visible pixels and pixels alone are counted alike.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import mitsuba as mi
import numpy as np

from pbrnet.pipeline.frames import Channels
from pbrnet.pipeline.passes.inputs import VisibleSurfaces, channels_by, object_index
from pbrnet.pipeline.render import raycast
from pbrnet.pipeline.render.drjit_arrays import bounds_of
from pbrnet.pipeline.render.scene import RenderScene
from pbrnet.pipeline.views import View
from pbrnet.scenes.arrays import AnyArray, BoolArray, Float64Array
from pbrnet.scenes.contract import Light
from pbrnet.scenes.geometry.directions import turned
from pbrnet.scenes.importing.semantics import NYU13_OF_NYU40, NYU40_OF_CATEGORY, category_number

_GRID = 8  # points per axis of a box that are tested against the image's border
_DIGITS = 6


def category(surfaces: VisibleSurfaces) -> AnyArray:
    """Return the number of the category, 0 for none, uint32 (P,)."""
    numbers = [category_number(item.category) for item in surfaces.scene.scene.objects]
    return np.array([0, *numbers], dtype=np.uint32)[object_index(surfaces)]


def nyu40(surfaces: VisibleSurfaces) -> AnyArray:
    """Return the NYU40 class, 0 for none, uint32 (P,)."""
    return np.array(NYU40_OF_CATEGORY, dtype=np.uint32)[category(surfaces)]


def nyu13(surfaces: VisibleSurfaces) -> AnyArray:
    """Return the class of NYU40's 13-class map, 0 for none, uint32 (P,)."""
    return np.array(NYU13_OF_NYU40, dtype=np.uint32)[nyu40(surfaces)]


def material(surfaces: VisibleSurfaces) -> AnyArray:
    """Return the index in the table of names + 1, 0 for none, uint32 (P,)."""
    return surfaces.scene.table.ids(surfaces.hits.shape)


# Renderer of each channel, (P,). Where no surface is, it returns 0.
RENDERERS: dict[str, Callable[[VisibleSurfaces], AnyArray]] = {
    "instance": object_index,
    "category": category,
    "nyu40": nyu40,
    "nyu13": nyu13,
    "material": material,
}


def labels_of(surfaces: VisibleSurfaces) -> tuple[Channels, dict[str, Any]]:
    """Return the channels of a `labels` frame, each (H, W), and the tables that explain them.

    The tables are `instances`, `light_sources` and `material_names`; see `describe_instances` and
    `describe_lights`.
    """
    return channels_by("labels", surfaces.view, RENDERERS, surfaces), {
        "instances": describe_instances(surfaces),
        "light_sources": describe_lights(surfaces.scene),
        "material_names": list(surfaces.scene.table.names),
    }


def describe_instances(surfaces: VisibleSurfaces) -> list[dict[str, Any]]:
    """Return an entry for each instance that the view sees, in the order of their numbers.

    `pixels` are seen, `pixels_alone` would be if nothing else were there; `visible_fraction` is
    their ratio and `occlusion` the rest. `truncation` is the share of the box that is outside the
    image: of a grid of points over it. `extent` is the image rectangle of the visible pixels:
    first column and row, and those behind the last; in an equirectangular view an instance behind
    the camera may lie on both edges. The box is `centre`, `axes` (rows: unit
    vectors) and `half_sizes`, in world metres; `centre_camera` and `axes_camera` are the same
    in the camera's axes.
    """
    scene, view = surfaces.scene, surfaces.view
    image = object_index(surfaces)
    seen = np.unique(image[image > 0])
    order = np.full(len(scene.scene.objects) + 1, -1, dtype=np.int32)
    order[seen - 1] = np.arange(len(seen))
    numbers = order[scene.geometry.objects]  # object -1 reads the last entry
    alone = raycast.objects_along(scene.geometry, numbers, surfaces.origins, surfaces.directions)
    rows, columns = np.divmod(np.arange(len(image)), view.width)
    entries = []
    for place, number in enumerate(seen):
        item, box = scene.scene.objects[number - 1], scene.boxes.of(int(number) - 1)
        here = image == number
        met = alone[:, place // 32] >> np.uint32(place % 32) & 1 > 0
        pixels, pixels_alone = int(here.sum()), int((met | here).sum())
        fraction = pixels / pixels_alone
        label = category_number(item.category)
        entries.append(
            {
                "instance": int(number),
                "object": item.id,
                "name": item.name,
                "category": label,
                "category_name": item.category,
                "nyu40": NYU40_OF_CATEGORY[label],
                "is_structure": item.is_structure,
                "room": item.room,
                "pixels": pixels,
                "pixels_alone": pixels_alone,
                "visible_fraction": round(fraction, _DIGITS),
                "occlusion": round(1 - fraction, _DIGITS),
                "truncation": round(1 - float(_inside(box.grid(_GRID), view).mean()), _DIGITS),
                "extent": [
                    int(columns[here].min()),
                    int(rows[here].min()),
                    int(columns[here].max()) + 1,
                    int(rows[here].max()) + 1,
                ],
                "centre": _plain(box.centre),
                "axes": _plain(box.axes),
                "half_sizes": _plain(box.half_sizes),
                "centre_camera": _plain(turned(box.centre - view.eye, surfaces.rotation.T)),
                "axes_camera": _plain(turned(box.axes, surfaces.rotation.T)),
            }
        )
    return entries


def describe_lights(render_scene: RenderScene) -> list[dict[str, Any]]:
    """Return an entry for each light of the scene that is on.

    `centre` and `size` are of the bounds of its shapes, or the position, in world metres; None for
    lights at infinity. `flux` is the radiant flux, linear RGB in the unit of `color` times m^2 sr:
    pi x area x radiance, of a point 4 pi x intensity; None where it varies over the light.
    `lumens` is the luminous flux where the source of the scene states it.
    """
    geometry = render_scene.geometry
    shapes = {shape.id(): shape for shape in geometry.shapes}
    lamps = {lamp.id(): lamp for lamp in render_scene.lights.lamps}
    return [
        {
            "light": light.id,
            "kind": light.kind,
            "room": light.room,
            "lumens": light.lumens,
            **_place_and_flux(light, shapes, lamps),
        }
        for light in render_scene.scene.lights
    ]


def _place_and_flux(
    light: Light, shapes: dict[str, mi.Shape], lamps: dict[str, mi.Emitter]
) -> dict[str, Any]:
    own = [shapes[name] for name in light.shapes if name in shapes]
    lit = [shape for shape in own if shape.is_emitter()]
    if lit:
        boxes = np.array([bounds_of(shape) for shape in lit])
        low, high = boxes[:, 0].min(axis=0), boxes[:, 1].max(axis=0)
        radiances = [_constant(shape.emitter(), "radiance") for shape in lit]
        areas = [float(np.array(shape.surface_area()).ravel()[0]) for shape in lit]
        fluxes = [
            math.pi * area * radiance
            for area, radiance in zip(areas, radiances, strict=True)
            if radiance is not None
        ]
        known = len(fluxes) == len(lit)
        return {
            "centre": _plain((low + high) / 2),
            "size": _plain(high - low),
            "flux": _significant(np.sum(fluxes, axis=0)) if known else None,
        }
    lamp = lamps.get(light.id)
    params = mi.traverse(lamp) if lamp is not None else {}
    if light.kind == "point" and "position" in params:
        intensity = _constant(lamp, "intensity")
        return {
            "centre": _plain(np.array(params["position"], dtype=np.float64).ravel()),
            "size": [0.0, 0.0, 0.0],
            "flux": None if intensity is None else _significant(4 * math.pi * intensity),
        }
    return {"centre": None, "size": None, "flux": None}


def _constant(emitter: mi.Emitter, name: str) -> Float64Array | None:
    """Return a constant of an emitter as linear RGB (3,); None if it is textured."""
    params = mi.traverse(emitter)
    if f"{name}.value" not in params:
        return None
    value = np.array(params[f"{name}.value"], dtype=np.float64).ravel()
    return np.broadcast_to(value, 3) if value.size in (1, 3) else None


def _inside(points: Float64Array, view: View) -> BoolArray:
    """Test which world points (N, 3) lie before the camera and within the image."""
    if view.is_panorama:
        return np.ones(len(points), dtype=bool)
    places, seen = view.lens.project(turned(points - view.eye, view.pose[:3, :3].T))
    inside: BoolArray = seen & ((places >= 0) & (places <= (view.width, view.height))).all(axis=1)
    return inside


def _plain(values: Float64Array) -> list[float] | list[list[float]]:
    """Return an array as lists of numbers, rounded."""
    return (np.round(values, _DIGITS) + 0.0).tolist()


def _significant(values: Float64Array) -> list[float]:
    return [float(f"{value:.6g}") for value in values]
