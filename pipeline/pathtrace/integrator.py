"""Joint path tracer: the image in the scene's own colours and its neutral twin, in one trace.

Every surface has two materials, its own and its neutral twin, and every path carries two
throughputs. At each vertex both materials are sampled with the same random numbers. Three cases:

* Both choose the same direction. This is the usual case, because twins keep roughness, gloss and
  lobes. The path continues, and each image takes the weight that its own material gave.
* One image's throughput is zero from here on. The path continues in the other's direction.
* The directions differ, for instance where the choice between gloss and colour depends on how dark
  the colour is. A fair coin decides which direction the path takes. The weight of the image whose
  direction is taken is doubled, the other image's becomes zero.

So each image by itself is that of a plain path tracer (emitter and BSDF sampling, combined by its
own densities) with the coin and Russian roulette as further factors of expectation one. It is
unbiased for every material whose own sampling is, delta lobes and black textures included, because
no density of one material divides the value of the other. Where the directions agree, shading is
bit-identical for all colours: direction and roulette follow the neutral throughput while it is not
zero.

Colour can also be traced alone, in some 0.85 of the time: then each vertex has one material,
roulette follows the throughput of colour, and samples are others than those of a joint trace.

Window panes change the camera ray and its weight, for both images alike, before all of this; see
`pbrnet.pipeline.pathtrace.panes`.

Random numbers are drawn in the order of Mitsuba's `path`, after one more in scenes with panes.
Without roulette and differing directions both images equal those of `path`, sample by sample. Not
supported, beside what the ground truth does not support anyway: hidden emitters, alpha, and
variants without Dr.Jit loops (`available`).
"""

from __future__ import annotations

import operator
from dataclasses import dataclass, field
from functools import cache, reduce

import drjit as dr
import mitsuba as mi

from pbrnet.pipeline.pathtrace.light_parts import LightParts, NoParts
from pbrnet.pipeline.pathtrace.light_sampling import PlannedLights, UniformLights
from pbrnet.pipeline.pathtrace.panes import Panes
from pbrnet.pipeline.pathtrace.scattering import PathState, Scattering, mis_weight
from pbrnet.pipeline.render.drjit_arrays import met_emitter, partner
from pbrnet.pipeline.render.raycast.meshes import Triangles, ray_intersect
from pbrnet.pipeline.render.variants import best_variant

# Squared distance up to which two unit directions are the same one, computed twice.
_SAME_DIRECTION = 1e-7


def available() -> bool:
    """Test whether the variant in use can trace both images at once (all but the scalar ones).

    In a process that has not set one, as a command that plans, it is the best on this machine.
    """
    return not (mi.variant() or best_variant()).startswith("scalar")


