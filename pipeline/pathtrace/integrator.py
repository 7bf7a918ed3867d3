"""Joint path tracer: the image in the scene's own colours and its neutral twin, in one trace.

Every surface has two materials, its own and its neutral twin, and every path carries two
throughputs. Where the values of both follow from one basis (`pbrnet.pipeline.render.neutral`), that
alone is evaluated. Elsewhere both materials are sampled with the same random numbers. Three cases:

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

Paths have four vertices on average, but the longest of eight has seven, and the lanes of a vector
take as long as the longest. So each lane traces several samples, one after the other. Random
numbers are drawn in the order of Mitsuba's `path`. With the same numbers and without roulette and
differing directions both images equal those of `path`, sample by sample. Not supported, beside what
the ground truth does not support anyway: hidden emitters, alpha, and variants without Dr.Jit loops
(`available`).
"""

from __future__ import annotations

import operator
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import reduce
from typing import Any, Protocol

import drjit as dr
import mitsuba as mi

from pbrnet.pipeline.pathtrace.light_parts import LightParts, NoParts
from pbrnet.pipeline.pathtrace.light_sampling import PlannedLights, UniformLights
from pbrnet.pipeline.pathtrace.panes import Panes
from pbrnet.pipeline.pathtrace.scattering import PathState, Scattering, mis_weight
from pbrnet.pipeline.render.drjit_arrays import met_emitter, partner, partner_table
from pbrnet.pipeline.render.material_sets import Basis
from pbrnet.pipeline.render.raycast.meshes import Triangles, ray_intersect
from pbrnet.pipeline.render.variants import best_variant

# Squared distance up to which two unit directions are the same one, computed twice.
_SAME_DIRECTION = 1e-7


def available() -> bool:
    """Test whether the variant in use can trace both images at once (all but the scalar ones).

    In a process that has not set one, as a command that plans, it is the best on this machine.
    """
    return not (mi.variant() or best_variant()).startswith("scalar")


@dataclass(init=False, eq=False)
class Bases:
    """Bases from which the values of a BSDF and of its neutral twin follow, see `basis_twin`."""

    table: mi.BSDFPtr  # of each BSDF's basis, or the BSDF itself
    colours: mi.BSDFPtr  # of each BSDF's reflectance twin
    albedo: mi.Float  # of the neutral twins

    def __init__(self, bases: Sequence[Basis], albedo: float) -> None:
        self.table = partner_table([(each.own, each.basis or each.own) for each in bases])
        self.colours = partner_table([(each.own, each.colour) for each in bases])
        self.albedo = dr.opaque(mi.Float, albedo)

    def tint(
        self,
        found: list[Scattering],
        own: mi.BSDFPtr,
        twin: mi.BSDFPtr,
        si: mi.SurfaceInteraction3f,
        active: mi.Bool,
    ) -> None:
        """Replace what bases gave by the answers of the BSDFs and of their neutral twins."""
        first, second = found
        based = active & (dr.reinterpret_array(mi.UInt32, twin) == 0)
        colour = partner(self.colours, own, based).eval_diffuse_reflectance(si, based)
        value, weight = first.value, first.weight
        first.value = dr.select(based, _tinted(value, colour), value)
        first.weight = dr.select(based, _tinted(weight, colour), weight)
        second.value = dr.select(based, _tinted(value, mi.Color3f(self.albedo)), second.value)
        second.weight = dr.select(based, _tinted(weight, mi.Color3f(self.albedo)), second.weight)
        second.pdf = dr.select(based, first.pdf, second.pdf)
        second.sample = dr.select(based, first.sample, second.sample)


def _tinted(basis: mi.Color3f, colour: mi.Color3f) -> mi.Color3f:
    return mi.Color3f(basis.x) + colour * (basis.y - basis.x)


class Sampler(Protocol):
    """Random numbers of the samples that lanes trace."""

    def begin(self, samples: mi.UInt32, where: mi.Bool) -> None:
        """Go to the first draw of other samples, in some lanes."""

    def next_1d(self) -> mi.Float:
        """Return a number in [0, 1) for each lane."""

    def next_2d(self) -> mi.Point2f:
        """Return a point in [0, 1)^2 for each lane."""


