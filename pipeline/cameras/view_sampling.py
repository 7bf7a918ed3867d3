"""Sampling of views that see much furniture, after PBRS (Zhang et al. 2017, section 3.2).

In each room, eyes lie on a jittered grid inside the floor polygon at a person's height and look
slightly down, once into every direction sector. Pitch and roll of each candidate, and the field of
view of each sector, may be drawn from ranges instead. A candidate's score is the sum, over the
objects that cover more than `min_coverage` of its pixels, of log(pixels / minimum pixels);
structure (walls, floors, ceilings) never counts. The best candidate of each (room, sector) is kept,
then the best `views_per_room` of each room, then at most `views_per_scene`, the best of every room
before the second best of any.

Additions to PBRS: nothing may lie within `clearance` of the eye in any direction, and the eye must
not be inside furniture; views are rejected that a near object blocks, that look mostly into another
room, or that show nearly the same as a better view of their room; and every rejected candidate is
counted by its reason. Where no candidate of a scene sees three pieces of furniture, as in an
empty flat, parts of the building count as objects, one is enough, and views that reach far indoors
score more. Views that show mostly outdoors, or one bare surface, are views of no room. With
`cameras.every_room`, rooms without views are searched again, by rules that become looser. With
`cameras.framing: photograph`, views are also rejected and scored as
`pbrnet.pipeline.cameras.framing` says, and `cameras.room_shares` leaves some rooms of a type
without views.
"""

from __future__ import annotations

import itertools
import math
import re
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt
import shapely
from shapely.geometry import Polygon

from pbrnet.pipeline.cameras.framing import THINGS, THIRDS, Framing, framing_of, is_framed
from pbrnet.pipeline.cameras.settings import CameraParams, ViewParams
from pbrnet.pipeline.lenses.model import Lens, world_rays
from pbrnet.pipeline.lenses.settings import lens_of
from pbrnet.pipeline.render import raycast
from pbrnet.pipeline.render.scene import RenderScene, cast
from pbrnet.pipeline.views import CameraFile, View, as_matrix, camera_model, look, rolled
from pbrnet.scenes.arrays import BoolArray, Float64Array
from pbrnet.scenes.contract import Room, Scene
from pbrnet.scenes.errors import InputError
from pbrnet.scenes.geometry.directions import fibonacci_sphere, turned
from pbrnet.scenes.seeds import generator

_DOORWAY = 0.3  # metres outside a room that count as in it: under doors, sloping ceilings
_ENCLOSED = 0.75  # share of directions that hit one object if the eye is inside it
_FURNISHED = 3  # objects that some candidate of a furnished scene sees
_NEARLY_ALL = 0.95  # share of a view
_FLAT = 0.05  # metres off a plane up to which a surface is flat
MOST_OUTDOORS = 0.6  # share of a view
_FARTHEST = 8.0  # metres; a view that reaches farther shows no more of a room
_REACH_WEIGHT = 3.0  # of the logarithm of the reach of a view without furniture
_COARSE = (12, 9)  # columns and rows of rays by which a view is measured
_RAYS = 192  # directions of the clearance test: 2.6 cm apart at 10 cm
_PIXELS = 1 << 21  # per trace

NO_LIGHT = "room has no lamp, window or door"
OUTSIDE = "outside the room"
ABOVE = "above the ceiling"
TOO_CLOSE = "closer to a surface than the clearance"
INSIDE = "inside an object"
NOT_TRIED = "not tried: beyond cameras.candidates"
BLOCKED = "blocked: too much of the view is too near"
FEW_OBJECTS = "too few objects"
BLANK = "shows one bare surface"
OUTDOORS = "shows mostly outdoors"
NOT_SHARED = "left out by cameras.room_shares"
ELSEWHERE = "looks mostly into another room"
UNFRAMED = "framed as no photograph is: blank wall, lamp or object too large, or too near"
LOW_SCORE = "score below cameras.min_score"
NOT_BEST = "not the best of its sector"
ALIKE = "shows nearly the same as a better view of its room"
BEYOND_ROOM = "beyond cameras.views_per_room"
BEYOND_SCENE = "beyond cameras.views_per_scene"

_SEARCHED = 8  # times `candidates` in a room without views
# Rules of views of such a room: most `min_objects`, `framing`, whether structure counts as objects.
_RULES = ((100, "photograph", False), (2, "photograph", False), (2, "paper", False),
          (1, "paper", False), (1, "paper", True))  # fmt: skip


