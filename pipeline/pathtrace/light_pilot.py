"""What lights a view: a plan, from a small pilot, of which lights its paths should ask.

In a home most lamps burn in other rooms, and nearly all of the sky is behind walls: asked
uniformly, most emitter samples find nothing. In the pilot, points that the camera sees, and points
one bounce further, ask every lamp, every window through which the sky may shine, the sun, and what
else there is of the environment. Each is then to be chosen in proportion to the root mean square
of what it adds to pixels, relative to the pixels' brightness (which minimises the variance of
one-sample estimates), and a twentieth of the choice goes to all alike. Where windows and sun are
all of the environment that counts, its own sampling, which costs as much as a ray, is left out.

These shares are a view's. At each vertex of a path they make way for what the lights would bring
there (`pipeline.pathtrace.light_sampling`): each light's strength is that with which, sent by
cosine and the square of the distance, it would bring what it brought to the pilot's points, shadows
included.

The pilot sees geometry and lights, no materials, so that plans, like shading, depend on no colour.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np
import numpy.typing as npt

from pipeline.render.raycast import column, vector
from pipeline.views import View
from scenes.arrays import BoolArray, Float64Array, Int64Array
from scenes.color import luminance
from scenes.contract import Portal
from scenes.seeds import generator

WINDOWS = 12  # at most so many of a scene's get directions of their own in a view
LAMPS = 12  # at most so many emitters are weighed at each vertex
_FLAT = 1e6  # metres: the spread of what brings all places alike, such as a whole sky
_GRID = (24, 18)  # camera rays of the pilot
_ASKED = 4  # samples of each light at each point
_UNIFORM = 0.05  # share of the choice that all have alike
_NEGLIGIBLE = 0.02  # of all light: below that the environment's own sampling is left out
_WIDEST, _STEP = 10.0, 0.005  # degrees: a sun's radius is looked for up to so much, in such steps
_CONTRAST = 3.0  # times as bright is a sun, at its edge, as the sky beside it
_MARGIN = 1.03
_FAINT = 0.01  # of the mean light: points darker than that do not count fully
ALBEDO = 0.5  # what surfaces are taken to pass on
_MOST = 10.0  # times the brightness of pixels that one point may add
LIFT = 1e-3  # metres that the pilot's rays start above surfaces
_GRAZING = 0.1  # of what a light brings to a surface that faces it, to one that it grazes
_LEAST = 0.02  # metres, spread of the smallest lamps
_AREA = 1e-4  # square metres: smaller openings are left to the sky's own sampling

OUTDOORS = 0.05  # metres beyond the box around the rooms

EVERYWHERE: Float64Array = np.array([[-np.inf] * 3, [np.inf] * 3])  # a box


@dataclass(frozen=True)
class Panes:
    """Rectangles that the sky may shine through: a corner (K, 3), two edges (K, 3), the normal
    that points outdoors (K, 3)."""

    corner: Float64Array
    edges: tuple[Float64Array, Float64Array]
    normal: Float64Array

    @property
    def area(self) -> Float64Array:
        """Square metres, (K,)."""
        lengths = [np.linalg.norm(edge, axis=1) for edge in self.edges]
        return np.asarray(lengths[0] * lengths[1])

    @property
    def centre(self) -> Float64Array:
        """Their middles, (K, 3)."""
        return np.asarray(self.corner + 0.5 * (self.edges[0] + self.edges[1]))

    @property
    def spread(self) -> Float64Array:
        """Metres, the rms distance of their points from the middle, (K,)."""
        return np.asarray(np.sqrt(sum((edge**2).sum(axis=1) for edge in self.edges) / 12))

    def take(self, chosen: Int64Array) -> Panes:
        """Some of them."""
        first, second = self.edges
        return Panes(self.corner[chosen], (first[chosen], second[chosen]), self.normal[chosen])


@dataclass(frozen=True)
class Sun:
    """A disc in the sky: its centre, a unit vector (3,), and the cosine of its angular radius."""

    towards: Float64Array
    cosine: float

    @property
    def density(self) -> float:
        """Of directions uniform over the disc, by solid angle."""
        return 1 / (2 * np.pi * (1 - self.cosine))


@dataclass(frozen=True)
class Pilot:
    """Points that the camera sees, then from each one bounce further, (P, 3); normals towards
    where they were seen from, (P, 3); which of them there are, (P,): the rest saw nothing.

    P is that of every view: kernels are compiled for the number of rays.
    """

    points: Float64Array
    normals: Float64Array
    hit: BoolArray


@dataclass(frozen=True)
class Places:
    """Where emitters are: the mean of their points (N, 3), and those points' rms distance from
    it (N,), metres."""

    centre: Float64Array
    spread: Float64Array


@dataclass(frozen=True)
class Strengths:
    """How strong each light is: times `reach` it is about what the light brings to a place."""

    emitters: (
        Float64Array  # (2, N): to places indoors, and to those outside the box around the rooms
    )
    windows: Float64Array  # (K,)
    sunlight: float


@dataclass(frozen=True)
class LightPlan:
    """How a view chooses its lights; `emitters`, `windows` and `sunlight` sum to 1.

    `emitters` (N,): the environment's entry is for its own sampling, which may be 0; `windows`
    (K,): directions through `panes`; `sunlight`: directions to the disc of `sun`. `strengths` and
    `places`, where there are, let each vertex weigh them anew; `indoors` is the box (2, 3) within
    which the sun is expected through panes alone. `bounced` is about what light bounced once brings
    to a surface in view, W/m^2, and `pilot` where all this was asked.
    """

    emitters: Float64Array
    windows: Float64Array
    panes: Panes
    sunlight: float = 0.0
    sun: Sun | None = None
    indoors: Float64Array = field(default_factory=lambda: EVERYWHERE)
    places: Places | None = None
    strengths: Strengths | None = None
    bounced: float = 0.0
    pilot: Pilot | None = None


def plan_lights(
    scene: Any,
    view: View,
    portals: tuple[Portal, ...],
    seed: int,
    indoors: npt.ArrayLike = EVERYWHERE,
) -> LightPlan:
    """The plan of a view, from its pilot; `scene` is the Mitsuba scene, `indoors` (2, 3) the box
    around its rooms: within it the sun shines through panes alone, or is hardly asked."""
    pilot = _pilot(scene, view, seed)
    points, normals, hit = pilot.points, pilot.normals, pilot.hit
    sky = _sky_of(scene)
    panes = panes_of(portals if sky is not None else ())
    brought, places = _asked(scene, points, normals, panes, sky, seed)
    shares = _shares(brought[hit], int(hit[: len(hit) // 2].sum()))
    if not shares.any():
        return _blind(len(scene.emitters()), panes)
    plan, best = _plan(shares, panes, sky)
    plan = replace(plan, indoors=np.asarray(indoors, dtype=np.float64))
    strengths = _strengths(brought[hit], points[hit], normals[hit], places, plan, best)
    first = len(hit) // 2
    bounced = ALBEDO * float(brought[first:][hit[first:]].sum()) / max(1, int(hit[:first].sum()))
    return replace(plan, places=places, strengths=strengths, bounced=bounced, pilot=pilot)


def rms(values: Float64Array) -> Float64Array:
    """Root mean square over the first axis."""
    return np.asarray(np.sqrt((values**2).mean(axis=0)))


def reach(cosine: Any, squared: Any, spread: Any) -> Any:
    """What a light of strength 1 brings to a surface, 1/m^2: by the cosine there, of either side
    and never quite 0, since lights are wide; and by the squared distance, never less than the
    light's spread. Arrays of any kind: NumPy's or Dr.Jit's."""
    return (_GRAZING + (1 - _GRAZING) * cosine) / (squared + spread * spread)


