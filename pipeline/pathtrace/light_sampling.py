"""Emitter sampling for next-event estimation: uniform, as in Mitsuba, or by a light plan.

With a `LightPlan`, portals are sampled by directions uniform over their area, and the sun by
directions uniform over its disc. The choice among portals, sun and emitters is made at every
vertex: mostly in proportion to the unoccluded irradiance that each would cause there (its strength
times `pbrnet.pipeline.pathtrace.portals.geometry_factor`), for the rest by the view's
probabilities, so that a light whose strength is wrong is still sampled.

The estimate is unbiased for every plan: directions that emitter sampling cannot produce are found
by BSDF sampling, and multiple importance sampling then gives them the weight 1.

The classes are dataclasses because Dr.Jit finds the arrays of a frozen kernel in fields.
"""

from __future__ import annotations

from dataclasses import dataclass

import drjit as dr
import mitsuba as mi
import numpy as np

from pbrnet.pipeline.pathtrace.guiding import Guidance, GuidingPlan, PathGuide
from pbrnet.pipeline.pathtrace.light_plan import MAX_PORTALS, OUTDOOR_MARGIN, LightPlan
from pbrnet.pipeline.pathtrace.portals import (
    RectangleSampler,
    below_one,
    choose,
    geometry_factor,
    opaque_floats,
)
from pbrnet.pipeline.render.drjit_arrays import column, environment_pointer

_BY_VIEW = 0.2  # share of the choice that follows the view's probabilities alone
MAX_WEIGHTED = 12  # emitters with a weight of their own at each vertex
_FAR = 1e9  # metres, coordinates of empty slots


@dataclass(init=False, eq=False)
class UniformLights:
    """Mitsuba's own emitter sampling: all emitters have the same probability."""

    choices = 0  # numbers that `choice` returns

    def choice(self, position: mi.Point3f, normal: mi.Normal3f) -> list[mi.Float]:
        """Return what `sample` and `density` need to know of a vertex."""
        return []

    def sample(
        self,
        scene: mi.Scene,
        si: mi.SurfaceInteraction3f,
        choice: list[mi.Float],
        sample: mi.Point2f,
        active: mi.Bool,
    ) -> tuple[mi.DirectionSample3f, mi.Color3f]:
        """Sample a direction to an emitter from a vertex with `sample` in [0, 1)^2.

        Returns a `mi.DirectionSample3f` and radiance over density, 0 if occluded.
        """
        return scene.sample_emitter_direction(si, sample, True, active)  # type: ignore[no-any-return]

    def density(
        self,
        scene: mi.Scene,
        ref: mi.Interaction3f,
        choice: list[mi.Float],
        ds: mi.DirectionSample3f,
        active: mi.Bool,
    ) -> mi.Float:
        """Return the density by solid angle of the direction `ds` in `sample` at vertex `ref`."""
        return scene.pdf_emitter_direction(ref, ds, active)

    def guidance(self, si: mi.SurfaceInteraction3f, active: mi.Bool) -> None:
        """Return None: paths are not guided."""


