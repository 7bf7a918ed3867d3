"""Which light a path's vertex asks: uniformly, as Mitsuba does, or by a `LightPlan`.

Planned, windows get directions uniform over their area and the sun directions over its disc.
The estimate is unbiased whatever the plan says: a direction that no light sampling can give is
found by the materials' own sampling, whose weight then is 1.

The classes are dataclasses for Dr.Jit's sake, which finds the arrays of a frozen kernel in fields.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np

from pipeline.light_plan import WINDOWS, LightPlan
from pipeline.rays import column


@dataclass(init=False, eq=False)
class UniformLights:
    """Mitsuba's own choice: every emitter alike."""

    def sample(self, scene: Any, si: Any, random: Any, active: Any) -> tuple[Any, Any]:
        """A direction towards a light, and its radiance over density, 0 where it is hidden."""
        return scene.sample_emitter_direction(si, random, True, active)  # type: ignore[no-any-return]

    def density(self, scene: Any, before: Any, ds: Any, active: Any) -> Any:
        """Density with which `sample` at `before` gives the direction `ds`."""
        return scene.pdf_emitter_direction(before, ds, active)


@dataclass(init=False, eq=False)
class PlannedLights:
    """The choice of a `LightPlan`.

    Directions into the environment come by up to three ways (`_Outdoors`); each counts with the
    density with which any of them gives it. Figures of the plan are opaque to the compiler, so
    that all views of a scene share one kernel.
    """

    pmf: Any  # mi.Float, by an emitter's number in the registry
    asks: bool  # whether emitters are asked at all
    asking: Any  # mi.Float, probability of that
    emitters: Any  # mi.EmitterPtr, those that are asked
    choice: Any  # mi.DiscreteDistribution over them
    outdoors: _Outdoors | None

    def __init__(self, scene: Any, plan: LightPlan) -> None:
        emitters = scene.emitters()
        numbers = np.array(dr.reinterpret_array(mi.UInt32, mi.EmitterPtr(list(emitters))))
        pmf = np.zeros(numbers.max() + 1)
        pmf[numbers] = plan.emitters
        self.pmf = column(mi.Float, pmf)
        asked = np.flatnonzero(plan.emitters)
        self.asks = len(asked) > 0
        self.asking = dr.opaque(mi.Float, float(plan.emitters.sum()))
        self.emitters = self.choice = None
        if self.asks:
            self.emitters = mi.EmitterPtr([emitters[row] for row in asked])
            self.choice = mi.DiscreteDistribution(column(mi.Float, plan.emitters[asked]))
        self.outdoors = None
        if plan.windows.sum() + plan.sunlight > 0:
            self.outdoors = _Outdoors(scene, plan)

    def sample(self, scene: Any, si: Any, random: Any, active: Any) -> tuple[Any, Any]:
        """As that of `UniformLights`."""
        if self.outdoors is None:
            ds, light = self._ask(si, random, active)
        elif not self.asks:
            ds, light = self.outdoors.sample(scene, si, random, active)
        else:
            asks = random.x < self.asking
            first = dr.select(
                asks, random.x / self.asking, (random.x - self.asking) / (1 - self.asking)
            )
            random = mi.Point2f(_below_one(first), random.y)
            ds, light = self._ask(si, random, active & asks)
            other, other_light = self.outdoors.sample(scene, si, random, active & ~asks)
            ds, light = dr.select(asks, ds, other), dr.select(asks, light, other_light)
        hidden = scene.ray_test(si.spawn_ray_to(ds.p), active & (ds.pdf != 0))
        ds.pdf[hidden] = 0
        return ds, dr.select(hidden, 0, light)

    def density(self, scene: Any, before: Any, ds: Any, active: Any) -> Any:
        """As that of `UniformLights`."""
        if self.outdoors is None:
            return self._asked(before, ds, active)
        sky = ds.emitter == mi.EmitterPtr(self.outdoors.environment)
        outdoors = self.outdoors.density(before.p, ds.d)
        if self.outdoors.asked:
            return self._asked(before, ds, active) + dr.select(sky, outdoors, 0)
        return dr.select(sky, outdoors, self._asked(before, ds, active & ~sky))

    def _asked(self, before: Any, ds: Any, active: Any) -> Any:
        number = dr.reinterpret_array(mi.UInt32, ds.emitter)
        pmf = dr.gather(mi.Float, self.pmf, number, active)
        return pmf * ds.emitter.pdf_direction(before, ds, active)

    def _ask(self, si: Any, random: Any, active: Any) -> tuple[Any, Any]:
        """A sample of one emitter; density and light count all ways to choose it."""
        index, again, pmf = self.choice.sample_reuse_pmf(random.x, active)
        pmf *= self.asking
        emitter = dr.gather(mi.EmitterPtr, self.emitters, index, active)
        ds, light = emitter.sample_direction(si, mi.Point2f(_below_one(again), random.y), active)
        # The sample's own density is taken: computed anew it may differ, as at a disc's very edge.
        density = ds.pdf * pmf
        if self.outdoors is not None and self.outdoors.asked:
            sky = (ds.emitter == mi.EmitterPtr(self.outdoors.environment)) & ~ds.delta
            density += dr.select(sky, self.outdoors.density(si.p, ds.d), 0)
        # Of millions of samples of `sunsky` a few are not finite: they count as none.
        fine = (ds.pdf > 0) & dr.isfinite(ds.pdf) & dr.all(dr.isfinite(light))
        light = dr.select(fine, light * (ds.pdf / density), 0)
        ds.pdf = dr.select(fine, density, 0)
        return ds, light