@dataclass
class Starts:
    """Beginnings of paths, one per sample: camera rays, world."""

    origin: mi.Point3f
    direction: mi.Vector3f
    weight: mi.Float  # of the path; 0 where the sample has no ray
    mirrored: mi.Bool  # which rays are mirror images in a window pane

    def ray(self, sample: mi.UInt32, active: mi.Bool) -> mi.Ray3f:
        """Return the rays of samples."""
        origin = dr.gather(mi.Point3f, self.origin, sample, active)
        return mi.Ray3f(origin, dr.gather(mi.Vector3f, self.direction, sample, active))


@dataclass(eq=False)
class JointPath:
    """Joint path tracer; `max_depth` and `rr_depth` are those of Mitsuba's `path`.

    `lights` samples the emitters; see `pbrnet.pipeline.pathtrace.light_sampling`. `panes` are the
    scene's window panes.
    """

    twins: mi.BSDFPtr  # table of each BSDF's neutral twin, null where `bases` has one
    max_depth: int
    rr_depth: int
    lights: UniformLights | PlannedLights = field(default_factory=UniformLights)
    parts: LightParts | NoParts = field(default_factory=NoParts)
    panes: Panes | None = None
    meshes: Triangles | None = None  # triangles of the scene, if all its shapes are meshes
    environment: mi.EmitterPtr | None = None  # from `environment_pointer`; compiled in if None
    alone: bool = False  # colour without neutral image; `twins` tells a recording which BSDFs exist
    bases: Bases | None = None

    @dr.syntax
    def trace(
        self, scene: mi.Scene, sampler: Sampler, starts: Starts, lanes: int
    ) -> list[mi.Color3f]:
        """Return the radiance of the paths that begin in `starts`, for each image, `mi.Color3f`.

        The images are colour, the neutral twin (unless colour is alone), and those of `parts`.
        Each of the `lanes` traces samples one after the other: where a path has ended, that of the
        next sample begins at once, since all lanes of a vector wait for the last of them.
        """
        count = dr.width(starts.weight)
        per_lane = -(-count // lanes)
        images = [dr.zeros(mi.Color3f, count) for _ in (*self.image_names, *self.parts.names)]
        # Loop state
        sample = dr.arange(mi.UInt32, lanes) * per_lane  # number of the sample
        last = dr.minimum(sample + per_lane, count)  # before it the lane ends
        dr.eval(sample, last)  # so that images of all sizes share a kernel
        active = sample < last
        ray = starts.ray(sample, active)  # current segment of the path
        depth = mi.UInt32(0)  # number of vertices passed
        eta = mi.Float(1)  # product of the relative indices of refraction along the path
        previous = dr.zeros(mi.Interaction3f)  # previous vertex, for densities of emitter sampling
        choice = [mi.Float(0) for _ in range(self.lights.choices)]  # of an emitter, there
        # Radiance, throughput, density: in the scene's own colours, and in the neutral twin
        states = [
            PathState(mi.Color3f(0), mi.Color3f(0), mi.Float(1), mi.Bool(True))
            for _ in self.image_names
        ]
        parts = self.parts.start()  # of the light in colour
        self.begin(sampler, starts, sample, states, parts, active)

        while dr.hint(active, exclude=[self, starts, images]):  # these arrays do not change
            si = ray_intersect(scene, self.meshes, ray, mi.Bool(False), active)

            # Emission at the vertex that BSDF sampling found
            ds = self.found_light(scene, si, previous)
            indirect = ~reduce(operator.and_, [state.delta for state in states])
            density = self.lights.density(scene, previous, choice, ds, indirect)
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
            choice = self.lights.choice(si.p, si.n)
            ds, light = self.lights.sample(scene, si, choice, sampler.next_2d(), smooth)
            lit = smooth & (ds.pdf != 0)
            first, second = sampler.next_1d(), sampler.next_2d()
            found = self.scatter_all(bsdfs, si, ds.d, first, second, active_next, smooth)
            self.tint(found, own, bsdfs, si, active_next)
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
            ended = active & ~(active_next & (random < survival))

            # The next sample, where the path has ended
            for image, radiance in zip(
                images, [*(state.radiance for state in states), *parts.images()], strict=True
            ):
                dr.scatter(image, radiance, sample, ended, dr.ReduceMode.NoConflicts)
            sample = dr.select(ended, sample + 1, sample)
            active = sample < last
            begins = ended & active
            ray = dr.select(begins, starts.ray(sample, begins), ray)
            depth = dr.select(begins, mi.UInt32(0), depth)
            eta = dr.select(begins, mi.Float(1), eta)
            self.begin(sampler, starts, sample, states, parts, begins)
        return images

    def begin(
        self,
        sampler: Sampler,
        starts: Starts,
        sample: mi.UInt32,
        states: list[PathState],
        parts: Any,
        where: mi.Bool,
    ) -> None:
        """Begin the paths of other samples, in some lanes."""
        sampler.begin(sample, where)
        weight = dr.gather(mi.Float, starts.weight, sample, where)
        for state in states:
            state.radiance = dr.select(where, 0, state.radiance)
            state.throughput = dr.select(where, mi.Color3f(weight), state.throughput)
            state.pdf = dr.select(where, 1, state.pdf)
            state.delta |= where
        parts.begin(dr.gather(mi.Bool, starts.mirrored, sample, where), where)

    @property
    def image_names(self) -> tuple[str, ...]:
        """Names of the images that are traced with a throughput of their own."""
        return ("colour",) if self.alone else ("colour", "neutral")

    def materials(self, own: mi.BSDFPtr, active: mi.Bool) -> list[mi.BSDFPtr]:
        """Return the BSDF of each image; with a basis, that alone."""
        if self.alone:
            return [own]
        first = own if self.bases is None else partner(self.bases.table, own, active)
        return [first, partner(self.twins, own, active)]

    def tint(
        self,
        found: list[Scattering],
        own: mi.BSDFPtr,
        bsdfs: list[mi.BSDFPtr],
        si: mi.SurfaceInteraction3f,
        active: mi.Bool,
    ) -> None:
        """Replace what bases gave, if there are any."""
        if self.bases is not None and not self.alone:
            self.bases.tint(found, own, bsdfs[1], si, active)

    def starts(
        self, scene: mi.Scene, sampler: Sampler, ray: mi.Ray3f, active: mi.Bool, count: int
    ) -> Starts:
        """Return the beginnings of `count` paths: camera rays after the first window pane.

        No random number is drawn in a scene without panes.
        """
        weight, mirrored = mi.Float(1), mi.Bool(False)
        active = active & dr.full(mi.Bool, True, count)
        if self.panes is not None:
            ray, weight, mirrored = self.panes.meet(scene, ray, sampler.next_1d(), active)
        direction = dr.select(active, ray.d, mi.Vector3f(0, 0, 1))
        origin = dr.select(active, ray.o, mi.Point3f(0))
        starts = Starts(origin, direction, dr.select(active, weight, 0), mirrored & active)
        dr.eval(starts)
        return starts

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
        towards_light = guidance.density(light)
        for number, (bsdf, scattering) in enumerate(zip(bsdfs, found, strict=True)):
            scattering.pdf = guidance.mixed(scattering.pdf, towards_light)
            sample = scattering.sample
            delta = ~guided & mi.has_flag(sample.sampled_type, mi.BSDFFlags.Delta)
            valid = guided | (sample.pdf > 0)
            sample.wo = dr.select(guided, guided_direction, sample.wo)
            sample.eta = dr.select(guided, 1, sample.eta)
            sample.sampled_type = dr.select(guided, 0, sample.sampled_type)
            mixed = smooth & ~delta & valid
            if number:  # few have a twin here, if there are bases
                mixed &= dr.reinterpret_array(mi.UInt32, bsdf) != 0
            value, pdf = bsdf.eval_pdf(mi.BSDFContext(), si, sample.wo, mixed)
            along = guidance.density(si.to_world(sample.wo), mixed if number else None)
            density = guidance.mixed(pdf, along)
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
