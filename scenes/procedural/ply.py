"""Binary PLY meshes as Mitsuba reads them."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from scenes.procedural.piece import Part


def write_ply(path: Path, part: Part, tile: float) -> None:
    """Write a part as little-endian binary PLY: position, normal where smooth, uv (as `u`, `v`).

    uvs are metres in a part and repeats of the texture, `tile` metres each, in the file.

    Facetted parts carry no normals; their shape asks Mitsuba for `face_normals`.
    """
    columns = [part.vertices]
    names = ["x", "y", "z"]
    if part.smooth:
        columns.append(part.normals)
        names += ["nx", "ny", "nz"]
    columns.append(part.uvs / tile)
    names += ["u", "v"]
    vertices = np.concatenate(columns, axis=1).astype("<f4")
    faces = np.empty(len(part.faces), dtype=[("count", "u1"), ("index", "<i4", (3,))])
    faces["count"] = 3
    faces["index"] = part.faces
    header = [
        "ply",
        "format binary_little_endian 1.0",
        f"element vertex {len(vertices)}",
        *(f"property float {name}" for name in names),
        f"element face {len(faces)}",
        "property list uchar int vertex_indices",
        "end_header",
    ]
    with path.open("wb") as stream:
        stream.write(("\n".join(header) + "\n").encode("ascii"))
        stream.write(vertices.tobytes())
        stream.write(faces.tobytes())
