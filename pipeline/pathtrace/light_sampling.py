"""Which light a path's vertex asks: uniformly, as Mitsuba does, or by a `LightPlan`.

Planned, windows get directions uniform over their area and the sun directions over its disc.
Which of them, or which lamp, is chosen anew at every vertex: mostly by what each would bring there
were nothing in between (its strength times `light_plan.reach`), for the rest by the view's shares,
lest a light that the strengths misjudge be hardly ever asked.
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

from pipeline.pathtrace.guiding import GLOWS, BouncePlan
from pipeline.pathtrace.light_pilot import LAMPS, OUTDOORS, LightPlan, Panes, reach
from pipeline.render.raycast import column

_BY_VIEW = 0.2  # share of the choice that goes by the view's shares alone
_GUIDED = 0.4  # of the paths at a vertex go through panes, if all bounced light comes from there


@dataclass(init=False, eq=False)
class UniformLights:
    """Mitsuba's own choice: every emitter alike."""

    def sample(self, scene: Any, si: Any, random: Any, active: Any) -> tuple[Any, Any]:
        """A direction towards a light, and its radiance over density, 0 where it is hidden."""
        return scene.sample_emitter_direction(si, random, True, active)  # type: ignore[no-any-return]

    def density(self, scene: Any, before: Any, ds: Any, active: Any) -> Any:
        """Density with which `sample` at `before` gives the direction `ds`."""
        return scene.pdf_emitter_direction(before, ds, active)

    def guidance(self, si: Any, active: Any) -> None:
        """None: paths go on as the materials say."""