@dataclass(eq=False)
class JointPath:
    """Joint path tracer; `max_depth` and `rr_depth` are those of Mitsuba's `path`.

    `lights` samples the emitters; see `pbrnet.pipeline.pathtrace.light_sampling`. `panes` are the
    scene's window panes.
    """

    twins: (
        mi.BSDFPtr
    )  # table of each BSDF's neutral twin, see `pbrnet.pipeline.render.drjit_arrays`
    max_depth: int
    rr_depth: int
    lights: UniformLights | PlannedLights = field(default_factory=UniformLights)
    parts: LightParts | NoParts = field(default_factory=NoParts)
    panes: Panes | None = None
    meshes: Triangles | None = None  # triangles of the scene, if all its shapes are meshes
    environment: mi.EmitterPtr | None = None  # from `environment_pointer`; compiled in if None
    alone: bool = False  # colour without neutral image; `twins` tells a recording which BSDFs exist

    def integrator(self) -> mi.SamplingIntegrator:
        """Return a Mitsuba integrator: colour in `R`, `G`, `B`, the others in three AOVs each.

        They are the neutral image, unless colour is alone, and those of `parts`. A band of zeros
        may follow.
        """
        return _integrator_class()(self)

    @dr.syntax
    def trace(
        self, scene: mi.Scene, sampler: mi.Sampler, ray: mi.Ray3f, active: mi.Bool
    ) -> list[mi.Color3f]:
        """Return the radiance along `ray` in each image, `mi.Color3f`.

        The images are colour, the neutral twin (unless colour is alone), and those of `parts`.
        """
        # Loop state
        ray = mi.Ray3f(ray)  # current segment of the path
        depth = mi.UInt32(0)  # number of vertices passed
        eta = mi.Float(1)  # product of the relative indices of refraction along the path
        previous = dr.zeros(mi.Interaction3f)  # previous vertex, for densities of emitter sampling
        ray, weight, mirrored = self.first_pane(scene, sampler, ray, active)
        # Radiance, throughput, density: in the scene's own colours, and in the neutral twin
        states = [
            PathState(mi.Color3f(0), mi.Color3f(weight), mi.Float(1), mi.Bool(True))
            for _ in self.image_names
        ]
        parts = self.parts.start()  # of the light in colour
        parts.start_in_mirror(mirrored)
        active = mi.Bool(active)  # paths that are still traced

        while dr.hint(active, exclude=[self]):  # the arrays of `self` do not change
            si = ray_intersect(scene, self.meshes, ray, depth == 0, active)

            # Emission at the vertex that BSDF sampling found
            ds = self.found_light(scene, si, previous)
            indirect = ~reduce(operator.and_, [state.delta for state in states])
            density = self.lights.density(scene, previous, ds, indirect)
            emitted = ds.emitter.eval(si, active)
            weight = self.bsdf_sampling_weight(states[0], density)
            parts.add_emission(self.parts, ds, states[0].throughput, emitted * weight)
            self.add_emission(states, emitted, density)

            # Next-event estimation: one emitter sample and one shadow ray for both materials
            active_next = active & si.is_valid() & (depth + 1 < self.max_depth)
            own = si.bsdf(ray)
            bsdfs = self.materials(own, active_next)
            is_smooth = [mi.has_flag(bsdf.flags(), mi.BSDFFlags.Smooth) for bsdf in bsdfs]
            smooth = active_next & reduce(operator.or_, is_smooth)
            ds, light = self.lights.sample(scene, si, sampler.next_2d(), smooth)
            lit = smooth & (ds.pdf != 0)
            first, second = sampler.next_1d(), sampler.next_2d()
            found = self.scatter_all(bsdfs, si, ds.d, first, second, active_next, smooth)
            arriving = dr.select(lit, light * self.emitter_sampling_value(found[0], ds), 0)
            parts.add_emitter_sample(
                self.parts, own, si, ds, found[0], states[0].throughput, arriving, active_next
            )
            self.add_emitter_sample(states, found, ds, light, lit)

            # One direction for all images
            direction, relative_eta, random = self.next_direction(states, found, sampler.next_1d())
            eta *= relative_eta
            previous = mi.Interaction3f(si)
            ray = si.spawn_ray(si.to_world(direction))

            # Russian roulette for all images at once
            depth[si.is_valid()] += 1
            survival, factor = self.roulette(states[0], states[-1], eta, depth)
            _scale(states, factor)
            active = active_next & (random < survival)
        return [*(state.radiance for state in states), *parts.images()]

    @property
    def image_names(self) -> tuple[str, ...]:
        """Names of the images that are traced with a throughput of their own."""
        return ("colour",) if self.alone else ("colour", "neutral")

    def materials(self, own: mi.BSDFPtr, active: mi.Bool) -> list[mi.BSDFPtr]:
        """Return the BSDF of each image."""
        return [own] if self.alone else [own, partner(self.twins, own, active)]

    def first_pane(
        self, scene: mi.Scene, sampler: mi.Sampler, ray: mi.Ray3f, active: mi.Bool
    ) -> tuple[mi.Ray3f, mi.Float, mi.Bool]:
        """Return camera rays after the first window pane, their weights, and which it mirrors.

        No random number is drawn in a scene without panes.
        """
        if self.panes is None:
            return ray, mi.Float(1), mi.Bool(False)
        return self.panes.meet(scene, ray, sampler.next_1d(active), active)

    def found_light(
        self, scene: mi.Scene, si: mi.SurfaceInteraction3f, previous: mi.Interaction3f
    ) -> mi.DirectionSample3f:
        """Return the direction sample, from a vertex, of what BSDF sampling met there."""
        ds = mi.DirectionSample3f(scene, si=si, ref=previous)
        if self.environment is not None:
            ds.emitter = met_emitter(si, self.environment)
        return ds

    def add_emission(self, states: list[PathState], emitted: mi.Color3f, density: mi.Float) -> None:
        """Add emission that BSDF sampling found to each image."""
        for state in states:
            weight = self.bsdf_sampling_weight(state, density)
            state.radiance += state.throughput * emitted * weight

    def add_emitter_sample(
        self,
        states: list[PathState],
        found: list[Scattering],
        ds: mi.DirectionSample3f,
        light: mi.Color3f,
        lit: mi.Bool,
    ) -> None:
        """Add an emitter sample to each image."""
        for state, scattering in zip(states, found, strict=True):
            value = self.emitter_sampling_value(scattering, ds)
            state.radiance[lit] += state.throughput * light * value

    def scatter_all(
        self,
        bsdfs: list[mi.BSDFPtr],
        si: mi.SurfaceInteraction3f,
        light: mi.Vector3f,
        first: mi.Float,
        second: mi.Point2f,
        active: mi.Bool,
        smooth: mi.Bool,
    ) -> list[Scattering]:
        """Evaluate and sample each material; `light` is the direction of the emitter sample.

        If paths are guided at this vertex, every direction counts with its density in the mixture
        of guiding and BSDF sampling.
        """
        wo = si.to_local(light)
        guidance = self.lights.guidance(si, smooth)
        if guidance is None:
            return [self.scatter(bsdf, si, wo, first, second, active) for bsdf in bsdfs]
        guided, first = guidance.split(first)
        found = [self.scatter(bsdf, si, wo, first, second, active) for bsdf in bsdfs]
        guided_direction = si.to_local(guidance.direction(first, second))
        for bsdf, scattering in zip(bsdfs, found, strict=True):
            scattering.pdf = guidance.mixed_density(scattering.pdf, light)
            sample = scattering.sample
            delta = ~guided & mi.has_flag(sample.sampled_type, mi.BSDFFlags.Delta)
            valid = guided | (sample.pdf > 0)
            sample.wo = dr.select(guided, guided_direction, sample.wo)
            sample.eta = dr.select(guided, 1, sample.eta)
            sample.sampled_type = dr.select(guided, 0, sample.sampled_type)
            mixed = smooth & ~delta & valid
            value, pdf = bsdf.eval_pdf(mi.BSDFContext(), si, sample.wo, mixed)
            density = guidance.mixed_density(pdf, si.to_world(sample.wo))
            weight = dr.select(density > 0, value / density, 0)
            unmixed = scattering.weight / (1 - guidance.share)
            scattering.weight = dr.select(mixed, weight, dr.select(valid, unmixed, 0))
            sample.pdf = dr.select(mixed, density, sample.pdf)
        return found

    def scatter(
        self,
        bsdf: mi.BSDFPtr,
        si: mi.SurfaceInteraction3f,
        wo: mi.Vector3f,
        first: mi.Float,
        second: mi.Point2f,
        active: mi.Bool,
    ) -> Scattering:
        """Evaluate a material towards the emitter sample `wo`, and sample a direction of it."""
        return Scattering(*bsdf.eval_pdf_sample(mi.BSDFContext(), si, wo, first, second, active))

    def bsdf_sampling_weight(self, state: PathState, density: mi.Float) -> mi.Float:
        """Return the MIS weight of emission found by BSDF sampling.

        `density` is that of the same direction by emitter sampling.
        """
        return mis_weight(state.pdf, density, state.delta)

    def emitter_sampling_value(
        self, scattering: Scattering, ds: mi.DirectionSample3f
    ) -> mi.Color3f:
        """Return BSDF times cosine times MIS weight of an emitter sample."""
        weight = mis_weight(ds.pdf, scattering.pdf, ds.delta)
        return scattering.value * weight

    def next_direction(
        self, states: list[PathState], found: list[Scattering], random: mi.Float
    ) -> tuple[mi.Vector3f, mi.Float, mi.Float]:
        """Choose the next direction and update the states; as `choose_direction`."""
        if not self.alone:
            (colour, neutral), (of_colour, of_neutral) = states, found
            return self.choose_direction(colour, neutral, of_colour, of_neutral, random)
        _follow(states[0], found[0])
        return found[0].sample.wo, found[0].sample.eta, random

    def choose_direction(
        self,
        colour: PathState,
        neutral: PathState,
        of_colour: Scattering,
        of_neutral: Scattering,
        random: mi.Float,
    ) -> tuple[mi.Vector3f, mi.Float, mi.Float]:
        """Choose the next direction and update both states; see this module's docstring.

        Returns the local direction, the relative index of refraction along it, and a random
        number that is independent of the choice.
        """
        _follow(colour, of_colour)
        _follow(neutral, of_neutral)
        colour_alive, neutral_alive = (dr.any(state.throughput != 0) for state in (colour, neutral))
        gap = dr.squared_norm(of_colour.sample.wo - of_neutral.sample.wo)
        differ = colour_alive & neutral_alive & (gap > _SAME_DIRECTION)
        heads = random < 0.5
        colour.throughput *= dr.select(differ, dr.select(heads, 2.0, 0.0), 1.0)
        neutral.throughput *= dr.select(differ, dr.select(heads, 0.0, 2.0), 1.0)
        follow_neutral = neutral_alive & ~(differ & heads)
        wo = dr.select(follow_neutral, of_neutral.sample.wo, of_colour.sample.wo)
        eta = dr.select(follow_neutral, of_neutral.sample.eta, of_colour.sample.eta)
        return wo, eta, dr.select(differ, 2 * random - dr.select(heads, 0.0, 1.0), random)

    def roulette(
        self, colour: PathState, neutral: PathState, eta: mi.Float, depth: mi.UInt32
    ) -> tuple[mi.Float, mi.Float]:
        """Return the survival probability of Russian roulette and the factor on the throughputs.

        The probability follows the neutral throughput, because shading must not depend on colours,
        but its fourth root, so that colours brighter than the neutral grey get enough samples. It
        follows the colour's throughput where the neutral one is zero.
        """
        largest = dr.max(neutral.throughput)
        importance = dr.select(largest > 0, dr.sqrt(dr.sqrt(largest)), dr.max(colour.throughput))
        survival = dr.minimum(importance * dr.square(eta), 0.95)
        enabled = depth >= self.rr_depth
        factor = dr.select(enabled & (survival > 0), dr.rcp(survival), 1.0)
        return dr.select(enabled | (importance == 0), survival, 1.0), factor


