"""Parser of `Home.xml`: checks every attribute and notes elements that it does not support."""

from __future__ import annotations

import math
import re
from collections import Counter
from dataclasses import replace
from pathlib import Path
from xml.etree.ElementTree import Element, ParseError

from defusedxml import ElementTree
from defusedxml.common import DefusedXmlException

from pbrnet.scenes.assets.piece import LightSource
from pbrnet.scenes.errors import InputError
from pbrnet.scenes.importing.changes import Changes
from pbrnet.scenes.sweethome.home import (
    Baseboard,
    Compass,
    Cut,
    Environment,
    Home,
    HomePiece,
    Level,
    Matrix,
    NamedMaterial,
    RoomShape,
    Sash,
    StoredCamera,
    Surface,
    Texture,
    Wall,
)

NEWEST = 7500  # the newest version whose elements this module knows
_MAX_ELEMENTS = 500_000
_MAX_ITEMS = 20_000  # walls, rooms, pieces
_MAX_POINTS = 5_000  # of one room
_FAR = 1e6  # cm: largest coordinate
_THINNEST = 0.5  # cm: thinner walls become sheets of this thickness, as in the application
_FURNITURE = ("pieceOfFurniture", "doorOrWindow", "light", "shelfUnit")
_DEPTH = 32  # of nested groups
# Known nested elements, used or not.
_NESTED = ("property", "texture", "material", "transformation", "lightSource",
          "lightSourceMaterial", "sash", "shelf", "baseboard", "point", "textStyle", "text",
          "backgroundImage", "printedLevel", "camera", "observerCamera", *_FURNITURE,
          "furnitureGroup")  # fmt: skip
# Known elements that have no equivalent in a scene; ignored silently.
_IGNORED = ("property", "furnitureVisibleProperty", "print", "backgroundImage")
_REPORTED = {
    "polyline": "polylines on the plan were left out",
    "label": "text labels were left out",
    "dimensionLine": "dimension lines were left out",
}


class _Attributes:
    """Attributes of one element, converted to numbers, flags and colours."""

    def __init__(self, element: Element, path: Path) -> None:
        self._element, self._path = element, path

    def error(self, name: str, value: object, wanted: str) -> InputError:
        label = self.text("id") or self.text("name")
        return InputError(
            f"{self._path}: Home.xml: <{self._element.tag}{' ' + repr(label) if label else ''}>: "
            f"{name}={value!r} is not {wanted}"
        )

    def text(self, name: str, default: str = "") -> str:
        return str(self._element.get(name, default))

    def optional_text(self, name: str) -> str | None:
        return self._element.get(name)

    def number(self, name: str, default: float | None = None, limit: float = _FAR) -> float:
        text = self._element.get(name)
        if text is None:
            if default is None:
                raise self.error(name, text, "given, and must be")
            return default
        try:
            value = float(text)
        except ValueError:
            raise self.error(name, text, "a number") from None
        if not math.isfinite(value) or abs(value) > limit:
            raise self.error(name, text, f"a number between -{limit:g} and {limit:g}")
        return value

    def optional_number(self, name: str, limit: float = _FAR) -> float | None:
        return None if self._element.get(name) is None else self.number(name, limit=limit)

    def size(self, name: str) -> float:
        value = self.number(name)
        if value < 0:
            raise self.error(name, value, "a size of 0 or more")
        return value

    def flag(self, name: str, default: bool) -> bool:
        return self.text(name, "true" if default else "false") == "true"

    def color(self, name: str) -> int | None:
        text = self._element.get(name)
        if text is None:
            return None
        try:
            return int(text, 16) & 0xFFFFFFFF
        except ValueError:
            raise self.error(name, text, "a colour AARRGGBB") from None

    def matrix(self, name: str, rows: int, columns: int) -> Matrix | None:
        text = self._element.get(name)
        if text is None:
            return None
        try:
            values = [float(item) for item in text.split()]
        except ValueError:
            values = []
        if len(values) != rows * columns or not all(
            math.isfinite(value) and abs(value) <= _FAR for value in values
        ):
            raise self.error(name, text, f"{rows * columns} numbers")
        return tuple(tuple(values[row * columns : (row + 1) * columns]) for row in range(rows))