@dataclass(init=False, eq=False)
class PlannedLights:
    """The choice of a `LightPlan`.

    Directions into the environment come by up to three ways (`_Outdoors`); each counts with the
    density with which any of them gives it. Figures of the plan are opaque to the compiler, so
    that all views of a scene share one kernel.
    """

    lamps: _Lamps | None
    outdoors: _Outdoors | None
    indoors: list[Any]  # mi.Float, lowest and highest coordinates of the rooms
    guide: _Guide | None

    def __init__(self, scene: Any, plan: LightPlan, bounces: BouncePlan | None = None) -> None:
        self.indoors = _scalars(np.clip(plan.indoors, -1e9, 1e9))
        lit = plan.emitters.any()
        self.lamps = _Lamps(scene, plan) if lit else None
        self.outdoors = _Outdoors(scene, plan) if plan.windows.sum() + plan.sunlight > 0 else None
        self.guide = _Guide(bounces, plan.bounced) if bounces is not None else None

    def sample(self, scene: Any, si: Any, random: Any, active: Any) -> tuple[Any, Any]:
        """As that of `UniformLights`."""
        chances = self.chances(si.p, si.n)
        which, again = _pick(chances, random.x)
        spot = mi.Point2f(_below_one(again), random.y)
        first = len(chances) - self.beyond
        ds, light = dr.zeros(mi.DirectionSample3f), mi.Color3f(0)
        if self.lamps is not None:
            ds, light = self._ask(si, chances, which, spot, active & (which < first))
        if self.outdoors is not None:
            out = which >= first
            other, other_light = self.outdoors.sample(
                scene, si, chances, which - first, spot, active & out
            )
            other.pdf += self._own(si, other, chances, active & out)
            other_light = dr.select(other.pdf > 0, other_light / other.pdf, 0)
            ds, light = dr.select(out, other, ds), dr.select(out, other_light, light)
        hidden = scene.ray_test(si.spawn_ray_to(ds.p), active & (ds.pdf != 0))
        ds.pdf[hidden] = 0
        return ds, dr.select(hidden, 0, light)

    def density(self, scene: Any, before: Any, ds: Any, active: Any) -> Any:
        """As that of `UniformLights`."""
        chances = self.chances(before.p, before.n)
        density = mi.Float(0)
        sky = mi.Bool(False)
        if self.outdoors is not None:
            sky = ds.emitter == mi.EmitterPtr(self.outdoors.environment)
            density = dr.select(sky, self.outdoors.density(before.p, ds.d, chances), 0)
        if self.lamps is not None:
            asked = active if self._asks_sky else active & ~sky
            density += self.lamps.chance(ds.emitter, chances) * ds.emitter.pdf_direction(
                before, ds, asked
            )
        return density

    def guidance(self, si: Any, active: Any) -> Guidance | None:
        """Where paths at a vertex had better go on; None where nothing is known to be better."""
        return None if self.guide is None else self.guide.at(si, active)

    def chances(self, place: Any, normal: Any) -> list[Any]:
        """Probability of each light at a vertex: the lamps that are weighed, all other emitters
        together, the panes and the sun."""
        weights, shares = [], []
        outside = self._is_outside(place)
        for part in (self.lamps, self.outdoors):
            if part is not None:
                weights += part.weights(place, normal, outside)
                shares += part.shares()
        total = sum(weights, mi.Float(0))
        by_view = dr.select(total > 0, _BY_VIEW, 1.0)
        near = dr.select(total > 0, (1 - _BY_VIEW) / total, 0.0)
        return [
            by_view * share + near * weight for share, weight in zip(shares, weights, strict=True)
        ]

    def _is_outside(self, place: Any) -> Any:
        """Whether a vertex lies beyond the box around the rooms."""
        outside = mi.Bool(False)
        for axis in range(3):
            low, high = self.indoors[axis], self.indoors[3 + axis]
            outside |= (place[axis] < low - OUTDOORS) | (place[axis] > high + OUTDOORS)
        return outside

    @property
    def beyond(self) -> int:
        """How many of the `chances` are those of panes and sun, the last ones."""
        return 0 if self.outdoors is None else self.outdoors.slots + 1

    @property
    def _asks_sky(self) -> bool:
        return self.outdoors is None or self.outdoors.asked

    def _own(self, si: Any, ds: Any, chances: list[Any], active: Any) -> Any:
        """Density with which the environment's own sampling gives a direction to it."""
        if self.lamps is None or not self._asks_sky:
            return mi.Float(0)
        before = dr.zeros(mi.Interaction3f)
        before.p = si.p
        chance = self.lamps.chance(ds.emitter, chances)
        return chance * ds.emitter.pdf_direction(before, ds, active & (ds.pdf > 0))

    def _ask(
        self, si: Any, chances: list[Any], which: Any, spot: Any, active: Any
    ) -> tuple[Any, Any]:
        """A sample of one emitter; density and light count all ways to choose it."""
        assert self.lamps is not None
        emitter, spot = self.lamps.emitter(which, spot)
        ds, light = emitter.sample_direction(si, spot, active)
        # The sample's own density is taken: computed anew it may differ, as at a disc's very edge.
        density = ds.pdf * self.lamps.chance(emitter, chances)
        if self.outdoors is not None and self.outdoors.asked:
            sky = (ds.emitter == mi.EmitterPtr(self.outdoors.environment)) & ~ds.delta
            density += dr.select(sky, self.outdoors.density(si.p, ds.d, chances), 0)
        # Of millions of samples of `sunsky` a few are not finite: they count as none.
        fine = (ds.pdf > 0) & dr.isfinite(ds.pdf) & dr.all(dr.isfinite(light))
        light = dr.select(fine, light * (ds.pdf / density), 0)
        ds.pdf = dr.select(fine, density, 0)
        return ds, light


def _pick(chances: list[Any], random: Any) -> tuple[Any, Any]:
    """The light in whose part of [0, 1) a number lies, and where in that part."""
    which, start, size = mi.UInt32(0), mi.Float(0), chances[0]
    passed = mi.Float(chances[0])
    for number, chance in enumerate(chances[1:], start=1):
        here = (random >= passed) & (chance > 0)
        which = dr.select(here, number, which)
        start = dr.select(here, passed, start)
        size = dr.select(here, chance, size)
        passed = passed + chance
    return which, dr.select(size > 0, (random - start) / size, 0)


