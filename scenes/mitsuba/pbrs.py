"""Houses of the PBRS release: what lies beside a house's template and tells more than it does.

PBRS (Zhang et al., *Physically-Based Rendering for Indoor Scene Understanding Using
Convolutional Neural Networks*, 2017) converted SUNCG houses for Mitsuba 0.5. The release keeps
cameras, categories and lamps in tables of their own, in the house's folder or one or two above.
Shapes carry the names of SUNCG's nodes: `Model#83_mesh` begins a thing, and the `main_18_mesh`,
`main_19_mesh` that follow are its other materials.
"""

from __future__ import annotations

import csv
import re
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
import shapely

from scenes.arrays import Float64Array
from scenes.contract import SceneObject
from scenes.errors import InputError
from scenes.geometry.mesh import Mesh
from scenes.importing.categories import category_of
from scenes.importing.changes import Changes
from scenes.importing.objects import bounds_of, room_of
from scenes.importing.shape import Shape
from scenes.mitsuba.reader import Node
from scenes.opened_files import OpenedFiles
from scenes.reconstruction.rooms import FoundRoom

EMITTER_SCALE = "75"  # of the environment map, in the release's render script
BULB_RADIANCE, SHADE_RADIANCE = 400.0, 0.5
MAX_CAMERAS = 2000
_MAX_BYTES = 4 * 2**20
_LIGHTS = "light_geometry_compact.txt"
_CATEGORIES = "ModelCategoryMappingNewActive.csv"
_WALLPAPER = "wallp_0.jpg"
_NODE = re.compile(r"(?P<kind>[A-Za-z]+)#(?P<rest>[\w#]+?)_mesh")
_MODEL = re.compile(r"(?P<id>(?:s__)?\d+)(?:_\d+)?")
_CLASSES = {"stand": "cabinet", "table_and_chair": "table", "mailbox": "other"}  # that mislead


@dataclass(frozen=True)
class ReleaseCamera:
    """One line of `room_camera.txt`, in the house's own Y-up axes, metres."""

    name: str  # room and sector, such as "Room#0_1_2"
    eye: Float64Array
    towards: Float64Array
    up: Float64Array
    half_fov: tuple[float, float]  # radians, in x and y
    score: float

    @property
    def room(self) -> str:
        """SUNCG's name of the room it stands in, such as "Room#0_1"."""
        return self.name.rpartition("_")[0]

    @property
    def sector(self) -> int:
        """Which quarter turn it looks into, from +X towards the file's +Z; -1 if unnamed."""
        tail = self.name.rpartition("_")[2]
        return int(tail) if tail.isdecimal() else -1


@dataclass(frozen=True)
class Lamp:
    """Which materials of a lamp's model shine: numbers in the order of its shapes."""

    bulbs: frozenset[int]
    shades: frozenset[int]


@dataclass(frozen=True)
class _Class:
    fine: str
    coarse: str
    structure: bool


@dataclass(frozen=True)
class Release:
    """What the release says about one house."""

    cameras: tuple[ReleaseCamera, ...] = ()
    nodes: frozenset[str] = frozenset()  # names in `room_camera_node.txt`
    lamps: dict[str, Lamp] = field(default_factory=dict)
    classes: dict[str, _Class] = field(default_factory=dict)
    parameters: dict[str, str] = field(default_factory=dict)  # defaults for the template


@dataclass
class Thing:
    """Shapes that belong together under a node's name."""

    kind: str  # "Model", "Room", "Wall", ...
    node: str  # SUNCG's name, such as "Model#83" or "Room#0_1"
    model: str  # the model's id, such as "83" or "s__1024"; "" for parts of the building
    shapes: list[str]


