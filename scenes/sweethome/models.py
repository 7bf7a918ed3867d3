"""Models inside a home: Wavefront OBJ with its MTL, or without either's suffix.

A model is read into pieces by group and material, in its own axes (x right, y up, z to the
front) and units. Files of other kinds raise `UnreadableModel`.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass, field, replace

import mapbox_earcut
import numpy as np

from scenes.errors import InputError
from scenes.mitsuba_source.changes import Changes
from scenes.mitsuba_source.meshes import Floats, Mesh, cleaned, creased
from scenes.sweethome.archive import HomeArchive
from scenes.sweethome.default_materials import DEFAULT_MATERIALS
from scenes.sweethome.missing import ABSENT

MAX_TRIANGLES = 2_000_000  # of one model
_MAX_CORNERS = 4096  # of one polygon
_CREASE = 44.0  # degrees: Java 3D's default
_MAX_MTL = 4 * 2**20


class UnreadableModel(Exception):
    """The model is of another kind, damaged or empty."""


@dataclass(frozen=True)
class ModelMaterial:
    """A material of a model, display values (sRGB)."""

    color: tuple[float, float, float] = (0.7102, 0.702, 0.6531)
    highlight: float = 0.0
    exponent: float = 0.0
    opacity: float = 1.0
    image: str | None = None  # a member of the archive


@dataclass(frozen=True)
class ModelPart:
    """The faces of one group and material."""

    group: str
    material_name: str
    material: ModelMaterial
    mesh: Mesh


@dataclass(frozen=True)
class Model:
    parts: tuple[ModelPart, ...]
    header: str = ""  # the comment at the file's start, where authors put their terms

    @property
    def bounds(self) -> Floats:
        """Axis-aligned bounds (2, 3) in the model's units."""
        bounds = np.array([part.mesh.bounds for part in self.parts])
        return np.stack([bounds[:, 0].min(axis=0), bounds[:, 1].max(axis=0)])


class Models:
    """Reads each model of an archive once."""

    def __init__(self, archive: HomeArchive, changes: Changes) -> None:
        self._archive, self._changes = archive, changes
        self._read: dict[str, Model | UnreadableModel] = {}

    def get(self, member: str) -> Model:
        """The model in a member of the archive; raises `UnreadableModel`."""
        if member not in self._read:
            try:
                self._read[member] = read_model(self._archive, member, self._changes)
            except UnreadableModel as error:
                self._read[member] = error
        found = self._read[member]
        if isinstance(found, UnreadableModel):
            raise found
        return found


@dataclass
class _Run:
    """Faces of one group, material and smoothing, as corner index triples (v, vt, vn)."""

    group: str
    material: str
    smooth: bool
    polygons: list[list[tuple[int, int, int]]] = field(default_factory=list)


def read_model(archive: HomeArchive, member: str, changes: Changes) -> Model:
    """The model in a member of the archive; raises `UnreadableModel`."""
    if member not in archive:
        raise UnreadableModel(ABSENT)
    try:
        data = archive.read(member)
    except InputError as error:
        raise UnreadableModel(str(error)) from None
    kind = _kind(member, data)
    if kind != "OBJ":
        raise UnreadableModel(f"{kind} models are not read")

    def library(name: str) -> dict[str, ModelMaterial]:
        found = archive.beside(member, name)
        if found is None:
            changes.note("material files of models are missing: {}", f"{name} of {member}")
            return {}
        try:
            text = archive.read(found, _MAX_MTL).decode("utf-8", "replace")
        except InputError as error:
            changes.note("material files of models cannot be read: {}", str(error))
            return {}
        return read_mtl(text, lambda image: archive.beside(found, image))

    return read_obj(data, library)


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


def _kind(member: str, data: bytes) -> str:
    head = data[:2048].lstrip()
    if data[:2] == b"MM":
        return "3DS"
    if head.startswith(b"<"):
        return "COLLADA"
    if data[:4] == b"FORM":
        return "LightWave"
    if data[:2] == b"PK":
        return "zipped"
    if b"\0" in head:
        return "binary"
    return "OBJ"


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
    if not np.isfinite(table).all() or np.abs(table).max() > 1e12:
        raise UnreadableModel("a coordinate is not a finite number")
    return table


