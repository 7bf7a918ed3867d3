"""Ray casting for measuring a scene while it is imported.

Always Mitsuba's scalar variant: the same answers on every machine, whatever renders later.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import mitsuba as mi
import numpy as np
import numpy.typing as npt

from scenes.mitsuba_source.meshes import Floats, Ints

_VARIANT = "scalar_rgb"


class RayCaster:
    """Closest hits with a soup of triangles."""

    def __init__(self, corners: Floats) -> None:
        mesh = mi.Mesh("triangles", 3 * len(corners), len(corners))
        parameters = mi.traverse(mesh)
        parameters["vertex_positions"] = corners.astype(np.float32).ravel()
        parameters["faces"] = np.arange(3 * len(corners), dtype=np.uint32)
        parameters.update()
        self._scene = mi.load_dict({"type": "scene", "triangles": mesh})

    def cast(self, origins: Floats, directions: Floats) -> tuple[Floats, Ints]:
        """Distances (N,), infinite where nothing is hit, and triangle numbers (N,), there -1.

        `origins` and `directions` broadcast to (N, 3); directions are unit vectors.
        """
        origins, directions = np.broadcast_arrays(
            np.asarray(origins, dtype=np.float64), np.asarray(directions, dtype=np.float64)
        )
        distances = np.full(len(origins), np.inf)
        triangles = np.full(len(origins), -1, dtype=np.int64)
        intersect, ray = self._scene.ray_intersect_preliminary, mi.Ray3f
        for index, (origin, way) in enumerate(
            zip(origins.tolist(), directions.tolist(), strict=True)
        ):
            hit = intersect(ray(origin, way), True)
            if hit.is_valid():
                distances[index], triangles[index] = hit.t, hit.prim_index
        return distances, triangles


@contextmanager
def ray_casting() -> Iterator[None]:
    """Casters live and work inside this context; the variant that was set before comes back."""
    before = mi.variant()
    mi.set_variant(_VARIANT)
    try:
        yield
    finally:
        if before is not None:
            mi.set_variant(before)


def sphere_directions(count: int) -> npt.NDArray[np.float64]:
    """`count` directions spread evenly over the sphere (a Fibonacci spiral), (N, 3)."""
    index = np.arange(count) + 0.5
    z = 1 - 2 * index / count
    angle = np.pi * (1 + 5**0.5) * index
    radius = np.sqrt(1 - z * z)
    return np.stack([radius * np.cos(angle), radius * np.sin(angle), z], axis=1)
