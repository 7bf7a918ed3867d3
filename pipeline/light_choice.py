"""Which light a path's vertex asks: uniformly, as Mitsuba does, or by what lights the view.

In a home most lamps burn in other rooms, and nearly all of the sky is behind walls: chosen
uniformly, most emitter samples find nothing. A `LightPlan` is made for each view from a small
pilot: points that the camera sees, and points one bounce further, ask every emitter, and every
window through which the sky may shine. Emitters are then chosen in proportion to the root mean
square of what they add to pixels, relative to the pixels' brightness (which minimises the variance
of one-sample estimates), windows get directions of their own, uniform over their
area, and a twentieth of the choice goes to all emitters alike, so that no light is ever left out:
the estimate is unbiased whatever the pilot found.

The pilot sees geometry and lights, no materials, so that plans, like shading, depend on no colour.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np
import numpy.typing as npt

from pipeline.rays import column, vector
from pipeline.tonemap import luminance
from pipeline.views import View
from scenes.contract import Portal
from scenes.seeds import generator

WINDOWS = 4  # at most so many of a scene's get directions of their own in a view
_GRID = (24, 18)  # camera rays of the pilot
_ASKED = 4  # samples of each light at each point
_UNIFORM = 0.05  # share of the choice that all emitters have alike
_FAINT = 0.01  # of the mean light: points darker than that do not count fully
_ALBEDO = 0.5  # what surfaces are taken to pass on
_MOST = 10.0  # times the brightness of pixels that one point may add
_LIFT = 1e-3  # metres that the pilot's rays start above surfaces
_AREA = 1e-4  # square metres: smaller openings are left to the sky's own sampling

Floats = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Panes:
    """Rectangles that the sky may shine through: a corner (K, 3), two edges (K, 3), the normal
    that points outdoors (K, 3)."""

    corner: Floats
    edges: tuple[Floats, Floats]
    normal: Floats

    @property
    def area(self) -> Floats:
        """Square metres, (K,)."""
        lengths = [np.linalg.norm(edge, axis=1) for edge in self.edges]
        return np.asarray(lengths[0] * lengths[1])

    def take(self, chosen: npt.NDArray[np.int64]) -> Panes:
        """Some of them."""
        first, second = self.edges
        return Panes(self.corner[chosen], (first[chosen], second[chosen]), self.normal[chosen])


@dataclass(frozen=True)
class LightPlan:
    """How a view chooses its lights: `emitters` (N,) sums to 1; with probability `through` the
    direction goes through one of `panes` instead, chosen by `windows` (K,), which sums to 1."""

    emitters: Floats
    through: float
    windows: Floats
    panes: Panes


class UniformLights:
    """Mitsuba's own choice: every emitter alike."""

    def sample(self, scene: Any, si: Any, random: Any, active: Any) -> tuple[Any, Any]:
        """A direction towards a light, and its radiance over density, 0 where it is hidden."""
        return scene.sample_emitter_direction(si, random, True, active)  # type: ignore[no-any-return]

    def density(self, scene: Any, before: Any, ds: Any, active: Any) -> Any:
        """Density with which `sample` at `before` gives the direction `ds`."""
        return scene.pdf_emitter_direction(before, ds, active)


