"""Import of one Mitsuba scene of any version.

The file is read into a tree of nodes, upgraded to the names of version 0.6, translated to shapes,
emitters and cameras, and made upright and metric. The assembly that all importers share does the
rest. Houses of the PBRS release bring further tables, see `pbrs`.
"""

from __future__ import annotations

import re
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np

from pbrnet.scenes.contract import Credit, Scene, load_scene, writing_scene
from pbrnet.scenes.errors import InputError
from pbrnet.scenes.geometry.transforms import look_at
from pbrnet.scenes.importing.assembly import Draft, assemble
from pbrnet.scenes.importing.camera import Camera, transformed_camera
from pbrnet.scenes.importing.changes import Changes
from pbrnet.scenes.importing.credits import find_credit
from pbrnet.scenes.importing.frame import upright_metric_frame
from pbrnet.scenes.importing.light.daylight import daylight
from pbrnet.scenes.importing.light.plan import sky_for
from pbrnet.scenes.importing.materials.textures import TextureStore
from pbrnet.scenes.importing.objects import group_objects
from pbrnet.scenes.importing.sandbox import Sandbox
from pbrnet.scenes.importing.shape import Shape
from pbrnet.scenes.importing.shapes.sealing_shapes import completing_shapes
from pbrnet.scenes.importing.xml_elements import plugin
from pbrnet.scenes.mitsuba.emitters import Emitters, half_fov_x
from pbrnet.scenes.mitsuba.materials import Materials
from pbrnet.scenes.mitsuba.options import MitsubaOptions
from pbrnet.scenes.mitsuba.pbrs import (
    ReleaseCamera,
    ReleaseNode,
    find_release,
    match_rooms,
    nodes_of,
    objects_of_nodes,
    with_lamp_emitters,
    without_duplicates,
)
from pbrnet.scenes.mitsuba.reader import Node, read_tree, unresolved
from pbrnet.scenes.mitsuba.shapes import ShapeReader
from pbrnet.scenes.mitsuba.textures import Textures
from pbrnet.scenes.mitsuba.upgrade import upgrade
from pbrnet.scenes.mitsuba.values import Properties, Scope
from pbrnet.scenes.opened_files import OpenedFiles
from pbrnet.scenes.reconstruction.interior import find_interior

_MAX_SENSORS = 64
_SENSORS = ("sensor", "camera")
_MAX_SIZE = 8192
# Materials of Recommendation ITU-R P.2040, as Sionna names them
_RADIO = re.compile(r"(^|[^a-z])(itu[-_]|radio-material)")


