"""Homes saved before version 5.3: serialised `Home` objects as the elements of `Home.xml`.

The application's later versions write the same classes as XML under the same names, so the fields
of the objects become the attributes and elements that `reader` checks. Rules by which the
application completes old objects on loading (`readObject` of its classes) are applied here:
walls without a height take the home's, furniture stands in the newest of three fields, the ground
of versions up to 3.4 is darkened.
"""

from __future__ import annotations

from typing import Any
from xml.etree import ElementTree
from xml.etree.ElementTree import Element

import numpy as np

from pbrnet.scenes.errors import InputError
from pbrnet.scenes.formats.java_objects import MAX_BYTES as MAX_BYTES
from pbrnet.scenes.formats.java_objects import JavaRecord, read_java_object

_MODEL = "com.eteks.sweethome3d.model."
_CONTENT = "file:temp!/"  # a member of the home's own archive
_NEW_GROUND = 3400  # the last version whose ground is darkened on loading
_DEPTH = 64  # of groups inside each other
_IDENTITY = [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0]
_CAMERA = ("x", "y", "z", "yaw", "pitch", "fieldOfView", "time")
_PIECE = (
    "angle",
    "backFaceShown",
    "catalogId",
    "creator",
    "deformable",
    "depth",
    "depthInPlan",
    "dropOnTopElevation",
    "elevation",
    "height",
    "heightInPlan",
    "id",
    "modelMirrored",
    "name",
    "pitch",
    "resizable",
    "roll",
    "shininess",
    "staircaseCutOutShape",
    "texturable",
    "visible",
    "width",
    "widthInPlan",
    "x",
    "y",
)
_OPENING = (
    "boundToWall",
    "cutOutShape",
    "wallCutOutOnBothSides",
    "wallDistance",
    "wallHeight",
    "wallLeft",
    "wallThickness",
    "wallTop",
    "wallWidth",
)
_WALL = (
    "arcExtent",
    "height",
    "heightAtEnd",
    "leftSideShininess",
    "rightSideShininess",
    "thickness",
    "xEnd",
    "xStart",
    "yEnd",
    "yStart",
)


def home_xml(data: bytes, where: str) -> bytes:
    """Return the `Home.xml` that says what a serialised home does; raises `InputError`."""
    try:
        home = read_java_object(data, where)
    except InputError as error:
        raise InputError(
            f"{error}; if Sweet Home 3D 5.3 or later opens the home, save it again there"
        ) from None
    if not isinstance(home, JavaRecord) or home.kind != f"{_MODEL}Home":
        raise InputError(f"{where}: Java objects, but no home")
    try:
        root = _Writer(home).root()
    except (TypeError, ValueError, AttributeError, KeyError, OverflowError) as error:
        raise InputError(f"{where}: a home with damaged fields ({error})") from None
    return ElementTree.tostring(root, encoding="utf-8")


