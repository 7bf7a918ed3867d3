"""Import of IFC buildings: rooms from spaces, objects from elements, metres from the file's unit.

IfcOpenShell reads the file in a child process (`export.py`). Windows without transparent parts
lose what fills their frames, or altogether if nothing in them is a pane, so that openings stay.
A building without spaces and ceilings gets ceilings.
"""

from __future__ import annotations

import json
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from shapely.geometry import Polygon
from shapely.geometry.polygon import orient

from pbrnet.scenes.arrays import Float64Array
from pbrnet.scenes.child_process import require_extra, run_child
from pbrnet.scenes.color import Color, decode_srgb_value
from pbrnet.scenes.contract import Scene, SceneObject, load_scene, writing_scene
from pbrnet.scenes.errors import InputError
from pbrnet.scenes.geometry.mesh import Mesh, cleaned, creased
from pbrnet.scenes.geometry.regions import largest_part, simplified, union
from pbrnet.scenes.ifc.classes import category_of_element, is_window, occupies_no_room
from pbrnet.scenes.ifc.options import IfcOptions
from pbrnet.scenes.ifc.slabs import built_ceiling, lacks_slab, slabs_of
from pbrnet.scenes.importing.assembly import Draft, assemble
from pbrnet.scenes.importing.changes import Changes
from pbrnet.scenes.importing.credits import find_credit
from pbrnet.scenes.importing.light.daylight import daylight
from pbrnet.scenes.importing.materials.surface import Surface, clear_glass, wrapped
from pbrnet.scenes.importing.names import Names
from pbrnet.scenes.importing.objects import room_of, structure_category
from pbrnet.scenes.importing.shape import Shape, bounds_of, make_object
from pbrnet.scenes.importing.shapes.panes import pieces_of_mesh
from pbrnet.scenes.importing.shapes.sealing_shapes import (
    CEILING,
    FLOOR,
    completing_shapes,
    sealing_shape,
)
from pbrnet.scenes.importing.xml_elements import plugin
from pbrnet.scenes.opened_files import OpenedFiles
from pbrnet.scenes.reconstruction.interior import find_interior, find_rooms
from pbrnet.scenes.reconstruction.raycast import RayCaster
from pbrnet.scenes.reconstruction.room_index import RoomIndex
from pbrnet.scenes.reconstruction.rooms import MIN_AREA, FoundRoom

if TYPE_CHECKING:  # the child's code: what an import gives depends on it, but it is loaded there
    from pbrnet.scenes.ifc import export as _export  # noqa: F401

_SECONDS = 300  # of a processor, for IfcOpenShell
_MEMORY = 8 * 2**30  # bytes of address space, for IfcOpenShell
_CREASE = 40.0  # degrees
_GREY: Color = (0.5, 0.5, 0.5)  # of surfaces without a style
_CLEAR = 0.4  # transparency from which a style is clear glass
_LEAST_HEIGHT = 1.0  # metres, of a space that is a room
_PRISM = 0.97  # least share of its floor's area times its height that a space without slopes fills
_TERRAIN = ("IfcSite", "IfcGeographicElement")  # classes: below it there are no rooms
_PANE_DEPTH = 0.06  # metres, greatest thickness of a pane
_PANE_SHARE = 0.2  # least share of a window's face that a pane covers


def import_ifc(
    path: Path, out: Path, scene_id: str, options: IfcOptions, opened: OpenedFiles
) -> Scene:
    """Import an IFC file into the scene folder `out`; raises `InputError`."""
    require_extra("ifcopenshell", "ifc", path)
    changes = Changes()
    opened.is_file(path)
    with writing_scene(out) as folder, tempfile.TemporaryDirectory() as unpacked:
        arguments = (str(path.resolve()), unpacked)
        run_child("pbrnet.scenes.ifc.export:export", arguments, path, _SECONDS, _MEMORY)
        data = json.loads((Path(unpacked) / "building.json").read_text())
        points = np.load(Path(unpacked) / "points.npy", allow_pickle=False)
        building = _Building(path, data, points, options, changes)
        building.read()
        credit = find_credit(
            opened, scene_id, options.licence, options.author or data["author"], changes
        )
        draft = Draft(
            scene_id,
            {
                "kind": "ifc",
                "file": path.name,
                "version": data["schema"],
                "storeys": building.storeys,
            },
            building.shapes,
            {},
            [daylight()],
            [],
            (credit,),
            hint=path.stem,
            grouping=partial(_objects, building.elements),
            ground=True,
            lamps=options.lamp_rule,
            stated_rooms=tuple(building.rooms),
            parts_shells=False,  # its elements are what they are
        )
        assemble(folder, draft, changes)
    return load_scene(out)


