"""Import of one PBRT scene of version 3 or 4.

`parser` reads directives, `reader` interprets them, `shapes`, `materials`, `textures` and `lights`
translate what they describe; the assembly that all importers share finds rooms and openings.
"""

from __future__ import annotations

import math
from pathlib import Path
from xml.etree.ElementTree import Element

import numpy as np

from pbrnet.scenes.contract import Scene, load_scene, writing_scene
from pbrnet.scenes.errors import InputError
from pbrnet.scenes.importing.assembly import Draft, assemble
from pbrnet.scenes.importing.camera import Camera, transformed_camera
from pbrnet.scenes.importing.changes import Changes
from pbrnet.scenes.importing.credits import find_credit
from pbrnet.scenes.importing.frame import upright_metric_frame
from pbrnet.scenes.importing.light.plan import sky_for
from pbrnet.scenes.importing.materials.textures import TextureStore
from pbrnet.scenes.importing.sandbox import Sandbox
from pbrnet.scenes.importing.shape import Emitter, Shape
from pbrnet.scenes.opened_files import OpenedFiles
from pbrnet.scenes.pbrt.lights import Lights
from pbrnet.scenes.pbrt.materials import Materials
from pbrnet.scenes.pbrt.options import PbrtOptions
from pbrnet.scenes.pbrt.reader import PbrtScene, read_scene
from pbrnet.scenes.pbrt.shapes import ShapeReader
from pbrnet.scenes.pbrt.textures import Textures
from pbrnet.scenes.pbrt.values import Context

_MAX_SIZE = 8192  # pixels of a stored view's side
_DEFAULT_FILM = (1280, 720)


def import_pbrt(
    path: Path, out: Path, scene_id: str, options: PbrtOptions, opened: OpenedFiles
) -> Scene:
    """Import a PBRT scene of version 3 or 4 into the scene folder `out`.

    Raises `InputError` that names file and line for everything that cannot be used.
    """
    opened.is_file(path)
    changes = Changes()
    context = Context(Sandbox(opened, options.root), changes)
    scene = read_scene(path, context)
    with writing_scene(out) as folder:
        store = TextureStore(folder / "textures", changes)
        textures = Textures(context, store)
        materials = Materials(context, textures)
        shapes = ShapeReader(context, materials, options.skip_missing).read(scene.shapes)
        if not shapes:
            raise InputError(f"{path}: the scene has no shapes")
        cameras = cameras_of(scene, changes)
        frame = upright_metric_frame(shapes, cameras, options, changes)
        shapes = [shape.transformed(frame) for shape in shapes]
        cameras = [transformed_camera(camera, frame, changes) for camera in cameras]
        lights = Lights(context, textures, store, frame)
        area, emitters = _emitters(path, scene, shapes, lights, options, changes)
        context.sandbox.note_relocated(changes)
        draft = Draft(
            scene_id,
            {"kind": "pbrt", "file": path.name},
            shapes,
            area,
            emitters,
            cameras,
            (find_credit(opened, scene_id, options.licence, options.author, changes),),
            hint=path.parent.name,
            max_depth=_max_depth(scene),
            lamps=options.lamp_rule,
        )
        assemble(folder, draft, changes)
    return load_scene(out)


def _emitters(
    path: Path,
    scene: PbrtScene,
    shapes: list[Shape],
    lights: Lights,
    options: PbrtOptions,
    changes: Changes,
) -> tuple[dict[str, Element], list[Emitter]]:
    """Area emitters by shape id, and all others; sun and sky if there is none."""
    translated: dict[int, Element | None] = {}
    area = {}
    for shape in shapes:
        if shape.emitter is None:
            continue
        if id(shape.emitter) not in translated:
            translated[id(shape.emitter)] = lights.area(shape.emitter)
        radiance = translated[id(shape.emitter)]
        if radiance is not None:
            area[shape.id] = radiance
    emitters = [
        made
        for light, to_world in scene.lights
        if (made := lights.world(light, to_world)) is not None
    ]
    return area, [*emitters, *sky_for(path, bool(area), emitters, options, changes)]


def cameras_of(scene: PbrtScene, changes: Changes) -> list[Camera]:
    """The file's perspective camera as a stored view; none, with a note, for other cameras."""
    camera, film = scene.camera, scene.film
    if camera is None:
        return []
    if camera.type not in ("perspective", "realistic"):
        changes.note("a camera without perspective projection was left out: {}", camera.type[:40])
        return []
    size = _DEFAULT_FILM
    if film is not None:
        size = (film.whole("xresolution", size[0]), film.whole("yresolution", size[1]))
    width, height = (min(max(side, 1), _MAX_SIZE) for side in size)
    aspect = camera.number("frameaspectratio", width / height)
    if not 0.01 < aspect < 100:
        raise camera.error("the aspect ratio of the image must be from 0.01 to 100")
    fov = camera.number("fov", 2 * camera.number("halffov", 45.0))
    if camera.type == "realistic":
        changes.note("a camera with lenses was replaced by a pinhole camera of 50 degrees")
        camera.ignore(*camera.names())
        fov = 50.0
    if not 0.1 <= fov < 179.5:
        raise camera.error(f"the field of view is {fov:g} degrees; it must be from 0.1 to 179.5")
    across = max(aspect, 1.0)
    window = camera.numbers("screenwindow")
    if window is not None and len(window) == 4 and window[1] > window[0]:
        across = 0.5 * float(window[1] - window[0])
        if abs(window[1] + window[0]) > 1e-6 or abs(window[3] + window[2]) > 1e-6:
            changes.note("the shift of a camera's principal point was left out")
    if camera.number("lensradius", 0.0) > 0:
        changes.note("a lens was replaced by a pinhole camera")
    camera.ignore("focaldistance", "shutteropen", "shutterclose")
    camera.report_unused()
    half = math.atan(math.tan(math.radians(fov) / 2) * across)
    # pbrt's x axis points to the right, Mitsuba's to the left.
    pose = scene.camera_to_world @ np.diag([-1.0, 1, 1, 1])
    return [Camera("camera", pose, half, width, height)]


def _max_depth(scene: PbrtScene) -> int:
    """The maximum path depth as Mitsuba counts it, from 2 to 65; 17 if the file sets none."""
    if scene.integrator is None or "maxdepth" not in scene.integrator:
        return 17
    return min(max(scene.integrator.whole("maxdepth", 16) + 1, 2), 65)
