"""Models as Wavefront OBJ with their MTL, or without either's suffix."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np

from scenes.formats.default_materials import DEFAULT_MATERIALS
from scenes.formats.model_parts import (
    MAX_TRIANGLES,
    Model,
    ModelMaterial,
    ModelPart,
    UnreadableModel,
    check_points,
    make_part,
    triangulated,
)
from scenes.geometry.mesh import Floats

_MAX_CORNERS = 4096  # of one polygon
_CREASE = 44.0  # degrees: Java 3D's default


@dataclass
class _Run:
    """Faces of one group, material and smoothing, as corner index triples (v, vt, vn)."""

    group: str
    material: str
    smooth: bool
    polygons: list[list[tuple[int, int, int]]] = field(default_factory=list)


def read_obj(data: bytes, library: Callable[[str], dict[str, ModelMaterial]]) -> Model:
    """An OBJ's faces by group and material; `library` reads the materials of an MTL by name."""
    lines = data.decode("latin-1").replace("\\\n", " ").replace("\\\r\n", " ").splitlines()
    rows: dict[str, list[str]] = {"v": [], "vt": [], "vn": []}
    materials = dict(_DEFAULTS)
    runs: dict[tuple[str, str, bool], _Run] = {}
    group, material, smooth = "default", "default", False
    run: _Run | None = None
    triangles = 0
    known: dict[str, tuple[int, int, int]] = {}  # corners seen before, which most are
    for number, line in enumerate(lines):
        word, _, rest = line.strip().partition(" ")
        if word in rows:
            rows[word].append(rest)
        elif word == "f":
            if run is None:
                run = runs.setdefault((group, material, smooth), _Run(group, material, smooth))
            corners = rest.split()
            triangles += len(corners) - 2
            if triangles > MAX_TRIANGLES or len(corners) > _MAX_CORNERS:
                raise UnreadableModel(f"more than {MAX_TRIANGLES:,} triangles")
            if len(corners) >= 3:
                sizes = (len(rows["v"]), len(rows["vt"]), len(rows["vn"]))
                polygon = []
                for text in corners:
                    corner = known.get(text)
                    if corner is None:
                        corner = _corner(text, sizes, number)
                        if "-" not in text:  # negative ones count from the end so far
                            known[text] = corner
                    polygon.append(corner)
                run.polygons.append(polygon)
        elif word in ("g", "o"):
            group, run = rest.strip() or "default", None
        elif word == "usemtl":
            material, run = rest.strip() or "default", None
        elif word == "s":
            smooth, run = rest.strip() not in ("off", "0", ""), None
        elif word == "mtllib":
            for name in {rest.strip(): 0, **dict.fromkeys(rest.split())}:
                if name.lower().endswith(".mtl") or " " not in name:
                    found = library(name)
                    materials.update(found)
                    if found:
                        break
    positions = _table(rows["v"], 3)
    uvs, normals = _table(rows["vt"], 2), _table(rows["vn"], 3)
    parts = []
    for one in runs.values():
        made = _part(one, positions, uvs, normals, materials)
        if made is not None:
            parts.append(made)
    if not parts:
        raise UnreadableModel("no faces in it")
    header = [line.lstrip("# ") for line in lines[:40] if line.startswith("#")]
    return Model(tuple(parts), "\n".join(header)[:4000])


def read_mtl(text: str, find: Callable[[str], str | None]) -> dict[str, ModelMaterial]:
    """The materials of an MTL; `find` gives the member for an image's name, or None."""
    made: dict[str, ModelMaterial] = {}
    name, current, shines = "", ModelMaterial(), True
    for line in text.splitlines():
        word, _, rest = line.strip().partition(" ")
        values = rest.split()
        word = word.lower()
        if word == "newmtl":
            name, current, shines = rest.strip(), ModelMaterial(color=(1.0, 1.0, 1.0)), True
        elif not name:
            continue
        try:
            if word == "kd":
                red, green, blue = (float(value) for value in (values * 3)[:3])
                current = replace(current, color=(red, green, blue))
            elif word == "ks" and shines:
                current = replace(current, highlight=float(np.mean([float(v) for v in values])))
            elif word == "ns":
                current = replace(current, exponent=max(float(values[0]), 0.0))
            elif word == "d":
                current = replace(current, opacity=min(max(float(values[-1]), 0.0), 1.0))
            elif word == "tr" and "d " not in text:
                current = replace(current, opacity=1 - min(max(float(values[0]), 0.0), 1.0))
            elif word == "illum" and int(float(values[0])) < 2:
                shines = False
                current = replace(current, highlight=0.0)
            elif word == "map_kd" and values:
                # Options such as `-s 1 1 1` may stand before the name, which may hold spaces.
                image = find(re.sub(r"^(-\w+(\s+[-\d.]+|\s+on|\s+off)*\s+)*", "", rest.strip()))
                image = image or find(values[-1])
                current = replace(current, image=image)
        except (ValueError, IndexError):
            continue  # a damaged line leaves the default
        if not all(map(np.isfinite, (*current.color, current.highlight, current.exponent))):
            current = ModelMaterial(opacity=current.opacity, image=current.image)
        made[name] = current
    return made


def _corner(text: str, sizes: tuple[int, int, int], line: int) -> tuple[int, int, int]:
    """Zero-based indices (v, vt, vn) of an OBJ corner, -1 where it has none."""
    try:
        given = [int(item) if item else 0 for item in text.split("/")[:3]]
    except ValueError:
        raise UnreadableModel(f"line {line + 1}: a face's corner {text[:40]!r}") from None
    made = [-1, -1, -1]
    for place, index in enumerate(given):
        made[place] = index - 1 if index > 0 else (sizes[place] + index if index < 0 else -1)
    if not 0 <= made[0] < sizes[0]:
        raise UnreadableModel(f"line {line + 1}: a face refers to a vertex that does not exist")
    return (made[0], made[1], made[2])


def _table(rows: list[str], columns: int) -> Floats:
    if not rows:
        return np.zeros((0, columns))
    try:
        values = [[float(value) for value in row.split()[:columns]] for row in rows]
        table = np.array([row + [0.0] * (columns - len(row)) for row in values])
    except ValueError:
        raise UnreadableModel("a coordinate is not a number") from None
    check_points(table)
    return table


def _part(
    run: _Run,
    positions: Floats,
    uvs: Floats,
    normals: Floats,
    materials: dict[str, ModelMaterial],
) -> ModelPart | None:
    by_size: dict[int, list[list[tuple[int, int, int]]]] = {}
    for polygon in run.polygons:
        by_size.setdefault(len(polygon), []).append(polygon)
    groups = [np.array(by_size[size], dtype=np.int64) for size in sorted(by_size)]
    material = materials.get(run.material) or materials.get(run.material.strip(), ModelMaterial())
    return make_part(
        run.group,
        run.material,
        material,
        triangulated(groups, positions),
        positions,
        uvs,
        normals,
        _CREASE if run.smooth else 0.0,
    )


_DEFAULTS = {
    name: ModelMaterial((row[0], row[1], row[2]), row[3], row[4], row[5])
    for name, row in DEFAULT_MATERIALS.items()
}
