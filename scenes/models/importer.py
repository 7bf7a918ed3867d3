"""The import of one glTF, GLB or OBJ file: a building as it stands, a single object in a room."""

from __future__ import annotations

import math
import tempfile
from dataclasses import replace
from functools import partial
from pathlib import Path
from xml.etree.ElementTree import Element

import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from scenes.arrays import Float64Array
from scenes.color import REC709
from scenes.contract import Credit, Scene, SceneObject, load_scene, writing_scene
from scenes.errors import InputError
from scenes.importing.assembly import Camera, Draft, assemble, moved
from scenes.importing.categories import category_of
from scenes.importing.changes import Changes
from scenes.importing.credits import find_credit
from scenes.importing.daylight import daylight
from scenes.importing.objects import bounds_of, room_of, structural_kind
from scenes.importing.sandbox import Sandbox
from scenes.importing.shape import Emitter, Shape
from scenes.importing.textures import TextureStore, UnreadableImage
from scenes.importing.xml_elements import plugin
from scenes.models.gltf import read_gltf
from scenes.models.gltf_container import open_asset
from scenes.models.gltf_images import Images
from scenes.models.model import Glow, Model, Punctual
from scenes.models.obj import read_model
from scenes.models.options import ModelOptions
from scenes.models.showroom import showroom
from scenes.opened_files import OpenedFiles
from scenes.photometry import LUMEN
from scenes.reconstruction.orientation import up_from_geometry, upright
from scenes.reconstruction.raycast import RayCaster
from scenes.reconstruction.rooms import FoundRoom, find_rooms

LARGEST_OBJECT = 6.0  # metres; larger things without a room are scenes of their own
_SMALLEST_OBJECT = 0.02
_LARGEST_GUESS = 60.0  # up to which a thing without a room may well be in metres
_LEAST_SCENE, _LARGEST_SCENE = 1.5, 200.0  # metres, of what may hold rooms
_UNITS = {1.0: "metres", 0.01: "centimetres", 0.0254: "inches", 0.001: "millimetres"}
_TOUCHING = 0.02  # metres
_JOINED = (
    "table",
    "desk",
    "bed",
    "wardrobe",
    "shelf",
    "bookshelf",
    "cabinet",
    "chest",
    "plant",
    "sofa",
    "armchair",
)
_Y = np.array([0.0, 1.0, 0.0])
# Emission is candela per square metre, but many files mean "as bright as white paper" by 1.
_DISPLAY_LIKE = 50.0  # a file whose brightest surface stays below this is one of those
_DISPLAY_NITS = 1000.0


def import_model(
    path: Path, out: Path, scene_id: str, options: ModelOptions, opened: OpenedFiles
) -> Scene:
    """Import a `.gltf`, `.glb` or `.obj` file into the scene folder `out`.

    A file with a closed room in it, or larger than `LARGEST_OBJECT`, is a scene of its own;
    anything else is an object, put into a plain room with a window and a lamp. Raises
    `InputError` that names file and element for everything that cannot be used.
    """
    changes = Changes()
    opened.is_file(path)
    sandbox = Sandbox(opened, options.root)
    with writing_scene(out) as folder, tempfile.TemporaryDirectory() as unpacked:
        textures = TextureStore(folder / "textures", changes)
        if path.suffix.lower() == ".obj":
            model = read_model(path, sandbox, textures, changes)
        else:
            asset = open_asset(path, sandbox)
            images = Images(asset, Path(unpacked), changes)
            model = read_gltf(asset, images, textures, changes)
        if not model.shapes:
            raise InputError(f"{path}: holds no surfaces")
        area = _area_lights(model, textures, changes)
        draft = _placed(model, area, path, scene_id, options, opened, changes)
        for old, new in sandbox.moved:
            if old != new:
                changes.note("files were found under another path: {}", f"{old!r} as {new!r}")
        assemble(folder, draft, changes)
    return load_scene(out)