@dataclass(frozen=True)
class Candidate:
    """A camera that is to be scored, with its room and direction sector."""

    room: Room
    sector: int
    pose: Float64Array  # camera_to_world (4, 4)
    lens: Lens


@dataclass(frozen=True)
class CoarseLook:
    """Measures of a view, from a coarse raster of rays."""

    nearness: float  # share of the rays that end nearer than `near`
    outdoors: float  # share of the rays that meet nothing, or the ground outdoors
    reach: float  # geometric mean of the rays' lengths, metres; those that end outdoors are short
    is_flat: bool  # one plane fills the view


@dataclass(frozen=True)
class Sight:
    """Score of a camera and the pixels of every object that it sees."""

    score: float
    objects: tuple[str, ...]  # ids of the objects that count
    seen: dict[str, int]  # object id -> pixels
    coarse: CoarseLook
    is_bare: bool  # no more than one bare surface
    framing: Framing | None = None  # with `cameras.framing: photograph`


_Kept = dict[str, list[tuple[Candidate, Sight]]]  # room id -> its views, best first


def sample_cameras(render_scene: RenderScene, params: ViewParams, seed: int) -> CameraFile:
    """Return the views of a scene and the number of rejected candidates by reason.

    Deterministic in the scene, `params.cameras`, `params.image` and `seed`. A scene may have no
    view. With `params.cameras.stored_views`, views of an imported scene
    (`scene.source["views"]`) are added, whatever their score; those outside every room only with
    `outside_views`, those that show nothing never. They are not candidates: candidates = sampled
    views + sum of `rejected`.
    """
    scene = render_scene.scene
    options = params.cameras
    rejected: Counter[str] = Counter()
    candidates: list[Candidate] = []
    lit: list[Room] = []
    total = 0
    for room in sorted(scene.rooms, key=lambda room: room.id):
        rng = generator(seed, "cameras", scene.scene_id, room.id)
        lens = generator(seed, "cameras", scene.scene_id, room.id, "lens")
        chance = generator(seed, "cameras", scene.scene_id, room.id, "share").random()
        taken = chance < options.share_of(room.type)
        found, excluded = _room_candidates(render_scene, room, params, rng, lens, taken)
        candidates += found
        rejected += excluded
        total += len(found) + sum(excluded.values())
        if taken and room.has_light:
            lit.append(room)
    scored = _scored(render_scene, candidates, params)
    rooms = {item.id: item.room for item in scene.objects if not item.is_structure}
    kept, by_reason = _best_of_rooms(scored, rooms, options)
    most = max((len(sight.objects) for _, sight in scored), default=0)
    unfurnished = not kept and by_reason[FEW_OBJECTS] > 0 and most < _FURNISHED
    if unfurnished:
        rooms = {item.id: item.room for item in scene.objects}
        counted = [(c, _with_structure(sight, params)) for c, sight in scored]
        kept, by_reason = _best_of_rooms(counted, rooms, replace(options, min_objects=1))
    relaxed: dict[str, str] = {}
    for room in lit if options.every_room else ():
        if room.id not in kept:
            more, reasons, rules = _search_room(render_scene, room, params, seed)
            kept |= more
            by_reason += reasons
            total += sum(map(len, more.values())) + sum(reasons.values())
            if more and rules:
                relaxed[room.id] = rules
    rejected += by_reason
    chosen, beyond = _best_of_scene(kept, options)
    rejected += Counter({BEYOND_SCENE: beyond})
    names = _room_names(scene)
    views = []
    for c, sight in chosen:
        view = make_view(scene, c.lens, f"{names[c.room.id]}-s{c.sector}", c.pose, sight, c.room)
        views.append(replace(view, sector=c.sector))
    left_out: dict[str, str] = {}
    if options.stored_views:
        names_taken = {view.view_id for view in views}
        stored, left_out = _stored_views(render_scene, params, names_taken, seed)
        views += stored
    return CameraFile(
        scene_id=scene.scene_id,
        views=tuple(sorted(views, key=lambda view: view.view_id)),
        candidates=total,
        rejected={reason: rejected[reason] for reason in sorted(rejected)},
        unfurnished=unfurnished,
        stored_left_out=left_out,
        relaxed=relaxed or None,
    )


