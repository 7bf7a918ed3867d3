"""The light sources of a scene as the illumination panorama needs them."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import mitsuba as mi
import numpy as np

from pipeline.render.raycast import Target
from pipeline.render.scenegraph import Graph
from scenes.arrays import BoolArray, Float64Array, Int32Array

_SUN_AND_SKY = ("sunsky", "timed_sunsky")
_ENVIRONMENTS = ("constant", "envmap", *_SUN_AND_SKY)


@dataclass(frozen=True)
class Lights:
    """Sources that have a place or a direction (`lamps`), and the environment.

    `shape[i]` is the shape that lamp i lights up, -1 for lamps without one (points, spots, the
    sun); `centre` (N, 3) and `radius` (N,) are bounding spheres of those shapes; `distant[i]`
    says that lamp i shines from outside the scene. `environment` is the sky without its sun,
    or an environment map; None where there is none. `texel` is the angle between the samples
    of an environment map, radians; infinite for smooth skies.
    """

    lamps: tuple[Any, ...]
    shape: Int32Array
    centre: Float64Array
    radius: Float64Array
    distant: BoolArray
    environment: Any | None
    texel: float


def collect_lights(graph: Graph, target: Target) -> Lights:
    """The lights of a loaded scene; of a sky with a sun, one twin for each alone."""
    lamps: list[Any] = []
    shapes: list[int] = []
    centres: list[Float64Array] = []
    radii: list[float] = []
    distant: list[bool] = []

    def add(lamp: Any, shape: int, centre: Any, radius: float, far: bool) -> None:
        lamps.append(lamp)
        shapes.append(shape)
        centres.append(np.asarray(centre, dtype=np.float64))
        radii.append(radius)
        distant.append(far)

    for index, shape in enumerate(target.shapes):
        if shape.is_emitter():
            box = shape.bbox()
            low, high = (
                np.array(corner, dtype=np.float64).ravel() for corner in (box.min, box.max)
            )
            add(
                shape.emitter(),
                index,
                (low + high) / 2,
                float(np.linalg.norm(high - low)) / 2,
                False,
            )
    environment, texel = None, math.inf
    for node in graph.nested(0, "Emitter"):
        plugin = graph.plugin(node)
        if plugin in _SUN_AND_SKY:
            sky, sun = graph.props(node), graph.props(node)
            sky["sun_scale"] = 0.0
            environment = graph.make_from(node, sky)
            if "sun_scale" not in sun or sun["sun_scale"] > 0:
                sun["sky_scale"] = 0.0
                lamp = graph.make_from(node, sun)
                lamp.set_scene(target.scene)
                add(lamp, -1, np.zeros(3), 0.0, True)
        elif plugin in _ENVIRONMENTS:
            environment = graph.make(node)
            if plugin == "envmap":
                texel = math.pi / mi.traverse(environment)["data"].shape[0]
        else:
            add(
                graph.make(node), -1, np.zeros(3), 0.0, plugin in ("directional", "directionalarea")
            )
    return Lights(
        tuple(lamps),
        np.array(shapes, dtype=np.int32),
        np.array(centres, dtype=np.float64).reshape(-1, 3),
        np.array(radii),
        np.array(distant, dtype=bool),
        environment,
        texel,
    )