class _Reader:
    def __init__(self, path: Path, changes: Changes, version: int) -> None:
        self.path, self.changes, self.version = path, changes, version
        self.hidden: Counter[str] = Counter()

    def attributes(self, element: Element) -> _Attributes:
        return _Attributes(element, self.path)

    def texture(self, element: Element | None) -> Texture | None:
        if element is None:
            return None
        get = self.attributes(element)
        width, height = get.number("width", -1.0), get.number("height", -1.0)
        scale = get.number("scale", 1.0, 1e4)
        if get.text("image") == "":
            self.changes.note("textures without an image were left out: {}", get.text("name"))
            return None
        return Texture(
            image=get.text("image"),
            name=get.text("name"),
            # -1 x -1 marks textures of models: 1 m a side, as in the application.
            width=width if width > 0 else 100.0,
            height=height if height > 0 else 100.0,
            x_offset=get.number("xOffset", 0.0),
            y_offset=get.number("yOffset", 0.0),
            angle=get.number("angle", 0.0),
            scale=scale if scale > 0 else 1.0,
            left_to_right=get.flag("leftToRightOriented", True),
            fitting=get.flag("fittingArea", False),
            creator=get.text("creator"),
        )

    def textures(self, element: Element) -> dict[str, Texture]:
        made = {}
        for child in element.findall("texture"):
            texture = self.texture(child)
            if texture is not None:
                made[child.get("attribute", "")] = texture
        return made

    def surface(
        self, get: _Attributes, side: str, texture: Texture | None, color: str = "Color"
    ) -> Surface:
        shininess = get.number(f"{side}Shininess", 0.0)
        return Surface(get.color(side + color), texture, min(max(shininess, 0.0), 1.0))

    def level(self, element: Element) -> Level:
        get = self.attributes(element)
        return Level(
            id=get.text("id"),
            name=get.text("name"),
            elevation=get.number("elevation"),
            floor_thickness=get.size("floorThickness"),
            height=get.size("height"),
            index=int(get.number("elevationIndex", -1.0)),
            visible=get.flag("visible", True),
            viewable=get.flag("viewable", True),
        )

    def wall(self, element: Element) -> Wall:
        get = self.attributes(element)
        textures = self.textures(element)
        left = self.surface(get, "leftSide", textures.get("leftSideTexture"))
        right = self.surface(get, "rightSide", textures.get("rightSideTexture"))
        boards = {
            child.get("attribute", ""): self.baseboard(child, own)
            for child, own in (
                (child, left if child.get("attribute") == "leftSideBaseboard" else right)
                for child in element.findall("baseboard")
            )
        }
        arc = get.optional_number("arcExtent", 2 * math.pi)
        start, end = ((get.number(f"x{side}"), get.number(f"y{side}")) for side in ("Start", "End"))
        thickness = get.size("thickness")
        if thickness < _THINNEST:
            self.changes.note("walls drawn as lines became sheets of 5 mm: {}", get.text("id"))
        return Wall(
            id=get.text("id"),
            level=get.optional_text("level"),
            start=start,
            end=end,
            thickness=max(thickness, _THINNEST),
            height=get.optional_number("height"),
            height_at_end=get.optional_number("heightAtEnd"),
            arc=arc or None,
            wall_at_start=get.optional_text("wallAtStart"),
            wall_at_end=get.optional_text("wallAtEnd"),
            left=left,
            right=right,
            top_color=get.color("topColor"),
            left_baseboard=boards.get("leftSideBaseboard"),
            right_baseboard=boards.get("rightSideBaseboard"),
        )

    def baseboard(self, element: Element, side: Surface) -> Baseboard:
        get = self.attributes(element)
        color, texture = get.color("color"), self.texture(element.find("texture"))
        # A baseboard without colour and texture has the finish of its wall.
        surface = side if color is None and texture is None else Surface(color, texture)
        return Baseboard(get.size("thickness"), get.size("height"), surface)

    def room(self, element: Element, number: int) -> RoomShape:
        get = self.attributes(element)
        textures = self.textures(element)
        points = [self.attributes(point) for point in element.findall("point")]
        if len(points) > _MAX_POINTS:
            raise get.error("point", len(points), f"a room of at most {_MAX_POINTS:,} points")
        return RoomShape(
            id=get.text("id") or f"room-{number}",
            level=get.optional_text("level"),
            name=get.text("name").strip(),
            points=tuple((point.number("x"), point.number("y")) for point in points),
            floor_visible=get.flag("floorVisible", True),
            ceiling_visible=get.flag("ceilingVisible", True),
            floor=self.surface(get, "floor", textures.get("floorTexture")),
            ceiling=self.surface(get, "ceiling", textures.get("ceilingTexture")),
        )

    def pieces(self, element: Element, level: str | None, depth: int) -> list[HomePiece]:
        """Return the visible pieces of an element; members of groups have absolute positions."""
        get = self.attributes(element)
        if not get.flag("visible", True):
            self.hidden[get.text("name") or element.tag] += 1
            return []
        if element.tag == "furnitureGroup":
            if depth > _DEPTH:
                raise get.error("depth", depth, f"at most {_DEPTH} groups inside each other")
            inner = get.optional_text("level") or level
            return [
                piece
                for child in element
                if child.tag in (*_FURNITURE, "furnitureGroup")
                for piece in self.pieces(child, inner, depth + 1)
            ]
        return [self.piece(element, get, level)]

    def piece(self, element: Element, get: _Attributes, level: str | None) -> HomePiece:
        rotation = get.matrix("modelRotation", 3, 3)
        centered = True
        if self.version < 5500 or get.text("modelCenteredAtOrigin") == "false":
            centered = rotation is None
        opening = element.tag == "doorOrWindow" or get.flag("doorOrWindow", False)
        staircase = get.optional_text("staircaseCutOutShape")
        flags = int(get.number("modelFlags", 0.0))
        return HomePiece(
            id=get.text("id"),
            kind=element.tag,
            name=get.text("name").strip(),
            catalog_id=get.text("catalogId"),
            creator=get.text("creator").strip(),
            level=get.optional_text("level") or level,
            model=get.optional_text("model") or None,
            x=get.number("x"),
            y=get.number("y"),
            elevation=get.number("elevation", 0.0),
            width=get.size("width"),
            depth=get.size("depth"),
            height=get.size("height"),
            angle=get.number("angle", 0.0),
            pitch=get.number("pitch", 0.0),
            roll=get.number("roll", 0.0),
            mirrored=get.flag("modelMirrored", False),
            rotation=rotation,
            centered=centered,
            hide_edges=bool(flags & 2),
            color=get.color("color"),
            texture=self.texture(element.find("texture")),
            shininess=get.optional_number("shininess"),
            materials=tuple(self.material(child) for child in element.findall("material")),
            transformations=tuple(
                (child.get("name", ""), matrix)
                for child in element.findall("transformation")
                if (matrix := self.attributes(child).matrix("matrix", 3, 4)) is not None
            ),
            staircase=staircase if staircase and staircase.lower() != "false" else None,
            cut=self.cut(get) if opening else None,
            sashes=tuple(self.sash(child) for child in element.findall("sash")),
            power=min(max(get.number("power", 0.5), 0.0), 1.0) if element.tag == "light" else 0.0,
            bulbs=tuple(self.bulb(child) for child in element.findall("lightSource")),
            emissive_materials=tuple(
                child.get("name", "") for child in element.findall("lightSourceMaterial")
            ),
        )

    def material(self, element: Element) -> NamedMaterial:
        get = self.attributes(element)
        return NamedMaterial(
            name=get.text("name"),
            key=get.optional_text("key"),
            color=get.color("color"),
            texture=self.texture(element.find("texture")),
            shininess=get.optional_number("shininess"),
        )

    def cut(self, get: _Attributes) -> Cut:
        return Cut(
            shape=get.optional_text("cutOutShape"),
            left=get.number("wallLeft", 0.0),
            width=get.number("wallWidth", 1.0),
            top=get.number("wallTop", 0.0),
            height=get.number("wallHeight", 1.0),
        )

    def sash(self, element: Element) -> Sash:
        get = self.attributes(element)
        names = ("xAxis", "yAxis", "width", "startAngle", "endAngle")
        return Sash(*(get.number(name, 0.0) for name in names))

    def bulb(self, element: Element) -> LightSource:
        get = self.attributes(element)
        color = get.color("color")
        return LightSource(
            get.number("x"),
            get.number("y"),
            get.number("z"),
            0xFFFFFF if color is None else color,
            get.optional_number("diameter"),
        )

    def camera(self, element: Element) -> StoredCamera:
        get = self.attributes(element)
        time = get.optional_text("time")
        if time is not None and not time.lstrip("-").isdigit():
            raise get.error("time", time, "milliseconds since 1970")
        milliseconds = None if time is None else int(time)
        if milliseconds is not None and abs(milliseconds) > 2**53:
            raise get.error("time", time, "milliseconds since 1970")
        return StoredCamera(
            attribute=get.text("attribute"),
            name=get.text("name").strip(),
            lens=get.text("lens", "PINHOLE"),
            x=get.number("x"),
            y=get.number("y"),
            z=get.number("z"),
            yaw=get.number("yaw"),
            pitch=get.number("pitch"),
            field_of_view=get.number("fieldOfView"),
            time=milliseconds,
        )

    def environment(self, element: Element | None) -> Environment:
        if element is None:
            return Environment()
        get = self.attributes(element)
        textures = self.textures(element)
        color = get.color("groundColor")
        sizes = [int(min(max(get.number(name, 400.0), 16), 8192))
                 for name in ("photoWidth", "photoHeight")]  # fmt: skip
        return Environment(
            ground_color=Environment.ground_color if color is None else color,
            ground_texture=textures.get("groundTexture"),
            sky_texture=textures.get("skyTexture"),
            photo_width=sizes[0],
            photo_height=sizes[1],
        )

    def compass(self, element: Element | None) -> Compass:
        if element is None:
            return Compass()
        get = self.attributes(element)
        latitude = get.optional_number("latitude", math.pi / 2 + 1e-6)
        return Compass(
            north=get.number("northDirection", 0.0),
            longitude=get.optional_number("longitude", 2 * math.pi),
            latitude=latitude,
            time_zone=get.text("timeZone"),
        )