@dataclass(init=False, eq=False)
class PlannedLights:
    """Emitter sampling by a `LightPlan`, and path guiding by a `GuidingPlan`.

    Three strategies may give the same direction into the environment: portals, sun, and its own
    sampling. Each sample is divided by the sum of their densities, which is the balance heuristic
    of a one-sample model (Veach and Guibas 1995). All figures of the plan are opaque to the
    compiler, and numbers of slots do not depend on the scene, so that scenes share kernels.
    """

    emitters: EmitterSampler | None
    outdoors: EnvironmentSampler | None
    indoors: list[mi.Float]  # lowest, then highest coordinates of the rooms
    guide: PathGuide | None

    def __init__(
        self, scene: mi.Scene, plan: LightPlan, guiding: GuidingPlan | None = None
    ) -> None:
        self.indoors = opaque_floats(np.clip(plan.indoors, -1e9, 1e9))
        self.emitters = EmitterSampler(scene, plan) if plan.emitters.any() else None
        sampled = len(plan.portals) > 0 or plan.sun > 0
        self.outdoors = EnvironmentSampler(scene, plan) if sampled else None
        self.guide = PathGuide(guiding, plan.indirect) if guiding is not None else None

    def sample(
        self,
        scene: mi.Scene,
        si: mi.SurfaceInteraction3f,
        probabilities: list[mi.Float],
        sample: mi.Point2f,
        active: mi.Bool,
    ) -> tuple[mi.DirectionSample3f, mi.Color3f]:
        """Sample a direction to an emitter; see `UniformLights.sample`."""
        index, stretched = choose(probabilities, sample.x)
        sample = mi.Point2f(below_one(stretched), sample.y)
        # The last ones are those of portals and sun.
        first = len(probabilities) - (0 if self.outdoors is None else self.outdoors.slots + 1)
        ds, light = dr.zeros(mi.DirectionSample3f), mi.Color3f(0)
        if self.emitters is not None:
            ds, light = self._sample_emitter(
                si, probabilities, index, sample, active & (index < first)
            )
        if self.outdoors is not None:
            out = index >= first
            other, other_light = self.outdoors.sample(
                scene, si, probabilities, index - first, sample, active & out
            )
            other.pdf += self._own_density(si, other, probabilities, active & out)
            other_light = dr.select(other.pdf > 0, other_light / other.pdf, 0)
            ds, light = dr.select(out, other, ds), dr.select(out, other_light, light)
        occluded = scene.ray_test(si.spawn_ray_to(ds.p), active & (ds.pdf != 0))
        ds.pdf[occluded] = 0
        return ds, dr.select(occluded, 0, light)

    def density(
        self,
        scene: mi.Scene,
        ref: mi.Interaction3f,
        probabilities: list[mi.Float],
        ds: mi.DirectionSample3f,
        active: mi.Bool,
    ) -> mi.Float:
        """Return the density of a direction; see `UniformLights.density`."""
        density = mi.Float(0)
        sky = mi.Bool(False)
        if self.outdoors is not None:
            sky = ds.emitter == self.outdoors.pointer
            density = dr.select(sky, self.outdoors.density(ref.p, ds.d, probabilities), 0)
        if self.emitters is not None:
            sampled = active if self._samples_environment else active & ~sky
            density += self.emitters.probability(
                ds.emitter, probabilities
            ) * ds.emitter.pdf_direction(ref, ds, sampled)
        return density

    def guidance(self, si: mi.SurfaceInteraction3f, active: mi.Bool) -> Guidance | None:
        """Return the guiding distribution at a vertex; None if the view has no guiding targets."""
        return None if self.guide is None else self.guide.at(si, active)

    @property
    def choices(self) -> int:
        """Number of probabilities at a vertex."""
        emitters = 0 if self.emitters is None else self.emitters.slots + 1
        return emitters + (0 if self.outdoors is None else self.outdoors.slots + 1)

    def choice(self, position: mi.Point3f, normal: mi.Normal3f) -> list[mi.Float]:
        """Return the probability of each light at a vertex.

        In this order: emitters with a slot, all other emitters together, portals, sun.
        """
        weights, by_view = [], []
        outdoors = self._is_outdoors(position)
        for part in (self.emitters, self.outdoors):
            if part is not None:
                weights += part.weights(position, normal, outdoors)
                by_view += part.view_probabilities()
        total = sum(weights, mi.Float(0))
        view_share = dr.select(total > 0, _BY_VIEW, 1.0)
        scale = dr.select(total > 0, (1 - _BY_VIEW) / total, 0.0)
        return [
            view_share * probability + scale * weight
            for probability, weight in zip(by_view, weights, strict=True)
        ]

    def _is_outdoors(self, position: mi.Point3f) -> mi.Bool:
        """Test whether a vertex lies outside the box around the rooms."""
        outdoors = mi.Bool(False)
        for axis in range(3):
            low, high = self.indoors[axis], self.indoors[3 + axis]
            outdoors |= position[axis] < low - OUTDOOR_MARGIN
            outdoors |= position[axis] > high + OUTDOOR_MARGIN
        return outdoors

    @property
    def _samples_environment(self) -> bool:
        """True if the environment's own sampling is used."""
        return self.outdoors is None or self.outdoors.own_sampling

    def _own_density(
        self,
        si: mi.SurfaceInteraction3f,
        ds: mi.DirectionSample3f,
        probabilities: list[mi.Float],
        active: mi.Bool,
    ) -> mi.Float:
        """Return the density of a direction by the environment's own sampling."""
        if self.emitters is None or not self._samples_environment:
            return mi.Float(0)
        ref = dr.zeros(mi.Interaction3f)
        ref.p = si.p
        probability = self.emitters.probability(ds.emitter, probabilities)
        return probability * ds.emitter.pdf_direction(ref, ds, active & (ds.pdf > 0))

    def _sample_emitter(
        self,
        si: mi.SurfaceInteraction3f,
        probabilities: list[mi.Float],
        index: mi.UInt32,
        sample: mi.Point2f,
        active: mi.Bool,
    ) -> tuple[mi.DirectionSample3f, mi.Color3f]:
        """Sample one emitter; density and radiance over density count all strategies."""
        assert self.emitters is not None
        emitter, sample = self.emitters.emitter(index, sample)
        ds, light = emitter.sample_direction(si, sample, active)
        # The sample's own density: computed anew it may differ, as at the very edge of a disc.
        density = ds.pdf * self.emitters.probability(emitter, probabilities)
        if self.outdoors is not None and self.outdoors.own_sampling:
            sky = (ds.emitter == self.outdoors.pointer) & ~ds.delta
            density += dr.select(sky, self.outdoors.density(si.p, ds.d, probabilities), 0)
        # A few of millions of `sunsky` samples are not finite: they count as zero.
        valid = (ds.pdf > 0) & dr.isfinite(ds.pdf) & dr.all(dr.isfinite(light))
        light = dr.select(valid, light * (ds.pdf / density), 0)
        ds.pdf = dr.select(valid, density, 0)
        return ds, light


