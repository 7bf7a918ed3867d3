"""Tables of the PBRS release that complete the scene file of a house.

PBRS (Zhang et al., *Physically-Based Rendering for Indoor Scene Understanding Using
Convolutional Neural Networks*, 2017) converted SUNCG houses for Mitsuba 0.5. The release keeps
cameras, categories and lamps in tables: in the house's folder, up to three folders above it, or in
`util_data` there; cameras also in `projects_camera` beside the folder of all houses.
Shapes have the names of SUNCG's nodes: `Model#83_mesh` begins a node, and the `main_18_mesh`,
`main_19_mesh` that follow are its other materials.
"""

from __future__ import annotations

import csv
import re
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
import shapely

from pbrnet.scenes.arrays import Float64Array
from pbrnet.scenes.contract import SceneObject
from pbrnet.scenes.errors import InputError
from pbrnet.scenes.geometry.mesh import Mesh
from pbrnet.scenes.geometry.regions import intersection, union
from pbrnet.scenes.importing.categories import category_of
from pbrnet.scenes.importing.changes import Changes
from pbrnet.scenes.importing.objects import room_of
from pbrnet.scenes.importing.shape import Shape, bounds_of, make_object
from pbrnet.scenes.mitsuba.reader import Node
from pbrnet.scenes.opened_files import OpenedFiles
from pbrnet.scenes.photometry import PBRS_BULB, PBRS_ENVIRONMENT
from pbrnet.scenes.reconstruction.room_index import RoomIndex
from pbrnet.scenes.reconstruction.rooms import FoundRoom

SHADE_RADIANCE = 0.5
MAX_CAMERAS = 2000
_MAX_BYTES = 4 * 2**20
_LIGHTS = "light_geometry_compact.txt"
_CATEGORIES = "ModelCategoryMappingNewActive.csv"
_CAMERAS = "room_camera.txt"
_WALLPAPER = "wallp_0.jpg"
_NODE = re.compile(r"(?P<kind>[A-Za-z]+)#(?P<rest>[\w#]+?)_mesh")
_MODEL = re.compile(r"(?P<id>(?:s__)?\d+)(?:_\d+)?")
# Fine classes whose words would give the wrong category.
_CLASS_OVERRIDES = {"stand": "cabinet", "table_and_chair": "table", "mailbox": "other"}


@dataclass(frozen=True)
class ReleaseCamera:
    """One line of `room_camera.txt`, in the house's axes, metres, Y up."""

    name: str  # room and sector, such as "Room#0_1_2"
    eye: Float64Array  # (3,)
    towards: Float64Array  # (3,), viewing direction
    up: Float64Array  # (3,)
    half_fov: tuple[float, float]  # radians, in x and y
    score: float

    @property
    def room(self) -> str:
        """SUNCG's name of the camera's room, such as "Room#0_1"."""
        return self.name.rpartition("_")[0]

    @property
    def sector(self) -> int:
        """Quarter turn of the viewing direction, counted from +X towards the file's +Z.

        -1 if the camera has no name.
        """
        tail = self.name.rpartition("_")[2]
        return int(tail) if tail.isdecimal() else -1


@dataclass(frozen=True)
class Lamp:
    """Emitting materials of a lamp model, as numbers in the order of its shapes."""

    bulbs: frozenset[int]
    shades: frozenset[int]


@dataclass(frozen=True)
class _ModelClass:
    """One line of the category table."""

    fine: str
    coarse: str
    structure: bool


@dataclass(frozen=True)
class Release:
    """The release's tables for one house."""

    cameras: tuple[ReleaseCamera, ...] = ()
    lamps: dict[str, Lamp] = field(default_factory=dict)
    classes: dict[str, _ModelClass] = field(default_factory=dict)
    parameters: dict[str, str] = field(default_factory=dict)  # defaults of the template's $names