def score_ids(
    ids: npt.NDArray[np.uint32], scene: Scene, min_coverage: float
) -> list[tuple[float, tuple[str, ...], dict[str, int]]]:
    """Return score, ids of the counted objects and pixels by object id of each image (N, H, W).

    An object counts if it is not structure and covers more than `min_coverage` of the pixels. The
    score is the sum of log(pixels / minimum) over the counted objects.
    """
    count, size = len(ids), int(np.prod(ids.shape[1:]))
    kinds = len(scene.objects) + 1
    flat = ids.reshape(count, -1).astype(np.int64) + np.arange(count)[:, None] * kinds
    pixels = np.bincount(flat.ravel(), minlength=count * kinds).reshape(count, kinds)[:, 1:]
    minimum = max(1.0, min_coverage * size)
    furniture = np.array([not item.is_structure for item in scene.objects], dtype=bool)
    results = []
    for row in pixels:
        counted = np.flatnonzero(furniture & (row > minimum))
        score = math.fsum(math.log(int(row[index]) / minimum) for index in counted)
        seen = {scene.objects[index].id: int(row[index]) for index in np.flatnonzero(row)}
        results.append((score, tuple(scene.objects[index].id for index in counted), seen))
    return results


def _search_room(
    render_scene: RenderScene, room: Room, params: ViewParams, seed: int
) -> tuple[_Kept, Counter[str], str]:
    """Return the views of a room that had none, the numbers of other candidates, and the rules.

    Its candidates are others, and more. The rules are the first of `_RULES` that some candidate
    obeys, as changes of `params.cameras`; "" for none.
    """
    scene, options = render_scene.scene, params.cameras
    more = replace(params, cameras=replace(options, candidates=_SEARCHED * options.candidates))
    eyes, lens = (
        generator(seed, "cameras", scene.scene_id, room.id, "search", name)
        for name in ("eyes", "lens")
    )
    candidates, _ = _room_candidates(render_scene, room, more, eyes, lens, True)
    scored = _scored(render_scene, candidates, params)
    for most, framing, structure in _RULES:
        rules: dict[str, Any] = {"min_objects": min(most, options.min_objects)}
        rules |= {"framing": framing} if options.framing == "photograph" else {}
        items = [item for item in scene.objects if structure or not item.is_structure]
        counted = [(c, _with_structure(s, params)) for c, s in scored] if structure else scored
        kept, rejected = _best_of_rooms(
            counted, {item.id: item.room for item in items}, replace(options, **rules)
        )
        if kept:
            break
    changes = [f"{key}: {rule}" for key, rule in rules.items() if rule != getattr(options, key)]
    return kept, rejected, ", ".join(changes + ["parts of the building count"] * structure)


def _scored(
    render_scene: RenderScene, candidates: Sequence[Candidate], params: ViewParams
) -> list[tuple[Candidate, Sight]]:
    cameras = [(c.pose, c.lens) for c in candidates]
    return list(zip(candidates, sights(render_scene, cameras, params), strict=True))


def _room_candidates(
    render_scene: RenderScene,
    room: Room,
    params: ViewParams,
    rng: np.random.Generator,
    lens: np.random.Generator,
    taken: bool,
) -> tuple[list[Candidate], Counter[str]]:
    """Return the candidates of a room to be scored, and the numbers of the others by reason.

    `lens` draws what has a range (field of view, pitch, roll), so that `rng` draws the same
    places and azimuths with ranges and without. A room that is not `taken` has no candidates.
    """
    options = params.cameras
    rejected: Counter[str] = Counter()
    polygon = shapely.make_valid(Polygon(room.floor))
    eyes = grid_eyes(polygon.bounds, options, rng)
    eyes[:, 2] += room.floor_z
    azimuths = _azimuths(len(eyes), options.sectors, rng)
    if not taken:
        rejected[NOT_SHARED] += azimuths.size
        return [], rejected
    if not room.has_light:
        rejected[NO_LIGHT] += azimuths.size
        return [], rejected
    free = shapely.contains_xy(polygon, eyes[:, 0], eyes[:, 1])
    rejected[OUTSIDE] += int((~free).sum()) * options.sectors
    low = eyes[:, 2] < room.ceiling_z - options.clearance
    rejected[ABOVE] += int((free & ~low).sum()) * options.sectors
    left = np.flatnonzero(free & low)
    close, enclosed = surroundings(render_scene, eyes[left], options.clearance)
    rejected[TOO_CLOSE] += int(close.sum()) * options.sectors
    rejected[INSIDE] += int((enclosed & ~close).sum()) * options.sectors
    left = left[~close & ~enclosed]
    candidates = []
    for sector in range(options.sectors):
        own = drawn_lens(params, lens)
        for index in rng.permutation(left)[: options.candidates]:
            azimuth = azimuths[index, sector]
            slope = drawn_slope(params, lens)
            pose = look(eyes[index], (math.cos(azimuth), math.sin(azimuth), slope))
            pose = rolled(pose, drawn(options.roll, lens, 0.0))
            candidates.append(Candidate(room, sector, pose, own))
    rejected[NOT_TRIED] += len(left) * options.sectors - len(candidates)
    return candidates, +rejected