def read_home(path: Path, text: bytes, changes: Changes) -> Home:
    """Parse `Home.xml`; `InputError` names the element and attribute that cannot be used."""
    if text.count(b"<") > 2 * _MAX_ELEMENTS:
        raise InputError(f"{path}: Home.xml: more than {_MAX_ELEMENTS:,} elements")
    try:
        root = ElementTree.fromstring(text)
    except (ParseError, ValueError, LookupError) as error:
        kind = "is refused" if isinstance(error, DefusedXmlException) else "is damaged"
        raise InputError(f"{path}: Home.xml {kind}: {error}") from None
    if root.tag != "home":
        raise InputError(f"{path}: Home.xml: the root is <{root.tag}>, not <home>")
    top = _Attributes(root, path)
    version = int(top.number("version", 5300.0))
    if version > NEWEST:
        changes.note(
            f"the home was saved by a newer version ({version}) than known here ({NEWEST}); "
            "what it added is left out"
        )
    reader = _Reader(path, changes, version)
    counts = Counter(child.tag for child in root)
    for tag in ("wall", "room", "level", *_FURNITURE, "furnitureGroup"):
        if counts[tag] > _MAX_ITEMS:
            raise InputError(f"{path}: Home.xml: {counts[tag]:,} <{tag}>; at most {_MAX_ITEMS:,}")
    pieces: list[HomePiece] = []
    for child in root:
        if child.tag in (*_FURNITURE, "furnitureGroup"):
            pieces += reader.pieces(child, None, 0)
            if len(pieces) > _MAX_ITEMS:
                raise InputError(f"{path}: Home.xml: more than {_MAX_ITEMS:,} pieces")
    known = {"wall", "room", "level", "camera", "observerCamera", "environment", "compass",
             *_FURNITURE, "furnitureGroup", *_IGNORED, *_REPORTED}  # fmt: skip
    for tag, sentence in _REPORTED.items():
        if counts[tag]:
            changes.note(f"{sentence} ({counts[tag]})")
    unknown = Counter({tag: count for tag, count in counts.items() if tag not in known})
    for child in root:
        if child.tag in known:
            unknown.update(one.tag for one in child.iter() if one.tag not in (child.tag, *_NESTED))
    for tag in sorted(unknown):
        changes.note("unknown elements were left out: {}", f"<{tag}> ({unknown[tag]})")
    for name, count in sorted(reader.hidden.items()):
        times = f"{count} x " if count > 1 else ""
        changes.note("pieces that are hidden in the home were left out: {}", f"{times}{name}")
    properties = {
        child.get("name", ""): child.get("value", "") for child in root.findall("property")
    }
    cameras = [reader.camera(child) for child in root if child.tag in ("camera", "observerCamera")]
    for number, camera in enumerate(cameras):
        if not camera.name:
            cameras[number] = replace(camera, name=f"{camera.attribute or 'camera'}")
    return Home(
        name=re.split(r"[\\/]", top.text("name"))[-1],  # often a whole path
        version=version,
        wall_height=top.number("wallHeight", 250.0),
        properties=properties,
        compass=reader.compass(root.find("compass")),
        environment=reader.environment(root.find("environment")),
        cameras=tuple(cameras),
        levels=tuple(reader.level(child) for child in root.findall("level")),
        walls=tuple(reader.wall(child) for child in root.findall("wall")),
        rooms=tuple(reader.room(child, n) for n, child in enumerate(root.findall("room"))),
        pieces=tuple(pieces),
    )