def _placed(
    model: Model,
    area: dict[str, Element],
    path: Path,
    scene_id: str,
    options: ModelOptions,
    opened: OpenedFiles,
    changes: Changes,
) -> Draft:
    """The model upright and in metres, with light, and in a room of its own if it has none."""
    up = _up(model, options)
    scale = _scale_of_rooms(model, up, options)
    alone = scale is None
    if scale is None:
        up = up if model.y_up or options.up != "auto" else _Y
        scale, alone = _scale_of_size(model, options, changes)
    _say_frame(up, scale, options, changes)
    frame = np.eye(4)
    frame[:3, :3] = scale * upright(up)
    around: list[Shape] = []
    views: list[Camera] = []
    if alone:
        low, high = bounds_of([shape.transformed(frame) for shape in model.shapes])
        room = showroom(low, high)
        frame = room.move @ frame
        views = room.cameras
        taken = {shape.id.lower() for shape in model.shapes}
        around = [_renamed(shape, taken) for shape in room.shapes]
        for old, new in zip(room.shapes, around, strict=True):
            if old.id in room.area:
                area = {**area, new.id: room.area[old.id]}
        changes.note("a single object was put into a plain room with a window and a lamp")
        if model.cameras:
            changes.note("cameras of a single object were left out")
    cameras = views or [moved(camera, frame, changes) for camera in model.cameras]
    emitters = [_punctual(light, frame) for light in model.lights]
    outdoors = alone or options.sky or not (emitters or area)
    if outdoors:
        emitters.append(daylight())
        if not alone and not options.sky:
            changes.note("the file has no light; sun, sky and ground were added")
    return Draft(
        scene_id,
        {"kind": model.kind, "file": path.name, "version": model.version},
        [shape.transformed(frame) for shape in model.shapes] + around,
        area,
        emitters,
        cameras,
        _credits(path, scene_id, model, options, alone, opened, changes),
        hint="" if alone else path.stem,
        grouping=partial(
            _objects,
            model.owners,
            frozenset(area),
            path.stem if alone else "",
            frozenset(shape.id for shape in model.shapes),
        ),
        ground=outdoors,
    )


def _up(model: Model, options: ModelOptions) -> Float64Array:
    """The axis that points up in the file, as a unit vector (3,)."""
    if options.up != "auto":
        return np.eye(3)["xyz".index(options.up)]
    if model.y_up:
        return _Y
    return up_from_geometry(np.concatenate([shape.mesh.corners for shape in model.shapes]), _Y)


def _scale_of_rooms(model: Model, up: Float64Array, options: ModelOptions) -> float | None:
    """Metres per unit such that closed rooms of usual height are found; None if there are none."""
    turn = upright(up)
    corners = np.concatenate([shape.mesh.corners for shape in model.shapes]) @ turn.T
    extent = float(np.max(np.ptp(corners.reshape(-1, 3), axis=0)))
    for scale in _UNITS if options.scale is None else (options.scale,):
        if not _LEAST_SCENE < scale * extent < _LARGEST_SCENE:
            continue
        eye = None
        if model.cameras:
            eye = scale * turn @ model.cameras[0].to_world[:3, 3]
        rooms = find_rooms(RayCaster(scale * corners), scale * corners, eye)
        if any(not room.guessed for room in rooms):
            return scale
    return None


def _scale_of_size(model: Model, options: ModelOptions, changes: Changes) -> tuple[float, bool]:
    """Metres per unit of a model without rooms, and whether it is a single object."""
    low, high = bounds_of(model.shapes)
    extent = float(np.max(high - low))
    if options.scale is not None:
        return options.scale, options.scale * extent <= LARGEST_OBJECT
    if extent < _SMALLEST_OBJECT:
        changes.note(
            f"an object of {extent:.3g} units was enlarged to 0.5 m (say otherwise with --scale)"
        )
        return 0.5 / extent, True
    if extent <= _LARGEST_GUESS:
        return 1.0, extent <= LARGEST_OBJECT
    for scale in _UNITS:
        if scale * extent <= LARGEST_OBJECT:
            return scale, True
    return 1.0, False