def import_mitsuba(
    path: Path, out: Path, scene_id: str, options: MitsubaOptions, opened: OpenedFiles
) -> Scene:
    """Import a Mitsuba XML scene of any version into the scene folder `out`.

    Raises `InputError` that names file, line and element for everything that cannot be used.
    """
    opened.is_file(path)
    changes = Changes()
    given = options.parameter
    release = find_release(path, opened, changes)
    defaults = release.parameters if release else {}
    sandbox = Sandbox(opened, options.root, (*given.values(), *defaults.values()))
    root, version = read_tree(path, sandbox, given, changes, defaults)
    scope = Scope(sandbox, changes, tuple(int(part[:6]) for part in version.split(".")))
    upgrade(root, scope.version)
    _index(root, scope)
    with writing_scene(out) as folder:
        textures = Textures(scope, TextureStore(folder / "textures", changes))
        materials = Materials(scope, textures)
        shapes = ShapeReader(scope, materials, options.skip_missing).read(root.children)
        shapes = _visible(shapes, changes)
        if not shapes:
            raise InputError(f"{path}: the scene has no shapes")
        nodes: list[ReleaseNode] = []
        is_radio = _is_radio(root)
        if is_radio:
            options = replace(options, up="z" if options.up == "auto" else options.up)
            options = replace(options, scale=options.scale or 1.0)
            changes.note("materials of radio waves (ITU) are those of Sionna: Z is up, in metres")
        if release:
            shapes = without_duplicates(shapes, changes)
            nodes = nodes_of(shapes)
            shapes = with_lamp_emitters(shapes, nodes, release, path, changes)
            options = replace(options, up="y" if options.up == "auto" else options.up)
            options = replace(options, scale=options.scale or 1.0)
        if release and release.cameras:
            root.children = [node for node in root.children if node.tag not in _SENSORS]
            cameras = [_release_camera(camera, root) for camera in release.cameras]
        else:
            cameras = _cameras(root, scope)
        frame = upright_metric_frame(
            shapes, cameras, options, scope.changes, _default_up(root, scope.is_old)
        )
        shapes = [shape.transformed(frame) for shape in shapes]
        cameras = [transformed_camera(camera, frame, changes) for camera in cameras]
        if is_radio:
            corners = np.concatenate([shape.mesh.corners for shape in shapes])
            shapes += completing_shapes(find_interior(corners).completion, changes)
        emitters = Emitters(scope, textures, frame, daylight if release else None)
        area = {
            shape.id: emitters.area(shape.emitter) for shape in shapes if shape.emitter is not None
        }
        others = [
            made
            for node in root.children
            if (target := scope.resolve(node)).tag in ("emitter", "luminaire")
            and (made := emitters.world(target)) is not None
        ]
        others += sky_for(path, bool(area), others, options, changes)
        _report_dropped(root, scope)
        sandbox.note_relocated(changes)
        draft = Draft(
            scene_id,
            {"kind": "mitsuba", "file": path.name, "version": version},
            shapes,
            area,
            others,
            cameras,
            (_credit(path, scene_id, options, release is not None, opened, changes),),
            hint=path.parent.name,
            max_depth=_max_depth(root, scope),
            lamps=options.lamp_rule,
            grouping=partial(objects_of_nodes, nodes, release) if release else group_objects,
            parts_shells=not release,
            room_names=partial(match_rooms, nodes) if release else None,
            ground=release is not None and any("sun" in made.kinds for made in others),
        )
        assemble(folder, draft, changes)
    return load_scene(out)


def _is_radio(root: Node) -> bool:
    """Test whether the scene is one of Sionna, for radio waves: their axes and unit are fixed."""
    names = (f"{node.type} {node.attributes.get('id', '')}" for node in root.walk()
             if node.tag == "bsdf")  # fmt: skip
    return any(_RADIO.search(name) for name in names)


def _index(root: Node, scope: Scope) -> None:
    """Index every element by its id and its `<alias>`es."""
    for node in root.walk():
        name = node.attributes.get("id")
        if not name or node.tag == "ref":
            continue
        if node.tag == "alias":
            target = scope.by_id.get(name)
            if target is None:
                raise node.error(f"no element has the id {name!r}")
            scope.by_id[node.attributes.get("as", "")] = target
        elif name in scope.by_id:
            raise node.error(f"the id {name!r} is used twice; ids must be unique")
        else:
            scope.by_id[name] = node


def _visible(shapes: list[Shape], changes: Changes) -> list[Shape]:
    """Give emitting shapes with an invisible material a black one, so that they stay."""
    kept = []
    for shape in shapes:
        if shape.surface.invisible and shape.emitter is not None:
            black = plugin("bsdf", "diffuse", reflectance=(0.0, 0.0, 0.0))
            surface = replace(
                shape.surface, element=black, invisible=False, see_through=False, transmissive=False
            )
            shape = replace(shape, surface=surface)
            changes.note("the invisible material of an emitting shape was replaced by matt black")
        kept.append(shape)
    return kept


def _cameras(root: Node, scope: Scope) -> list[Camera]:
    """All perspective sensors whose parameters have values."""
    cameras: list[Camera] = []
    for child in root.children:
        node = scope.resolve(child) if child.tag == "ref" else child
        if node.tag not in _SENSORS:
            continue
        if node.type not in ("perspective", "thinlens", "perspective_rdist"):
            scope.changes.note("a sensor of unsupported type was left out: {}", repr(node.type))
            continue
        missing = sorted({name for part in node.walk() for text in part.attributes.values()
                          for name in unresolved(text)})  # fmt: skip
        if missing:
            scope.changes.note(
                "a sensor was left out because its parameters have no value: {}",
                ", ".join(f"${name}" for name in missing),
            )
            continue
        if len(cameras) >= _MAX_SENSORS:
            scope.changes.note(f"only the first {_MAX_SENSORS} sensors were kept")
            break
        cameras.append(_camera(node, len(cameras), scope))
    return cameras


