"""Sampling of the environment through portals and towards the sun's disc."""

from __future__ import annotations

from dataclasses import dataclass

import drjit as dr
import mitsuba as mi
import numpy as np

from pbrnet.pipeline.pathtrace.light_plan import LightPlan
from pbrnet.pipeline.pathtrace.portals import RectangleSampler, geometry_factor, opaque_floats
from pbrnet.pipeline.render.drjit_arrays import registry_id


@dataclass(init=False, eq=False)
class EnvironmentSampler:
    """Directions to the environment: uniform over a portal's area, or over the sun's disc.

    Densities exclude the environment's own sampling. `own_sampling` says that it is used as well
    and may give the same directions.
    """

    environment: mi.Emitter
    pointer: mi.EmitterPtr  #  to it
    own_sampling: bool
    portals: RectangleSampler | None
    has_sun: bool
    frame: mi.Frame3f  #  around the sun's direction
    cosine: mi.Float  # of the sun's angular radius
    disc_density: mi.Float  # by solid angle over the disc
    sun: list[mi.Float]  # the sun's strength, and its probability in the whole view

    def __init__(self, scene: mi.Scene, plan: LightPlan) -> None:
        self.environment = scene.environment()
        number = dr.opaque(mi.UInt32, registry_id(self.environment, mi.EmitterPtr))
        self.pointer = dr.reinterpret_array(mi.EmitterPtr, number)
        emitters = scene.emitters()
        row = next(row for row, emitter in enumerate(emitters) if emitter.is_environment())
        self.own_sampling = bool(plan.emitters[row] > 0)
        strengths = plan.strengths.portals if plan.strengths is not None else np.zeros(0)
        self.portals = None
        if plan.portals.sum() > 0:
            slots = len(plan.portals)  # the same in all views of a scene
            self.portals = RectangleSampler(plan.rectangles, strengths, plan.portals, slots)
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
        ds.dist = 2 * scene.bbox().bounding_sphere().radius
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
        return self.portals.density(position, self.frame.n, [mi.Float(1)] * self.slots) > 0