def grid_eyes(
    bounds: tuple[float, float, float, float], options: CameraParams, rng: np.random.Generator
) -> Float64Array:
    """Return eyes (N, 3), one jittered per cell over `bounds`; z is the height above the floor."""
    low_x, low_y, high_x, high_y = bounds
    across = max(1, math.ceil((high_x - low_x) / options.grid))
    along = max(1, math.ceil((high_y - low_y) / options.grid))
    x, y = np.meshgrid(np.arange(across), np.arange(along), indexing="ij")
    cells = np.stack([x.ravel(), y.ravel()], axis=1) + rng.random((across * along, 2))
    heights = options.eye_height + options.eye_jitter * rng.uniform(-1, 1, across * along)
    return np.column_stack([cells * options.grid + (low_x, low_y), heights])


def drawn(bounds: tuple[float, ...], rng: np.random.Generator, otherwise: float) -> float:
    """Return a number drawn evenly from [least, most], or `otherwise` if `bounds` is empty."""
    return float(rng.uniform(bounds[0], bounds[1])) if bounds else otherwise


def drawn_lens(params: ViewParams, rng: np.random.Generator) -> Lens:
    """Return the lens of a view, with field of view, focal length and so on from their ranges."""
    half_fov_x = drawn(params.cameras.half_fov_x, rng, params.image.half_fov_x)
    return lens_of(params.image, half_fov_x, rng)


def named_lens(
    params: ViewParams, half_fov_x: float | None, seed: int, scene_id: str, name: str
) -> Lens:
    """Return the lens of a camera from a file.

    The field of view that the file may state, radians, is that of a perspective camera without
    distortion, and counts for such images alone.
    """
    image = params.image
    stated = half_fov_x if image.is_pinhole else None
    return lens_of(image, stated, generator(seed, "cameras", scene_id, name, "lens"))


def drawn_slope(params: ViewParams, rng: np.random.Generator) -> float:
    """Return the tangent of a camera's pitch: drawn, or `tilt`; panoramas are level without."""
    if params.cameras.pitch:
        return math.tan(drawn(params.cameras.pitch, rng, 0.0))
    return 0.0 if params.image.is_panorama else params.cameras.tilt


def _azimuths(count: int, sectors: int, rng: np.random.Generator) -> Float64Array:
    """Return an azimuth per eye and sector, radians from +X towards +Y, (count, sectors)."""
    spread = rng.random((count, sectors))
    azimuths: Float64Array = (np.arange(sectors) + spread) * (2 * math.pi / sectors)
    return azimuths


def surroundings(
    render_scene: RenderScene, eyes: Float64Array, clearance: float
) -> tuple[BoolArray, BoolArray]:
    """Return for each eye (N, 3) whether a surface is within `clearance` and whether it is inside
    furniture or in or above a sloping roof, bool (N,) each."""
    if not len(eyes):
        return np.zeros(0, dtype=bool), np.zeros(0, dtype=bool)
    directions = fibonacci_sphere(_RAYS)
    distance, hit = cast(
        render_scene, np.repeat(eyes, _RAYS, axis=0), np.tile(directions, (len(eyes), 1))
    )
    distance, hit = distance.reshape(-1, _RAYS), hit.reshape(-1, _RAYS)
    structure = np.array([o.is_structure for o in render_scene.scene.objects] + [True])
    enclosed = np.zeros(len(eyes), dtype=bool)
    for index, row in enumerate(hit):
        values, counts = np.unique(row[~structure[row]], return_counts=True)
        enclosed[index] = len(values) > 0 and counts.max() > _ENCLOSED * _RAYS
    roofs = np.array([o.category == "slab" for o in render_scene.scene.objects] + [False])
    # Ceilings and floors hide a roof from eyes in rooms; sloping ones have room above them.
    for upright in (-1.0, 1.0) if render_scene.scene.source.get("slopes") else ():
        enclosed |= roofs[cast(render_scene, eyes, np.tile([0.0, 0.0, upright], (len(eyes), 1)))[1]]
    return distance.min(axis=1) < clearance, enclosed