def find_release(path: Path, opened: OpenedFiles, changes: Changes) -> Release | None:
    """The release's tables around the scene file `path`; None where it is no PBRS house.

    Only files of the release's own names are looked for, in the folder and the two above it.
    Raises `InputError` for tables that are damaged.
    """
    folder = path.parent
    lamps, classes, wallpaper = (
        _near(folder, n, opened) for n in (_LIGHTS, _CATEGORIES, _WALLPAPER)
    )
    cameras = folder / "room_camera.txt"
    if not opened.is_file(cameras) and not lamps and not classes:
        return None
    parameters = {"emitter_scale": EMITTER_SCALE}
    if wallpaper:
        parameters["default_texture_path"] = str(wallpaper)
    return Release(
        _cameras(folder, opened, changes) if opened.is_file(cameras) else (),
        _nodes(folder / "room_camera_node.txt", opened),
        read_lamps(lamps) if lamps else {},
        _classes(classes) if classes else {},
        parameters,
    )


def read_cameras(path: Path) -> list[ReleaseCamera]:
    """A camera file: 12 numbers a line, eye, towards, up, half field of view in x and y, score."""
    cameras = []
    for number, line in enumerate(_lines(path), start=1):
        words = line.split()
        try:
            values = np.array([float(word) for word in words])
        except ValueError:
            raise InputError(f"{path}:{number}: not a line of numbers: {line[:60]!r}") from None
        if len(values) not in (11, 12) or not np.isfinite(values).all():
            raise InputError(f"{path}:{number}: a camera has 12 finite numbers, not {len(values)}")
        eye, towards, up = values[:3], values[3:6], values[6:9]
        if np.linalg.norm(np.cross(towards, up)) < 1e-6:
            raise InputError(f"{path}:{number}: this camera looks along its up direction")
        if not (0.01 < values[9] < 1.55 and 0.01 < values[10] < 1.55):
            raise InputError(f"{path}:{number}: an impossible field of view")
        score = float(values[11]) if len(values) == 12 else 0.0
        half = (float(values[9]), float(values[10]))
        cameras.append(ReleaseCamera(f"camera_{number}", eye, towards, up, half, score))
        if len(cameras) > MAX_CAMERAS:
            raise InputError(f"{path}: more than {MAX_CAMERAS} cameras; refused")
    return cameras


def read_lamps(path: Path) -> dict[str, Lamp]:
    """The table of lamps: model, number of bulb materials, these, number of shades, these.

    A material is named `material_<n>`; the release counts the model's shapes by that number.
    """
    lamps = {}
    for number, line in enumerate(_lines(path), start=1):
        words = line.split()
        try:
            bulbs = int(words[1])
            shades = int(words[2 + bulbs])
            first, second = words[2 : 2 + bulbs], words[3 + bulbs : 3 + bulbs + shades]
            if bulbs < 0 or shades < 0 or len(words) != 3 + bulbs + shades:
                raise ValueError
            lamps[words[0]] = Lamp(
                frozenset(int(word.rpartition("_")[2]) for word in first),
                frozenset(int(word.rpartition("_")[2]) for word in second),
            )
        except (ValueError, IndexError):
            raise InputError(
                f"{path}:{number}: not a line of the lamp table: {line[:60]!r}"
            ) from None
    return lamps


def things_of(shapes: list[Shape]) -> list[Thing]:
    """The shapes of a house by the node they belong to, in the file's order."""
    things: list[Thing] = []
    for shape in shapes:
        match = _NODE.fullmatch(shape.name)
        if match is None:
            if not things:
                things.append(Thing("", shape.name, "", []))
            things[-1].shapes.append(shape.id)
            continue
        kind, rest = match["kind"], match["rest"]
        model = _MODEL.fullmatch(rest) if kind == "Model" else None
        name = f"{kind}#{model['id'] if model else rest}"
        things.append(Thing(kind, name, model["id"] if model else "", [shape.id]))
    return things


