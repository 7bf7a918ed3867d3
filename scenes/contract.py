"""Scene contract: the scene folder that every scene source writes and every stage reads.

A scene is a folder `data/scenes/<scene_id>/` with

* `scene.xml`: plain Mitsuba 3, opens with the `mitsuba` command as it is, no sensor needed by us
  (one is written so that the command has something to show); every shape has a unique id;
* `meshes/`, `textures/`: what `scene.xml` names, by relative path; meshes are binary PLY;
* `scene.json`: the `Scene` below.

World: metres, right-handed, Z up. Clear window panes are portals here, never glass in
`scene.xml` (it would stop shadow rays). Shapes are never merged across objects.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

from pbrnet.scenes.checked import OPTIONAL, build, check_name, plain
from pbrnet.scenes.errors import InputError
from pbrnet.scenes.files import atomic_directory, read_json, write_json

SCHEMA = 1
# Keys in `source` by which the scenes stage knows its own scenes: the fingerprint, and the files
# that an import looked for.
STAGE_KEY = "made_by_stage"
STAGE_FILES_KEY = "opened_files"
MAX_EXTENT = 1e6  # metres across, skies and grounds included
Point2 = tuple[float, float]
Point3 = tuple[float, float, float]
Box = tuple[Point3, Point3]  # least and greatest corner


@dataclass(frozen=True)
class Credit:
    """Author and licence of a part of the scene."""

    part: str  # what it covers: "geometry", a file name, or "everything"
    title: str
    author: str
    licence: str  # SPDX identifier where there is one, e.g. "CC-BY-3.0"
    source: str = ""  # where it came from: a public page, a package, or "generated"


@dataclass(frozen=True)
class Room:
    """A room; `floor` is a simple polygon, counter-clockwise seen from above, metres."""

    id: str
    name: str
    type: str  # "living", "bedroom", "kitchen", "bathroom", "study", "dining", "other"
    floor: tuple[Point2, ...]
    floor_z: float
    ceiling_z: float
    has_light: bool  # a lamp (lit or not), a window or a door leads light into it


@dataclass(frozen=True)
class SceneObject:
    """One object, such as a chair or a wall; `shapes` are the ids of its shapes in `scene.xml`."""

    id: str
    name: str
    category: str  # "chair", "table", "lamp", "wall", "floor", "ceiling", "window", ...
    shapes: tuple[str, ...]
    bbox_min: Point3
    bbox_max: Point3
    is_structure: bool  # walls, floors, ceilings and the like: never counted by the camera score
    room: str | None = None


@dataclass(frozen=True)
class Light:
    """A light source that is on in this scene."""

    id: str
    kind: Literal["area", "point", "spot", "directional", "sun", "sky", "environment"]
    shapes: tuple[str, ...] = ()  # the emitting shapes of an area light
    room: str | None = None
    lumens: float | None = None  # luminous flux where it is known


@dataclass(frozen=True)
class Portal:
    """An opening to the outside; `polygon` is planar, metres, `normal` points outdoors."""

    id: str
    kind: Literal["window", "door", "opening"]
    polygon: tuple[Point3, ...]
    normal: Point3
    clear: bool  # light passes straight through; False: frosted or closed
    room: str | None = None
    panes: int = 0  # sheets of clear glass, behind each other, that reflect for the camera


@dataclass(frozen=True)
class Joint:
    """A hinge or slide of an object: its connected bodies within one of the `boxes` move.

    `axis` and boxes (low, high) are in axes turned by `yaw` degrees about Z; boxes are from the
    pivot, with the joint closed. A greater `value` opens.
    """

    object: str
    kind: Literal["hinge", "slide"]
    pivot: Point3
    axis: Point3  # unit, right-handed
    limits: tuple[float, float]  # degrees, of slides metres, from closed
    value: float  # at present
    boxes: tuple[Box, ...]
    yaw: float = 0.0

    def verify(self, where: str) -> None:
        """Check axis and boxes; raises ValueError."""
        if not math.isclose(math.hypot(*self.axis), 1, abs_tol=1e-3) or not self.boxes:
            raise ValueError(f"{where}: a joint needs an axis of unit length and a box")


@dataclass(frozen=True)
class Scene:
    """`scene.json`."""

    scene_id: str
    source: dict[str, Any]  # "kind": "procedural" | "mitsuba" | ..., and what made it: seed, path
    rooms: tuple[Room, ...]
    objects: tuple[SceneObject, ...]
    lights: tuple[Light, ...]
    portals: tuple[Portal, ...]
    credits: tuple[Credit, ...]
    lighting: str = "unknown"  # "day", "evening", "night", "mixed", "pbrs" or "unknown"
    plan: str = ""  # scenes with the same plan never fall into different splits
    joints: tuple[Joint, ...] = field(default=(), metadata=OPTIONAL)
    changes: tuple[str, ...] = ()  # what an importer changed or lost, a sentence each
    schema: int = SCHEMA
    units: str = "metres, Z up, right-handed"
    folder: Path = field(default=Path(), init=False, compare=False)

    @property
    def xml(self) -> Path:
        """`scene.xml` of a scene read from disk."""
        return self.folder / "scene.xml"

    @property
    def origin(self) -> dict[str, Any]:
        """`source` without the keys of the scenes stage, as a copy of the scene has it."""
        stage = (STAGE_KEY, STAGE_FILES_KEY)
        return {name: value for name, value in self.source.items() if name not in stage}

    def verify(self, where: str) -> None:
        """Check schema, credits, ids and rooms; raises ValueError."""
        check_name(self.scene_id, "a scene's id", where, ValueError)
        prefix = where or self.scene_id
        if self.schema != SCHEMA:
            raise ValueError(f"{prefix}: schema {self.schema}, this version reads {SCHEMA}")
        if not self.credits:
            raise ValueError(f"{prefix}: no credits; licence and author of every part are needed")
        for kind, ids in (
            ("room", [room.id for room in self.rooms]),
            ("object", [thing.id for thing in self.objects]),
            ("shape", [shape for thing in self.objects for shape in thing.shapes]),
            ("portal", [portal.id for portal in self.portals]),
        ):
            repeated = sorted(name for name, count in Counter(ids).items() if count > 1)
            if repeated:
                raise ValueError(f"{prefix}: {kind} id {repeated[0]!r} is used twice")
        for room in self.rooms:
            if len(room.floor) < 3 or room.ceiling_z <= room.floor_z:
                raise ValueError(f"{prefix}: room {room.id!r} has no floor area or no height")
            places = [*(value for point in room.floor for value in point), room.ceiling_z]
            if not all(abs(value) <= MAX_EXTENT for value in places):
                raise ValueError(f"{prefix}: room {room.id!r} lies more than {MAX_EXTENT:g} m away")
        strange = {joint.object for joint in self.joints} - {thing.id for thing in self.objects}
        if strange:
            raise ValueError(f"{prefix}: a joint of {min(strange)!r}, which is no object")


@contextmanager
def writing_scene(folder: Path) -> Iterator[Path]:
    """Yield a temporary scene folder (with `meshes/`, `textures/`); it becomes `folder` at the end.

    Write `scene.xml`, then call `save_scene(partial, scene)` inside the block.
    """
    with atomic_directory(folder) as partial:
        (partial / "meshes").mkdir()
        (partial / "textures").mkdir()
        yield partial


def save_scene(folder: Path, scene: Scene) -> None:
    """Check `scene` and write it as `folder/scene.json`."""
    try:
        scene.verify("")
    except ValueError as error:
        raise InputError(str(error)) from None
    write_json(Path(folder) / "scene.json", plain(scene, brief=True))


def load_scene(folder: Path) -> Scene:
    """Read a scene folder; `InputError` names what is missing or wrong."""
    folder = Path(folder)
    path = folder / "scene.json"
    scene = build(Scene, read_json(path), str(path), InputError)
    if not (folder / "scene.xml").is_file():
        raise InputError(f"{folder}: scene.xml is missing")
    object.__setattr__(scene, "folder", folder)
    return scene


def scene_folders(root: Path) -> list[Path]:
    """Return the complete scene folders below `data/scenes`, sorted by id."""
    return sorted(path.parent for path in Path(root).glob("*/scene.json"))
