"""Renders of a scene in this process: one view, quick previews, the dollhouse.

The dollhouse view is an orthographic render under a constant sky, without ceilings and anything
above them.
"""

from __future__ import annotations

import math
import tempfile
from collections.abc import Sequence
from pathlib import Path
from xml.etree.ElementTree import Element, ElementTree

import defusedxml.ElementTree
import mitsuba as mi
import numpy as np
import shapely
from shapely.geometry import Polygon

from pbrnet.pipeline.cameras.settings import CameraParams, ViewParams
from pbrnet.pipeline.cameras.view_sampling import sample_cameras
from pbrnet.pipeline.channels import RGB
from pbrnet.pipeline.frames import stacked
from pbrnet.pipeline.images import Picture
from pbrnet.pipeline.params import Params
from pbrnet.pipeline.passes.denoise import denoise
from pbrnet.pipeline.passes.registry import render, settings_of
from pbrnet.pipeline.passes.settings import GroundTruthParams
from pbrnet.pipeline.photograph import photograph
from pbrnet.pipeline.render.scene import open_scene, set_variant
from pbrnet.pipeline.tonemap import to_bytes
from pbrnet.pipeline.views import ImageParams, View, as_matrix, camera_model, lens_of, look
from pbrnet.scenes.arrays import Float32Array
from pbrnet.scenes.color import encode_srgb
from pbrnet.scenes.contract import Room, Scene, load_scene
from pbrnet.scenes.formats.ply import read_ply, write_ply
from pbrnet.scenes.formats.scene_xml import check_scene_xml
from pbrnet.scenes.geometry.mesh import Mesh
from pbrnet.scenes.seeds import derive

_WIDTH = 640  # pixels
_SPP, _DEPTH = 16, 4
_ELEVATION, _AZIMUTH = math.radians(68), math.radians(-60)  # of the camera, seen from the centre
_MARGIN = 0.4  # metres around the rooms
_WALL_MARGIN = 0.02  # metres inside a room's outline that count as wall
_CUT = 0.15  # metres below a storey's lowest ceiling, above which items are removed
_BACKGROUND = np.array([246.0, 245.0, 241.0])
_SURROUNDINGS = ("ground", "outdoors", "tree", "house", "hedge")
_QUICK = GroundTruthParams(spp=16, block_spp=8, denoise="oidn", joint=False)  # colour alone
_QUICK_WIDTH = 320


def draw_dollhouse(scene: Scene) -> Picture:
    """Render the lowest storey with rooms from above at an angle, without ceilings."""
    set_variant("auto")
    lowest = min((room.floor_z for room in scene.rooms), default=scene_floor(scene))
    storey = [room for room in scene.rooms if room.floor_z < lowest + 1.0]
    cut = min((room.ceiling_z for room in storey), default=lowest + 2.5) - _CUT
    low, high = _extent(scene, lowest, cut)
    with tempfile.TemporaryDirectory(prefix="pbrnet-dollhouse-") as folder:
        path = _cutaway_scene(scene, cut, low, high, Path(folder))
        loaded = mi.load_file(str(path), optimize=False, parallel=False)
        image = np.asarray(mi.render(loaded, spp=_SPP, seed=0), dtype=np.float32)
        guides = np.asarray(mi.render(loaded, integrator=_guides(), spp=_SPP, seed=0))
    color, guides = image[..., :3], np.nan_to_num(guides).astype(np.float32)
    albedo, normal = np.clip(guides[..., -6:-3], 0, 1), guides[..., -3:]
    bands = {band: np.ascontiguousarray(color[..., index]) for index, band in enumerate(RGB)}
    clean = denoise(bands, np.ascontiguousarray(albedo), np.ascontiguousarray(normal))
    linear = stacked(clean)
    # Under a sky of radiance 1, radiance is about the reflectance: no exposure is needed.
    picture = to_bytes(encode_srgb(np.clip(linear, 0, 1)))
    # Antialiased edges are blended with the background.
    shown = np.clip(np.linalg.norm(normal, axis=-1, keepdims=True), 0, 1)
    return np.rint(shown * picture + (1 - shown) * _BACKGROUND).astype(np.uint8)