def _below_one(number: Any) -> Any:
    """A stretched random number, in [0, 1) again: at 1, rounded up, some samplers return NaN."""
    return dr.clip(number, 0, dr.one_minus_epsilon(mi.Float))


@dataclass(init=False, eq=False)
class _Lamps:
    """Emitters, the environment with its own sampling among them: some are weighed at every
    vertex (`slots`), the others go by the view's shares."""

    slots: int
    numbers: list[Any]  # mi.Float, 7 a slot: centre, spread, strengths in- and outdoors, share
    slot_of: Any  # mi.UInt32, by an emitter's number in the registry; `slots` for the others
    share_of: Any  # mi.Float, by the same number: an emitter's share among the others
    rest: Any  # mi.Float, share of the view of all others
    emitters: Any  # mi.EmitterPtr, those in slots, then the others
    choice: Any  # mi.DiscreteDistribution over the others; None if there are none

    def __init__(self, scene: Any, plan: LightPlan) -> None:
        emitters = scene.emitters()
        asked = np.flatnonzero(plan.emitters)
        strengths = plan.strengths
        order = (
            asked if strengths is None else asked[np.argsort(-plan.emitters[asked], kind="stable")]
        )
        self.slots = min(LAMPS, len(asked)) if strengths is not None else 0
        near, others = order[: self.slots], np.sort(order[self.slots :])
        filled = np.zeros((self.slots, 7))
        if plan.places is not None and strengths is not None:
            filled[:, :3] = plan.places.centre[near]
            filled[:, 3] = plan.places.spread[near]
            filled[:, 4:6] = strengths.emitters[:, near].T
            filled[:, 6] = plan.emitters[near]
        self.numbers = _scalars(filled)
        registry = np.array(dr.reinterpret_array(mi.UInt32, mi.EmitterPtr(list(emitters))))
        slot_of = np.full(registry.max() + 1, self.slots, dtype=np.uint32)
        slot_of[registry[near]] = np.arange(self.slots)
        rest = float(plan.emitters[others].sum())
        share_of = np.zeros(registry.max() + 1)
        if len(others):
            share_of[registry[others]] = plan.emitters[others] / rest
        self.slot_of, self.share_of = column(mi.UInt32, slot_of), column(mi.Float, share_of)
        self.rest = dr.opaque(mi.Float, rest)
        self.emitters = mi.EmitterPtr([emitters[row] for row in (*near, *others)])
        self.choice = None
        if len(others):
            self.choice = mi.DiscreteDistribution(column(mi.Float, plan.emitters[others]))

    def weights(self, place: Any, normal: Any, outside: Any) -> list[Any]:
        """About what each slot's emitter would bring to a vertex; 0 for the others."""
        made = []
        for slot in range(self.slots):
            x, y, z, spread, indoors, outdoors, _ = self._slot(slot)
            strength = dr.select(outside, outdoors, indoors)
            towards = mi.Vector3f(x, y, z) - place
            squared = dr.squared_norm(towards)
            cosine = dr.abs(dr.dot(towards, normal)) * dr.rsqrt(squared + 1e-12)
            made.append(strength * reach(cosine, squared, spread))
        return [*made, mi.Float(0)]

    def shares(self) -> list[Any]:
        """The view's, of each slot and of the others."""
        return [*(self._slot(slot)[6] for slot in range(self.slots)), self.rest]

    def chance(self, emitter: Any, chances: list[Any]) -> Any:
        """Probability that an emitter is asked."""
        number = dr.reinterpret_array(mi.UInt32, emitter)
        known = number < dr.width(self.slot_of)
        slot = dr.gather(mi.UInt32, self.slot_of, number, known)
        share = dr.gather(mi.Float, self.share_of, number, known)
        found = share * chances[self.slots]
        for index in range(self.slots):
            found = dr.select(slot == index, chances[index], found)
        return dr.select(known, found, 0)

    def emitter(self, which: Any, spot: Any) -> tuple[Any, Any]:
        """The emitter of a slot or, by one of the random numbers, one of the others."""
        if self.choice is None:
            return dr.gather(mi.EmitterPtr, self.emitters, dr.minimum(which, self.slots - 1)), spot
        other, again, _ = self.choice.sample_reuse_pmf(spot.x)
        among = which >= self.slots
        index = dr.select(among, self.slots + other, which)
        x = dr.select(among, _below_one(again), spot.x)
        return dr.gather(mi.EmitterPtr, self.emitters, index), mi.Point2f(x, spot.y)

    def _slot(self, slot: int) -> list[Any]:
        return self.numbers[7 * slot : 7 * slot + 7]