def _blind(count: int, panes: Panes) -> LightPlan:
    """Where the pilot saw no light: all emitters alike."""
    return LightPlan(np.full(count, 1 / count), np.zeros(0), panes.take(np.arange(0)))


def _strengths(
    brought: Float64Array,
    points: Float64Array,
    normals: Float64Array,
    places: Places,
    plan: LightPlan,
    best: Int64Array,
) -> Strengths:
    """By root mean squares over the pilot's points of what was brought and of `reach`."""
    count = len(places.spread)

    def reached(centre: Float64Array, spread: Float64Array) -> tuple[Float64Array, Float64Array]:
        towards = centre[None] - points[:, None]
        squared = (towards**2).sum(axis=-1)
        towards /= np.sqrt(squared + 1e-12)[..., None]
        cosine = np.abs((towards * normals[:, None]).sum(axis=-1))
        return np.asarray(reach(cosine, squared, spread)), towards

    lamps, _ = reached(places.centre, places.spread)
    windows, towards = reached(plan.panes.centre, plan.panes.spread)
    windows = windows * np.maximum((towards * plan.panes.normal).sum(axis=-1), 0)
    sun = np.zeros(3) if plan.sun is None else plan.sun.towards
    sunny = reach(np.abs(normals @ sun), 0.0, 1.0) * _may_see(sun, points, plan)
    outside = is_outside(points, plan.indoors)
    sides = [side if side.any() else np.ones_like(side) for side in (~outside, outside)]
    return Strengths(
        np.array([rms(brought[side, :count]) / rms(lamps[side]) for side in sides]),
        rms(brought[:, count:-1][:, best]) / np.maximum(rms(windows), 1e-30),
        float(rms(brought[:, -1]) / np.maximum(rms(sunny), 1e-30)),
    )