def quick_renders(scene: Scene, views: Sequence[View], count: int = 2) -> list[tuple[str, Picture]]:
    """Render up to `count` views, of different rooms where possible; return names and pictures.

    Views are sampled if `views` is empty; a scene without any view gives an empty list. 16 samples
    per pixel, denoised.
    """
    set_variant("auto")
    opened = open_scene(load_scene(scene.folder))
    params = Params(
        image=ImageParams(width=_QUICK_WIDTH, height=_QUICK_WIDTH * 3 // 4),
        cameras=CameraParams(
            views_per_room=1,
            views_per_scene=8,
            eye_height=1.55,
            eye_jitter=0.05,
            pitch=(),
            roll=(),
            framing="paper",
        ),
        groundtruth=_QUICK,
    )
    found = views or sample_cameras(opened, ViewParams(params.cameras, params.image), 0).views
    pictures, settings = [], settings_of(params, ["color"])
    for view in _best_views(found, count):
        seed = derive(0, view.view_id)
        channels, _ = render(opened, _resized(view), settings, seed)["color"]
        linear = stacked(channels).astype(np.float32)
        label = view.view_id if views else f"{view.room or 'scene'}, no view of the camera file"
        pictures.append((label, photograph(linear)))
    return pictures


def scene_floor(scene: Scene) -> float:
    """Return the lowest z of the scene's objects, in metres: its floor if it has no rooms."""
    near = [item for item in scene.objects if item.category not in _SURROUNDINGS]
    return min((item.bbox_min[2] for item in near), default=0.0)


def _best_views(views: Sequence[View], count: int) -> list[View]:
    best = sorted(views, key=lambda view: (-view.score, view.view_id))
    chosen: list[View] = []
    for view in best:
        if view.room not in {other.room for other in chosen}:
            chosen.append(view)
    chosen += [view for view in best if view not in chosen]
    return chosen[:count]


def _resized(view: View) -> View:
    scale = min(1.0, _QUICK_WIDTH / view.width)
    width, height = round(view.width * scale), max(1, round(view.height * scale))
    if view.is_panorama:
        width, height = 2 * (width // 2), width // 2
    return view.resized(width, height)


def _extent(scene: Scene, floor: float, cut: float) -> tuple[np.ndarray, np.ndarray]:
    """Return the lowest and highest corner (3,) of the region to show."""
    points = [(x, y) for room in scene.rooms for x, y in room.floor]
    if not points:
        near = [item for item in scene.objects if item.category not in _SURROUNDINGS]
        points = [corner[:2] for item in near for corner in (item.bbox_min, item.bbox_max)]
    flat = np.array(points or [(-2.0, -2.0), (2.0, 2.0)])
    return (
        np.array([*(flat.min(axis=0) - _MARGIN), floor]),
        np.array([*(flat.max(axis=0) + _MARGIN), cut]),
    )


def _cutaway_scene(
    scene: Scene, cut: float, low: np.ndarray, high: np.ndarray, folder: Path
) -> Path:
    """Write a copy of `scene.xml` under a constant sky, without shapes above `cut` or far away."""
    check_scene_xml(scene.xml)
    root: Element = defusedxml.ElementTree.parse(scene.xml).getroot()
    for node in [*root.findall("emitter"), *root.findall("sensor"), *root.findall("integrator")]:
        root.remove(node)
    for node in root.iter("string"):
        if node.get("name") == "filename":
            node.set("value", str((scene.folder / node.get("value", "")).resolve()))
    owner = {name: item for item in scene.objects for name in item.shapes}
    for shape in root.findall("shape"):
        item = owner.get(shape.get("id", ""))
        middle = None if item is None else 0.5 * np.add(item.bbox_min, item.bbox_max)
        outside = middle is not None and bool(((middle < low - 2) | (middle > high + 2))[:2].any())
        if item is not None and (
            item.category in ("ceiling", *_SURROUNDINGS) or item.bbox_min[2] >= cut or outside
        ):
            root.remove(shape)
            continue
        for emitter in shape.findall("emitter"):
            shape.remove(emitter)
        if item is not None and item.is_structure and item.bbox_max[2] > cut:
            _cut_open(shape, cut, scene.rooms, root, folder)
    for number, node in enumerate(_rendering(low, high)):
        root.insert(number, node)
    target = folder / "scene.xml"
    ElementTree(root).write(target, encoding="utf-8", xml_declaration=True)
    return target


def _cut_open(
    shape: Element, cut: float, rooms: Sequence[Room], root: Element, folder: Path
) -> None:
    """Remove the triangles of a mesh that lie wholly above `cut` over a room.

    The tops of walls are beside the rooms and stay.
    """
    file = next((item for item in shape.findall("string") if item.get("name") == "filename"), None)
    if file is None or shape.get("type") != "ply":
        return
    mesh = read_ply(Path(file.get("value", "")))
    x, y, _ = mesh.corners.mean(axis=1).T
    over = np.zeros(len(mesh.faces), dtype=bool)
    for room in rooms:
        over |= shapely.contains_xy(Polygon(room.floor).buffer(-_WALL_MARGIN), x, y)
    keep = (mesh.corners[:, :, 2].min(axis=1) < cut) | ~over
    if keep.all():
        return
    if not keep.any():
        root.remove(shape)
        return
    kept: Mesh = mesh.subset(keep)
    target = folder / f"{shape.get('id')}.ply"
    write_ply(target, kept)
    file.set("value", str(target))


def _rendering(low: np.ndarray, high: np.ndarray) -> Element:
    """Return integrator, sky, and an orthographic sensor that frames the box (3,) to (3,)."""
    flat = math.cos(_ELEVATION)
    back = np.array([flat * math.cos(_AZIMUTH), flat * math.sin(_AZIMUTH), math.sin(_ELEVATION)])
    side = np.array([-math.sin(_AZIMUTH), math.cos(_AZIMUTH), 0.0])
    up = np.cross(back, side)
    corners = np.array(np.meshgrid(*zip(low, high, strict=True))).reshape(3, -1).T
    half = 0.5 * np.ptp(np.stack([corners @ side, corners @ up], axis=1), axis=0)
    middle = 0.5 * (low + high)
    diagonal = float(np.linalg.norm(high - low))
    pose = np.eye(4)
    # Mitsuba's sensor looks along +z with +x to the left.
    pose[:3, 0], pose[:3, 1], pose[:3, 2] = -side * half[0], up * half[0], -back
    pose[:3, 3] = middle + (diagonal + 10.0) * back
    height = int(min(max(_WIDTH * half[1] / half[0], 200), 2 * _WIDTH))
    text = " ".join(f"{value:.9g}" for value in pose.ravel())
    found: Element = defusedxml.ElementTree.fromstring(f"""<scene>
        <integrator type="path">
            <integer name="max_depth" value="{_DEPTH}"/>
            <boolean name="hide_emitters" value="true"/>
        </integrator>
        <emitter type="constant"><rgb name="radiance" value="1"/></emitter>
        <sensor type="orthographic">
            <transform name="to_world"><matrix value="{text}"/></transform>
            <float name="far_clip" value="{2 * diagonal + 100:.6g}"/>
            <sampler type="multijitter"/>
            <film type="hdrfilm">
                <integer name="width" value="{_WIDTH}"/>
                <integer name="height" value="{height}"/>
                <string name="pixel_format" value="rgb"/>
                <rfilter type="box"/>
            </film>
        </sensor>
    </scene>""")
    return found


def _guides() -> object:
    return mi.load_dict({"type": "aov", "aovs": "albedo:albedo,normal:sh_normal"})


def view_at(
    eye: Sequence[float],
    target: Sequence[float],
    image: ImageParams | None = None,
    name: str = "view",
) -> View:
    """Return a view from `eye` towards `target`, metres, z up; `image` gives size and lens."""
    pose = look(eye, np.subtract(target, eye))
    return View(
        "scene",
        name,
        camera_to_world=as_matrix(pose),
        **camera_model(lens_of(image or ImageParams())),
    )


def render_view(scene: Scene | Path, view: View, params: Params | None = None) -> Float32Array:
    """Path-trace the colour of a view: float32 (H, W, 3), linear radiance.

    `scene` is a scene or its folder. `params.groundtruth` has samples, depth and denoiser,
    `params.seed` the seed, `params.farm.variant` Mitsuba's variant. Raises `InputError` for a
    scene that cannot be opened.
    """
    params = params or Params()
    set_variant(params.farm.variant)
    opened = open_scene(scene if isinstance(scene, Scene) else load_scene(Path(scene)))
    seed = derive(params.seed, view.view_id)
    channels, _ = render(opened, view, settings_of(params, ["color"]), seed)["color"]
    return stacked(channels).astype(np.float32)
