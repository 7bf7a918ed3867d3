"""Ray casting for measuring a scene while it is imported.

Always Mitsuba's scalar variant, and without setting it for the process: the same answers on
every machine, and whoever renders later still chooses.
"""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import Any

import mitsuba as mi
import numpy as np

from scenes.arrays import Float64Array, Int64Array
from scenes.formats.ply import write_ply
from scenes.geometry.mesh import Mesh

_VARIANT = "scalar_rgb"
# Robust: else one ray in 200 that is aimed at an edge slips between the triangles that share it,
# and walks of light find cracks where there are none.
_SCENE = """<scene version="3.0.0">
<boolean name="embree_use_robust_intersections" value="true"/><shape type="ply">
<string name="filename" value="{}"/><boolean name="face_normals" value="true"/></shape></scene>"""


class RayCaster:
    """Closest hits with a soup of triangles, `corners` (F, 3, 3), and with those of a `base`.

    The base's triangles count first. To sort a whole scene takes long; a few more do not.
    """

    def __init__(self, corners: Float64Array, base: RayCaster | None = None) -> None:
        self._base = base
        self.count: int = len(corners) + (base.count if base is not None else 0)
        faces = np.arange(3 * len(corners)).reshape(-1, 3)
        self._ray = mi.scalar_rgb.Ray3f  # first, so that what follows knows its Python types
        # `mi.load_dict` needs a variant set for the whole process; the parser behind it does not.
        config = mi.parser.ParserConfig(_VARIANT)
        config.merge_meshes = config.parallel = False
        with tempfile.TemporaryDirectory() as folder:
            file = Path(folder) / "triangles.ply"
            write_ply(file, Mesh(corners.reshape(-1, 3), faces))
            state = mi.parser.parse_string(config, _SCENE.format(file))
            mi.parser.transform_all(config, state)
            self._scene = mi.parser.instantiate(config, state)

    def cast(
        self, origins: Float64Array, directions: Float64Array
    ) -> tuple[Float64Array, Int64Array]:
        """Distances (N,), infinite where nothing is hit, and triangle numbers (N,), there -1.

        `origins` and `directions` broadcast to (N, 3); directions are unit vectors.
        """
        origins, directions = np.broadcast_arrays(
            np.asarray(origins, dtype=np.float64), np.asarray(directions, dtype=np.float64)
        )
        if self._base is not None:
            return self._nearer(*self._base.cast(origins, directions), origins, directions)
        return self._cast(origins, directions)

    def _nearer(
        self,
        distances: Float64Array,
        triangles: Int64Array,
        origins: Float64Array,
        directions: Float64Array,
    ) -> tuple[Float64Array, Int64Array]:
        assert self._base is not None
        own, number = self._cast(origins, directions)
        here = own < distances
        return np.where(here, own, distances), np.where(here, self._base.count + number, triangles)

    def _cast(
        self, origins: Float64Array, directions: Float64Array
    ) -> tuple[Float64Array, Int64Array]:
        intersect, ray = self._scene.ray_intersect_preliminary, self._ray
        point, vector = mi.scalar_rgb.Point3f, mi.scalar_rgb.Vector3f
        hits: list[Any] = [
            intersect(ray(point(x, y, z), vector(u, v, w)), True)
            # By columns: a list for each ray would take longer than to cast it.
            for x, y, z, u, v, w in zip(*origins.T.tolist(), *directions.T.tolist(), strict=True)
        ]
        distances = np.array([hit.t for hit in hits], dtype=np.float64)
        triangles = np.array([hit.prim_index for hit in hits], dtype=np.int64)
        return distances, np.where(np.isfinite(distances), triangles, -1)