@dataclass
class ReleaseNode:
    """A node of the SUNCG house with its shapes."""

    kind: str  # "Model", "Room", "Wall", ...
    name: str  # such as "Model#83" or "Room#0_1"
    model: str  # id of the model, such as "83" or "s__1024"; "" for parts of the building
    shapes: list[str]  # ids


def find_release(path: Path, opened: OpenedFiles, changes: Changes) -> Release | None:
    """Read the release's tables for the scene file `path`; None if it is no PBRS house.

    `opened` records the files looked for. Raises `InputError` for damaged tables.
    """
    folder = path.parent
    lamps, classes, wallpaper = (
        _near(folder, name, opened) for name in (_LIGHTS, _CATEGORIES, _WALLPAPER)
    )
    beside = folder.resolve()
    places = (folder, beside.parent.parent / "projects_camera" / beside.name)
    cameras = next((one for one in places if opened.is_file(one / _CAMERAS)), None)
    if cameras is None and not lamps and not classes:
        return None
    parameters = {"emitter_scale": f"{PBRS_ENVIRONMENT:g}"}
    if wallpaper:
        parameters["default_texture_path"] = str(wallpaper)
    return Release(
        () if cameras is None else _cameras(cameras, opened, changes),
        read_lamps(lamps) if lamps else {},
        _classes(classes) if classes else {},
        parameters,
    )


def read_cameras(path: Path) -> list[ReleaseCamera]:
    """Read a camera file.

    A line has 12 numbers: eye, towards, up, half field of view in x and y (radians), score.
    """
    cameras = []
    for number, line in enumerate(_lines(path), start=1):
        words = line.split()
        try:
            values = np.array([float(word) for word in words])
        except ValueError:
            raise InputError(f"{path}:{number}: expected numbers, got {line[:60]!r}") from None
        if len(values) not in (11, 12) or not np.isfinite(values).all():
            raise InputError(
                f"{path}:{number}: a camera needs 12 finite numbers, got {line[:60]!r}"
            )
        eye, towards, up = values[:3], values[3:6], values[6:9]
        if np.linalg.norm(np.cross(towards, up)) < 1e-6:
            raise InputError(f"{path}:{number}: the camera looks along its up direction")
        if not (0.01 < values[9] < 1.55 and 0.01 < values[10] < 1.55):
            raise InputError(
                f"{path}:{number}: half a field of view must be between 0.01 and 1.55 radians"
            )
        score = float(values[11]) if len(values) == 12 else 0.0
        half = (float(values[9]), float(values[10]))
        cameras.append(ReleaseCamera(f"camera_{number}", eye, towards, up, half, score))
        if len(cameras) > MAX_CAMERAS:
            raise InputError(f"{path}: the file has more than the limit of {MAX_CAMERAS} cameras")
    return cameras


def read_lamps(path: Path) -> dict[str, Lamp]:
    """Read the table of lamps, by model.

    A line has the model, the number of bulb materials and their names, the number of shade
    materials and their names. `material_<n>` is the material of the model's shape number n.
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
                f"{path}:{number}: not a valid line of the lamp table: {line[:60]!r}"
            ) from None
    return lamps


def nodes_of(shapes: list[Shape]) -> list[ReleaseNode]:
    """Group the shapes of a house by node, in the file's order."""
    nodes: list[ReleaseNode] = []
    for shape in shapes:
        match = _NODE.fullmatch(shape.name)
        if match is None:
            if not nodes:
                nodes.append(ReleaseNode("", shape.name, "", []))
            nodes[-1].shapes.append(shape.id)
            continue
        kind, rest = match["kind"], match["rest"]
        model = _MODEL.fullmatch(rest) if kind == "Model" else None
        name = f"{kind}#{model['id'] if model else rest}"
        nodes.append(ReleaseNode(kind, name, model["id"] if model else "", [shape.id]))
    return nodes


