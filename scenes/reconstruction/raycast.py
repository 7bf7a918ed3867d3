"""Ray casting against plain triangles, for measuring a scene during its import.

Input: triangles (F, 3, 3) in world space. Output: closest-hit distances and triangle numbers.

The caster always uses Mitsuba's scalar variant with robust intersection tests and does not set
the variant of the process. The results are the same on every machine, and the caller stays free
to choose a variant for rendering. `pbrnet.pipeline.render.raycast` casts rays in finished scenes.
"""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import Any

import mitsuba as mi
import numpy as np

from pbrnet.scenes.arrays import BoolArray, Float64Array, Int64Array
from pbrnet.scenes.formats.ply import write_ply
from pbrnet.scenes.geometry.mesh import Mesh

_VARIANT = "scalar_rgb"
# Without robust tests, one ray in 200 that is aimed at an edge slips between the two triangles
# that share it, and random walks report gaps where there are none.
_SCENE = """<scene version="3.0.0">
<boolean name="embree_use_robust_intersections" value="true"/><shape type="ply">
<string name="filename" value="{}"/><boolean name="face_normals" value="true"/></shape></scene>"""


class RayCaster:
    """Closest hits with triangles `corners` (F, 3, 3) and with those of an optional `base`.

    Triangles are numbered from 0, those of the base first. Extending a base by a few triangles
    is much faster than to build the acceleration structure of a whole scene again.
    """

    def __init__(self, corners: Float64Array, base: RayCaster | None = None) -> None:
        self._base = base
        self.count: int = len(corners) + (base.count if base is not None else 0)
        faces = np.arange(3 * len(corners)).reshape(-1, 3)
        self._ray = mi.scalar_rgb.Ray3f  # loads the variant's Python types for the parser below
        # `mi.load_dict` needs a variant set for the whole process; the parser does not.
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
        """Return distances (N,), infinite for a miss, and triangle numbers (N,), -1 for a miss.

        `origins` and `directions` broadcast to (N, 3); directions are unit vectors.
        """
        origins, directions = np.broadcast_arrays(
            np.asarray(origins, dtype=np.float64), np.asarray(directions, dtype=np.float64)
        )
        distances, triangles = self._cast_own(origins, directions)
        if self._base is None:
            return distances, triangles
        base_distances, base_triangles = self._base.cast(origins, directions)
        nearer = distances < base_distances
        return (
            np.where(nearer, distances, base_distances),
            np.where(nearer, self._base.count + triangles, base_triangles),
        )

    def escapes(self, origins: Float64Array, directions: Float64Array) -> BoolArray:
        """Return which rays (N,) hit nothing; faster than to look for the closest hits.

        `origins` and `directions` broadcast to (N, 3); directions are unit vectors.
        """
        origins, directions = np.broadcast_arrays(
            np.asarray(origins, dtype=np.float64), np.asarray(directions, dtype=np.float64)
        )
        is_hit, ray = self._scene.ray_test, self._ray
        point, vector = mi.scalar_rgb.Point3f, mi.scalar_rgb.Vector3f
        free: BoolArray = ~np.array(
            [
                is_hit(ray(point(x, y, z), vector(u, v, w)), True)
                for x, y, z, u, v, w in zip(
                    *origins.T.tolist(), *directions.T.tolist(), strict=True
                )
            ],
            dtype=bool,
        )
        if self._base is not None:
            free[free] = self._base.escapes(origins[free], directions[free])
        return free

    def _cast_own(
        self, origins: Float64Array, directions: Float64Array
    ) -> tuple[Float64Array, Int64Array]:
        intersect, ray = self._scene.ray_intersect_preliminary, self._ray
        point, vector = mi.scalar_rgb.Point3f, mi.scalar_rgb.Vector3f
        hits: list[Any] = [
            intersect(ray(point(x, y, z), vector(u, v, w)), True)
            # By columns: building a list for each ray takes longer than casting it.
            for x, y, z, u, v, w in zip(*origins.T.tolist(), *directions.T.tolist(), strict=True)
        ]
        distances = np.array([hit.t for hit in hits], dtype=np.float64)
        triangles = np.array([hit.prim_index for hit in hits], dtype=np.int64)
        return distances, np.where(np.isfinite(distances), triangles, -1)