def is_outside(points: Float64Array, indoors: Float64Array) -> BoolArray:
    """Which points (P, 3) lie beyond the box (2, 3) around the rooms."""
    low, high = indoors
    return np.asarray(((points < low - OUTDOORS) | (points > high + OUTDOORS)).any(axis=1))


def _may_see(sun: Float64Array, points: Float64Array, plan: LightPlan) -> BoolArray:
    """Whether the sun may shine on each point (P, 3): through a pane, or from the open sky."""
    outside = is_outside(points, plan.indoors)
    through = _densities(plan.panes, points, np.broadcast_to(sun, points.shape)) > 0
    return np.asarray(outside | through.any(axis=1))


@dataclass(frozen=True)
class _Sky:
    """The environment: its place among the emitters, its sun if it has one, and whether without
    it it is so even that directions uniform over a window will do."""

    row: int
    sun: Sun | None
    even: bool


def _plan(shares: Float64Array, panes: Panes, sky: _Sky | None) -> tuple[LightPlan, Int64Array]:
    """From what each adds: emitters (N,), panes (K,) and the sun (1,); and the panes taken."""
    count = len(shares) - len(panes.area) - 1
    emitters, windows, sunlight = shares[:count], shares[count:-1], float(shares[-1])
    best = np.argsort(-windows, kind="stable")[:WINDOWS]
    kept = np.concatenate([np.ones(count), np.ones(len(best)), [0.0]])
    if sky is not None and sky.sun is not None:
        kept[-1] = 1  # whatever the pilot saw of it: materials hardly ever find it by chance
    if sky is not None and sky.even and (len(best) or sky.sun is not None):
        rest = emitters[sky.row] + windows.sum() - windows[best].sum()
        kept[sky.row] = rest > _NEGLIGIBLE * shares.sum()
    chosen = kept * np.concatenate([emitters, windows[best], [sunlight]])
    alike = kept / kept.sum()
    chosen = chosen / chosen.sum() if chosen.sum() > 0 else alike
    chosen = (1 - _UNIFORM) * chosen + _UNIFORM * alike
    plan = LightPlan(
        chosen[:count],
        chosen[count:-1],
        panes.take(best),
        float(chosen[-1]),
        sky.sun if sky is not None else None,
    )
    return plan, best


def _sky_of(scene: Any) -> _Sky | None:
    environment = scene.environment()
    if environment is None:
        return None
    row = next(row for row, one in enumerate(scene.emitters()) if one.is_environment())
    params = mi.traverse(environment)
    keys = {key for key, _ in params.items()}
    if "sun_direction" not in keys:
        return _Sky(row, None, not any(key.endswith("data") for key in keys))
    local = np.array(params["sun_direction"], dtype=np.float64).ravel()
    turned = np.array(params["to_world"].matrix, dtype=np.float64).reshape(4, 4)[:3, :3] @ local
    for towards in (turned, local):
        sun = _disc_about(environment, towards / np.linalg.norm(towards))
        if sun is not None:
            return _Sky(row, sun, True)
    return _Sky(row, None, float(params["sun_scale"]) == 0)