def with_lamp_emitters(
    shapes: list[Shape], nodes: list[ReleaseNode], release: Release, path: Path, changes: Changes
) -> list[Shape]:
    """Add the emitters of the lamp table to shapes without emitters from the template.

    Radiance is in the release's units, see `pbrnet.scenes.photometry`.
    """
    radiance: dict[str, float] = {}
    by_id = {shape.id: shape for shape in shapes}
    for release_node in nodes:
        lamp = release.lamps.get(release_node.model)
        if lamp is None or any(by_id[name].emitter is not None for name in release_node.shapes):
            continue
        for number, name in enumerate(release_node.shapes):
            if number in lamp.bulbs:
                radiance[name] = PBRS_BULB
            elif number in lamp.shades and not by_id[name].surface.transmissive:
                radiance[name] = SHADE_RADIANCE
    if radiance:
        changes.note("shapes became emitters by the release's lamp table: {}", str(len(radiance)))
    return [
        replace(shape, emitter=_area(radiance[shape.id], path)) if shape.id in radiance else shape
        for shape in shapes
    ]


def without_duplicates(shapes: list[Shape], changes: Changes) -> list[Shape]:
    """Leave out shapes that lie exactly on an earlier one.

    SUNCG stores some rooms twice, and which of two equal surfaces a ray hits is undefined.
    """
    seen: set[bytes] = set()
    kept = []
    for shape in shapes:
        key = _surface_key(shape.mesh)
        if key in seen and shape.emitter is None:
            changes.note(
                "a duplicate of another shape in the same place was left out: {}", shape.id
            )
            continue
        seen.add(key)
        kept.append(shape)
    return kept


def objects_of_nodes(
    nodes: list[ReleaseNode],
    release: Release,
    shapes: list[Shape],
    rooms: list[FoundRoom],
    room_ids: list[str],
) -> tuple[SceneObject, ...]:
    """Objects of `scene.json` from nodes, with the categories of the release's table."""
    by_id = {shape.id: shape for shape in shapes}
    index = RoomIndex(rooms)
    objects = []
    for release_node in nodes:
        members = [by_id[name] for name in release_node.shapes if name in by_id]
        for name, category, structure, part in _parts(release_node, members, release):
            low, high = bounds_of(part)
            room = room_of(0.5 * (low + high), low, index, room_ids)
            object_id = part[0].id.removesuffix("_mesh")
            objects.append(make_object(object_id, name, category, part, structure, room))
    return tuple(objects)


def match_rooms(
    nodes: list[ReleaseNode], shapes: list[Shape], rooms: list[FoundRoom], room_ids: list[str]
) -> dict[str, str]:
    """Map SUNCG's room names to ids of the rooms found, by shared floor area."""
    by_id = {shape.id: shape for shape in shapes}
    names = {}
    for release_node in nodes:
        if release_node.kind != "Room":
            continue
        corners = [
            by_id[name].mesh.corners[:, :, :2] for name in release_node.shapes if name in by_id
        ]
        if not corners or not rooms:
            continue
        plan = union(shapely.polygons(np.concatenate(corners)))
        shared = [intersection(room.floor, plan).area for room in rooms]
        best = int(np.argmax(shared))
        if shared[best] > 0.5 * min(plan.area, rooms[best].floor.area):
            names[release_node.name] = room_ids[best]
    return names


def _surface_key(mesh: Mesh) -> bytes:
    """A key of the triangles, rounded to 10 micrometres, independent of order and winding."""
    corners = np.round(mesh.corners, 5) + 0.0
    turn = np.lexsort((corners[..., 2], corners[..., 1], corners[..., 0]), axis=1)
    rows = np.take_along_axis(corners, turn[..., None], axis=1).reshape(-1, 9)
    return bytes(rows[np.lexsort(rows.T)].tobytes())