@dataclass(init=False, eq=False)
class _Outdoors:
    """Directions to the environment through panes and to the sun's disc.

    Densities do not count the environment's own sampling, which `asked` says may give the same
    directions.
    """

    environment: Any  # mi.Emitter
    asked: bool
    panes: _PaneSampler | None
    sunny: bool
    frame: Any  # mi.Frame3f around the sun
    cosine: Any  # of the sun's angular radius
    uniform: Any  # mi.Float, density over the disc
    sun: list[Any]  # mi.Float: strength and share of the view

    def __init__(self, scene: Any, plan: LightPlan) -> None:
        self.environment = scene.environment()
        emitters = scene.emitters()
        own = next(row for row, emitter in enumerate(emitters) if emitter.is_environment())
        self.asked = bool(plan.emitters[own] > 0)
        strengths = plan.strengths.windows if plan.strengths is not None else np.zeros(0)
        self.panes = None
        if plan.windows.sum() > 0:
            slots = len(plan.windows)  # the same in all views of a scene
            self.panes = _PaneSampler(plan.panes, strengths, plan.windows, slots)
        sun = plan.sun if plan.sunlight > 0 else None
        self.sunny = sun is not None
        self.frame = self.cosine = self.uniform = None
        self.sun = []
        if sun is not None:
            towards = [dr.opaque(mi.Float, part) for part in sun.towards.tolist()]
            self.frame = mi.Frame3f(mi.Vector3f(*towards))
            self.cosine = dr.opaque(mi.Float, sun.cosine)
            self.uniform = dr.opaque(mi.Float, sun.density)
            strength = plan.strengths.sunlight if plan.strengths is not None else 0.0
            self.sun = _scalars([strength, plan.sunlight])

    @property
    def slots(self) -> int:
        """Panes that are weighed at every vertex."""
        return 0 if self.panes is None else len(self.panes.panes)

    def weights(self, place: Any, normal: Any, outside: Any) -> list[Any]:
        """About what comes to a vertex through each pane and from the sun."""
        made = [] if self.panes is None else self.panes.weights(place, normal)
        sun = mi.Float(0)
        if self.sunny:
            cosine = dr.abs(dr.dot(self.frame.n, normal))
            sun = self.sun[0] * reach(cosine, 0.0, 1.0)
            sun = dr.select(outside | self._through_panes(place), sun, 0)
        return [*made, sun]

    def _through_panes(self, place: Any) -> Any:
        """Whether the sun's rays come to a vertex through a pane."""
        if self.panes is None:
            return mi.Bool(False)
        return self.panes.density(place, self.frame.n, [mi.Float(1)] * self.slots) > 0

    def shares(self) -> list[Any]:
        """The view's, of each pane and of the sun."""
        made = [] if self.panes is None else self.panes.shares
        sun = self.sun[1] if self.sunny else mi.Float(0)
        return [*made, sun]

    def sample(
        self, scene: Any, si: Any, chances: list[Any], which: Any, spot: Any, active: Any
    ) -> tuple[Any, Any]:
        """A direction, its density and the radiance there, whether or not it is hidden; `which`
        pane, or the sun."""
        towards, sunwards = mi.Vector3f(0, 0, 1), mi.Bool(False)
        if self.panes is not None:
            towards = dr.normalize(self.panes.point(dr.minimum(which, self.slots - 1), spot) - si.p)
        if self.sunny:
            sunwards = which == self.slots
            local = mi.warp.square_to_uniform_cone(spot, self.cosine)
            towards = dr.select(sunwards, self.frame.to_world(local), towards)
        density = self.density(si.p, towards, chances, sunwards)
        fine = active & (density > 0)
        ds = dr.zeros(mi.DirectionSample3f)
        ds.d, ds.n = towards, -towards
        ds.dist = 2 * scene.bbox().bounding_sphere().radius
        ds.p = si.p + towards * ds.dist
        ds.emitter = mi.EmitterPtr(self.environment)
        ds.pdf = dr.select(fine, density, 0)
        beyond = dr.zeros(mi.SurfaceInteraction3f)
        beyond.wi = -towards
        return ds, dr.select(fine, self.environment.eval(beyond, fine), 0)

    def density(
        self, origin: Any, direction: Any, chances: list[Any], sunwards: Any = False
    ) -> Any:
        """Density, by solid angle, of a direction from `origin`; `sunwards`: known to be the
        sun's, which at the very edge of its disc rounding hides."""
        *through, sunlight = chances[-self.slots - 1 :]
        density = mi.Float(0)
        if self.panes is not None:
            density += self.panes.density(origin, direction, through)
        if self.sunny:
            inside = (dr.dot(direction, self.frame.n) > self.cosine) | sunwards
            density += dr.select(inside, sunlight * self.uniform, 0)
        return density