def _disc_about(environment: Any, towards: Float64Array) -> Sun | None:
    """The sun around `towards`, as wide as the sky is bright there; None if it shines not there."""
    aside = perpendicular(towards)
    angles = np.radians(np.arange(0, _WIDEST, _STEP))
    around = np.cos(angles)[:, None] * towards + np.sin(angles)[:, None] * aside
    beyond = dr.zeros(mi.SurfaceInteraction3f, len(angles))
    beyond.wi = vector(mi.Vector3f, -around)
    light = luminance(np.array(environment.eval(beyond)).T.astype(np.float64))
    edge = int(np.argmax(light[:-1] / np.maximum(light[1:], 1e-30)))
    if light[edge] <= _CONTRAST * light[edge + 1]:
        return None
    # A little wider: rounding at the edge then meets sky, not sun.
    return Sun(towards, float(np.cos(_MARGIN * angles[edge + 1])))


def perpendicular(direction: Float64Array) -> Float64Array:
    """A unit vector at right angles to `direction` (3,): level, unless that points up or down."""
    aside = np.cross(direction, [0.0, 0.0, 1.0] if abs(direction[2]) < 0.9 else [0.0, 1.0, 0.0])
    return np.asarray(aside / np.linalg.norm(aside))


def panes_of(portals: tuple[Portal, ...]) -> Panes:
    """The rectangle around each portal's polygon, in its plane; the tiny ones are left out."""
    corners, firsts, seconds, normals = [], [], [], []
    for portal in portals:
        polygon, normal = np.array(portal.polygon), np.array(portal.normal, dtype=np.float64)
        normal = normal / np.linalg.norm(normal)
        aside = perpendicular(normal)
        upwards = np.cross(aside, normal)
        across, along = (polygon - polygon[0]) @ aside, (polygon - polygon[0]) @ upwards
        first, second = np.ptp(across) * aside, np.ptp(along) * upwards
        if np.linalg.norm(first) * np.linalg.norm(second) < _AREA:
            continue
        corners.append(polygon[0] + across.min() * aside + along.min() * upwards)
        firsts.append(first)
        seconds.append(second)
        normals.append(normal)
    stacked = [np.array(rows).reshape(-1, 3) for rows in (corners, firsts, seconds, normals)]
    return Panes(stacked[0], (stacked[1], stacked[2]), stacked[3])


def _pilot(scene: Any, view: View, seed: int) -> Pilot:
    random = generator(seed, "pilot")
    width, height = _GRID
    columns, rows = np.meshgrid(np.arange(width) + 0.5, np.arange(height) + 0.5)
    pixels = np.stack([columns * view.width / width, rows * view.height / height], axis=-1)
    local = np.concatenate([pixels.reshape(-1, 2), np.ones((width * height, 1))], axis=1)
    directions = local @ np.linalg.inv(view.intrinsics).T @ view.pose[:3, :3].T
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    origins = np.tile(view.eye, (len(directions), 1))
    points, normals, hit = first_hits(scene, origins, directions)
    bounced = random.normal(size=points.shape)
    bounced = bounced / np.linalg.norm(bounced, axis=1, keepdims=True) + normals
    lengths = np.linalg.norm(bounced, axis=1, keepdims=True)
    bounced = np.where(lengths > 1e-3, bounced / np.maximum(lengths, 1e-3), normals)
    further, beside, again = first_hits(scene, points + LIFT * normals, bounced)
    return Pilot(
        np.concatenate([points, further]),
        np.concatenate([normals, beside]),
        np.concatenate([hit, hit & again]),
    )


def first_hits(
    scene: Any, origins: Float64Array, directions: Float64Array
) -> tuple[Float64Array, Float64Array, BoolArray]:
    """Points, normals, and which rays hit; for those that did not, their own origin and the way
    back."""
    ray = mi.Ray3f(vector(mi.Point3f, origins), vector(mi.Vector3f, directions))
    si = scene.ray_intersect(ray)
    hit = si.is_valid()
    normal = dr.select(dr.dot(si.n, ray.d) > 0, -si.n, si.n)
    values = dr.select(hit, si.p, ray.o), dr.select(hit, normal, -ray.d)
    points, normals = (np.array(value).T.astype(np.float64) for value in values)
    return points, normals, np.array(hit)


