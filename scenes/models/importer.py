"""Import of one model file: a building as it is, or a single object in a plain room.

A reader turns the file into a `Model`; everything after that is the same for all formats: unit
and up axis, lights in radiometric units, daylight, grouping into objects, and the assembly.

To add a format, write a module with a `ModelReader` and add its line to `options.READERS`.
"""

from __future__ import annotations

import math
import re
import tempfile
from copy import deepcopy
from dataclasses import replace
from functools import partial
from pathlib import Path
from pkgutil import resolve_name
from typing import Protocol
from xml.etree.ElementTree import Element

import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from pbrnet.scenes.arrays import Float64Array, as_triple
from pbrnet.scenes.color import REC709
from pbrnet.scenes.contract import Credit, Scene, SceneObject, load_scene, writing_scene
from pbrnet.scenes.errors import InputError
from pbrnet.scenes.importing.assembly import Draft, assemble
from pbrnet.scenes.importing.camera import Camera, transformed_camera
from pbrnet.scenes.importing.categories import category_of, has_structural_name, own_name
from pbrnet.scenes.importing.changes import Changes
from pbrnet.scenes.importing.credits import find_credit
from pbrnet.scenes.importing.light.daylight import daylight
from pbrnet.scenes.importing.materials.textures import (
    TextureStore,
    UnreadableImage,
    is_encoded,
    read_radiance,
)
from pbrnet.scenes.importing.names import extended
from pbrnet.scenes.importing.objects import room_of, shape_category, structure_category
from pbrnet.scenes.importing.sandbox import Sandbox, model_root
from pbrnet.scenes.importing.shape import (
    Emitter,
    Shape,
    bounds_of,
    directional_light,
    make_object,
    point_light,
    spot_light,
)
from pbrnet.scenes.importing.shapes.doubled_faces import with_doubled_faces_apart
from pbrnet.scenes.importing.shapes.opaque_panes import with_clear_windows
from pbrnet.scenes.importing.shapes.panes import with_named_glass
from pbrnet.scenes.importing.shapes.sealing_shapes import completing_shapes
from pbrnet.scenes.importing.shapes.uncut_walls import with_cut_walls
from pbrnet.scenes.importing.xml_elements import plugin
from pbrnet.scenes.models.floors import missing_floor
from pbrnet.scenes.models.model import Emission, Model, PunctualLight
from pbrnet.scenes.models.options import READERS, ModelOptions
from pbrnet.scenes.models.pieces import UNKNOWN, Pieces, split_unnamed, without_misleading_names
from pbrnet.scenes.models.placement import place_model
from pbrnet.scenes.models.restored import restore
from pbrnet.scenes.models.scans import note_baked_light
from pbrnet.scenes.models.showroom import showroom
from pbrnet.scenes.opened_files import OpenedFiles
from pbrnet.scenes.photometry import LUMEN
from pbrnet.scenes.reconstruction.interior import Interior
from pbrnet.scenes.reconstruction.orientation import upright
from pbrnet.scenes.reconstruction.room_index import RoomIndex
from pbrnet.scenes.reconstruction.rooms import FoundRoom
from pbrnet.scenes.reconstruction.scale_clues import unit_name

