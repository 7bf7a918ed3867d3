"""RenderFormer's HDF5 files, one a room: triangles with materials, and the cameras in the room.

`triangles` (N, 3, 3), `vn` (N, 3, 3), `texture` (N, 13, 32, 32), `c2w` (V, 4, 4), `fov` (V,). The
room is moved and scaled into a box from -0.5 to 0.5, Z up; camera axes are x right, y up, z
backward; `fov` is the angle in degrees of a square picture as high as ours. Channels of a texture:
diffuse, specular, roughness, normal, emission; constant over a triangle, 0 in the half of the
square outside of it. Attributes say how to undo the scales.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import Any

import mitsuba as mi
import numpy as np
import shapely
import trimesh

from pbrnet.pipeline.export.parts import Advance, Format, Job, hdf5_file, library, scene_parts
from pbrnet.pipeline.export.room_mesh import Soup, cut_room, within_budget
from pbrnet.pipeline.export.rows import ViewRow
from pbrnet.pipeline.render import raycast
from pbrnet.pipeline.render.boxes import shape_points
from pbrnet.pipeline.render.scene import RenderScene, open_scene, set_variant
from pbrnet.pipeline.views import opengl_pose
from pbrnet.scenes.arrays import Float64Array, Int64Array
from pbrnet.scenes.color import luminance
from pbrnet.scenes.contract import Portal, Room, load_scene
from pbrnet.scenes.errors import InputError

TEXELS = 32
CHANNELS = 13
POWER = 20.0  # sum of emission x area in the box, about that of RenderFormer's own training scenes
_PROBE = 0.02  # metres in front of a triangle from which its material is looked up
_DIRECTIONS = 512  # towards the sky, for the light of a window
_ROUGHEST, _SMOOTHEST = 1.0, 0.01  # that RenderFormer knows


def _check(job: Job) -> None:
    for name in ("h5py", "fast_simplification"):
        library(name, "an export to RenderFormer")
    for scene in job.rows.scenes():
        if not (job.scenes / scene / "scene.json").is_file():
            raise InputError(
                f"{job.scenes / scene}: renderformer needs the scene's geometry, which is not "
                "there; make it with: pbrnet scenes, or name its folder with --data"
            )


def _write(job: Job, rows: Sequence[ViewRow], folder: Path, advance: Advance) -> None:
    set_variant()
    opened = open_scene(load_scene(job.scenes / rows[0].scene_id))
    meshes, lost = scene_meshes(opened)
    _, content = next(iter(job.rows.read(rows[:1], ("depth",))))
    height = content.images["depth"].shape[0]
    rooms: dict[str, list[ViewRow]] = {}
    for row in rows:
        rooms.setdefault(room_of(row, opened.scene.rooms).id, []).append(row)
    for room in opened.scene.rooms:
        views = rooms.get(room.id, [])
        if not views:
            continue
        soup = cut_room(meshes, room)
        portals = [one for one in opened.scene.portals if one.room == room.id and one.clear]
        windows = window_triangles(portals) if opened.lights.environment else np.zeros((0, 3, 3))
        if not len(soup):
            raise InputError(f"{opened.scene.folder}: the room {room.id} has no triangles")
        soup = within_budget(soup, job.options.triangles - len(windows))
        eye = np.mean([row.pose[:3, 3] for row in views], axis=0)
        soup, material = shaded(opened, soup, eye)
        light = _sky(opened, portals, len(windows))
        _save(folder / f"{room.id}.h5", soup, windows, material, light, views, height, lost)
        for _ in views:
            advance()


def room_of(row: ViewRow, rooms: Sequence[Room]) -> Room:
    """Return the room that a camera is in, or the nearest; `InputError` without rooms."""
    if not rooms:
        raise InputError(
            f"{row.scene_id}: renderformer writes one file per room, but scene.json has no rooms"
        )
    place = shapely.Point(row.pose[:2, 3])
    height = row.pose[2, 3]

    def away(room: Room) -> float:
        above = max(0.0, room.floor_z - height, height - room.ceiling_z)
        return float(shapely.Polygon(room.floor).distance(place)) + above

    return min(rooms, key=away)


def scene_meshes(opened: RenderScene) -> tuple[list[tuple[int, Float64Array, Int64Array]], int]:
    """Return shape, vertices and faces of every shape, and how many could not be meshed.

    Clear panes are left out. Spheres, disks and cylinders become triangles; instances of groups
    cannot be meshed.
    """
    found, lost = [], 0
    for number, shape in enumerate(opened.geometry.shapes):
        if opened.geometry.clear[number]:
            continue
        if shape.is_mesh():
            vertices = np.array(shape.vertex_positions_buffer(), np.float64).reshape(-1, 3)
            faces = np.array(shape.faces_buffer(), np.int64).reshape(-1, 3)
        else:
            made = _primitive(shape)
            if made is None:
                lost += 1
                continue
            vertices, faces = made
        if len(faces):
            found.append((number, vertices, faces))
    return found, lost


def _primitive(shape: Any) -> tuple[Float64Array, Int64Array] | None:
    kind = shape.class_name()
    if kind == "Rectangle":
        return shape_points(shape), np.array([[0, 1, 2], [0, 2, 3]])
    made = {
        "Sphere": lambda: trimesh.creation.icosphere(subdivisions=1),
        "Disk": lambda: trimesh.creation.cylinder(1.0, 1e-3, sections=16),
        "Cylinder": lambda: trimesh.creation.cylinder(1.0, segment=[[0, 0, 0], [0, 0, 1]]),
    }.get(kind)
    if made is None:
        return None
    mesh = made()
    matrix = np.array(mi.traverse(shape)["to_world"].matrix, dtype=np.float64).reshape(4, 4)
    return mesh.vertices @ matrix[:3, :3].T + matrix[:3, 3], np.asarray(mesh.faces, np.int64)


def window_triangles(portals: Sequence[Portal]) -> Float64Array:
    """Return the openings as triangles (2 each, 3, 3) whose normals point into the room."""
    found = []
    for portal in portals:
        corners = np.array(portal.polygon, dtype=np.float64)
        outward = np.cross(corners[1] - corners[0], corners[2] - corners[0])
        if outward @ np.array(portal.normal) > 0:
            corners = corners[::-1]
        found += [corners[[0, i, i + 1]] for i in range(1, len(corners) - 1)]
    return np.array(found).reshape(-1, 3, 3)


def shaded(opened: RenderScene, soup: Soup, eye: Float64Array) -> tuple[Soup, Float64Array]:
    """Return the material of each triangle (N, 10): diffuse, specular, roughness, emission.

    It is looked up by a ray on the triangle's middle, from the side of `eye`, else from the other;
    where another surface is in the way, the shape's mean is taken. Emission is that of the side
    which emits; triangles that emit at their back alone are turned round.
    """
    centres, normals = soup.corners.mean(axis=1), soup.normals
    towards = ((eye - centres) * normals).sum(axis=1) >= 0
    opened.apply_materials()
    sides = {front: _probed(opened, soup, centres, normals, front) for front in (True, False)}
    front, back = sides[True], sides[False]
    near, far = (np.where(towards[:, None], *pair) for pair in ((front, back), (back, front)))
    found = np.where(np.isnan(near[:, :1]), far, near)
    light = np.fmax(front[:, 7:], back[:, 7:])
    turned = np.nan_to_num(front[:, 7]) < np.nan_to_num(back[:, 7])
    found[:, 7:] = light
    for shape in np.unique(soup.shape[np.isnan(found[:, 0])]):
        same = soup.shape == shape
        missing = same & np.isnan(found[:, 0])
        known = found[same & ~missing]
        plain = np.array([*[0.5] * 3, *[0.0] * 3, 1.0, *[0.0] * 3])
        found[missing] = known.mean(axis=0) if len(known) else plain
    found[:, 3:6] = np.clip(found[:, 3:6], 0, 1)
    found[:, :3] = np.clip(found[:, :3], 0, 1 - found[:, 3:6])  # together at most 1
    found[:, 6] = np.clip(found[:, 6], _SMOOTHEST, _ROUGHEST)
    corners = np.where(turned[:, None, None], soup.corners[:, ::-1], soup.corners)
    return Soup(corners, soup.shape), found


def _probed(
    opened: RenderScene, soup: Soup, centres: Float64Array, normals: Float64Array, front: bool
) -> Float64Array:
    """Return the material at the front or the back of each triangle, NaN where it is not met."""
    directions = -normals if front else normals
    origins = centres - _PROBE * directions
    emitting = np.array([shape.is_emitter() for shape in opened.geometry.shapes], dtype=bool)
    hits = raycast.surfaces(opened.geometry, origins, directions)
    values, _ = opened.table.values(opened.geometry, hits, origins, directions)
    _, _, light = raycast.emitted_radiance(opened.geometry, origins, directions, emitting)
    material = np.concatenate(
        [
            hits.reflectance * (1 - values.metalness[:, None]),
            np.repeat(values.specular.mean(axis=1, keepdims=True), 3, axis=1),
            values.roughness[:, None],
            np.repeat(luminance(light)[:, None], 3, axis=1),
        ],
        axis=1,
    )
    material[hits.shape != soup.shape] = np.nan
    return material


def _sky(opened: RenderScene, portals: Sequence[Portal], count: int) -> Float64Array:
    """Return the mean luminance of the sky through each triangle of the openings, (count,)."""
    if not count:
        return np.zeros(0)
    number = np.arange(_DIRECTIONS) + 0.5
    radius, angle = np.sqrt(number / _DIRECTIONS), np.pi * (1 + math.sqrt(5)) * number
    local = np.stack([radius * np.cos(angle), radius * np.sin(angle), np.sqrt(1 - radius**2)], -1)
    found: list[float] = []
    for portal in portals:
        outward = np.array(portal.normal, dtype=np.float64)
        across = np.cross(outward, np.eye(3)[np.abs(outward).argmin()])
        across /= np.linalg.norm(across)
        axes = np.stack([across, np.cross(outward, across), outward])
        light = raycast.environment_radiance(opened.lights.environment, local @ axes)
        found += [float(luminance(light).mean())] * (len(portal.polygon) - 2)
    return np.array(found)


def _save(
    path: Path,
    soup: Soup,
    windows: Float64Array,
    material: Float64Array,
    light: Float64Array,
    views: Sequence[ViewRow],
    height: int,
    lost: int,
) -> None:
    """Write a room's file."""
    corners = np.concatenate([soup.corners, windows])
    panes = np.zeros((len(windows), 10))
    panes[:, 6], panes[:, 7:] = _ROUGHEST, light[:, None]
    material = np.concatenate([material, panes])
    low, high = corners.reshape(-1, 3).min(axis=0), corners.reshape(-1, 3).max(axis=0)
    centre, size = (low + high) / 2, float((high - low).max())
    triangles = (corners - centre) / size
    whole = Soup(triangles, np.zeros(len(triangles), np.int64))
    power = float((material[:, 7] * whole.areas).sum())
    scale = POWER / power if power > 0 else 1.0
    c2w = np.stack([opengl_pose(row.pose) for row in views])
    c2w[:, :3, 3] = (c2w[:, :3, 3] - centre) / size
    fov = [math.degrees(2 * math.atan(height / (2 * row.intrinsics[1, 1]))) for row in views]
    packed = {"compression": "gzip", "compression_opts": 4, "track_times": False}
    with hdf5_file(path) as file:
        file.create_dataset("triangles", data=triangles.astype(np.float32), **packed)
        normals = np.repeat(whole.normals[:, None], 3, axis=1)
        file.create_dataset("vn", data=normals.astype(np.float32), **packed)
        file.create_dataset("texture", data=textures(material, scale), **packed)
        file.create_dataset("c2w", data=c2w.astype(np.float32), **packed)
        file.create_dataset("fov", data=np.array(fov, np.float32), **packed)
        file.attrs["views"] = [row.view_id for row in views]
        file.attrs["centre"], file.attrs["metres"] = centre, size
        file.attrs["emission_scale"], file.attrs["shapes_lost"] = scale, lost


def textures(material: Float64Array, scale: float) -> Any:
    """Return textures, float16 (N, 13, 32, 32), of materials (N, 10); emission times `scale`."""
    flat = np.repeat([[0.5, 0.5, 1.0]], len(material), axis=0)  # the normal map of no bumps
    emission = np.minimum(material[:, 7:] * scale, np.finfo(np.float16).max)
    values = np.concatenate([material[:, :7], flat, emission], axis=1).astype(np.float16)
    column, row = np.meshgrid(np.arange(TEXELS), np.arange(TEXELS), indexing="ij")
    return values[:, :, None, None] * (column + row <= TEXELS).astype(np.float16)


FORMAT = Format(
    "renderformer",
    "RenderFormer: triangles, materials and cameras of each room",
    ("depth",),
    partial(scene_parts, _write),
    check=_check,
    uses=("triangles",),
)