def _say_frame(up: Float64Array, scale: float, options: ModelOptions, changes: Changes) -> None:
    if up[2] != 1:
        name = "+" + "XYZ"[int(np.argmax(up))]
        changes.note(f"the scene was turned so that its {name} axis points up (Z)")
    if scale in _UNITS and scale != 1 and options.scale is None:
        changes.note(f"lengths were read as {_UNITS[scale]} (say otherwise with --scale)")


def _area_lights(model: Model, textures: TextureStore, changes: Changes) -> dict[str, Element]:
    """Emitters of glowing shapes. Luminance L in cd / m^2 is radiance L x LUMEN in our units."""
    if not model.glows:
        return {}
    brightest = max(float(np.array(glow.color) @ REC709) for glow in model.glows.values())
    unit = LUMEN
    if brightest < _DISPLAY_LIKE:
        unit = LUMEN * _DISPLAY_NITS
        changes.note(
            f"emission up to {brightest:.3g} is relative: 1 was read as {_DISPLAY_NITS:g} cd/m^2"
        )
    made = {}
    for shape in model.shapes:
        glow = model.glows.get(shape.id)
        if glow is not None:
            made[shape.id] = plugin(
                "emitter", "area", radiance=_radiance(glow, unit, textures, changes)
            )
    return made


def _radiance(
    glow: Glow, unit: float, textures: TextureStore, changes: Changes
) -> tuple[float, float, float] | Element:
    red, green, blue = (float(value) * unit for value in glow.color)
    if glow.image is not None:
        try:
            stored = textures.radiance(glow.image, (red, green, blue))
            return plugin("texture", "bitmap", filename=stored, raw=True, to_uv=glow.to_uv)
        except UnreadableImage as error:
            changes.note("damaged texture of a light, left out: {}", f"{glow.image.name} ({error})")
    return (red, green, blue)


def _punctual(light: Punctual, frame: Float64Array) -> Emitter:
    """Candela times LUMEN is radiant intensity, lux times LUMEN irradiance, in our units."""
    pose = frame @ light.pose
    axes = pose[:3, :3] / np.linalg.norm(pose[:3, :3], axis=0)
    place = (float(pose[0, 3]), float(pose[1, 3]), float(pose[2, 3]))
    way = -axes[:, 2]
    strength = np.array(light.color) * light.intensity * LUMEN
    rgb = (float(strength[0]), float(strength[1]), float(strength[2]))
    if light.kind == "directional":
        made = plugin("emitter", "directional", irradiance=rgb)
        made.append(Element("vector", {"name": "direction", "value": " ".join(map(str, way))}))
        return Emitter(made, ("directional",))
    if light.kind == "point":
        made = plugin("emitter", "point", intensity=rgb)
        made.append(Element("point", {"name": "position", "value": " ".join(map(str, place))}))
        return Emitter(made, ("point",), place)
    side = np.cross([0.0, 0, 1] if abs(way[2]) < 0.9 else [1.0, 0, 0], way)
    side /= np.linalg.norm(side)
    to_world = np.eye(4)
    to_world[:3, :3] = np.stack([side, np.cross(way, side), way], axis=1)
    to_world[:3, 3] = place
    outer = math.degrees(light.outer)
    made = plugin(
        "emitter",
        "spot",
        intensity=rgb,
        cutoff_angle=outer,
        beam_width=min(math.degrees(light.inner), 0.999 * outer),
        to_world=to_world,
    )
    return Emitter(made, ("spot",), place)