class _Writer:
    """Elements of one home."""

    def __init__(self, home: JavaRecord) -> None:
        self.home = home
        self.levels = _numbered(home["levels"], "level")
        self.walls = _numbered(home["walls"], "wall")

    def root(self) -> Element:
        home = self.home
        root = _element("home", home, ("version", "name", "wallHeight"))
        for name, value in (home["properties"].fields if home["properties"] else {}).items():
            ElementTree.SubElement(root, "property", name=_clean(name), value=_clean(str(value)))
        self._environment(root)
        if home["compass"]:
            compass = _element("compass", home["compass"], ("northDirection", "x", "y"))
            _set(compass, home["compass"], ("longitude", "latitude", "visible"))
            zone = home["compass"]["timeZone"]
            if zone:
                _set(compass, zone, ("ID",), {"ID": "timeZone"})
            root.append(compass)
        for name in ("observerCamera", "topCamera"):
            self._camera(root, home[name], name)
        for camera in _items(home["storedCameras"]):
            self._camera(root, camera, "storedCamera")
        for level, identifier in _in_order(home["levels"], self.levels):
            names = ("name", "elevation", "floorThickness", "height", "elevationIndex")
            element = _element("level", level, (*names, "visible", "viewable"))
            element.set("id", identifier)
            root.append(element)
        furniture = (
            home["furnitureWithGroups"] or home["furnitureWithDoorsAndWindows"] or home["furniture"]
        )
        for piece in _items(furniture):
            self._piece(root, piece, 0)
        for wall, identifier in _in_order(home["walls"], self.walls):
            self._wall(root, wall, identifier)
        for room in _items(home["rooms"]):
            self._room(root, room)
        for field, tag in (
            ("polylines", "polyline"),
            ("dimensionLines", "dimensionLine"),
            ("labels", "label"),
        ):
            for _ in _items(home[field]):
                ElementTree.SubElement(root, tag)
        return root

    def _environment(self, root: Element) -> None:
        home, environment = self.home, self.home["environment"] or self.home
        element = _element("environment", environment, ("photoWidth", "photoHeight"))
        ground = home["groundColor"]
        if ground is not None and home["version"] is not None and home["version"] <= _NEW_GROUND:
            bands = [(int(ground) >> shift & 0xFF) * 3 // 4 for shift in (16, 8, 0)]
            ground = bands[0] << 16 | bands[1] << 8 | bands[2]
        _color(element, "groundColor", ground)
        _color(element, "skyColor", home["skyColor"])
        self._texture(element, home["groundTexture"], "groundTexture")
        self._texture(element, environment["skyTexture"], "skyTexture")
        root.append(element)

    def _camera(self, root: Element, camera: JavaRecord | None, attribute: str) -> None:
        if camera is None:
            return
        tag = "observerCamera" if camera.kind == f"{_MODEL}ObserverCamera" else "camera"
        element = _element(tag, camera, (*_CAMERA, "name"))
        element.set("attribute", attribute)
        element.set("lens", _clean(camera["lensName"] or "PINHOLE"))
        root.append(element)

    def _piece(self, root: Element, piece: JavaRecord, depth: int) -> None:
        if depth > _DEPTH:
            raise ValueError(f"more than {_DEPTH} groups inside each other")
        kind = piece.kind.removeprefix(_MODEL)
        tag = {
            "HomeFurnitureGroup": "furnitureGroup",
            "HomeDoorOrWindow": "doorOrWindow",
            "HomeLight": "light",
        }.get(kind, "pieceOfFurniture")
        element = _element(tag, piece, _PIECE)
        self._level(element, piece)
        _color(element, "color", piece["color"])
        for name in ("model", "icon"):
            _content(element, name, piece[name])
        numbers = [value for row in _items(piece["modelRotation"]) for value in row]
        if numbers and numbers != _IDENTITY:
            element.set("modelRotation", " ".join(map(_number, numbers)))
            centred = bool(piece["modelCenteredAtOrigin"])
            element.set("modelCenteredAtOrigin", "true" if centred else "false")
        self._texture(element, piece["texture"], None)
        for material in _items(piece["modelMaterials"]):
            if material is not None:
                self._material(element, material)
        if tag == "doorOrWindow":
            _set(element, piece, _OPENING)
            for sash in _items(piece["sashes"]):
                names = ("xAxis", "yAxis", "width", "startAngle", "endAngle")
                element.append(_element("sash", sash, names))
        elif tag == "light":
            _set(element, piece, ("power",))
            for light in _items(piece["lightSources"]):
                source = _element("lightSource", light, ("x", "y", "z", "diameter"))
                _color(source, "color", light["color"])
                element.append(source)
        elif tag == "furnitureGroup":
            for member in _items(piece["furniture"]):
                self._piece(element, member, depth + 1)
        else:
            _set(element, piece, ("doorOrWindow",))
        root.append(element)

    def _material(self, element: Element, material: JavaRecord) -> None:
        made = _element("material", material, ("name", "key", "shininess"))
        _color(made, "color", material["color"])
        self._texture(made, material["texture"], None)
        element.append(made)

    def _wall(self, root: Element, wall: JavaRecord, identifier: str) -> None:
        element = _element("wall", wall, _WALL)
        element.set("id", identifier)
        if wall["height"] is None:
            _set(element, self.home, ("wallHeight",), {"wallHeight": "height"})
        self._level(element, wall)
        for name in ("wallAtStart", "wallAtEnd"):
            if wall[name] is not None and id(wall[name]) in self.walls:
                element.set(name, self.walls[id(wall[name])])
        for name in ("leftSideColor", "rightSideColor", "topColor"):
            _color(element, name, wall[name])
        for name in ("leftSideTexture", "rightSideTexture"):
            self._texture(element, wall[name], name)
        for name in ("leftSideBaseboard", "rightSideBaseboard"):
            board = wall[name]
            if board is not None:
                made = _element("baseboard", board, ("thickness", "height"))
                made.set("attribute", name)
                _color(made, "color", board["color"])
                self._texture(made, board["texture"], None)
                element.append(made)
        root.append(element)

    def _room(self, root: Element, room: JavaRecord) -> None:
        names = ("id", "name", "floorVisible", "ceilingVisible")
        element = _element("room", room, (*names, "floorShininess", "ceilingShininess"))
        self._level(element, room)
        for name in ("floorColor", "ceilingColor"):
            _color(element, name, room[name])
        for name in ("floorTexture", "ceilingTexture"):
            self._texture(element, room[name], name)
        for x, y in _items(room["points"]):
            ElementTree.SubElement(element, "point", x=_number(x), y=_number(y))
        root.append(element)

    def _level(self, element: Element, item: JavaRecord) -> None:
        if item["level"] is not None and id(item["level"]) in self.levels:
            element.set("level", self.levels[id(item["level"])])

    def _texture(self, element: Element, texture: JavaRecord | None, name: str | None) -> None:
        if texture is None:
            return
        names = ("name", "creator", "width", "height", "xOffset", "yOffset", "angle", "scale")
        made = _element("texture", texture, (*names, "leftToRightOriented", "fittingArea"))
        if name is not None:
            made.set("attribute", name)
        _content(made, "image", texture["image"])
        element.append(made)


def _numbered(items: Any, word: str) -> dict[int, str]:
    """Identifiers by the identity of the objects: the objects' own, else numbers."""
    return {id(item): _clean(item["id"] or f"{word}{n}") for n, item in enumerate(_items(items))}


def _in_order(items: Any, identifiers: dict[int, str]) -> list[tuple[JavaRecord, str]]:
    return [(item, identifiers[id(item)]) for item in _items(items)]


def _items(value: Any) -> list[Any]:
    """Elements of a list, also where it stands in one of Java's wrappers; [] for none."""
    while isinstance(value, JavaRecord):
        value = next((value[name] for name in ("list", "c", "a", "element") if value[name]), [])
        if isinstance(value, JavaRecord) and value.kind.startswith(_MODEL):
            return [value]
    return [] if value is None else list(value)


def _element(tag: str, item: JavaRecord, names: tuple[str, ...]) -> Element:
    element = Element(tag)
    _set(element, item, names)
    return element


def _set(
    element: Element,
    item: JavaRecord,
    names: tuple[str, ...],
    renamed: dict[str, str] | None = None,
) -> None:
    """Fields that are there, as attributes: of the same name but for those `renamed`."""
    for name in names:
        value = item[name]
        if value is None:
            continue
        key = (renamed or {}).get(name, name)
        if isinstance(value, bool):
            element.set(key, "true" if value else "false")
        elif isinstance(value, (int, float)):
            element.set(key, _number(value))
        else:
            element.set(key, _clean(value))


def _number(value: float) -> str:
    """A number as Java prints it: floats of the model have 32 bits."""
    return str(value) if isinstance(value, int) else str(np.float32(value))


def _color(element: Element, name: str, value: int | None) -> None:
    if value is not None:
        element.set(name, f"{int(value) & 0xFFFFFFFF:08X}")


def _content(element: Element, name: str, content: JavaRecord | None) -> None:
    """The archive's member that a piece of content names; nothing for content elsewhere."""
    url = content["url"] if isinstance(content, JavaRecord) else None
    file = url["file"] if isinstance(url, JavaRecord) else None
    if isinstance(file, str) and file.startswith(_CONTENT):
        element.set(name, _clean(file.removeprefix(_CONTENT)))


def _clean(text: Any) -> str:
    """Text without the characters that XML cannot hold."""
    if not isinstance(text, str):
        raise TypeError(f"{type(text).__name__} in place of a text")
    return "".join(one for one in text if one in "\t\n\r" or (one >= " " and not _is_odd(one)))


def _is_odd(one: str) -> bool:
    return "\ud800" <= one <= "\udfff" or one in "\ufffe\uffff"