class PlannedLights:
    """The choice of a `LightPlan`."""

    def __init__(self, scene: Any, plan: LightPlan) -> None:
        self.emitters = mi.EmitterPtr(list(scene.emitters()))
        self.environment = scene.environment()
        numbers = np.array(dr.reinterpret_array(mi.UInt32, self.emitters))
        pmf = np.zeros(numbers.max() + 1)
        pmf[numbers] = plan.emitters
        self.pmf = column(mi.Float, pmf)  # by an emitter's number in the registry
        self.choice = mi.DiscreteDistribution(column(mi.Float, plan.emitters))
        self.panes = None
        if self.environment is not None and len(plan.windows):
            self.panes = _PaneSampler(plan)
            number = dr.reinterpret_array(mi.UInt32, mi.EmitterPtr(self.environment))
            self.sky_pmf = dr.opaque(mi.Float, pmf[int(np.array(number)[0])])
        self.through = dr.opaque(mi.Float, plan.through)

    def sample(self, scene: Any, si: Any, random: Any, active: Any) -> tuple[Any, Any]:
        """As that of `UniformLights`."""
        if self.panes is None:
            ds, light = self._ask(si, random, active)
        else:
            through = random.x < self.through
            rest = dr.select(
                through, random.x / self.through, (random.x - self.through) / (1 - self.through)
            )
            random = mi.Point2f(rest, random.y)
            ds, light = self._ask(si, random, active & ~through)
            other, other_light = self._look_out(scene, si, random, active & through)
            ds, light = dr.select(through, other, ds), dr.select(through, other_light, light)
            density = self._either(si.p, ds, through)
            light *= dr.select(ds.pdf > 0, ds.pdf / density, 0)
            ds.pdf = dr.select(ds.pdf > 0, density, 0)
        hidden = scene.ray_test(si.spawn_ray_to(ds.p), active & (ds.pdf != 0))
        ds.pdf[hidden] = 0
        return ds, dr.select(hidden, 0, light)

    def density(self, scene: Any, before: Any, ds: Any, active: Any) -> Any:
        """As that of `UniformLights`."""
        number = dr.reinterpret_array(mi.UInt32, ds.emitter)
        pmf = dr.gather(mi.Float, self.pmf, number, active)
        density = pmf * ds.emitter.pdf_direction(before, ds, active)
        if self.panes is None:
            return density
        leaving = dr.select(self._is_sky(ds), self.panes.density(before.p, ds.d), 0)
        return self.through * leaving + (1 - self.through) * density

    def _either(self, origin: Any, ds: Any, through: Any) -> Any:
        """Density with which one way or the other gives what `through` says which one gave.

        Each sample's own density is taken from it: computed anew it may differ, as at the very
        edge of the sun's disc.
        """
        assert self.panes is not None
        sky = self._is_sky(ds) & ~ds.delta
        asked = dr.select(through, self._asked_density(origin, ds, sky & through), ds.pdf)
        seen = dr.select(through, ds.pdf, self.panes.density(origin, ds.d))
        return (1 - self.through) * asked + self.through * dr.select(sky, seen, 0)

    def _asked_density(self, origin: Any, ds: Any, active: Any) -> Any:
        before = dr.zeros(mi.Interaction3f)
        before.p = origin
        return self.sky_pmf * self.environment.pdf_direction(before, ds, active)

    def _is_sky(self, ds: Any) -> Any:
        return ds.emitter == mi.EmitterPtr(self.environment)

    def _ask(self, si: Any, random: Any, active: Any) -> tuple[Any, Any]:
        """A sample of one emitter; density and light count the choice of the emitter."""
        index, again, pmf = self.choice.sample_reuse_pmf(random.x, active)
        emitter = dr.gather(mi.EmitterPtr, self.emitters, index, active)
        ds, light = emitter.sample_direction(si, mi.Point2f(again, random.y), active)
        ds.pdf *= pmf
        return ds, light / pmf

    def _look_out(self, scene: Any, si: Any, random: Any, active: Any) -> tuple[Any, Any]:
        """A direction through a pane to the sky; density and light count the choice of pane."""
        assert self.panes is not None
        towards = dr.normalize(self.panes.point(random) - si.p)
        density = self.panes.density(si.p, towards)
        ds = dr.zeros(mi.DirectionSample3f)
        ds.d, ds.n, ds.pdf = towards, -towards, density
        sphere = scene.bbox().bounding_sphere()
        ds.dist = 2 * sphere.radius
        ds.p = si.p + towards * ds.dist
        ds.emitter = mi.EmitterPtr(self.environment)
        beyond = dr.zeros(mi.SurfaceInteraction3f)
        beyond.wi = -towards
        light = self.environment.eval(beyond, active & (density > 0))
        return ds, dr.select(density > 0, light / density, 0)


class _PaneSampler:
    """Points on panes, and densities of directions through them; `WINDOWS` panes, some empty."""

    def __init__(self, plan: LightPlan) -> None:
        count = len(plan.windows)
        filled = np.zeros((WINDOWS, 12))
        first, second = plan.panes.edges
        filled[:count] = np.concatenate([plan.panes.corner, first, second, plan.panes.normal], 1)
        pmf = np.zeros(WINDOWS)
        pmf[:count] = plan.windows
        area = np.ones(WINDOWS)
        area[:count] = plan.panes.area
        self.numbers = column(mi.Float, filled.ravel())
        self.pmf, self.area = column(mi.Float, pmf), column(mi.Float, area)
        self.choice = mi.DiscreteDistribution(column(mi.Float, pmf))

    def point(self, random: Any) -> Any:
        """A point on one of the panes."""
        index, again, _ = self.choice.sample_reuse_pmf(random.x)
        corner, first, second, _ = self._pane(index)
        return corner + again * first + random.y * second

    def density(self, origin: Any, direction: Any) -> Any:
        """Density, by solid angle, of a direction from `origin`: the sum over the panes it
        leaves through."""
        density = mi.Float(0)
        for index in range(WINDOWS):
            corner, first, second, normal = self._pane(mi.UInt32(index))
            slope = dr.dot(direction, normal)
            reach = dr.dot(corner - origin, normal) / slope
            place = origin + reach * direction - corner
            across = dr.dot(place, first) / dr.squared_norm(first)
            along = dr.dot(place, second) / dr.squared_norm(second)
            inside = (slope > 1e-6) & (reach > 1e-4)
            inside &= (across >= 0) & (across <= 1) & (along >= 0) & (along <= 1)
            pmf = dr.gather(mi.Float, self.pmf, mi.UInt32(index))
            area = dr.gather(mi.Float, self.area, mi.UInt32(index))
            density += dr.select(inside, pmf * dr.square(reach) / (area * slope), 0)
        return density

    def _pane(self, index: Any) -> list[Any]:
        numbers = [dr.gather(mi.Float, self.numbers, 12 * index + i) for i in range(12)]
        return [mi.Vector3f(*numbers[3 * part : 3 * part + 3]) for part in range(4)]


