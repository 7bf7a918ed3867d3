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

from pbrnet.pipeline.pathtrace.emitter_sampling import EmitterSampler
from pbrnet.pipeline.pathtrace.environment_sampling import EnvironmentSampler
from pbrnet.pipeline.pathtrace.guiding import Guidance, GuidingPlan, PathGuide
from pbrnet.pipeline.pathtrace.light_plan import OUTDOOR_MARGIN, LightPlan
from pbrnet.pipeline.pathtrace.portals import below_one, choose, opaque_floats

_BY_VIEW = 0.2  # share of the choice that follows the view's probabilities alone


@dataclass(init=False, eq=False)
class UniformLights:
    """Mitsuba's own emitter sampling: all emitters have the same probability."""

    def sample(
        self, scene: mi.Scene, si: mi.SurfaceInteraction3f, sample: mi.Point2f, active: mi.Bool
    ) -> tuple[mi.DirectionSample3f, mi.Color3f]:
        """Sample a direction to an emitter from a vertex with `sample` in [0, 1)^2.

        Returns a `mi.DirectionSample3f` and radiance over density, 0 if occluded.
        """
        return scene.sample_emitter_direction(si, sample, True, active)  # type: ignore[no-any-return]

    def density(
        self, scene: mi.Scene, ref: mi.Interaction3f, ds: mi.DirectionSample3f, active: mi.Bool
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
    compiler, so that all views of a scene share one kernel.
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
        sampled = plan.portals.sum() + plan.sun > 0
        self.outdoors = EnvironmentSampler(scene, plan) if sampled else None
        self.guide = PathGuide(guiding, plan.indirect) if guiding is not None else None

    def sample(
        self, scene: mi.Scene, si: mi.SurfaceInteraction3f, sample: mi.Point2f, active: mi.Bool
    ) -> tuple[mi.DirectionSample3f, mi.Color3f]:
        """Sample a direction to an emitter; see `UniformLights.sample`."""
        probabilities = self.probabilities(si.p, si.n)
        index, stretched = choose(probabilities, sample.x)
        sample = mi.Point2f(below_one(stretched), sample.y)
        first = len(probabilities) - self.outdoor_count
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
        self, scene: mi.Scene, ref: mi.Interaction3f, ds: mi.DirectionSample3f, active: mi.Bool
    ) -> mi.Float:
        """Return the density of a direction; see `UniformLights.density`."""
        probabilities = self.probabilities(ref.p, ref.n)
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

    def probabilities(self, position: mi.Point3f, normal: mi.Normal3f) -> list[mi.Float]:
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

    @property
    def outdoor_count(self) -> int:
        """Number of the last `probabilities`: those of portals and sun."""
        return 0 if self.outdoors is None else self.outdoors.slots + 1

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