_WORD = re.compile("[a-z]+")
_TOUCH_DISTANCE = 0.02  # metres
# Categories of which shapes that touch are one object, such as a table's top and legs.
_MERGED_CATEGORIES = (
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
# Emission is defined in candela per square metre, but many files use 1 for a bright display.
_MAX_RELATIVE = 50.0  # a file whose brightest surface stays below this does so
_RELATIVE_UNIT = 1000.0  # candela per square metre

_BLACK = 0.001  # of white, linear: the brightest of an image that is black
_FARTHEST = 1e30  # units; what lies farther out is no number of single precision


class ModelReader(Protocol):
    """Reads a model file.

    Files beside `path` are found through `sandbox`, images are stored in `textures`, embedded
    images may be unpacked into the temporary folder `unpacked`, and everything that is left out
    is noted in `changes`. Raises `InputError` that names file and element for damaged files.
    """

    def __call__(
        self, path: Path, sandbox: Sandbox, textures: TextureStore, unpacked: Path, changes: Changes
    ) -> Model: ...


def import_model(
    path: Path, out: Path, scene_id: str, options: ModelOptions, opened: OpenedFiles
) -> Scene:
    """Import a model file with a suffix in `READERS` into the scene folder `out`.

    A file that has a closed room, or is larger than `LARGEST_OBJECT`, is a scene of its own. Any
    other file is a single object, placed in a plain room with a window and a lamp. Raises
    `InputError` that names file and element for everything that cannot be used.
    """
    changes = Changes()
    opened.is_file(path)
    sandbox = Sandbox(opened, options.root or model_root(opened))
    with writing_scene(out) as folder, tempfile.TemporaryDirectory() as unpacked:
        textures = TextureStore(folder / "textures", changes)
        reader: ModelReader = resolve_name(READERS[path.suffix.lower()])
        model = reader(path, sandbox, textures, Path(unpacked), changes)
        if not model.shapes:
            raise InputError(f"{path}: the file has no surfaces")
        for shape in model.shapes:
            if np.abs(shape.mesh.vertices).max(initial=0.0) > _FARTHEST:
                raise InputError(
                    f"{path}: {shape.name!r:.80} lies too far out for any unit; repair it"
                )
        if model.up and model.unit:
            axis = np.eye(3)["xyz".index(model.up)]
            model.shapes += missing_floor(model.shapes, axis, model.unit, changes)
        model.emissions = _without_black(model.emissions)
        if not _is_restored(folder, model, path, scene_id, options, textures, sandbox, changes):
            area = _area_lights(model, textures, changes)
            draft = _draft(model, area, path, scene_id, options, opened, changes)
            sandbox.note_relocated(changes)
            assemble(folder, draft, changes)
    return load_scene(out)


def _is_restored(
    folder: Path,
    model: Model,
    path: Path,
    scene_id: str,
    options: ModelOptions,
    textures: TextureStore,
    sandbox: Sandbox,
    changes: Changes,
) -> bool:
    """Write the scene that the file itself describes; False if there is none, or it is unwanted."""
    if model.described is None or replace(options, root=None) != ModelOptions():
        return False
    frame = np.eye(4)
    frame[:3, :3] = (model.unit or 1.0) * upright(np.eye(3)["xyz".index(model.up or "z")])
    emitters = [_punctual_emitter(light, frame) for light in model.lights]
    area = _area_lights(model, textures, changes, absolute=True)
    return restore(folder, scene_id, model, frame, area, emitters, textures, sandbox, path, changes)


def _draft(
    model: Model,
    area: dict[str, Element],
    path: Path,
    scene_id: str,
    options: ModelOptions,
    opened: OpenedFiles,
    changes: Changes,
) -> Draft:
    """The model upright and in metres, with light, and in a plain room if it has none."""
    placement = place_model(model, path.stem, options)
    is_single = placement.kind == "object"
    for doubt in placement.doubts:
        changes.note(doubt)
    _note_frame(placement.up, placement.scale, model, options, changes)
    frame = np.eye(4)
    frame[:3, :3] = placement.scale * upright(placement.up)
    added: list[Shape] = []
    views: list[Camera] = []
    if is_single:
        low, high = bounds_of([shape.transformed(frame) for shape in model.shapes])
        room = showroom(low, high)
        frame, views = room.move @ frame, room.cameras
        added = _with_unused_ids(room.shapes, model)
        for old, new in zip(room.shapes, added, strict=True):
            if old.id in room.area:
                area = {**area, new.id: room.area[old.id]}
        changes.note("a single object was placed in a plain room with a window and a lamp")
        if model.cameras:
            changes.note("cameras of a single object were left out")
    cameras = views or [transformed_camera(camera, frame, changes) for camera in model.cameras]
    if placement.interior is not None:
        completion = completing_shapes(placement.interior.completion, changes)
        added = _with_unused_ids(completion, model)
    emitters = [_punctual_emitter(light, frame) for light in model.lights]
    shapes = with_named_glass([shape.transformed(frame) for shape in model.shapes], changes)
    shapes = with_doubled_faces_apart(shapes, model.emissions.keys(), changes)
    node_paths, unknown = model.node_paths, frozenset[str]()
    if not is_single:
        note_baked_light(shapes, changes)
        shapes = with_cut_walls(shapes, changes)
        shapes = with_clear_windows(shapes, added, area.keys(), changes)
        pieces, node_paths = _split(shapes, node_paths, placement.interior, changes)
        shapes, unknown = pieces.shapes, frozenset(pieces.piece)
        area = _area_of_pieces(area, pieces)
    outdoors = is_single or options.sky or model.outdoors
    if outdoors:
        emitters.append(daylight())
    source = {"kind": model.kind, "file": path.name, "version": model.version}
    grouping = partial(
        _objects,
        node_paths,
        unknown,
        frozenset(area),
        path.stem if is_single else "",
        frozenset(shape.id for shape in model.shapes),
    )
    return Draft(
        scene_id,
        {**source, "placement": placement.summary},
        shapes + added,
        area,
        emitters,
        cameras,
        _credits(path, scene_id, model, options, is_single, opened, changes),
        hint="" if is_single else path.stem,
        grouping=grouping,
        ground=outdoors,
        photometric=True,
        sky_if_dark=not outdoors,
        lamps=options.lamp_rule,
    )


def _split(
    shapes: list[Shape],
    node_paths: dict[str, tuple[str, ...]],
    interior: Interior | None,
    changes: Changes,
) -> tuple[Pieces, dict[str, tuple[str, ...]]]:
    """Shapes and names without misleading names; large unnamed meshes are taken apart."""
    if interior is not None:
        shapes, node_paths = without_misleading_names(shapes, node_paths, interior.floors)
    pieces = split_unnamed(shapes, node_paths)
    if pieces.piece:
        changes.note(
            "large meshes without telling names were split by connected parts; those that are "
            f"no part of the building are objects of category {UNKNOWN!r}"
        )
    return pieces, {**node_paths, **{id_: (f":{name}",) for id_, name in pieces.piece.items()}}


def _note_frame(
    up: Float64Array, scale: float, model: Model, options: ModelOptions, changes: Changes
) -> None:
    if up[2] != 1:
        name = "+" + "XYZ"[int(np.argmax(up))]
        changes.note(f"the scene was turned so that its {name} axis points up (Z)")
    if options.scale is None and not math.isclose(scale, model.unit or 1):
        stated = f", though the file states {model.unit:g} m" if model.unit else ""
        changes.note(f"lengths were read as {unit_name(scale)}{stated} (change it with --scale)")


def _without_black(emissions: dict[str, Emission]) -> dict[str, Emission]:
    """The emissions whose image is not black, as exporters write it for what emits nothing.

    Radiance may be in a large unit, so that any but 0 shines.
    """
    images = {emission.image for emission in emissions.values() if emission.image is not None}
    black = set()
    for image in images:
        try:
            limit = _BLACK if is_encoded(image) else 0.0
            if read_radiance(image).max(initial=0.0) <= limit:
                black.add(image)
        except UnreadableImage:
            continue  # reported where it is stored
    return {id_: each for id_, each in emissions.items() if each.image not in black}


def _area_lights(
    model: Model, textures: TextureStore, changes: Changes, absolute: bool = False
) -> dict[str, Element]:
    """Area emitters by shape id; luminance L in cd/m^2 is radiance L x LUMEN in our units.

    Unless the unit is `absolute`, faint emission is taken for relative.
    """
    if not model.emissions:
        return {}
    brightest = max(
        float(np.array(emission.color) @ REC709) for emission in model.emissions.values()
    )
    unit = LUMEN
    if brightest < _MAX_RELATIVE and not absolute:
        unit = LUMEN * _RELATIVE_UNIT
        changes.note(
            f"emission up to {brightest:.3g} is relative: 1 was read as {_RELATIVE_UNIT:g} cd/m^2"
        )
    made = {}
    for shape in model.shapes:
        emission = model.emissions.get(shape.id)
        if emission is not None:
            made[shape.id] = plugin(
                "emitter", "area", radiance=_radiance(emission, unit, textures, changes)
            )
    return made


def _radiance(
    emission: Emission, unit: float, textures: TextureStore, changes: Changes
) -> tuple[float, float, float] | Element:
    red, green, blue = (float(value) * unit for value in emission.color)
    if emission.image is not None:
        try:
            stored = textures.radiance(emission.image, (red, green, blue))
            return plugin("texture", "bitmap", filename=stored, raw=True, to_uv=emission.to_uv)
        except UnreadableImage as error:
            changes.note(
                "damaged emission texture was left out: {}", f"{emission.image.name} ({error})"
            )
    return (red, green, blue)


def _punctual_emitter(light: PunctualLight, frame: Float64Array) -> Emitter:
    """An emitter of Mitsuba in metres, Z up.

    Candela times LUMEN is radiant intensity, and lux times LUMEN is irradiance, in our units.
    """
    pose = frame @ light.pose
    axes = pose[:3, :3] / np.linalg.norm(pose[:3, :3], axis=0)
    place = as_triple(pose[:3, 3])
    direction = -axes[:, 2]
    strength = np.array(light.color) * light.intensity * LUMEN
    rgb = as_triple(strength)
    if light.kind == "directional":
        return directional_light(direction, rgb)
    if light.kind == "point":
        return point_light(place, rgb)
    return spot_light(place, direction, rgb, math.degrees(light.outer), math.degrees(light.inner))


def _area_of_pieces(area: dict[str, Element], pieces: Pieces) -> dict[str, Element]:
    """Area emitters by shape id, also of pieces of shapes that shine."""
    gone = set(pieces.origin.values()) - {shape.id for shape in pieces.shapes}
    made = {id_: emitter for id_, emitter in area.items() if id_ not in gone}
    for id_, origin in pieces.origin.items():
        if origin in area:
            made[id_] = deepcopy(area[origin])
    return made


def _objects(
    node_paths: dict[str, tuple[str, ...]],
    unknown: frozenset[str],
    emitting: frozenset[str],
    single_name: str,
    own_ids: frozenset[str],
    shapes: list[Shape],
    rooms: list[FoundRoom],
    room_ids: list[str],
) -> tuple[SceneObject, ...]:
    """Group shapes into objects by the file's nodes; structure is one object for each shape.

    A single object in a plain room has the name of its file, `single_name` (else ""). If this
    name tells a category, all its shapes are one object of it; otherwise only the shapes without
    a category of their own are. `own_ids` are the ids of the file's shapes, `emitting` of those
    that emit light, `unknown` of pieces of meshes without telling names.
    """
    groups: dict[str, list[Shape]] = {}
    kinds: dict[str, tuple[str, str, bool]] = {}  # category, name, is structure
    shape_counts = _shape_counts(node_paths)
    collections = _collections(node_paths, shapes)
    whole = category_of(single_name)
    index = RoomIndex(rooms)
    for shape in shapes:
        names = node_paths.get(shape.id, ())
        part = bool(single_name) and shape.id in own_ids
        structure = "" if part else structure_category(shape, index)
        if structure == "structure" and category_of(shape.name) in ("door", "window"):
            structure = category_of(shape.name)
        if structure:
            key, kind = shape.id, (structure, shape.name, True)
        else:
            key, category, name = _owning_node(
                names, shape, shape_counts, collections, len(node_paths)
            )
            if part and (whole != "other" or category == "other"):
                key, category, name = "/", whole, single_name
            if category == "other" and shape.id in emitting:
                category = "lamp"
            elif category == "other" and shape.id in unknown:
                category = UNKNOWN
            kind = (category, name, False)
        groups.setdefault(key, []).append(shape)
        if key not in kinds or kinds[key][0] == "other":
            kinds[key] = kind
    groups = _merge_touching(groups, kinds)
    objects = []
    for key, members in groups.items():
        category, name, structure_flag = kinds[key]
        low, high = bounds_of(members)
        room = room_of(0.5 * (low + high), low, index, room_ids)
        objects.append(make_object(members[0].id, name, category, members, structure_flag, room))
    return tuple(objects)


def _merge_touching(
    groups: dict[str, list[Shape]], kinds: dict[str, tuple[str, str, bool]]
) -> dict[str, list[Shape]]:
    """Merge groups that touch and have the same one of `_MERGED_CATEGORIES`.

    `kinds` holds category, name and whether it is structure of each group.
    """
    target = {key: key for key in groups}
    for category in _MERGED_CATEGORIES:
        keys = [key for key in groups if kinds[key][0] == category and not kinds[key][2]]
        if not keys:
            continue
        bounds = np.array([bounds_of(groups[key]) for key in keys])
        low, high = bounds[:, 0] - _TOUCH_DISTANCE, bounds[:, 1] + _TOUCH_DISTANCE
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
    merged: dict[str, list[Shape]] = {}
    for key, members in groups.items():
        merged.setdefault(target[key], []).extend(members)
    return merged


def _shape_counts(node_paths: dict[str, tuple[str, ...]]) -> dict[tuple[str, ...], int]:
    """The number of shapes below each node."""
    shape_counts: dict[tuple[str, ...], int] = {}
    for names in node_paths.values():
        for depth in range(1, len(names) + 1):
            shape_counts[names[:depth]] = shape_counts.get(names[:depth], 0) + 1
    return shape_counts


def _owning_node(
    names: tuple[str, ...],
    shape: Shape,
    shape_counts: dict[tuple[str, ...], int],
    collections: frozenset[tuple[str, ...]],
    total: int,
) -> tuple[str, str, str]:
    """Key, category and name of the node that a shape belongs to.

    The outermost node whose name tells a category, that does not contain all `total` shapes and is
    none of the `collections`, else the innermost node.
    """
    for depth in range(1, len(names) + 1):
        label = names[depth - 1].partition(":")[2]
        category = category_of(own_name(label, shape.surface.name))
        if names[:depth] in collections:
            continue
        if category != "other" and (shape_counts[names[:depth]] < total or depth == len(names)):
            return "/".join(names[:depth]), category, label
    label = names[-1].partition(":")[2] if names else shape.name
    key = "/".join(names) if names else shape.id
    if has_structural_name(label):
        return key, category_of(shape.name), label
    return key, shape_category(shape), label or shape.name


def _collections(
    node_paths: dict[str, tuple[str, ...]], shapes: list[Shape]
) -> frozenset[tuple[str, ...]]:
    """Nodes that hold several things of the kind that their names tell: `Chairs` of `Chair0` ...

    The things have the node's name, without further words, and stand apart: parts of one thing, by
    material for instance, may be called so, too, but share its place.
    """
    members: dict[tuple[str, ...], dict[tuple[str, ...], list[Shape]]] = {}
    for shape in shapes:
        names = node_paths.get(shape.id, ())
        for depth in range(1, len(names)):
            if _is_one_of(names[depth], names[depth - 1]):
                members.setdefault(names[:depth], {}).setdefault(names[: depth + 1], []).append(
                    shape
                )
    found = set()
    for node, things in members.items():
        bounds = np.array([bounds_of(each) for each in things.values()])
        low, high = bounds[:, 0], bounds[:, 1]
        meets = ((low[:, None] <= high) & (high[:, None] >= low)).all(axis=2).sum(axis=1) > 1
        if len(bounds) > 1 and meets.mean() < 0.5:
            found.add(node)
    return frozenset(found)


def _is_one_of(label: str, group: str) -> bool:
    """Test whether nodes' names tell one category, and the first has no word beyond the second."""
    words, known = (
        {word.removesuffix("s") for word in _WORD.findall(one.partition(":")[2].lower())}
        for one in (label, group)
    )
    category = category_of(label.partition(":")[2])
    return (
        category != "other" and words <= known and category == category_of(group.partition(":")[2])
    )


def _with_unused_ids(shapes: list[Shape], model: Model) -> list[Shape]:
    """`shapes`, their ids extended until the model has none of them, even if case is ignored."""
    taken = {shape.id.lower() for shape in model.shapes}
    return [replace(shape, id=extended(shape.id, taken)) for shape in shapes]


def _credits(
    path: Path,
    scene_id: str,
    model: Model,
    options: ModelOptions,
    is_single: bool,
    opened: OpenedFiles,
    changes: Changes,
) -> tuple[Credit, ...]:
    author = options.author or model.author
    credit = find_credit(opened, scene_id, options.licence or model.licence, author, changes)
    if not is_single:
        return (credit,)
    return (
        replace(credit, part=path.name),
        Credit("room", "plain room", "pbrnet", "CC0-1.0", "generated"),
    )