def plan_lights(scene: Any, view: View, portals: tuple[Portal, ...], seed: int) -> LightPlan:
    """The plan of a view, from its pilot; `scene` is the Mitsuba scene."""
    points, normals, seen = _pilot_points(scene, view, seed)
    panes = panes_of(portals) if scene.environment() is not None else panes_of(())
    count = len(scene.emitters())
    shares = _shares(_asked(scene, points, normals, panes, seed), seen)
    emitters, windows = shares[:count], shares[count:]
    best = np.argsort(-windows, kind="stable")[:WINDOWS]
    best = best[windows[best] > 0]
    lit = emitters.sum() + windows[best].sum()
    through = float((1 - _UNIFORM) * windows[best].sum() / lit) if lit > 0 else 0.0
    chosen = emitters / emitters.sum() if emitters.sum() > 0 else np.full(count, 1 / count)
    # Of all choices, `_UNIFORM` are alike for all emitters, those of the panes counted in.
    alike = _UNIFORM / (1 - through)
    return LightPlan(
        (1 - alike) * chosen + alike / count,
        through,
        windows[best] / windows[best].sum() if len(best) else np.zeros(0),
        panes.take(best),
    )


def panes_of(portals: tuple[Portal, ...]) -> Panes:
    """The rectangle around each portal's polygon, in its plane; the tiny ones are left out."""
    corners, firsts, seconds, normals = [], [], [], []
    for portal in portals:
        polygon, normal = np.array(portal.polygon), np.array(portal.normal, dtype=np.float64)
        normal = normal / np.linalg.norm(normal)
        aside = np.cross(normal, [0.0, 0.0, 1.0] if abs(normal[2]) < 0.9 else [0.0, 1.0, 0.0])
        aside /= np.linalg.norm(aside)
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


def _pilot_points(scene: Any, view: View, seed: int) -> tuple[Floats, Floats, int]:
    """Points that the camera sees and, from each, one bounce further; normals towards where
    they were seen from; how many the camera sees."""
    random = generator(seed, "pilot")
    width, height = _GRID
    columns, rows = np.meshgrid(np.arange(width) + 0.5, np.arange(height) + 0.5)
    pixels = np.stack([columns * view.width / width, rows * view.height / height], axis=-1)
    local = np.concatenate([pixels.reshape(-1, 2), np.ones((width * height, 1))], axis=1)
    directions = local @ np.linalg.inv(view.intrinsics).T @ view.pose[:3, :3].T
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    origins = np.tile(view.eye, (len(directions), 1))
    found = [_first_hits(scene, origins, directions)]
    points, normals = found[0]
    bounced = random.normal(size=points.shape)
    bounced = bounced / np.linalg.norm(bounced, axis=1, keepdims=True) + normals
    lengths = np.linalg.norm(bounced, axis=1, keepdims=True)
    bounced = np.where(lengths > 1e-3, bounced / np.maximum(lengths, 1e-3), normals)
    found.append(_first_hits(scene, points + _LIFT * normals, bounced))
    both = [np.concatenate(parts) for parts in zip(*found, strict=True)]
    return both[0], both[1], len(points)


def _first_hits(scene: Any, origins: Floats, directions: Floats) -> tuple[Floats, Floats]:
    ray = mi.Ray3f(vector(mi.Point3f, origins), vector(mi.Vector3f, directions))
    si = scene.ray_intersect(ray)
    normal = dr.select(dr.dot(si.n, ray.d) > 0, -si.n, si.n)
    hit = np.array(si.is_valid())
    points, normals = (np.array(value).T.astype(np.float64)[hit] for value in (si.p, normal))
    return points, normals


