"""Two images from one trace of paths: the scene in its own colours, and its neutral twin.

Every surface has two materials, its own and the grey twin's, and every path carries two
throughputs. Both materials are given the same random numbers at each vertex. Three cases:

* they choose the same direction (nearly always: the twins keep roughness, gloss and lobes): the
  path goes on, and each image takes the weight that its own material gave;
* one image's throughput is zero from here on: the path goes on in the other's direction;
* they part, as where the choice between gloss and colour depends on how dark the colour is: a
  coin decides whom the path follows; the follower's weight is doubled, the other's becomes zero.

So each image by itself is a plain path tracer's (emitter and BSDF sampling combined by its own
densities) with the coin and the roulette as further factors whose expectation is one: unbiased
for both, for every material whose own sampling is, delta lobes and black textures included, as no
density of one material ever divides the other's value. Where the twins do not part, shading depends
on no colour, to the bit: direction and roulette are the grey path's while it has any throughput.

Random numbers are drawn as Mitsuba's `path` draws them, so that without roulette and partings both
images equal `path`'s, sample by sample. Left out, beside what the ground truth leaves out anyway:
hidden emitters, alpha, and variants without Dr.Jit's loops (`available`).
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cache
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np

from pipeline.pathtrace.light_sampling import PlannedLights, UniformLights
from pipeline.render.raycast import column

# Squared distance of unit directions beyond which they are not one direction computed twice.
_APART = 1e-7


@dataclass
class Branch:
    """What a path carries for one of its two images."""

    radiance: Any  # mi.Color3f, gathered so far
    throughput: Any  # mi.Color3f
    pdf: Any  # mi.Float, of the last direction, in this image's material; 1 at the camera
    delta: Any  # mi.Bool, whether that direction came from a delta lobe, or the camera


@dataclass
class Scattering:
    """One material at one vertex: towards an emitter sample, and its own sampled direction."""

    value: Any  # mi.Color3f, BSDF times cosine towards the emitter sample
    pdf: Any  # mi.Float, density of that direction under the material's own sampling
    sample: Any  # mi.BSDFSample3f
    weight: Any  # mi.Color3f, BSDF times cosine over density of the sampled direction


def available() -> bool:
    """Whether the variant in use can trace both images at once (all but the scalar ones)."""
    return bool(dr.is_jit_v(mi.Float))


def twin_table(pairs: list[tuple[Any, Any]]) -> Any:
    """`mi.BSDFPtr` array that gives at a BSDF's registry index its twin; `pairs` are of BSDFs."""
    own, twins = (_indices([pair[which] for pair in pairs]) for which in (0, 1))
    table = np.zeros(own.max() + 1, dtype=np.uint32)
    table[own] = twins
    return dr.reinterpret_array(mi.BSDFPtr, column(mi.UInt32, table))


def _indices(bsdfs: list[Any]) -> Any:
    """Registry indices of BSDFs, (N,)."""
    return np.array(dr.reinterpret_array(mi.UInt32, mi.BSDFPtr(bsdfs)))