def _parts(
    release_node: ReleaseNode, members: list[Shape], release: Release
) -> list[tuple[str, str, bool, list[Shape]]]:
    """The objects of a node: name, category, whether it is structure, and shapes.

    A room is split into floor and ceiling.
    """
    if not members:
        return []
    if release_node.kind == "Room":
        lowest = min(shape.mesh.bounds[0, 2] for shape in members)
        under = [shape for shape in members if shape.mesh.bounds.mean(axis=0)[2] < lowest + 1.0]
        over = [shape for shape in members if shape not in under]
        tail = release_node.name.partition("#")[2]
        return [
            (f"{kind.capitalize()}#{tail}", kind, True, part)
            for kind, part in (("floor", under), ("ceiling", over))
            if part
        ]
    if release_node.kind != "Model":
        kind = release_node.kind.lower()
        category = kind if kind in ("wall", "floor", "ceiling", "ground") else "structure"
        return [(release_node.name, category, True, members)]
    known = release.classes.get(release_node.model)
    if known is None:
        return [(release_node.name, "other", False, members)]
    category = _CLASS_OVERRIDES.get(known.fine) or category_of(known.fine, known.coarse)
    return [(release_node.name, category, known.structure, members)]


def _cameras(folder: Path, opened: OpenedFiles, changes: Changes) -> tuple[ReleaseCamera, ...]:
    """Cameras with their names, without those that the release flags as bad."""
    cameras = read_cameras(folder / _CAMERAS)
    names = _optional_lines(folder / "room_camera_name.txt", opened)
    flags = _optional_lines(folder / "room_camera_good.txt", opened)
    for label, lines in (("names", names), ("flags", flags)):
        if lines and len(lines) != len(cameras):
            changes.note(
                f"the release has {len(cameras)} cameras but {len(lines)} {label} for them; "
                f"the {label} were ignored"
            )
    if len(names) == len(cameras):
        cameras = [
            replace(camera, name=name.strip()) for camera, name in zip(cameras, names, strict=True)
        ]
    if len(flags) == len(cameras):
        good = [
            camera
            for camera, flag in zip(cameras, flags, strict=True)
            if flag.strip() not in ("0", "0.0")
        ]
        if len(good) < len(cameras):
            changes.note(
                "cameras that the release flags as being in a room without light were left out: {}",
                str(len(cameras) - len(good)),
            )
        cameras = good
    return tuple(cameras)


def _classes(path: Path) -> dict[str, _ModelClass]:
    rows = csv.DictReader(_lines(path))
    wanted = {"model_id", "fine_grained_class", "coarse_grained_class"}
    if not wanted <= set(rows.fieldnames or ()):
        raise InputError(
            f"{path}: is not the release's category table; it needs the columns {sorted(wanted)}"
        )
    return {
        row["model_id"]: _ModelClass(
            row["fine_grained_class"] or "",
            row["coarse_grained_class"] or "other",
            row.get("empty_struct_obj") == "1",
        )
        for row in rows
        if row["model_id"]
    }


def _near(folder: Path, name: str, opened: OpenedFiles) -> Path | None:
    """Find a table of the release: in `folder`, above it, or in `util_data` there."""
    above = list(folder.resolve().parents)[:3]
    for place in (folder, *(place / sub for place in above for sub in (".", "util_data"))):
        if opened.is_file(place / name):
            return (place / name).resolve()
    return None


def _lines(path: Path) -> list[str]:
    if path.stat().st_size > _MAX_BYTES:
        raise InputError(
            f"{path}: is larger than {_MAX_BYTES >> 20} MiB, so it is not a table of the release"
        )
    text = path.read_bytes().decode("utf-8", "replace")
    return [line for line in text.splitlines() if line.strip()]


def _optional_lines(path: Path, opened: OpenedFiles) -> list[str]:
    return _lines(path) if opened.is_file(path) else []


def _area(radiance: float, path: Path) -> Node:
    """An area emitter element, as if the scene file had it."""
    value = Node("spectrum", {"name": "radiance", "value": str(radiance)}, path, 0)
    return Node("emitter", {"type": "area"}, path, 0, [value])