def with_lamps(
    shapes: list[Shape], things: list[Thing], release: Release, path: Path, changes: Changes
) -> list[Shape]:
    """Lamps of the table made to shine, unless the template has made them shine already."""
    radiance: dict[str, float] = {}
    by_id = {shape.id: shape for shape in shapes}
    for thing in things:
        lamp = release.lamps.get(thing.model)
        if lamp is None or any(by_id[name].emitter is not None for name in thing.shapes):
            continue
        for number, name in enumerate(thing.shapes):
            if number in lamp.bulbs:
                radiance[name] = BULB_RADIANCE
            elif number in lamp.shades and not by_id[name].surface.transmissive:
                radiance[name] = SHADE_RADIANCE
    if radiance:
        changes.note("lamps of the release's table were lit: {}", str(len(radiance)))
    return [
        replace(shape, emitter=_area(radiance[shape.id], path)) if shape.id in radiance else shape
        for shape in shapes
    ]


def without_doubles(shapes: list[Shape], changes: Changes) -> list[Shape]:
    """The shapes without those that lie exactly on an earlier one.

    SUNCG stores some rooms twice; which of two equal surfaces a ray meets would be chance.
    """
    seen: set[bytes] = set()
    kept = []
    for shape in shapes:
        key = _surface_key(shape.mesh)
        if key in seen and shape.emitter is None:
            changes.note(
                "a shape that repeats another in the same place was left out: {}", shape.id
            )
            continue
        seen.add(key)
        kept.append(shape)
    return kept


def release_objects(
    things: list[Thing],
    release: Release,
    shapes: list[Shape],
    rooms: list[FoundRoom],
    room_ids: list[str],
) -> tuple[SceneObject, ...]:
    """Objects by SUNCG's nodes, with the category table's words."""
    by_id = {shape.id: shape for shape in shapes}
    objects = []
    for thing in things:
        members = [by_id[name] for name in thing.shapes if name in by_id]
        for name, category, structure, part in _parts(thing, members, release):
            low, high = bounds_of(part)
            objects.append(
                SceneObject(
                    id=part[0].id.removesuffix("_mesh"),
                    name=name,
                    category=category,
                    shapes=tuple(shape.id for shape in part),
                    bbox_min=(float(low[0]), float(low[1]), float(low[2])),
                    bbox_max=(float(high[0]), float(high[1]), float(high[2])),
                    is_structure=structure,
                    room=room_of(0.5 * (low + high), low, rooms, room_ids),
                )
            )
    return tuple(objects)


def rooms_by_name(
    things: list[Thing], shapes: list[Shape], rooms: list[FoundRoom], room_ids: list[str]
) -> dict[str, str]:
    """SUNCG's room names -> ids of the rooms found, by the floor area they share."""
    by_id = {shape.id: shape for shape in shapes}
    names = {}
    for thing in things:
        if thing.kind != "Room":
            continue
        corners = [by_id[name].mesh.corners[:, :, :2] for name in thing.shapes if name in by_id]
        if not corners or not rooms:
            continue
        plan = shapely.union_all(shapely.polygons(np.concatenate(corners)))
        shared = [room.floor.intersection(plan).area for room in rooms]
        best = int(np.argmax(shared))
        if shared[best] > 0.5 * min(plan.area, rooms[best].floor.area):
            names[thing.node] = room_ids[best]
    return names


def _surface_key(mesh: Mesh) -> bytes:
    """The same for the same triangles, whatever their order and winding; to 10 micrometres."""
    corners = np.round(mesh.corners, 5) + 0.0
    turn = np.lexsort((corners[..., 2], corners[..., 1], corners[..., 0]), axis=1)
    rows = np.take_along_axis(corners, turn[..., None], axis=1).reshape(-1, 9)
    return bytes(rows[np.lexsort(rows.T)].tobytes())