@dataclass(init=False, eq=False)
class EmitterSampler:
    """Emitters of a scene, among them the environment with its own sampling.

    The most likely ones have a slot, hence a weight of their own at every vertex. The others share
    one more entry and are chosen among themselves by the view's probabilities.
    """

    slots: int
    numbers: list[mi.Float]  # 7 per slot: centre, spread, strengths in- and outdoors, share
    slot_of: mi.UInt32  #  by an emitter's registry id; `slots` for the others
    share_of: mi.Float  #  by registry id: an emitter's share among the others
    rest: mi.Float  # probability of all others together in the whole view
    emitters: mi.EmitterPtr  # those in slots, then the others
    choice: mi.DiscreteDistribution  #  over the others

    def __init__(self, scene: mi.Scene, plan: LightPlan) -> None:
        emitters = scene.emitters()
        sampled = np.flatnonzero(plan.emitters)
        strengths = plan.strengths
        order = (
            sampled
            if strengths is None
            else sampled[np.argsort(-plan.emitters[sampled], kind="stable")]
        )
        count = min(MAX_WEIGHTED, len(sampled)) if strengths is not None else 0
        weighted, others = order[:count], np.sort(order[count:])
        self.slots = MAX_WEIGHTED if count else 0
        numbers = np.zeros((self.slots, 7))
        numbers[:, :3] = _FAR
        if plan.extents is not None and strengths is not None:
            numbers[:count, :3] = plan.extents.centre[weighted]
            numbers[:count, 3] = plan.extents.spread[weighted]
            numbers[:count, 4:6] = strengths.emitters[:, weighted].T
            numbers[:count, 6] = plan.emitters[weighted]
        self.numbers = opaque_floats(numbers)
        registry = np.array(dr.reinterpret_array(mi.UInt32, mi.EmitterPtr(list(emitters))))
        slot_of = np.full(registry.max() + 1, self.slots, dtype=np.uint32)
        slot_of[registry[weighted]] = np.arange(count)
        rest = float(plan.emitters[others].sum())
        share_of = np.zeros(registry.max() + 1)
        if len(others):
            share_of[registry[others]] = plan.emitters[others] / rest
        self.slot_of, self.share_of = column(mi.UInt32, slot_of), column(mi.Float, share_of)
        self.rest = dr.opaque(mi.Float, rest)
        # From memory: a single id would be compiled in. Empty slots and, if there are no others,
        # their place are never chosen.
        empty = [order[0]] * (self.slots - count)
        if not len(others):
            others = order[:1]
        numbers = column(mi.UInt32, registry[[*weighted, *empty, *others]])
        self.emitters = dr.reinterpret_array(mi.EmitterPtr, numbers)
        self.choice = mi.DiscreteDistribution(column(mi.Float, plan.emitters[others]))

    def weights(
        self, position: mi.Point3f, normal: mi.Normal3f, outdoors: mi.Bool
    ) -> list[mi.Float]:
        """Return the approximate irradiance by each slot's emitter at a vertex, then 0."""
        weights = []
        for slot in range(self.slots):
            x, y, z, spread, indoor_strength, outdoor_strength, _ = self._slot(slot)
            strength = dr.select(outdoors, outdoor_strength, indoor_strength)
            offset = mi.Vector3f(x, y, z) - position
            squared = dr.squared_norm(offset)
            cosine = dr.abs(dr.dot(offset, normal)) * dr.rsqrt(squared + 1e-12)
            weights.append(strength * geometry_factor(cosine, squared, spread))
        return [*weights, mi.Float(0)]

    def view_probabilities(self) -> list[mi.Float]:
        """Return the view's probability of each slot and of the others together."""
        return [*(self._slot(slot)[6] for slot in range(self.slots)), self.rest]

    def probability(self, emitter: mi.EmitterPtr, probabilities: list[mi.Float]) -> mi.Float:
        """Return the probability that an emitter is sampled, given those at the vertex."""
        number = dr.reinterpret_array(mi.UInt32, emitter)
        known = number < dr.opaque(mi.UInt32, dr.width(self.slot_of))
        slot = dr.gather(mi.UInt32, self.slot_of, number, known)
        share = dr.gather(mi.Float, self.share_of, number, known)
        found = share * probabilities[self.slots]
        for index in range(self.slots):
            found = dr.select(slot == index, probabilities[index], found)
        return dr.select(known, found, 0)

    def emitter(self, index: mi.UInt32, sample: mi.Point2f) -> tuple[mi.EmitterPtr, mi.Point2f]:
        """Return the emitter of a slot, or one of the others, and the random numbers left.

        `sample` in [0, 1)^2 chooses among the others; its used component is stretched anew.
        """
        other, stretched, _ = self.choice.sample_reuse_pmf(sample.x)
        is_other = index >= self.slots
        row = dr.select(is_other, self.slots + other, index)
        x = dr.select(is_other, below_one(stretched), sample.x)
        return dr.gather(mi.EmitterPtr, self.emitters, row), mi.Point2f(x, sample.y)

    def _slot(self, slot: int) -> list[mi.Float]:
        return self.numbers[7 * slot : 7 * slot + 7]