def _objects(
    owners: dict[str, tuple[str, ...]],
    shining: frozenset[str],
    alone: str,
    own: frozenset[str],
    shapes: list[Shape],
    rooms: list[FoundRoom],
    room_ids: list[str],
) -> tuple[SceneObject, ...]:
    """One object for each thing that the file names, structure shape by shape.

    A single object in a showroom comes with its file's name, `alone`: it is what that says, with
    all its parts. If that says nothing, so are the parts that say nothing either. `own` are
    the ids of the file's shapes.
    """
    groups: dict[str, list[Shape]] = {}
    kinds: dict[str, tuple[str, str, bool]] = {}  # category, name, is structure
    reach = _reach(owners)
    whole = category_of(alone)
    for shape in shapes:
        names = owners.get(shape.id, ())
        part = bool(alone) and shape.id in own
        structure = "" if part else structural_kind(shape, rooms)
        if structure:
            key, kind = shape.id, (structure, shape.name, True)
        else:
            key, category, name = _owner(names, shape, reach, len(owners))
            if part and (whole != "other" or category == "other"):
                key, category, name = "/", whole, alone
            kind = (
                "lamp" if shape.id in shining and category == "other" else category,
                name,
                False,
            )
        groups.setdefault(key, []).append(shape)
        if key not in kinds or kinds[key][0] == "other":
            kinds[key] = kind
    groups = _joined(groups, kinds)
    objects = []
    for key, members in groups.items():
        category, name, structure_flag = kinds[key]
        low, high = bounds_of(members)
        objects.append(
            SceneObject(
                members[0].id,
                name,
                category,
                tuple(shape.id for shape in members),
                (float(low[0]), float(low[1]), float(low[2])),
                (float(high[0]), float(high[1]), float(high[2])),
                structure_flag,
                room_of(0.5 * (low + high), low, rooms, room_ids),
            )
        )
    return tuple(objects)


def _joined(
    groups: dict[str, list[Shape]], kinds: dict[str, tuple[str, str, bool]]
) -> dict[str, list[Shape]]:
    """Things of one telling category that touch, such as a table's top and legs, as one."""
    target = {key: key for key in groups}
    for category in _JOINED:
        keys = [key for key in groups if kinds[key][0] == category and not kinds[key][2]]
        if not keys:
            continue
        bounds = np.array([bounds_of(groups[key]) for key in keys])
        low, high = bounds[:, 0] - _TOUCHING, bounds[:, 1] + _TOUCHING
        rows: list[int] = []
        columns: list[int] = []
        for row in range(len(keys)):
            meets = ((low[row] <= high) & (high[row] >= low)).all(axis=1)
            columns += np.nonzero(meets)[0].tolist()
            rows += [row] * int(meets.sum())
        graph = coo_matrix((np.ones(len(rows)), (rows, columns)), shape=(len(keys),) * 2)
        _, labels = connected_components(graph, directed=False)
        first: dict[int, str] = {}
        for key, label in zip(keys, labels.tolist(), strict=True):
            target[key] = first.setdefault(label, key)
    joined: dict[str, list[Shape]] = {}
    for key, members in groups.items():
        joined.setdefault(target[key], []).extend(members)
    return joined


def _reach(owners: dict[str, tuple[str, ...]]) -> dict[tuple[str, ...], int]:
    """How many shapes stand below each named thing."""
    reach: dict[tuple[str, ...], int] = {}
    for names in owners.values():
        for depth in range(1, len(names) + 1):
            reach[names[:depth]] = reach.get(names[:depth], 0) + 1
    return reach


def _owner(
    names: tuple[str, ...], shape: Shape, reach: dict[tuple[str, ...], int], total: int
) -> tuple[str, str, str]:
    """Key, category and name of the outermost thing with a telling name that is not everything;
    else of the innermost."""
    for depth in range(1, len(names) + 1):
        label = names[depth - 1].partition(":")[2]
        category = category_of(label)
        if category != "other" and (reach[names[:depth]] < total or depth == len(names)):
            return "/".join(names[:depth]), category, label
    label = names[-1].partition(":")[2] if names else shape.name
    key = "/".join(names) if names else shape.id
    return key, category_of(shape.name, shape.surface.name), label or shape.name


def _renamed(shape: Shape, taken: set[str]) -> Shape:
    name = shape.id
    while name.lower() in taken:
        name += "_"
    return replace(shape, id=name)


def _credits(
    path: Path,
    scene_id: str,
    model: Model,
    options: ModelOptions,
    alone: bool,
    opened: OpenedFiles,
    changes: Changes,
) -> tuple[Credit, ...]:
    author = options.author or model.author
    credit = find_credit(opened, scene_id, options.licence or model.licence, author, changes)
    if not alone:
        return (credit,)
    return (
        replace(credit, part=path.name),
        Credit("room", "plain room", "pbrnet", "CC0-1.0", "generated"),
    )