def _parts(
    thing: Thing, members: list[Shape], release: Release
) -> list[tuple[str, str, bool, list[Shape]]]:
    """Name, category, is it structure, and shapes; a room's are parted into floor and ceiling."""
    if not members:
        return []
    if thing.kind == "Room":
        lowest = min(shape.mesh.bounds[0, 2] for shape in members)
        under = [shape for shape in members if shape.mesh.bounds.mean(axis=0)[2] < lowest + 1.0]
        over = [shape for shape in members if shape not in under]
        tail = thing.node.partition("#")[2]
        return [
            (f"{kind.capitalize()}#{tail}", kind, True, part)
            for kind, part in (("floor", under), ("ceiling", over))
            if part
        ]
    if thing.kind != "Model":
        kind = thing.kind.lower()
        category = kind if kind in ("wall", "floor", "ceiling", "ground") else "structure"
        return [(thing.node, category, True, members)]
    known = release.classes.get(thing.model)
    if known is None:
        return [(thing.node, "other", False, members)]
    category = _CLASSES.get(known.fine) or category_of(known.fine, known.coarse)
    return [(thing.node, category, known.structure, members)]


def _cameras(folder: Path, opened: OpenedFiles, changes: Changes) -> tuple[ReleaseCamera, ...]:
    """The cameras with their names, without those that the release marks as bad."""
    cameras = read_cameras(folder / "room_camera.txt")
    names = _optional_lines(folder / "room_camera_name.txt", opened)
    marks = _optional_lines(folder / "room_camera_good.txt", opened)
    for label, lines in (("names", names), ("marks", marks)):
        if lines and len(lines) != len(cameras):
            changes.note(
                f"the release has {len(cameras)} cameras but {len(lines)} {label} for them; "
                f"the {label} were left out"
            )
    if len(names) == len(cameras):
        cameras = [
            replace(camera, name=name.strip()) for camera, name in zip(cameras, names, strict=True)
        ]
    if len(marks) == len(cameras):
        good = [
            camera
            for camera, mark in zip(cameras, marks, strict=True)
            if mark.strip() not in ("0", "0.0")
        ]
        if len(good) < len(cameras):
            changes.note(
                "cameras in rooms without light, as the release marks them, were left out: {}",
                str(len(cameras) - len(good)),
            )
        cameras = good
    return tuple(cameras)


def _nodes(path: Path, opened: OpenedFiles) -> frozenset[str]:
    lines = _optional_lines(path, opened)
    return frozenset(words[1] for line in lines if len(words := line.split(maxsplit=1)) == 2)


def _classes(path: Path) -> dict[str, _Class]:
    rows = csv.DictReader(_lines(path))
    wanted = {"model_id", "fine_grained_class", "coarse_grained_class"}
    if not wanted <= set(rows.fieldnames or ()):
        raise InputError(f"{path}: not the release's category table; it needs {sorted(wanted)}")
    return {
        row["model_id"]: _Class(
            row["fine_grained_class"] or "",
            row["coarse_grained_class"] or "other",
            row.get("empty_struct_obj") == "1",
        )
        for row in rows
        if row["model_id"]
    }


def _near(folder: Path, name: str, opened: OpenedFiles) -> Path | None:
    """A table of the release: beside the house, above it, or in `util_data` there."""
    above = list(folder.resolve().parents)[:2]
    for place in (folder, *(place / sub for place in above for sub in (".", "util_data"))):
        if opened.is_file(place / name):
            return (place / name).resolve()
    return None


def _lines(path: Path) -> list[str]:
    if path.stat().st_size > _MAX_BYTES:
        raise InputError(f"{path}: more than {_MAX_BYTES >> 20} MiB; not a table of the release")
    text = path.read_bytes().decode("utf-8", "replace")
    return [line for line in text.splitlines() if line.strip()]


def _optional_lines(path: Path, opened: OpenedFiles) -> list[str]:
    return _lines(path) if opened.is_file(path) else []


def _area(radiance: float, path: Path) -> Node:
    value = Node("spectrum", {"name": "radiance", "value": str(radiance)}, path, 0)
    return Node("emitter", {"type": "area"}, path, 0, [value])