@dataclass
class _Building:
    path: Path
    data: dict[str, Any]
    points: Float64Array  # (F, 3, 3), metres, Z up
    options: IfcOptions
    changes: Changes
    shapes: list[Shape] = field(default_factory=list)
    elements: dict[str, dict[str, Any]] = field(default_factory=dict)  # by shape id
    rooms: list[tuple[str, FoundRoom]] = field(default_factory=list)
    storeys: list[str] = field(default_factory=list)
    _with_rooms: set[str] = field(default_factory=set)  # names of storeys
    _names: Names = field(default_factory=Names)
    _surfaces: dict[int, Surface] = field(default_factory=dict)

    def read(self) -> None:
        """Fill shapes, rooms and storeys; raises `InputError` if nothing is left."""
        elements = self.data["elements"]
        known = list(dict.fromkeys(each["storey"] for each in elements if each["storey"]))
        for name in self.options.storey:
            if name not in known:
                raise InputError(
                    f"{self.path}: no storey {name!r}; there are {', '.join(known) or 'none'}"
                )
        self.storeys = [name for name in known if name in (self.options.storey or known)]
        for element in elements:
            if self.options.storey and element["storey"] not in self.options.storey:
                continue
            if element["class"] in ("IfcSpace", "IfcSpatialZone"):
                self._space(element)
            elif not occupies_no_room(element["class"]):
                self._element(element)
        if not self.shapes:
            raise InputError(f"{self.path}: the file has no elements with surfaces")
        if self.rooms:
            self._add_slabs()
            self._add_unstated_rooms()
        else:
            self.changes.note("the file has no spaces: rooms were derived from its surfaces")
            self._close()
        for kind, count in self.data["lost"].items():
            self.changes.note("elements whose shape cannot be made: {}", f"{count} {kind}")
        if any(self.data["shift"]):
            moved = ", ".join(f"{value:g}" for value in self.data["shift"])
            self.changes.note(f"the building was moved by ({moved}) m, near the origin")
        if any(each["class"] == "IfcLightFixture" for each in elements):
            self.changes.note("light fixtures are off: IFC does not state their light here")

    def _close(self) -> None:
        """Add ceilings and walls to spaces that are open above, if there is no closed room."""
        corners = np.concatenate([shape.mesh.corners for shape in self.shapes])
        for shape in completing_shapes(find_interior(corners).completion, self.changes):
            self._add(shape, "IfcBuildingElementPart")

    def _add_slabs(self) -> None:
        """Add floors and ceilings to spaces that lack them, at the heights that the file states."""
        rays = RayCaster(np.concatenate([shape.mesh.corners for shape in self.shapes]))
        self._end_at_ceilings(rays)
        for name, color, predefined in (("floor", FLOOR, "FLOOR"), ("ceiling", CEILING, "CEILING")):
            rooms = [room for _, room in self.rooms if lacks_slab(room, rays, name == "ceiling")]
            if rooms:
                shape = sealing_shape(f"added_{name}", slabs_of(rooms, name == "ceiling"), color)
                self._add(shape, "IfcCovering", predefined)
                self.changes.note(f"spaces without a {name} got one at their height: {len(rooms)}")

    def _end_at_ceilings(self, rays: RayCaster) -> None:
        """Lower the ceilings of spaces to those that are built inside them."""
        stated, self.rooms = self.rooms, []
        for name, room in stated:
            height = built_ceiling(room, rays)
            if height < room.floor_z + _LEAST_HEIGHT:
                self.changes.note("spaces too low to be rooms were left out: {}", name)
                continue
            if height < room.ceiling_z:
                self.changes.note("spaces higher than their ceiling end at it: {}", name)
            self.rooms.append((name, replace(room, ceiling_z=height)))

    def _add_unstated_rooms(self) -> None:
        """Add the closed rooms of storeys without a space, or note that they have none.

        A room is one of them if it shares at most half its height with each space: beside spaces,
        closed cavities are shafts and hollow walls.
        """
        bands = {
            name: self._wall_heights(name) for name in self.storeys if name not in self._with_rooms
        }
        if not bands:
            return
        corners = [
            shape.mesh.corners for shape in self.shapes
            if self.elements[shape.id]["class"] not in _TERRAIN
        ]  # fmt: skip
        spaces = [room for _, room in self.rooms]
        for room in find_rooms(np.concatenate(corners), None):
            middle = 0.5 * (room.floor_z + room.ceiling_z)
            around = [name for name, (low, high) in bands.items() if low < middle < high]
            if around and not room.guessed and not any(_is_beside(room, one) for one in spaces):
                self.rooms.append(("", room))
                self._with_rooms.update(around)
        for name in bands:
            if name in self._with_rooms:
                self.changes.note("storeys without a space got rooms from their surfaces: {}", name)
            else:
                self.changes.note("storeys without a space have no rooms: {}", name)

    def _wall_heights(self, storey: str) -> tuple[float, float]:
        """The lowest and highest z of a storey's walls, in metres."""
        heights = [
            self._corners(each)[..., 2].ravel() for each in self.data["elements"]
            if each["storey"] == storey and each["class"].startswith("IfcWall")
        ]  # fmt: skip
        found = np.concatenate(heights) if heights else np.zeros(1)
        return float(found.min()), float(found.max())

    def _add(self, shape: Shape, kind: str, predefined: str = "") -> None:
        added = replace(shape, id=self._names.unique(shape.id))
        self.shapes.append(added)
        self.elements[added.id] = {
            "class": kind, "name": shape.name, "guid": added.id, "part_of": "",
            "predefined": predefined,
        }  # fmt: skip

    def _space(self, element: dict[str, Any]) -> None:
        if element["predefined"] in ("EXTERNAL", "GFA") or element["class"] != "IfcSpace":
            return
        corners = self._corners(element)
        low, high = corners[..., 2].min(), corners[..., 2].max()
        one, two = (corners[:, k, :2] - corners[:, 0, :2] for k in (1, 2))
        facing = np.abs(one[:, 0] * two[:, 1] - one[:, 1] * two[:, 0]) > 1e-8
        flat = [Polygon(corner) for corner in corners[facing, :, :2]]
        floor = simplified(largest_part(union(flat)), 0.005)
        name = element["long_name"] or element["name"] or "space"
        if not isinstance(floor, Polygon) or floor.area < MIN_AREA or high - low < _LEAST_HEIGHT:
            self.changes.note("spaces too small to be rooms were left out: {}", name)
            return
        outline = orient(Polygon(floor.exterior))
        volume = abs(float(np.sum(corners[:, 0] * np.cross(corners[:, 1], corners[:, 2])))) / 6
        is_prism = volume > _PRISM * outline.area * (high - low)
        solid = None if is_prism else corners
        self.rooms.append((name, FoundRoom(outline, float(low), float(high), solid=solid)))
        self._with_rooms.add(element["storey"])

    def _element(self, element: dict[str, Any]) -> None:
        label = element["name"] or element["class"]
        parts = [
            (self._mesh(start, stop, label), self._surface(material))
            for start, stop, material in element["ranges"]
        ]
        if is_window(element["class"]) and not any(part.see_through for _, part in parts):
            parts = self._glazed(parts, label)
        for mesh, surface in parts:
            if len(mesh.faces):
                shape = Shape(self._names.unique(label), label, mesh, surface)
                self.shapes.append(shape)
                self.elements[shape.id] = element

    def _glazed(self, parts: list[tuple[Mesh, Surface]], label: str) -> list[tuple[Mesh, Surface]]:
        """The parts of a window without glass, its panes made of glass; none without a pane."""
        bounds = np.array([mesh.bounds for mesh, _ in parts if len(mesh.faces)]).reshape(-1, 3)
        if not len(bounds):
            return []
        whole = np.sort(np.ptp(bounds, axis=0))
        made, found = [], False
        for mesh, surface in parts:
            labels = pieces_of_mesh(mesh)
            for number in range(labels.max(initial=-1) + 1):
                piece = mesh.subset(labels == number)
                size = np.sort(np.ptp(piece.bounds, axis=0))
                is_pane = (
                    size[0] <= _PANE_DEPTH
                    and size[1] * size[2] >= _PANE_SHARE * whole[1] * whole[2]
                    and labels.max() + len(parts) > 1
                )
                found |= bool(is_pane)
                made.append((piece, self._glass() if is_pane else surface))
        if found:
            self.changes.note(
                "panes of windows without a transparent style became glass: {}", label
            )
            return made
        self.changes.note(
            "windows of one solid piece were left out, their openings stay: {}", label
        )
        return []

    def _mesh(self, start: int, stop: int, label: str) -> Mesh:
        corners = self.points[start:stop].reshape(-1, 3)
        vertices, inverse = np.unique(corners, axis=0, return_inverse=True)
        mesh, _ = cleaned(Mesh(vertices, inverse.reshape(-1, 3)), f"{self.path}: {label}")
        return creased(mesh, _CREASE) if len(mesh.faces) else mesh

    def _corners(self, element: dict[str, Any]) -> Float64Array:
        return np.concatenate([self.points[start:stop] for start, stop, _ in element["ranges"]])

    def _surface(self, number: int) -> Surface:
        if number not in self._surfaces:
            name, *color, transparency = (
                self.data["materials"][number] if number >= 0 else ("", *_GREY, 0.0)
            )
            self._surfaces[number] = _surface(name, color, transparency, number >= 0)
        return self._surfaces[number]

    def _glass(self) -> Surface:
        return self._surfaces.setdefault(-2, _surface("glass", _GREY, 1.0, True))