def _asked(
    scene: Any,
    points: Float64Array,
    normals: Float64Array,
    panes: Panes,
    sky: _Sky | None,
    seed: int,
) -> tuple[Float64Array, Places]:
    """Luminance that each light brings to each point, (P, N + K + 1): emitters, panes, the sun; and
    where the emitters are.

    Of an even sky, the sun's disc counts for the sun, what comes through panes for them, and only
    the rest for the environment's own sampling. Of another it is split by the balance heuristic.
    """
    random = generator(seed, "asked")
    places = np.repeat(points + LIFT * normals, _ASKED, axis=0)
    facing = np.repeat(normals, _ASKED, axis=0)
    of_emitters, lamps = _from_emitters(scene, places, facing, panes, sky, random)
    brought = [
        of_emitters,
        _through_panes(scene, places, facing, panes, sky, random),
        from_sun(scene, places, facing, sky.sun if sky is not None else None, random),
    ]
    shape = (-1, len(points), _ASKED)
    return np.concatenate([part.reshape(shape).mean(axis=-1) for part in brought]).T, lamps


def _from_emitters(
    scene: Any,
    places: Float64Array,
    facing: Float64Array,
    panes: Panes,
    sky: _Sky | None,
    random: np.random.Generator,
) -> tuple[Float64Array, Places]:
    """One estimate of each emitter's light at each place, (N, Q); and where the emitters are."""
    emitters = mi.EmitterPtr(list(scene.emitters()))
    count = len(emitters)
    index = column(mi.UInt32, np.repeat(np.arange(count), len(places)))
    si = _surface(np.tile(places, (count, 1)), np.tile(facing, (count, 1)))
    numbers = vector(mi.Point2f, random.random((count * len(places), 2)))
    ds, light = dr.gather(mi.EmitterPtr, emitters, index).sample_direction(si, numbers)
    hidden = scene.ray_test(si.spawn_ray_to(ds.p), ds.pdf != 0)
    light = dr.select(hidden | (ds.pdf == 0), 0, light * dr.maximum(dr.dot(ds.d, si.n), 0))
    density, towards = np.array(ds.pdf, dtype=np.float64), np.array(ds.d).T
    brought = luminance(np.array(light).T.astype(np.float64)).reshape(count, -1)
    if sky is not None:
        mine = slice(sky.row * len(places), (sky.row + 1) * len(places))
        there = towards[mine].astype(np.float64)
        others = _densities(panes, places, there).sum(axis=1)
        if sky.even:
            brought[sky.row] *= (others == 0) & ~in_disc(sky.sun, there)
        else:
            brought[sky.row] *= density[mine] / np.maximum(density[mine] + others, 1e-30)
    spots = np.array(ds.p).T.astype(np.float64).reshape(count, -1, 3)
    return np.nan_to_num(brought), _places_of(scene, spots)


def _places_of(scene: Any, spots: Float64Array) -> Places:
    """From points (N, Q, 3) on the emitters; what is infinitely far is everywhere alike."""
    far = [mi.has_flag(one.flags(), mi.EmitterFlags.Infinite) for one in scene.emitters()]
    fine = np.where(np.isfinite(spots), spots, 0)
    centre = np.where(np.array(far)[:, None], 0, fine.mean(axis=1))
    spread = np.sqrt(((fine - centre[:, None]) ** 2).sum(axis=-1).mean(axis=1))
    return Places(centre, np.where(far, _FLAT, np.maximum(spread, _LEAST)))


def in_disc(sun: Sun | None, directions: Float64Array) -> BoolArray:
    if sun is None:
        return np.zeros(directions.shape[:-1], dtype=bool)
    return np.asarray(directions @ sun.towards > sun.cosine)


def _through_panes(
    scene: Any,
    places: Float64Array,
    facing: Float64Array,
    panes: Panes,
    sky: _Sky | None,
    random: np.random.Generator,
) -> Float64Array:
    """One estimate of the sky's light through each pane at each place, (K, Q)."""
    count = len(panes.area)
    if not count or sky is None:
        return np.zeros((count, len(places)))
    towards, worth = towards_panes(places, facing, panes, random)
    worth = worth * ~in_disc(sky.sun, towards)
    light = seen(scene, np.tile(places, (count, 1)), towards.reshape(-1, 3)).reshape(count, -1)
    return np.asarray(np.nan_to_num(light * worth))


