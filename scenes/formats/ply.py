"""PLY meshes."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from scenes.geometry.mesh import Mesh


def write_ply(path: Path, mesh: Mesh) -> None:
    """Write a mesh as little-endian binary PLY, float32, with normals and uv where it has them."""
    columns = [("x", mesh.vertices[:, 0]), ("y", mesh.vertices[:, 1]), ("z", mesh.vertices[:, 2])]
    if mesh.normals is not None:
        columns += [(f"n{axis}", mesh.normals[:, i]) for i, axis in enumerate("xyz")]
    if mesh.uvs is not None:
        columns += [("u", mesh.uvs[:, 0]), ("v", mesh.uvs[:, 1])]
    rows = np.stack([values for _, values in columns], axis=1).astype("<f4")
    faces = np.empty(len(mesh.faces), dtype=[("count", "u1"), ("corners", "<i4", (3,))])
    faces["count"] = 3
    faces["corners"] = mesh.faces
    header = [
        "ply",
        "format binary_little_endian 1.0",
        f"element vertex {len(rows)}",
        *(f"property float {name}" for name, _ in columns),
        f"element face {len(faces)}",
        "property list uchar int vertex_indices",
        "end_header\n",
    ]
    path.write_bytes("\n".join(header).encode("ascii") + rows.tobytes() + faces.tobytes())