def _part(
    run: _Run,
    positions: Floats,
    uvs: Floats,
    normals: Floats,
    materials: dict[str, ModelMaterial],
) -> ModelPart | None:
    corners = _triangles(run.polygons, positions)
    if not len(corners):
        return None
    flat = corners.reshape(-1, 3)
    # Corners without texture coordinates or normals do without on the whole part.
    has_uvs = len(uvs) > 0 and bool(((flat[:, 1] >= 0) & (flat[:, 1] < len(uvs))).all())
    has_normals = len(normals) > 0 and bool(((flat[:, 2] >= 0) & (flat[:, 2] < len(normals))).all())
    columns = [0] + ([1] if has_uvs else []) + ([2] if has_normals else [])
    keys, inverse = np.unique(flat[:, columns], axis=0, return_inverse=True)
    index = {column: keys[:, place] for place, column in enumerate(columns)}
    mesh = Mesh(
        positions[index[0]],
        inverse.reshape(-1, 3),
        normals[index[2]] if has_normals else None,
        uvs[index[1]] if has_uvs else None,
    )
    try:
        mesh, _ = cleaned(mesh, "model")
    except InputError as error:
        raise UnreadableModel(str(error)) from None
    if not len(mesh.faces):
        return None
    if mesh.normals is None:
        # Facetted parts get the normals of their facets, so that all parts of a piece have some.
        mesh = creased(mesh, _CREASE if run.smooth else 0.0)
    material = materials.get(run.material) or materials.get(run.material.strip(), ModelMaterial())
    return ModelPart(run.group, run.material, material, mesh)


def _triangles(polygons: list[list[tuple[int, int, int]]], positions: Floats) -> np.ndarray:
    """Corner triples (T, 3, 3) of polygons: convex ones as fans, others by ear clipping."""
    by_size: dict[int, list[list[tuple[int, int, int]]]] = {}
    for corners in polygons:
        by_size.setdefault(len(corners), []).append(corners)
    made = []
    for size, group in sorted(by_size.items()):
        indices = np.array(group, dtype=np.int64)  # (P, size, 3)
        if size == 3:
            made.append(indices)
            continue
        points = positions[indices[:, :, 0]]
        ahead, behind = np.roll(points, -1, axis=1), np.roll(points, 1, axis=1)
        normals = np.cross(points, ahead).sum(axis=1)  # twice the areas (Newell)
        turns = np.einsum("pki,pi->pk", np.cross(points - behind, ahead - points), normals)
        is_convex = (turns >= -1e-12 * (normals**2).sum(axis=1)[:, None]).all(axis=1)
        fans = [indices[is_convex][:, [0, k, k + 1]] for k in range(1, size - 1)]
        made.append(np.stack(fans, axis=1).reshape(-1, 3, 3))
        made += [_ears(indices[p], points[p], normals[p]) for p in np.nonzero(~is_convex)[0]]
    return np.concatenate(made) if made else np.zeros((0, 3, 3), dtype=np.int64)


def _ears(corners: np.ndarray, points: Floats, normal: Floats) -> np.ndarray:
    """Triangles (T, 3, 3) of one polygon of any shape, facing as it does."""
    plane = [axis for axis in range(3) if axis != int(np.argmax(np.abs(normal)))]
    flat = np.ascontiguousarray(points[:, plane])
    ends = np.array([len(flat)], dtype=np.uint32)
    found = mapbox_earcut.triangulate_float64(flat, ends).reshape(-1, 3).astype(np.int64)
    a, b, c = (points[found[:, corner]] for corner in range(3))
    turned = np.cross(b - a, c - a) @ normal < 0
    found[turned] = found[turned][:, ::-1]
    return corners[found]


_DEFAULTS = {
    name: ModelMaterial((row[0], row[1], row[2]), row[3], row[4], row[5])
    for name, row in DEFAULT_MATERIALS.items()
}
