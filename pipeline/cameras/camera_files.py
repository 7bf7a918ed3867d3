"""Camera file of a scene: sampled views, walks, trajectories, overlapping sets, stereo partners.

Each part has random generators of its own, so that no part changes the views of another.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import shapely
from scipy.sparse import csr_array
from shapely.geometry import Polygon

from pbrnet.pipeline.cameras.overlap import choose_overlapping, outlook
from pbrnet.pipeline.cameras.settings import ViewParams
from pbrnet.pipeline.cameras.trajectory_files import Trajectory
from pbrnet.pipeline.cameras.view_sampling import (
    INSIDE,
    MOST_OUTDOORS,
    TOO_CLOSE,
    drawn,
    drawn_lens,
    drawn_slope,
    grid_eyes,
    make_view,
    named_lens,
    room_at,
    sample_cameras,
    sights,
    surroundings,
)
from pbrnet.pipeline.cameras.walks import FreeFloor, find_walk, free_floors
from pbrnet.pipeline.lenses.model import Lens
from pbrnet.pipeline.render.scene import RenderScene, cast
from pbrnet.pipeline.views import CameraFile, View, as_matrix, look, rolled
from pbrnet.scenes.arrays import Float64Array
from pbrnet.scenes.contract import Room
from pbrnet.scenes.geometry.directions import turned
from pbrnet.scenes.seeds import generator

_TRIES = 6  # walks of which the one that sees most is taken
_EVERY = 6  # frames between those that tell how much a walk sees
_STANDING = 0.25  # worth of a walk that turns on the spot, relative to one that leads on

_CANDIDATES = 32  # places in a room for the views of an overlapping set
_NEAR_TARGET = 0.8  # metres that such a view keeps from what all of them look at
_RIGHT = "right"  # what a stereo partner's name has in addition

THROUGH = "a surface lies between this frame and the next"
NO_WALK = "no free floor for so long a walk"
NO_SET = "too few views of the room overlap so much"


def make_cameras(
    render_scene: RenderScene,
    params: ViewParams,
    seed: int,
    trajectories: Sequence[Trajectory] = (),
) -> CameraFile:
    """Return all views of a scene; deterministic in the arguments.

    In `stored_left_out` are walks for which the free floor is too small, trajectories that collide
    if those are rejected, sets that overlap too little, and partners of stereo pairs that have no
    room; in `collisions` the frames of trajectories that collide.
    """
    file = sample_cameras(render_scene, params, seed)
    views, left_out = list(file.views), dict(file.stored_left_out)
    floors = _floors(render_scene, params) if params.cameras.walks else []
    for number in range(params.cameras.walks):
        name = f"walk-{number:02d}"
        rng = generator(seed, "cameras", render_scene.scene.scene_id, name)
        found = _walk(render_scene, params, floors, rng)
        if found is None:
            left_out[name] = NO_WALK
        else:
            views += frames_of(render_scene, params, name, *found)
    collided: dict[str, dict[str, str]] = {}
    for given in trajectories:
        poses = np.array(given.camera_to_world, dtype=np.float64)
        if wrong := collisions(render_scene, params, poses):
            collided[given.name] = wrong
            if params.cameras.collisions == "reject":
                left_out[given.name] = described_collisions(wrong, len(poses))
                continue
        scene_id = render_scene.scene.scene_id
        lens = named_lens(params, given.half_fov_x, seed, scene_id, given.name)
        views += frames_of(render_scene, params, given.name, poses, lens)
    if params.cameras.overlap_views:
        views, without = _overlapping_sets(render_scene, params, seed, views)
        left_out |= without
    if params.cameras.stereo_baseline:
        views, without = stereo_pairs(render_scene, params, views)
        left_out |= without
    views.sort(key=lambda view: view.view_id)
    return replace(file, views=tuple(views), stored_left_out=left_out, collisions=collided)


def collisions(
    render_scene: RenderScene, params: ViewParams, poses: Float64Array
) -> dict[str, str]:
    """Return the frames of a trajectory, poses (F, 4, 4), that have no room, with the reasons.

    A frame keeps `clearance` and is not inside an object; between it and the next one lies no
    surface. Empty if the parameters accept everything.
    """
    if params.cameras.collisions == "accept":
        return {}
    eyes = poses[:, :3, 3]
    close, enclosed = surroundings(render_scene, eyes, params.cameras.clearance)
    steps = np.diff(eyes, axis=0)
    lengths = np.sqrt((steps**2).sum(axis=1))
    passed = np.zeros(len(eyes), dtype=bool)
    moved = np.flatnonzero(lengths > 0)
    if len(moved):
        free, _ = cast(render_scene, eyes[moved], steps[moved] / lengths[moved, None])
        passed[moved] = free < lengths[moved]
    flags = ((INSIDE, enclosed), (THROUGH, passed), (TOO_CLOSE, close))
    return {
        str(frame): next(reason for reason, flag in flags if flag[frame])
        for frame in np.flatnonzero(enclosed | passed | close).tolist()
    }


def described_collisions(found: dict[str, str], frames: int) -> str:
    """Return one line about the frames that collide: by reason, numbers in ranges."""
    by_reason: dict[str, list[int]] = {}
    for frame, reason in found.items():
        by_reason.setdefault(reason, []).append(int(frame))
    parts = [f"{reason}: {_ranges(numbers)}" for reason, numbers in by_reason.items()]
    return f"{len(found)} of {frames} frames collide; {'; '.join(parts)}"


def _ranges(numbers: list[int]) -> str:
    """Return ascending numbers as text, such as 3-7, 12."""
    parts: list[list[int]] = []
    for number in numbers:
        if parts and parts[-1][-1] == number - 1:
            parts[-1].append(number)
        else:
            parts.append([number])
    return ", ".join(f"{p[0]}-{p[-1]}" if len(p) > 1 else str(p[0]) for p in parts)


def _floors(render_scene: RenderScene, params: ViewParams) -> list[tuple[FreeFloor, csr_array]]:
    """Return the storeys with light that have free floor, and their steps."""
    lit = [room for room in render_scene.scene.rooms if room.has_light]
    floors = free_floors(render_scene, lit, params.cameras.eye_height)
    return [(floor, floor.steps()) for floor in floors if floor.walkable.any()]


def _walk(
    render_scene: RenderScene,
    params: ViewParams,
    floors: list[tuple[FreeFloor, csr_array]],
    rng: np.random.Generator,
) -> tuple[Float64Array, Lens] | None:
    """Return poses (F, 4, 4) and lens of the walk that sees most of `_TRIES`."""
    options = params.cameras
    best: tuple[float, Float64Array] | None = None
    lens = drawn_lens(params, rng)
    roll = drawn(options.roll, rng, 0.0)
    slope = drawn_slope(params, rng)
    height = options.eye_height + options.eye_jitter * float(rng.uniform(-1, 1))
    areas = np.array([float(floor.walkable.sum()) for floor, _ in floors])
    for _ in range(_TRIES if floors else 0):
        floor, steps = floors[int(rng.choice(len(floors), p=areas / areas.sum()))]
        walk = find_walk(
            floor, steps, options.walk_frames, options.walk_step, options.walk_turn, rng
        )
        if walk is None:
            continue
        eyes = np.column_stack([walk.places, np.full(len(walk.places), floor.floor_z + height)])
        close, enclosed = surroundings(render_scene, eyes, options.clearance)
        if close.any() or enclosed.any():
            continue
        poses = np.array(
            [
                rolled(look(eye, (math.cos(angle), math.sin(angle), slope)), roll)
                for eye, angle in zip(eyes, walk.headings.tolist(), strict=True)
            ]
        )
        some = [(pose, lens) for pose in poses[::_EVERY]]
        seen = list(sights(render_scene, some, params))
        blocked = sum(sight.coarse.nearness > options.max_near for sight in seen) / len(seen)
        score = (1 - blocked) * math.fsum(sight.score for sight in seen) / len(seen)
        metres = math.fsum(np.sqrt((np.diff(eyes, axis=0) ** 2).sum(axis=1)).tolist())
        score *= _STANDING + (1 - _STANDING) * metres / (options.walk_step * len(eyes))
        if best is None or score > best[0]:
            best = (score, poses)
    return None if best is None else (best[1], lens)


def frames_of(
    render_scene: RenderScene, params: ViewParams, name: str, poses: Float64Array, lens: Lens
) -> list[View]:
    """Return the views of a trajectory, poses (F, 4, 4), linked with their neighbours."""
    scene = render_scene.scene
    cameras = [(pose, lens) for pose in poses]
    matrices = [as_matrix(pose) for pose in poses]
    views = []
    for number, sight in enumerate(sights(render_scene, cameras, params)):
        pose = poses[number]
        room = room_at(scene, pose[:3, 3])
        view = make_view(scene, lens, f"{name}-{number:04d}", pose, sight, room)
        views.append(
            replace(
                view,
                trajectory=name,
                frame=number,
                pose_before=matrices[number - 1] if number else (),
                pose_after=matrices[number + 1] if number + 1 < len(poses) else (),
            )
        )
    return views


def _overlapping_sets(
    render_scene: RenderScene, params: ViewParams, seed: int, views: list[View]
) -> tuple[list[View], dict[str, str]]:
    """Return the views with the overlapping set of each room, and the sets that overlap too little.

    The best sampled view of a room is the first of its set. The others look from other places of
    the room at the same point as that one, which lies in the middle of its image.
    """
    scene = render_scene.scene
    best: dict[str, View] = {}
    for view in views:
        room, sampled = view.room, view.sector >= 0 and not view.trajectory
        if room and sampled and (room not in best or view.score > best[room].score):
            best[room] = view
    rooms = {room.id: room for room in scene.rooms}
    result, without = list(views), {}
    for room_id, anchor in sorted(best.items()):
        name = f"set-{anchor.view_id.rpartition('-s')[0]}"
        rng = generator(seed, "cameras", scene.scene_id, room_id, "overlap")
        found = _overlapping(render_scene, params, rooms[room_id], anchor, rng)
        if found is None:
            without[name] = NO_SET
            continue
        members, median = found
        linked = {"view_set": name, "set_overlap": round(median, 6)}
        result[result.index(anchor)] = replace(anchor, **linked)  # type: ignore[arg-type]
        result += [
            replace(view, view_id=f"{name}-{number:02d}", **linked)  # type: ignore[arg-type]
            for number, view in enumerate(members, 1)
        ]
    return result, without


def _overlapping(
    render_scene: RenderScene,
    params: ViewParams,
    room: Room,
    anchor: View,
    rng: np.random.Generator,
) -> tuple[list[View], float] | None:
    """Return the further views of a set, and the median overlap; None if that is too small."""
    options = params.cameras
    lens = anchor.lens
    first = outlook(render_scene, anchor.pose, lens)
    if not len(first.points):
        return None
    axis, eye = anchor.pose[:3, 2], anchor.eye
    along = np.median(turned(first.points - eye, anchor.pose[:3, :3].T)[:, 2])
    target = eye + float(along) * axis
    polygon = shapely.make_valid(Polygon(room.floor))
    eyes = grid_eyes(polygon.bounds, options, rng)
    eyes[:, 2] += room.floor_z
    eyes = eyes[shapely.contains_xy(polygon, eyes[:, 0], eyes[:, 1])]
    eyes = eyes[((eyes[:, :2] - target[:2]) ** 2).sum(axis=1) >= _NEAR_TARGET**2]
    eyes = eyes[eyes[:, 2] < room.ceiling_z - options.clearance]
    close, enclosed = surroundings(render_scene, eyes, options.clearance)
    eyes = rng.permutation(eyes[~close & ~enclosed])[:_CANDIDATES]
    slope = float(axis[2]) / math.hypot(axis[0], axis[1])
    cameras = []
    for place in eyes:
        x, y = (target - place)[:2].tolist()
        length = math.hypot(x, y)
        cameras.append((look(place, (x / length, y / length, slope)), lens))
    clear = [
        (pose, sight)
        for (pose, _), sight in zip(cameras, sights(render_scene, cameras, params), strict=True)
        if sight.coarse.nearness <= options.max_near and sight.coarse.outdoors <= MOST_OUTDOORS
    ]
    seen = [outlook(render_scene, pose, lens) for pose, _ in clear]
    wanted = options.overlap_views - 1
    chosen, median = choose_overlapping(render_scene, first, seen, wanted, options.overlap)
    if len(chosen) < wanted or median < options.overlap:
        return None
    views = [make_view(render_scene.scene, lens, "", *clear[index], room) for index in chosen]
    return views, median


def stereo_pairs(
    render_scene: RenderScene, params: ViewParams, views: list[View]
) -> tuple[list[View], dict[str, str]]:
    """Return the views with their partners on the right, and the partners that have no room.

    A partner keeps `clearance`, and nothing lies between the two eyes. The partners of the frames
    of a trajectory are one, too, if all of them have room.
    """
    baseline = params.cameras.stereo_baseline
    poses = np.array([view.pose for view in views]).reshape(-1, 4, 4)
    right = poses.copy()
    right[:, :3, 3] += baseline * poses[:, :3, 0]
    close, enclosed = surroundings(render_scene, right[:, :3, 3], params.cameras.clearance)
    free = np.ones(len(views), dtype=bool)
    if len(views):
        free = cast(render_scene, poses[:, :3, 3], poses[:, :3, 0])[0] > baseline
    fits = free & ~close & ~enclosed
    groups: dict[str, list[int]] = {}
    for index, view in enumerate(views):
        groups.setdefault(view.trajectory or f"/{view.view_id}", []).append(index)
    paired, without = [], {}
    for members in groups.values():
        lefts = [views[index] for index in members]
        name = f"{lefts[0].trajectory or lefts[0].view_id}-{_RIGHT}"
        if not fits[members].all():
            without[name] = TOO_CLOSE
            paired += lefts
            continue
        partners = frames_of(render_scene, params, name, right[members], lefts[0].lens)
        for left, partner in zip(lefts, partners, strict=True):
            if not left.trajectory:
                partner = replace(partner, view_id=name, trajectory="", frame=-1)
            paired.append(replace(left, stereo_partner=partner.view_id, stereo_offset=baseline))
            partner = replace(partner, sector=left.sector)
            paired.append(replace(partner, stereo_partner=left.view_id, stereo_offset=-baseline))
    return paired, without