def _is_beside(room: FoundRoom, space: FoundRoom) -> bool:
    shared = min(room.ceiling_z, space.ceiling_z) - max(room.floor_z, space.floor_z)
    return shared > 0.5 * (room.ceiling_z - room.floor_z)


def _surface(name: str, color: Sequence[float], transparency: float, is_display: bool) -> Surface:
    """A matt surface, clear glass or a translucent one; a display colour is sRGB."""
    if transparency >= _CLEAR:
        return clear_glass(name=name)
    red, green, blue = (decode_srgb_value(float(one)) if is_display else one for one in color)
    both = wrapped("twosided", plugin("bsdf", "diffuse", reflectance=(red, green, blue)))
    if transparency <= 0.01:
        return Surface(both, double=True, name=name)
    masked = wrapped("mask", both, opacity=1.0 - transparency)
    return Surface(masked, transmissive=True, name=name)


def _objects(
    elements: dict[str, dict[str, Any]],
    shapes: list[Shape],
    rooms: list[FoundRoom],
    room_ids: list[str],
) -> tuple[SceneObject, ...]:
    """One object for each element, or for the element that it is a part of."""
    groups: dict[str, list[Shape]] = {}
    for shape in shapes:
        element = elements[shape.id]
        groups.setdefault(element["part_of"] or element["guid"], []).append(shape)
    index = RoomIndex(rooms)
    objects = []
    for members in groups.values():
        element = elements[members[0].id]
        category, is_structure = category_of_element(element)
        if category in ("slab", ""):
            category = structure_category(members[0], index) or "structure"
        elif category == "other" and element["class"] == "IfcBuildingElementProxy":
            category = structure_category(members[0], index) or category
            is_structure = category != "other"
        low, high = bounds_of(members)
        objects.append(
            make_object(
                members[0].id,
                element["name"] or element["class"],
                category,
                members,
                is_structure,
                room_of(0.5 * (low + high), low, index, room_ids),
            )
        )
    return tuple(objects)