def towards_panes(
    places: Float64Array, facing: Float64Array, panes: Panes, random: np.random.Generator
) -> tuple[Float64Array, Float64Array]:
    """From each place a direction to a point on each pane, (K, Q, 3), and the irradiance that
    radiance 1 from there would bring, over the point's density, (K, Q)."""
    spots = random.random((len(panes.area), len(places), 2, 1))
    first, second = (edge[:, None] for edge in panes.edges)
    towards = panes.corner[:, None] + spots[:, :, 0] * first + spots[:, :, 1] * second - places
    metres = np.maximum(np.linalg.norm(towards, axis=-1, keepdims=True), 1e-3)
    towards = towards / metres
    slope = np.maximum((towards * panes.normal[:, None]).sum(axis=-1), 0)
    cosine = np.maximum((towards * facing).sum(axis=-1), 0)
    return towards, panes.area[:, None] * slope * cosine / metres[..., 0] ** 2


def from_sun(
    scene: Any,
    places: Float64Array,
    facing: Float64Array,
    sun: Sun | None,
    random: np.random.Generator,
) -> Float64Array:
    """One estimate of the sun's light at each place, (1, Q)."""
    if sun is None:
        return np.zeros((1, len(places)))
    numbers = vector(mi.Point2f, random.random((len(places), 2)))
    local = mi.warp.square_to_uniform_cone(numbers, sun.cosine)
    frame = mi.Frame3f(mi.Vector3f(*sun.towards.tolist()))
    towards = np.array(frame.to_world(local)).T.astype(np.float64)
    cosine = np.maximum((towards * facing).sum(axis=-1), 0)
    return (seen(scene, places, towards) * cosine / sun.density)[None]


def seen(scene: Any, places: Float64Array, directions: Float64Array) -> Float64Array:
    """Luminance of the environment in directions (Q, 3) from places (Q, 3), 0 where hidden."""
    beyond = dr.zeros(mi.SurfaceInteraction3f, len(places))
    beyond.wi = vector(mi.Vector3f, -directions)
    light = scene.environment().eval(beyond)
    hidden = scene.ray_test(mi.Ray3f(vector(mi.Point3f, places), -beyond.wi))
    shown = np.array(dr.select(hidden, 0, light)).T.astype(np.float64)
    return np.asarray(luminance(shown), dtype=np.float64)


def _surface(places: Float64Array, normals: Float64Array) -> Any:
    si = dr.zeros(mi.SurfaceInteraction3f, len(places))
    si.p, si.n = vector(mi.Point3f, places), vector(mi.Normal3f, normals)
    return si


def _densities(panes: Panes, places: Float64Array, towards: Float64Array) -> Float64Array:
    """Density of each direction through each pane, (Q, K)."""
    slope = towards @ panes.normal.T
    away = ((panes.corner[None] - places[:, None]) * panes.normal[None]).sum(axis=-1)
    fine = (slope > 1e-6) & (away > 0)
    metres = np.where(fine, away / np.where(fine, slope, 1), 0)
    spot = places[:, None] + metres[..., None] * towards[:, None] - panes.corner[None]
    for edge in panes.edges:
        part = (spot * edge[None]).sum(axis=-1) / (edge**2).sum(axis=-1)
        fine &= (part >= 0) & (part <= 1)
    return np.where(fine, metres**2 / (panes.area * np.where(fine, slope, 1)), 0)


def _shares(brought: Float64Array, seen: int) -> Float64Array:
    """Root mean square of what each light adds, (N + K + 1,), relative to the pixels' brightness.

    The first `seen` points are in the image: there a light's share counts. The others are a
    bounce away: what they pass on adds to pixels of any brightness, so a small patch in the sun,
    which lights the whole room, counts for much.
    """
    total = brought.sum(axis=1)
    if not total.any():
        return np.zeros(brought.shape[1])
    passed_on = ALBEDO * total[seen:].mean() if len(total) > seen else 0.0
    brightness = total[:seen].mean() + passed_on
    near = brought[:seen] / (total[:seen] + passed_on + _FAINT * brightness)[:, None]
    far = np.minimum(ALBEDO * brought[seen:] / brightness, _MOST)
    return np.asarray(np.sqrt((near**2).mean(axis=0) + (far**2).sum(axis=0) / max(1, len(far))))