def sights(
    render_scene: RenderScene, cameras: Sequence[tuple[Float64Array, Lens]], params: ViewParams
) -> Iterator[Sight]:
    """Yield the sight of each camera from a small id image; a chunk of cameras per trace.

    A camera is its `camera_to_world` (4, 4) and its lens; cameras that follow each other with the
    same lens share a trace.
    """
    scene = render_scene.scene
    options = params.cameras
    height = _id_height(params)
    width = 2 * height if params.image.is_panorama else options.id_width
    chunk = max(1, _PIXELS // (width * height))
    structure = {item.id for item in scene.objects if item.is_structure}
    for lens, group in itertools.groupby(cameras, key=lambda camera: camera[1]):
        small = lens.resized(width, height, square=True)
        poses = [pose for pose, _ in group]
        for start in range(0, len(poses), chunk):
            some = np.array(poses[start : start + chunk])
            ids = _object_ids(render_scene, some, small)
            looks = _coarse_looks(render_scene, some, lens, options.near)
            for (score, objects, seen), coarse, image_ids in zip(
                score_ids(ids, scene, options.min_coverage), looks, ids, strict=True
            ):
                framing = None
                if options.framing == "photograph":
                    framing = framing_of(image_ids, scene, objects)
                    shown = sum(name not in structure for name in seen)
                    score += THIRDS * framing.thirds + THINGS * shown
                bare = coarse.is_flat and not objects
                yield Sight(score, objects, seen, coarse, bare, framing)


def _object_ids(
    render_scene: RenderScene, poses: Float64Array, lens: Lens
) -> npt.NDArray[np.uint32]:
    """Return object index + 1 of each pixel, 0 for none, uint32 (N, H, W); `poses` is (N, 4, 4)."""
    rays = lens.rays()
    if lens.is_central and rays.valid.all():
        return raycast.object_ids(render_scene.geometry, poses, lens.scaled_rays())
    found = [cast(render_scene, *world_rays(lens, pose), through_glass=True)[1] for pose in poses]
    return (np.array(found).reshape(-1, lens.height, lens.width) + 1).astype(np.uint32)


def _id_height(params: ViewParams) -> int:
    """Return the height of the id images, pixels."""
    return max(1, round(params.cameras.id_width * params.image.height / params.image.width))


def _coarse_looks(
    render_scene: RenderScene, poses: Float64Array, lens: Lens, near: float
) -> list[CoarseLook]:
    """Return the measures of each view by a grid of rays; `poses` is (N, 4, 4).

    Those of a panorama are even on the sphere. A view without rays at some pixels is never flat.
    Parallel rays that begin where the eye does not see, as in a wall, are as short as can be.
    """
    columns, rows = _COARSE
    if lens.is_panorama:
        local = fibonacci_sphere(columns * rows)
        starts, whole = np.zeros_like(local), False
    else:
        seen = lens.resized(columns, rows).rays()
        local, starts = seen.directions[seen.valid], seen.origins[seen.valid]
        whole = bool(seen.valid.all())
    directions = np.concatenate([turned(local, pose[:3, :3]) for pose in poses])
    origins = np.concatenate([pose[:3, 3] + turned(starts, pose[:3, :3]) for pose in poses])
    distance, hit = cast(render_scene, origins, directions, through_glass=True)
    if not lens.is_central:
        distance[_are_hidden(render_scene, poses, origins)] = 0.0
    is_ground = [item.category == "ground" for item in render_scene.scene.objects]
    outdoors = np.isinf(distance) | np.array([*is_ground, False])[hit]
    length = np.where(outdoors, near, np.clip(distance, near, _FARTHEST))
    lengths = np.sqrt((directions**2).sum(axis=1))
    points = origins + (np.where(np.isinf(distance), 0.0, distance) / lengths)[:, None] * directions
    return [
        CoarseLook(
            float((distance[part] < near).mean()),
            float(outdoors[part].mean()),
            math.exp(math.fsum(np.log(length[part]).tolist()) / len(local)),
            whole and not outdoors[part].any() and _is_flat(points[part].reshape(rows, columns, 3)),
        )
        for part in (slice(k, k + len(local)) for k in range(0, len(distance), len(local)))
    ]


def _are_hidden(render_scene: RenderScene, poses: Float64Array, origins: Float64Array) -> BoolArray:
    """Test whether something hides each of `origins` (P, 3), as many a pose, from its eye."""
    eyes = np.repeat(poses[:, :3, 3], len(origins) // len(poses), axis=0)
    ways = origins - eyes
    length = np.sqrt((ways**2).sum(axis=1))
    found = cast(render_scene, eyes, ways / np.maximum(length, 1e-9)[:, None], through_glass=True)
    return np.asarray(found[0] < length)


def _is_flat(points: Float64Array) -> bool:
    """Return whether points (rows, columns, 3) that fill a view lie in one plane, nearly all."""
    origin = points[0, 0]
    normal = np.cross(points[0, -1] - origin, points[-1, points.shape[1] // 2] - origin)
    length = math.sqrt(float((normal**2).sum()))
    away = np.abs(((points - origin) * normal).sum(axis=2))
    return bool((away <= _FLAT * length).mean() >= _NEARLY_ALL)


def _rejection(
    room: Room, sight: Sight, rooms: dict[str, str | None], options: CameraParams
) -> str:
    """Return why a candidate is rejected, or ""; `rooms` maps object ids to room ids."""
    known = [rooms[name] for name in sight.objects if rooms[name] is not None]
    if sight.coarse.nearness > options.max_near:
        return BLOCKED
    if len(sight.objects) < options.min_objects:
        return FEW_OBJECTS
    if sight.is_bare:
        return BLANK
    if sight.coarse.outdoors > MOST_OUTDOORS:
        return OUTDOORS
    if known and known.count(room.id) < options.min_own * len(known):
        return ELSEWHERE
    framing = sight.framing if options.framing == "photograph" else None
    if framing is not None and not is_framed(framing, sight.coarse.reach):
        return UNFRAMED
    if sight.score < options.min_score:
        return LOW_SCORE
    return ""


def _with_structure(sight: Sight, params: ViewParams) -> Sight:
    """Return the sight with everything counted that covers enough pixels, structure too.

    To the score it adds how far the view reaches indoors, in logarithms of `near`.
    """
    size = params.cameras.id_width * _id_height(params)
    minimum = max(1.0, params.cameras.min_coverage * size)
    pixels = {name: count for name, count in sight.seen.items() if count > minimum}
    score = math.fsum(math.log(count / minimum) for count in pixels.values())
    score += _REACH_WEIGHT * math.log(sight.coarse.reach / params.cameras.near)
    return replace(sight, score=score, objects=tuple(pixels))


def _best_of_rooms(
    scored: list[tuple[Candidate, Sight]], furniture: dict[str, str | None], options: CameraParams
) -> tuple[_Kept, Counter[str]]:
    """Return the best of each sector, then room, and the numbers of the others.

    `furniture` maps the ids of the objects that may count to rooms.
    """
    rejected: Counter[str] = Counter()
    passed = []
    for candidate, sight in scored:
        reason = _rejection(candidate.room, sight, furniture, options)
        if reason:
            rejected[reason] += 1
        else:
            passed.append((candidate, sight))
    sectors: dict[tuple[str, int], tuple[Candidate, Sight]] = {}
    for candidate, sight in passed:
        key = (candidate.room.id, candidate.sector)
        if key not in sectors or sight.score > sectors[key][1].score:
            sectors[key] = (candidate, sight)
    rejected[NOT_BEST] += len(passed) - len(sectors)
    rooms: _Kept = {}
    for best in sorted(sectors.values(), key=lambda view: (-view[1].score, view[0].sector)):
        kept = rooms.setdefault(best[0].room.id, [])
        if len(kept) >= options.views_per_room:
            rejected[BEYOND_ROOM] += 1
        elif any(_overlap(best[1], view[1], furniture) > options.max_alike for view in kept):
            rejected[ALIKE] += 1
        else:
            kept.append(best)
    return rooms, +rejected


def _best_of_scene(
    rooms: _Kept, options: CameraParams
) -> tuple[list[tuple[Candidate, Sight]], int]:
    """Return the best of every room before the second best of any, and the number of the others."""
    ranked = [
        (rank, -view[1].score, room, view)
        for room, kept in rooms.items()
        for rank, view in enumerate(kept)
    ]
    ranked.sort(key=lambda entry: entry[:3])
    chosen = [view for _, _, _, view in ranked[: options.views_per_scene]]
    return chosen, len(ranked) - len(chosen)


def _overlap(one: Sight, other: Sight, furniture: dict[str, str | None]) -> float:
    """Return the share of furniture pixels that two views have in common, in [0, 1]."""
    names = (one.seen.keys() | other.seen.keys()) & furniture.keys()
    common = sum(min(one.seen.get(name, 0), other.seen.get(name, 0)) for name in names)
    together = sum(max(one.seen.get(name, 0), other.seen.get(name, 0)) for name in names)
    return common / together if together else 1.0


def _stored_views(
    render_scene: RenderScene, params: ViewParams, taken: set[str], seed: int
) -> tuple[list[View], dict[str, str]]:
    """Return the cameras stored in an imported scene, with the image size of the parameters.

    Also the names of those that show nothing of a room, with the reasons.
    """
    scene = render_scene.scene
    views, left_out = [], {}
    for number, stored in enumerate(scene.source.get("views", [])):
        try:
            pose = np.array(stored["camera_to_world"], dtype=np.float64).reshape(4, 4)
            half_fov_x = float(stored.get("half_fov_x", params.image.half_fov_x))
        except (KeyError, TypeError, ValueError):
            raise InputError(
                f"{scene.folder / 'scene.json'}: source.views[{number}] needs camera_to_world "
                "(4x4) and half_fov_x (radians)"
            ) from None
        named = next((room for room in scene.rooms if room.id == stored.get("room")), None)
        room = named or room_at(scene, pose[:3, 3])
        if room is None and not params.cameras.outside_views:
            continue
        name = f"stored-{slug(str(stored.get('name', number)))}"
        while name in taken:
            name += "-again"
        taken.add(name)
        lens = named_lens(params, half_fov_x, seed, scene.scene_id, name)
        (sight,) = sights(render_scene, [(pose, lens)], params)
        reason = _shows_nothing(render_scene, pose, sight)
        if reason:
            left_out[name] = reason
            continue
        view = make_view(scene, lens, name, pose, sight, room)
        views.append(replace(view, sector=int(stored.get("sector", view.sector))))
    return views, left_out


def _shows_nothing(render_scene: RenderScene, pose: Float64Array, sight: Sight) -> str:
    """Return why a stored camera, which may stand anywhere, is no view; "" if it is one."""
    _, enclosed = surroundings(render_scene, pose[None, :3, 3], 0.0)
    if enclosed[0]:
        return INSIDE
    if sight.coarse.nearness > _NEARLY_ALL:
        return BLOCKED
    return BLANK if sight.is_bare else ""


def make_view(
    scene: Scene, lens: Lens, view_id: str, pose: Float64Array, sight: Sight, room: Room | None
) -> View:
    """Return the view of a camera with its room, its score and what it sees."""
    return View(
        scene_id=scene.scene_id,
        view_id=view_id,
        **camera_model(lens),
        camera_to_world=as_matrix(pose),
        room=room.id if room else None,
        room_type=room.type if room else "other",
        score=sight.score,
        seen=sight.seen,
    )


def room_at(scene: Scene, eye: Any) -> Room | None:
    """Return the room that contains a point (3,), or the nearest within `_DOORWAY`; or None."""
    point = shapely.Point(eye[0], eye[1])
    away = {
        room.id: float(shapely.make_valid(Polygon(room.floor)).distance(point))
        for room in scene.rooms
        if room.floor_z - _DOORWAY <= eye[2] <= room.ceiling_z + _DOORWAY
    }
    rooms = [room for room in scene.rooms if away.get(room.id, math.inf) <= _DOORWAY]
    return min(rooms, key=lambda room: away[room.id], default=None)


def _room_names(scene: Scene) -> dict[str, str]:
    """Return a name per room id that is safe in file names and unique in the scene."""
    names: dict[str, str] = {}
    for room in sorted(scene.rooms, key=lambda room: room.id):
        name = slug(room.id)
        while name in names.values() or name == "stored":
            name += "_"
        names[room.id] = name
    return names


def slug(text: str) -> str:
    return re.sub(r"[^A-Za-z0-9]+", "-", text).strip("-")[:60] or "room"
