"""Contents of `Home.xml` as dataclasses: centimetres, radians, plan y down, sRGB integers.

Names follow the DTD of the application. `None` means that the attribute is absent.
"""

from __future__ import annotations

from dataclasses import dataclass

from pbrnet.scenes.assets.piece import LightSource

Matrix = tuple[tuple[float, ...], ...]  # rows


@dataclass(frozen=True)
class Texture:
    """An image on a surface: `width` x `height` cm, rotated by `angle`, times `scale`.

    The offsets are fractions of the image's size.
    """

    image: str
    name: str
    width: float
    height: float
    x_offset: float = 0.0
    y_offset: float = 0.0
    angle: float = 0.0
    scale: float = 1.0
    left_to_right: bool = True
    fitting: bool = False
    creator: str = ""


@dataclass(frozen=True)
class Surface:
    """Finish of a side: `color` 0xAARRGGBB, `shininess` in [0, 1]."""

    color: int | None = None
    texture: Texture | None = None
    shininess: float = 0.0


@dataclass(frozen=True)
class Level:
    id: str
    name: str
    elevation: float
    floor_thickness: float
    height: float
    index: int
    visible: bool
    viewable: bool


@dataclass(frozen=True)
class Baseboard:
    thickness: float
    height: float
    surface: Surface


@dataclass(frozen=True)
class Wall:
    """A wall from start to end; `height_at_end` differs for sloping ones, `arc` for round ones."""

    id: str
    level: str | None
    start: tuple[float, float]
    end: tuple[float, float]
    thickness: float
    height: float | None
    height_at_end: float | None
    arc: float | None
    wall_at_start: str | None
    wall_at_end: str | None
    left: Surface
    right: Surface
    top_color: int | None
    left_baseboard: Baseboard | None = None
    right_baseboard: Baseboard | None = None


@dataclass(frozen=True)
class RoomShape:
    id: str
    level: str | None
    name: str
    points: tuple[tuple[float, float], ...]
    floor_visible: bool
    ceiling_visible: bool
    floor: Surface
    ceiling: Surface


@dataclass(frozen=True)
class NamedMaterial:
    """An override of one of a model's materials."""

    name: str
    key: str | None
    color: int | None
    texture: Texture | None
    shininess: float | None


@dataclass(frozen=True)
class Cut:
    """The part of the front of a door or window that is cut out of walls, as fractions."""

    shape: str | None  # SVG path in the unit square, y down; None: the whole front
    left: float = 0.0
    width: float = 1.0
    top: float = 0.0
    height: float = 1.0


@dataclass(frozen=True)
class Sash:
    """A leaf of a door or window: axis and width as fractions of the piece's size.

    `y` counts from its back; angles are radians in the piece, counter-clockwise from above, of the
    closed leaf and of the open one.
    """

    x: float
    y: float
    width: float
    start: float
    end: float


@dataclass(frozen=True)
class HomePiece:
    """A piece of furniture, a door or window (`cut`), or a lamp (`bulbs`)."""

    id: str
    kind: str  # name of the XML element
    name: str
    catalog_id: str
    creator: str
    level: str | None
    model: str | None
    x: float
    y: float
    elevation: float
    width: float
    depth: float
    height: float
    angle: float
    pitch: float = 0.0
    roll: float = 0.0
    mirrored: bool = False
    rotation: Matrix | None = None
    centered: bool = True
    hide_edges: bool = False
    color: int | None = None
    texture: Texture | None = None
    shininess: float | None = None
    materials: tuple[NamedMaterial, ...] = ()
    transformations: tuple[tuple[str, Matrix], ...] = ()
    staircase: str | None = None
    cut: Cut | None = None
    sashes: tuple[Sash, ...] = ()
    power: float = 0.0
    bulbs: tuple[LightSource, ...] = ()
    emissive_materials: tuple[str, ...] = ()  # names of the materials of a lamp that emit light


@dataclass(frozen=True)
class StoredCamera:
    attribute: str
    name: str
    lens: str
    x: float
    y: float
    z: float
    yaw: float
    pitch: float
    field_of_view: float
    time: int | None


@dataclass(frozen=True)
class Compass:
    north: float = 0.0
    longitude: float | None = None
    latitude: float | None = None
    time_zone: str = ""


@dataclass(frozen=True)
class Environment:
    ground_color: int = 0xA8A8A8
    ground_texture: Texture | None = None
    sky_texture: Texture | None = None
    photo_width: int = 400
    photo_height: int = 300


@dataclass(frozen=True)
class Home:
    name: str
    version: int
    wall_height: float
    properties: dict[str, str]
    compass: Compass
    environment: Environment
    cameras: tuple[StoredCamera, ...]
    levels: tuple[Level, ...]
    walls: tuple[Wall, ...]
    rooms: tuple[RoomShape, ...]
    pieces: tuple[HomePiece, ...]