@dataclass(init=False, eq=False)
class _PaneSampler:
    """Points on rectangles, and densities of directions through them; some may be empty."""

    numbers: Any  # mi.Float, 9 a rectangle: corner, two edges
    panes: list[_Pane]
    shares: list[Any]  # mi.Float, of the view

    def __init__(self, panes: Panes, strengths: Any, shares: Any, slots: int) -> None:
        count = len(panes.area)
        strengths, shares = _padded(strengths, slots), _padded(shares, slots)
        corners = np.concatenate([panes.corner, *panes.edges], axis=1)
        self.numbers = column(mi.Float, _padded(corners, slots).ravel())
        self.shares = _scalars(shares)
        self.panes = [_Pane(panes, strengths, row) for row in range(count)]
        # Each an object of its own: kernels are recorded with what is the same and what is not.
        self.panes += [_Pane(None, strengths, 0) for _ in range(slots - count)]

    def weights(self, place: Any, normal: Any, one_side: bool = False) -> list[Any]:
        """About what comes to a vertex through each, to `one_side` of it or to both."""
        made = []
        for pane in self.panes:
            cosine = dr.dot(pane.towards(place), normal)
            cosine = dr.maximum(cosine, 0) if one_side else dr.abs(cosine)
            made.append(pane.strength * pane.reach(place, cosine))
        return made

    def point(self, pane: Any, random: Any) -> Any:
        """A point on a pane."""
        numbers = [dr.gather(mi.Float, self.numbers, 9 * pane + i) for i in range(9)]
        corner, first, second = (mi.Vector3f(*numbers[3 * k : 3 * k + 3]) for k in range(3))
        return corner + random.x * first + random.y * second

    def density(self, origin: Any, direction: Any, chances: list[Any]) -> Any:
        """Density, by solid angle, of a direction from `origin`: the sum over the panes it
        leaves through, each with its probability."""
        density = mi.Float(0)
        for pane, chance in zip(self.panes, chances, strict=True):
            density += chance * pane.density(origin, direction)
        return density