@dataclass(eq=False)
class JointPath:
    """The joint path tracer; `max_depth` and `rr_depth` mean what they mean in `path`.

    `lights` chooses the emitter samples; see `pipeline.pathtrace.light_sampling`.
    """

    twins: Any  # see `twin_table`
    max_depth: int
    rr_depth: int
    lights: UniformLights | PlannedLights = field(default_factory=UniformLights)

    def integrator(self) -> Any:
        """A Mitsuba integrator: colour in `R`, `G`, `B`, the neutral image in three AOVs."""
        return _adapter()(self)

    @dr.syntax
    def trace(self, scene: Any, sampler: Any, ray: Any, active: Any) -> tuple[Any, Any]:
        """Incident radiance along `ray` in colour and in the neutral twin, `mi.Color3f` each."""
        ray = mi.Ray3f(ray)
        active = mi.Bool(active)
        depth = mi.UInt32(0)  # vertices passed
        eta = mi.Float(1)  # product of the relative indices of refraction along the path
        before = dr.zeros(mi.Interaction3f)  # the vertex before
        colour, grey = _at_camera(), _at_camera()

        while dr.hint(active, exclude=[self]):  # whose arrays do not change
            si = scene.ray_intersect(
                ray, ray_flags=mi.RayFlags.All, coherent=(depth == 0), active=active
            )

            # Emission that the last direction found
            ds = mi.DirectionSample3f(scene, si=si, ref=before)
            density = self.lights.density(scene, before, ds, ~(colour.delta & grey.delta))
            emitted = ds.emitter.eval(si, active)
            colour.radiance += colour.throughput * emitted * self.found(colour, density)
            grey.radiance += grey.throughput * emitted * self.found(grey, density)

            # Both materials, with one emitter sample, one shadow ray, the same random numbers
            goes_on = active & si.is_valid() & (depth + 1 < self.max_depth)
            own = si.bsdf(ray)
            twin = dr.gather(mi.BSDFPtr, self.twins, dr.reinterpret_array(mi.UInt32, own), goes_on)
            smooth = goes_on & mi.has_flag(own.flags() | twin.flags(), mi.BSDFFlags.Smooth)
            ds, light = self.lights.sample(scene, si, sampler.next_2d(), smooth)
            lit = smooth & (ds.pdf != 0)
            first, second = sampler.next_1d(), sampler.next_2d()
            of_colour, of_grey = self.scatterings(
                (own, twin), si, ds.d, first, second, goes_on, smooth
            )
            colour.radiance[lit] += colour.throughput * light * self.lit(of_colour, ds)
            grey.radiance[lit] += grey.throughput * light * self.lit(of_grey, ds)

            # One direction for both
            towards, relative_eta, random = self.choose(
                colour, grey, of_colour, of_grey, sampler.next_1d()
            )
            eta *= relative_eta
            before = mi.Interaction3f(si)
            ray = si.spawn_ray(si.to_world(towards))

            # Roulette for both at once
            depth[si.is_valid()] += 1
            survival, share = self.roulette(colour, grey, eta, depth)
            colour.throughput *= share
            grey.throughput *= share
            active = goes_on & (random < survival)
        return colour.radiance, grey.radiance

    def scatterings(
        self,
        bsdfs: tuple[Any, Any],
        si: Any,
        light: Any,
        first: Any,
        second: Any,
        active: Any,
        smooth: Any,
    ) -> list[Scattering]:
        """Both materials at a vertex, with the direction `light` towards the emitter sample.

        Where `lights` know a better way on than the materials do, each direction counts with its
        density by both, as if one had been drawn from the mixture of them.
        """
        wo = si.to_local(light)
        guidance = self.lights.guidance(si, smooth)
        if guidance is None:
            return [self.scatter(bsdf, si, wo, first, second, active) for bsdf in bsdfs]
        led, first = guidance.split(first)
        found = [self.scatter(bsdf, si, wo, first, second, active) for bsdf in bsdfs]
        onwards = si.to_local(guidance.direction(first, second))
        for bsdf, scattering in zip(bsdfs, found, strict=True):
            scattering.pdf = guidance.mixed(scattering.pdf, light)
            sample = scattering.sample
            delta = ~led & mi.has_flag(sample.sampled_type, mi.BSDFFlags.Delta)
            there = led | (sample.pdf > 0)
            sample.wo = dr.select(led, onwards, sample.wo)
            sample.eta = dr.select(led, 1, sample.eta)
            sample.sampled_type = dr.select(led, 0, sample.sampled_type)
            again = smooth & ~delta & there
            value, pdf = bsdf.eval_pdf(mi.BSDFContext(), si, sample.wo, again)
            density = guidance.mixed(pdf, si.to_world(sample.wo))
            weight = dr.select(density > 0, value / density, 0)
            alone = scattering.weight / (1 - guidance.share)
            scattering.weight = dr.select(again, weight, dr.select(there, alone, 0))
            sample.pdf = dr.select(again, density, sample.pdf)
        return found

    def scatter(
        self, bsdf: Any, si: Any, wo: Any, first: Any, second: Any, active: Any
    ) -> Scattering:
        """A material's value towards the emitter sample, and its own sample of a direction."""
        return Scattering(*bsdf.eval_pdf_sample(mi.BSDFContext(), si, wo, first, second, active))

    def found(self, branch: Branch, density: Any) -> Any:
        """Weight of emission that a material's direction found, given the emitters' density."""
        return dr.select(branch.delta, 1, power_heuristic(branch.pdf, density))

    def lit(self, scattering: Scattering, ds: Any) -> Any:
        """Value times weight of light from an emitter sample."""
        weight = dr.select(ds.delta, 1, power_heuristic(ds.pdf, scattering.pdf))
        return scattering.value * weight

    def choose(
        self, colour: Branch, grey: Branch, of_colour: Scattering, of_grey: Scattering, random: Any
    ) -> tuple[Any, Any, Any]:
        """The direction to go on in: updates both branches, see this module's docstring.

        Returns the local direction, the relative index of refraction along it, and a random
        number that is independent of the choice.
        """
        branches = (colour, of_colour), (grey, of_grey)
        for branch, scattering in branches:
            branch.throughput = branch.throughput * scattering.weight
            branch.pdf = scattering.sample.pdf
            branch.delta = mi.has_flag(scattering.sample.sampled_type, mi.BSDFFlags.Delta)
        lives, grey_lives = (dr.any(branch.throughput != 0) for branch, _ in branches)
        gap = dr.squared_norm(of_colour.sample.wo - of_grey.sample.wo)
        part = lives & grey_lives & (gap > _APART)
        heads = random < 0.5
        colour.throughput *= dr.select(part, dr.select(heads, 2.0, 0.0), 1.0)
        grey.throughput *= dr.select(part, dr.select(heads, 0.0, 2.0), 1.0)
        follow_grey = grey_lives & ~(part & heads)
        wo = dr.select(follow_grey, of_grey.sample.wo, of_colour.sample.wo)
        eta = dr.select(follow_grey, of_grey.sample.eta, of_colour.sample.eta)
        return wo, eta, dr.select(part, 2 * random - dr.select(heads, 0.0, 1.0), random)

    def roulette(self, colour: Branch, grey: Branch, eta: Any, depth: Any) -> tuple[Any, Any]:
        """Probability that the path goes on, and what it then gains.

        By the grey throughput, since shading must not depend on colours, but by its fourth root,
        so that colours brighter than the grey are not starved; by the colour's where the grey one
        is zero.
        """
        of_grey = dr.max(grey.throughput)
        likely = dr.select(of_grey > 0, dr.sqrt(dr.sqrt(of_grey)), dr.max(colour.throughput))
        survival = dr.minimum(likely * dr.square(eta), 0.95)
        at_stake = depth >= self.rr_depth
        share = dr.select(at_stake & (survival > 0), dr.rcp(survival), 1.0)
        return dr.select(at_stake | (likely == 0), survival, 1.0), share


def power_heuristic(one: Any, other: Any) -> Any:
    """Veach's power heuristic with exponent 2: the weight of a sample of density `one`."""
    one, other = dr.square(one), dr.square(other)
    weight = one / (one + other)
    return dr.select(dr.isfinite(weight), weight, 0)


def _at_camera() -> Branch:
    return Branch(mi.Color3f(0), mi.Color3f(1), mi.Float(1), mi.Bool(True))


@cache
def _adapter() -> Any:
    """Class of Mitsuba integrators that trace a `JointPath`: Mitsuba's base needs a variant."""

    class JointIntegrator(mi.SamplingIntegrator):  # type: ignore[misc]
        def __init__(self, path: JointPath) -> None:
            super().__init__(mi.Properties())
            self.path = path

        def sample(
            self, scene: Any, sampler: Any, ray: Any, medium: Any = None, active: Any = True
        ) -> tuple[Any, Any, list[Any]]:
            colour, grey = self.path.trace(scene, sampler, ray, active)
            return colour, mi.Bool(active), list(grey)

        def aov_names(self) -> list[str]:
            return [f"neutral.{band}" for band in "RGB"]

    return JointIntegrator