def _below_one(number: Any) -> Any:
    """A stretched random number, in [0, 1) again: at 1, rounded up, some samplers return NaN."""
    return dr.clip(number, 0, dr.one_minus_epsilon(mi.Float))


@dataclass(init=False, eq=False)
class _Outdoors:
    """Directions to the environment through panes and to the sun's disc.

    Densities count the probabilities of both, not that of the environment's own sampling, which
    `asked` says may give the same directions.
    """

    environment: Any  # mi.Emitter
    asked: bool
    own_pmf: Any  # mi.Float, as the figures below: probability of the environment's own sampling
    through: Any  # probability of a direction through a pane
    share: Any  # of that among those through panes and to the sun
    panes: _PaneSampler | None
    sunny: bool
    frame: Any  # mi.Frame3f around the sun
    cosine: Any  # of the sun's angular radius
    sun_density: Any

    def __init__(self, scene: Any, plan: LightPlan) -> None:
        self.environment = scene.environment()
        emitters = scene.emitters()
        own = next(row for row, emitter in enumerate(emitters) if emitter.is_environment())
        self.asked = bool(plan.emitters[own] > 0)
        self.own_pmf = dr.opaque(mi.Float, float(plan.emitters[own]))
        through = float(plan.windows.sum())
        self.through = dr.opaque(mi.Float, through)
        self.share = dr.opaque(mi.Float, through / (through + plan.sunlight))
        self.panes = _PaneSampler(plan) if through > 0 else None
        sun = plan.sun if plan.sunlight > 0 else None
        self.sunny = sun is not None
        self.frame = self.cosine = self.sun_density = None
        if sun is not None:
            towards = [dr.opaque(mi.Float, part) for part in sun.towards.tolist()]
            self.frame = mi.Frame3f(mi.Vector3f(*towards))
            self.cosine = dr.opaque(mi.Float, sun.cosine)
            self.sun_density = dr.opaque(mi.Float, plan.sunlight * sun.density)

    def sample(self, scene: Any, si: Any, random: Any, active: Any) -> tuple[Any, Any]:
        """A direction, its density and its radiance over that, whether or not it is hidden."""
        share = self.share
        through = random.x < share
        towards, sunwards = mi.Vector3f(0, 0, 1), mi.Bool(False)
        if self.panes is not None:
            spot = mi.Point2f(_below_one(random.x / share), random.y)
            towards = dr.normalize(self.panes.point(spot) - si.p)
        if self.sunny:
            spot = mi.Point2f(_below_one((random.x - share) / (1 - share)), random.y)
            local = mi.warp.square_to_uniform_cone(spot, self.cosine)
            towards = dr.select(through, towards, self.frame.to_world(local))
            sunwards = ~through
        density = self.density(si.p, towards, sunwards)
        fine = active & (density > 0)
        ds = dr.zeros(mi.DirectionSample3f)
        ds.d, ds.n = towards, -towards
        ds.dist = 2 * scene.bbox().bounding_sphere().radius
        ds.p = si.p + towards * ds.dist
        ds.emitter = mi.EmitterPtr(self.environment)
        if self.asked:
            before = dr.zeros(mi.Interaction3f)
            before.p = si.p
            density += self.own_pmf * self.environment.pdf_direction(before, ds, fine)
        ds.pdf = dr.select(fine, density, 0)
        beyond = dr.zeros(mi.SurfaceInteraction3f)
        beyond.wi = -towards
        light = self.environment.eval(beyond, fine)
        return ds, dr.select(fine, light / density, 0)

    def density(self, origin: Any, direction: Any, sunwards: Any = False) -> Any:
        """Density, by solid angle, of a direction from `origin`; `sunwards`: known to be the
        sun's, which at the very edge of its disc rounding hides."""
        density = mi.Float(0)
        if self.panes is not None:
            density += self.through * self.panes.density(origin, direction)
        if self.sunny:
            inside = (dr.dot(direction, self.frame.n) > self.cosine) | sunwards
            density += dr.select(inside, self.sun_density, 0)
        return density


@dataclass(init=False, eq=False)
class _PaneSampler:
    """Points on panes, and densities of directions through them; `WINDOWS` panes, some empty."""

    numbers: Any  # mi.Float, 12 a pane: corner, two edges, normal
    pmf: Any  # mi.Float, as the next, one a pane
    area: Any
    choice: Any  # mi.DiscreteDistribution

    def __init__(self, plan: LightPlan) -> None:
        count = len(plan.windows)
        filled = np.zeros((WINDOWS, 12))
        first, second = plan.panes.edges
        filled[:count] = np.concatenate([plan.panes.corner, first, second, plan.panes.normal], 1)
        pmf = np.zeros(WINDOWS)
        pmf[:count] = plan.windows / plan.windows.sum()
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