def _asked(scene: Any, points: Floats, normals: Floats, panes: Panes, seed: int) -> Floats:
    """Luminance that each light brings to each point, (P, N + K): emitters, then panes.

    What the environment brings through panes counts for the panes, the rest (the sun) for it,
    split by the balance heuristic.
    """
    random = generator(seed, "asked")
    if not len(points):
        return np.zeros((0, len(scene.emitters()) + len(panes.area)))
    places = np.repeat(points + _LIFT * normals, _ASKED, axis=0)
    facing = np.repeat(normals, _ASKED, axis=0)
    brought = [
        _from_emitters(scene, places, facing, panes, random),
        _through_panes(scene, places, facing, panes, random),
    ]
    shape = (-1, len(points), _ASKED)
    return np.concatenate([part.reshape(shape).mean(axis=-1) for part in brought]).T


def _from_emitters(
    scene: Any, places: Floats, facing: Floats, panes: Panes, random: np.random.Generator
) -> Floats:
    """One estimate of each emitter's light at each place, (N, Q)."""
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
    for row, emitter in enumerate(scene.emitters()):
        if emitter.is_environment() and len(panes.area):
            mine = slice(row * len(places), (row + 1) * len(places))
            others = _densities(panes, places, towards[mine].astype(np.float64)).sum(axis=1)
            brought[row] *= density[mine] / np.maximum(density[mine] + others, 1e-30)
    return np.asarray(np.nan_to_num(brought))


def _through_panes(
    scene: Any, places: Floats, facing: Floats, panes: Panes, random: np.random.Generator
) -> Floats:
    """One estimate of the environment's light through each pane at each place, (K, Q)."""
    count = len(panes.area)
    if not count:
        return np.zeros((0, len(places)))
    spots = random.random((count, len(places), 2, 1))
    first, second = (edge[:, None] for edge in panes.edges)
    towards = panes.corner[:, None] + spots[:, :, 0] * first + spots[:, :, 1] * second - places
    reach = np.maximum(np.linalg.norm(towards, axis=-1, keepdims=True), 1e-3)
    towards = towards / reach
    slope = np.maximum((towards * panes.normal[:, None]).sum(axis=-1), 0)
    cosine = np.maximum((towards * facing).sum(axis=-1), 0)
    worth = panes.area[:, None] * slope * cosine / reach[..., 0] ** 2
    si = _surface(np.tile(places, (count, 1)), np.tile(facing, (count, 1)))
    si.wi = vector(mi.Vector3f, -towards.reshape(-1, 3))
    light = scene.environment().eval(si)
    light = dr.select(scene.ray_test(mi.Ray3f(si.p, -si.wi)), 0, light)
    brought = luminance(np.array(light).T.astype(np.float64)).reshape(count, -1)
    return np.asarray(np.nan_to_num(brought * worth))


def _surface(places: Floats, normals: Floats) -> Any:
    si = dr.zeros(mi.SurfaceInteraction3f, len(places))
    si.p, si.n = vector(mi.Point3f, places), vector(mi.Normal3f, normals)
    return si


def _densities(panes: Panes, places: Floats, towards: Floats) -> Floats:
    """Density of each direction through each pane, (Q, K)."""
    slope = towards @ panes.normal.T
    away = ((panes.corner[None] - places[:, None]) * panes.normal[None]).sum(axis=-1)
    fine = (slope > 1e-6) & (away > 0)
    reach = np.where(fine, away / np.where(fine, slope, 1), 0)
    spot = places[:, None] + reach[..., None] * towards[:, None] - panes.corner[None]
    for edge in panes.edges:
        part = (spot * edge[None]).sum(axis=-1) / (edge**2).sum(axis=-1)
        fine &= (part >= 0) & (part <= 1)
    return np.where(fine, reach**2 / (panes.area * np.where(fine, slope, 1)), 0)


def _shares(brought: Floats, seen: int) -> Floats:
    """Root mean square of what each light adds, (N + K,), relative to the brightness of pixels.

    The first `seen` points are in the image: there a light's share counts. The others are a
    bounce away: what they pass on adds to pixels of any brightness, so a small patch in the sun,
    which lights the whole room, counts for much.
    """
    total = brought.sum(axis=1)
    if not total.any():
        return np.zeros(brought.shape[1])
    passed_on = _ALBEDO * total[seen:].mean() if len(total) > seen else 0.0
    brightness = total[:seen].mean() + passed_on
    near = brought[:seen] / (total[:seen] + passed_on + _FAINT * brightness)[:, None]
    far = np.minimum(_ALBEDO * brought[seen:] / brightness, _MOST)
    return np.asarray(np.sqrt((near**2).mean(axis=0) + (far**2).sum(axis=0) / max(1, len(far))))