@dataclass(init=False, eq=False)
class _Pane:
    """A rectangle; one that is missing has no area to hit, and no strength."""

    centre: Any  # mi.Vector3f
    normal: Any  # mi.Vector3f, outwards
    across: Any  # mi.Vector3f, an edge over half its squared length
    along: Any  # mi.Vector3f, the other edge, so too
    area: Any  # mi.Float, as the next
    spread: Any
    strength: Any

    def __init__(self, panes: Panes | None, strengths: Any, row: int) -> None:
        if panes is None:
            up, nowhere = np.array([0.0, 0.0, 1.0]), np.full(3, 1e9)
            vectors, figures = (nowhere, up, nowhere, nowhere), (1.0, 1.0, 0.0)
        else:
            first, second = (edge[row] for edge in panes.edges)
            vectors = (
                panes.centre[row],
                panes.normal[row],
                2 * first / (first @ first),
                2 * second / (second @ second),
            )
            figures = (panes.area[row], panes.spread[row], strengths[row])
        self.centre, self.normal, self.across, self.along = (
            mi.Vector3f(*_scalars(vector)) for vector in vectors
        )
        self.area, self.spread, self.strength = _scalars(figures)

    def towards(self, place: Any) -> Any:
        """The direction from a vertex to its middle."""
        away = self.centre - place
        return away * dr.rsqrt(dr.squared_norm(away) + 1e-12)

    def reach(self, place: Any, cosine: Any) -> Any:
        """About what comes through it to a vertex, with this cosine there, at strength 1."""
        slope = dr.maximum(dr.dot(self.towards(place), self.normal), 0)
        return slope * reach(cosine, dr.squared_norm(self.centre - place), self.spread)

    def density(self, origin: Any, direction: Any) -> Any:
        """Density, by solid angle, of a direction from `origin`; 0 beside the pane."""
        slope = dr.dot(direction, self.normal)
        towards = self.centre - origin
        reached = dr.dot(towards, self.normal) / slope
        place = reached * direction - towards
        inside = (slope > 1e-6) & (reached > 1e-4)
        inside &= dr.abs(dr.dot(place, self.across)) <= 1
        inside &= dr.abs(dr.dot(place, self.along)) <= 1
        return dr.select(inside, dr.square(reached) / (self.area * slope), 0)


@dataclass(init=False, eq=False)
class _Guide:
    """Leads paths to the glows of a `BouncePlan`."""

    glows: _PaneSampler
    bounced: Any  # mi.Float, what bounces bring to a place on average

    def __init__(self, plan: BouncePlan, bounced: float) -> None:
        self.glows = _PaneSampler(plan.glows, plan.strengths, np.zeros(0), GLOWS)
        self.bounced = dr.opaque(mi.Float, bounced)

    def at(self, si: Any, active: Any) -> Guidance:
        """Its advice at a vertex."""
        facing = dr.mulsign(si.n, mi.Frame3f.cos_theta(si.wi))
        weights = self.glows.weights(si.p, facing, one_side=True)
        total = sum(weights, mi.Float(0))
        share = dr.select(active & (total > 0), _GUIDED * total / (total + self.bounced), 0)
        chances = [dr.select(total > 0, weight / total, 0) for weight in weights]
        return Guidance(share, chances, self.glows, si.p)


@dataclass(eq=False)
class Guidance:
    """At a vertex: with the probability `share` the path goes on to one of the glows."""

    share: Any
    chances: list[Any]
    glows: _PaneSampler
    place: Any

    def split(self, random: Any) -> tuple[Any, Any]:
        """Whether a random number says so, and that number made new."""
        led = random < self.share
        return led, _below_one(
            dr.select(led, random / self.share, (random - self.share) / (1 - self.share))
        )

    def direction(self, first: Any, second: Any) -> Any:
        """One to a glow."""
        which, _ = _pick(self.chances, first)
        return dr.normalize(self.glows.point(which, second) - self.place)

    def mixed(self, pdf: Any, direction: Any) -> Any:
        """Density of a direction by both ways, from that by the material's."""
        led = self.glows.density(self.place, direction, self.chances)
        return (1 - self.share) * pdf + self.share * led


def _scalars(values: Any) -> list[Any]:
    """`mi.Float` of one entry each, which kernels read far faster than they gather from arrays."""
    return [dr.opaque(mi.Float, float(value)) for value in np.ravel(values)]


def _padded(rows: Any, count: int) -> Any:
    """So many rows, the missing ones 0."""
    return np.concatenate([rows, np.zeros((count - len(rows), *rows.shape[1:]))])
