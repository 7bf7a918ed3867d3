"""Light sources of a scene, as the illumination panorama needs them."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import mitsuba as mi
import numpy as np

from pbrnet.pipeline.render.bsdf_calls import keep_from_calls
from pbrnet.pipeline.render.drjit_arrays import bounds_of
from pbrnet.pipeline.render.scene_geometry import SceneGeometry
from pbrnet.pipeline.render.scenegraph import Graph
from pbrnet.scenes.arrays import BoolArray, Float64Array, Int32Array

_SUN_AND_SKY = ("sunsky", "timed_sunsky")
_ENVIRONMENTS = ("constant", "envmap", *_SUN_AND_SKY)


@dataclass(frozen=True)
class Lights:
    """Emitters with a position or a direction (`lamps`), and the environment emitter.

    `shape[i]` is the index of lamp i's shape, -1 for lamps without one (point and spot lights, the
    sun). `centre` (N, 3) and `radius` (N,) are bounding spheres of those shapes, in metres.
    `distant[i]` says that lamp i is infinitely far away. `environment` is the sky without its
    sun, or an environment map; None if there is none. `texel_angle` is the angle between the
    samples of an environment map, in radians; infinite for smooth skies.
    """

    lamps: tuple[Any, ...]
    shape: Int32Array
    centre: Float64Array
    radius: Float64Array
    distant: BoolArray
    environment: Any | None
    texel_angle: float


def collect_lights(graph: Graph, geometry: SceneGeometry) -> Lights:
    """Return the lights of a loaded scene; a sky with a sun is split into its two parts."""
    # Each: lamp, index of its shape, centre and radius of that, whether it is infinitely far away.
    found: list[tuple[Any, int, Float64Array, float, bool]] = []
    for index, shape in enumerate(geometry.shapes):
        if shape.is_emitter():
            low, high = bounds_of(shape)
            radius = float(np.linalg.norm(high - low)) / 2
            found.append((shape.emitter(), index, (low + high) / 2, radius, False))
    environment, texel_angle = None, math.inf
    for node in graph.nested(0, "Emitter"):
        plugin = graph.plugin(node)
        if plugin in _SUN_AND_SKY:
            sky, sun = graph.props(node), graph.props(node)
            sky["sun_scale"] = 0.0
            environment = graph.make_from(node, sky)
            keep_from_calls(environment)
            if "sun_scale" not in sun or sun["sun_scale"] > 0:
                sun["sky_scale"] = 0.0
                lamp = graph.make_from(node, sun)
                lamp.set_scene(geometry.scene)
                keep_from_calls(lamp)
                found.append((lamp, -1, np.zeros(3), 0.0, True))
        elif plugin in _ENVIRONMENTS:
            environment = graph.make(node)
            if plugin == "envmap":
                texel_angle = math.pi / mi.traverse(environment)["data"].shape[0]
        else:
            far = plugin in ("directional", "directionalarea")
            found.append((graph.make(node), -1, np.zeros(3), 0.0, far))
    lamps, shapes, centres, radii, distant = zip(*found, strict=True) if found else ((),) * 5
    return Lights(
        lamps,
        np.array(shapes, dtype=np.int32),
        np.array(centres, dtype=np.float64).reshape(-1, 3),
        np.array(radii, dtype=np.float64),
        np.array(distant, dtype=bool),
        environment,
        texel_angle,
    )