@dataclass(init=False, eq=False)
class EnvironmentSampler:
    """Directions to the environment: uniform over a portal's area, or over the sun's disc.

    Densities exclude the environment's own sampling. `own_sampling` says that it is used as well
    and may give the same directions.
    """

    environment: mi.Emitter
    pointer: mi.EmitterPtr  #  to it
    far: mi.Float  # metres, distance of what it is taken for
    own_sampling: bool
    portals: RectangleSampler | None
    has_sun: bool
    frame: mi.Frame3f  #  around the sun's direction
    cosine: mi.Float  # of the sun's angular radius
    disc_density: mi.Float  # by solid angle over the disc
    sun: list[mi.Float]  # the sun's strength, and its probability in the whole view

    def __init__(self, scene: mi.Scene, plan: LightPlan) -> None:
        self.environment = scene.environment()
        self.pointer = environment_pointer(scene)
        self.far = dr.opaque(mi.Float, 2 * scene.bbox().bounding_sphere().radius)
        emitters = scene.emitters()
        row = next(row for row, emitter in enumerate(emitters) if emitter.is_environment())
        self.own_sampling = bool(plan.emitters[row] > 0)
        strengths = plan.strengths.portals if plan.strengths is not None else np.zeros(0)
        self.portals = None
        if len(plan.portals):
            self.portals = RectangleSampler(plan.rectangles, strengths, plan.portals, MAX_PORTALS)
        sun = plan.sun_disc if plan.sun > 0 else None
        self.has_sun = sun is not None
        self.frame = self.cosine = self.disc_density = None
        self.sun = []
        if sun is not None:
            direction = [dr.opaque(mi.Float, part) for part in sun.direction.tolist()]
            self.frame = mi.Frame3f(mi.Vector3f(*direction))
            self.cosine = dr.opaque(mi.Float, sun.cosine)
            self.disc_density = dr.opaque(mi.Float, sun.density)
            strength = plan.strengths.sun if plan.strengths is not None else 0.0
            self.sun = opaque_floats([strength, plan.sun])

    @property
    def slots(self) -> int:
        """Number of portals with a weight of their own at every vertex."""
        return 0 if self.portals is None else len(self.portals.rectangles)

    def weights(
        self, position: mi.Point3f, normal: mi.Normal3f, outdoors: mi.Bool
    ) -> list[mi.Float]:
        """Return the approximate irradiance through each portal and by the sun at a vertex."""
        weights = [] if self.portals is None else self.portals.weights(position, normal)
        sun = mi.Float(0)
        if self.has_sun:
            cosine = dr.abs(dr.dot(self.frame.n, normal))
            sun = self.sun[0] * geometry_factor(cosine, 0.0, 1.0)
            sun = dr.select(outdoors | self._sees_sun_through_portal(position), sun, 0)
        return [*weights, sun]

    def view_probabilities(self) -> list[mi.Float]:
        """Return the view's probability of each portal and of the sun."""
        portals = [] if self.portals is None else self.portals.probabilities
        sun = self.sun[1] if self.has_sun else mi.Float(0)
        return [*portals, sun]

    def sample(
        self,
        scene: mi.Scene,
        si: mi.SurfaceInteraction3f,
        probabilities: list[mi.Float],
        index: mi.UInt32,
        sample: mi.Point2f,
        active: mi.Bool,
    ) -> tuple[mi.DirectionSample3f, mi.Color3f]:
        """Sample a direction through portal `index`, or to the sun if `index` is `slots`.

        Returns a `mi.DirectionSample3f` with the density, and the radiance of the environment
        there, without a visibility test.
        """
        direction, to_sun = mi.Vector3f(0, 0, 1), mi.Bool(False)
        if self.portals is not None:
            slot = dr.minimum(index, self.slots - 1)
            direction = dr.normalize(self.portals.point(slot, sample) - si.p)
        if self.has_sun:
            to_sun = index == self.slots
            local = mi.warp.square_to_uniform_cone(sample, self.cosine)
            direction = dr.select(to_sun, self.frame.to_world(local), direction)
        density = self.density(si.p, direction, probabilities, to_sun)
        valid = active & (density > 0)
        ds = dr.zeros(mi.DirectionSample3f)
        ds.d, ds.n = direction, -direction
        ds.dist = self.far
        ds.p = si.p + direction * ds.dist
        ds.emitter = self.pointer
        ds.pdf = dr.select(valid, density, 0)
        miss = dr.zeros(mi.SurfaceInteraction3f)
        miss.wi = -direction
        return ds, dr.select(valid, self.environment.eval(miss, valid), 0)

    def density(
        self,
        origin: mi.Point3f,
        direction: mi.Vector3f,
        probabilities: list[mi.Float],
        to_sun: mi.Bool = False,
    ) -> mi.Float:
        """Return the density by solid angle of a direction from `origin`.

        `to_sun` marks directions that were sampled in the sun's disc: at its very edge, rounding
        would place some of them outside.
        """
        *through, sun = probabilities[-self.slots - 1 :]
        density = mi.Float(0)
        if self.portals is not None:
            density += self.portals.density(origin, direction, through)
        if self.has_sun:
            inside = (dr.dot(direction, self.frame.n) > self.cosine) | to_sun
            density += dr.select(inside, sun * self.disc_density, 0)
        return density

    def _sees_sun_through_portal(self, position: mi.Point3f) -> mi.Bool:
        """Test whether the sun's direction from a vertex passes a portal."""
        if self.portals is None:
            return mi.Bool(False)
        return self.portals.passed(position, self.frame.n)