def _follow(state: PathState, scattering: Scattering) -> None:
    """Update a path's state for the direction that its material sampled."""
    state.throughput = state.throughput * scattering.weight
    state.pdf = scattering.sample.pdf
    state.delta = mi.has_flag(scattering.sample.sampled_type, mi.BSDFFlags.Delta)


def _scale(states: list[PathState], factor: mi.Float) -> None:
    for state in states:
        state.throughput *= factor


@cache
def _integrator_class() -> type[mi.SamplingIntegrator]:
    """Return the integrator class for a `JointPath`; its base class needs a Mitsuba variant."""

    class JointIntegrator(mi.SamplingIntegrator):  # type: ignore[misc]
        def __init__(self, path: JointPath) -> None:
            super().__init__(mi.Properties())
            self.path = path

        def sample(
            self,
            scene: mi.Scene,
            sampler: mi.Sampler,
            ray: mi.RayDifferential3f,
            medium: mi.Medium | None = None,
            active: mi.Bool = True,
        ) -> tuple[mi.Color3f, mi.Bool, list[mi.Float]]:
            colour, *others = self.path.trace(scene, sampler, ray, active)
            bands = [band for image in others for band in image]
            padding = len(self.aov_names()) - len(bands)
            return colour, mi.Bool(active), bands + [mi.Float(0)] * padding

        def aov_names(self) -> list[str]:
            images = (*self.path.image_names[1:], *self.path.parts.names)
            names = [f"{image}.{band}" for image in images for band in "RGB"]
            # With a power of two of channels, a film adds samples up in another order, and colour
            # would differ in its last bit. Its other four channels are colour and weight.
            return names if (len(names) + 4).bit_count() > 1 else [*names, "padding"]

    return JointIntegrator