def _camera(node: Node, number: int, scope: Scope) -> Camera:
    properties = Properties(node, scope)
    properties.ignore("id", "near_clip", "far_clip", "shutter_open", "shutter_close", "mode")
    if node.type != "perspective":
        properties.ignore("aperture_radius", "focus_distance", "kc")
        scope.changes.note("a lens was replaced by a pinhole camera: {}", node.type)
    properties.ignore("focus_distance", "animated")
    size = [1280, 720]
    for film in properties.nested("film"):
        inner = Properties(film, scope)
        size = [inner.whole("width", 768), inner.whole("height", 576)]
        crop = inner.whole("crop_width", 0)
        if crop:
            scope.changes.note("the crop window of a film was left out")
    width, height = (min(max(side, 1), _MAX_SIZE) for side in size)
    half = half_fov_x(properties, width, height)
    for name in ("principal_point_offset_x", "principal_point_offset_y", "shift_x", "shift_y"):
        if properties.number(name, 0.0) != 0:
            scope.changes.note("the shift of a camera's principal point was left out")
    matrix = properties.transform()
    properties.nested("sampler", "film")
    properties.report_unused()
    return Camera(node.attributes.get("id") or f"sensor_{number}", matrix, half, width, height)


def _release_camera(camera: ReleaseCamera, root: Node) -> Camera:
    try:
        pose = look_at(camera.eye, camera.eye + camera.towards, camera.up)
    except ValueError as error:
        raise root.error(str(error)) from error
    more = {"sector": camera.sector, "score": camera.score, "half_fov_y": camera.half_fov[1]}
    return Camera(camera.name, pose, camera.half_fov[0], 640, 480, camera.room, more)


def _default_up(root: Node, is_old: bool) -> tuple[float, float, float]:
    """Z for a sunsky of Mitsuba 3, whose zenith it is; else Y."""
    kinds = {node.type for node in root.children if node.tag == "emitter"}
    is_z = not is_old and kinds & {"sunsky", "timed_sunsky"}
    return (0.0, 0.0, 1.0) if is_z else (0.0, 1.0, 0.0)


def _credit(
    path: Path,
    scene_id: str,
    options: MitsubaOptions,
    release: bool,
    opened: OpenedFiles,
    changes: Changes,
) -> Credit:
    if not release:
        return find_credit(opened, scene_id, options.licence, options.author, changes)
    author = options.author or "SUNCG; prepared for Mitsuba by Zhang et al. (PBRS, 2017)"
    changes.note(
        "this house of the PBRS release comes from SUNCG; check the terms under which you have it "
        "before you share anything made from it"
    )
    return find_credit(opened, path.parent.name, options.licence, author, changes)


def _report_dropped(root: Node, scope: Scope) -> None:
    """Note the top-level elements that are not imported."""
    for node in root.children:
        if node.tag == "integrator" and node.type not in ("path", "volpath"):
            scope.changes.note("an integrator was replaced by path tracing: {}", repr(node.type))
        elif node.tag == "medium":
            scope.changes.note("participating media were left out")
        elif node.tag not in (
            "integrator", "bsdf", "texture", "shape", "emitter", "luminaire", "sensor", "camera",
            "ref", "alias", "film", "sampler", "rfilter", *("default", "include", "path"),
        ):  # fmt: skip
            scope.changes.note(
                "an unknown element was left out: {}", f"<{node.tag}> ({node.place})"
            )


def _max_depth(root: Node, scope: Scope) -> int:
    """The integrator's maximum path depth, from 2 to 65; 17 if the file sets none."""
    for node in root.children:
        if node.tag == "integrator":
            depth = Properties(node, scope).whole("max_depth", -1)
            if depth > 0:
                return min(max(depth, 2), 65)
    return 17
