"""Light at surface points, in Dr.Jit kernels: one emitter sample and one gathered direction each.

Direct light is estimated by both, combined by multiple importance sampling (Veach and Guibas 1995):
the emitter sample with its shadow ray, and emission that the gathered direction meets. The light
of the surface that it meets is indirect light; its caller looks it up. Directions are
cosine-distributed, or guided to bright surfaces (`pbrnet.pipeline.pathtrace.guiding`).
"""

from __future__ import annotations

from dataclasses import dataclass

import drjit as dr
import mitsuba as mi

from pbrnet.pipeline.pathtrace.light_sampling import PlannedLights
from pbrnet.pipeline.pathtrace.scattering import diffuse_lobes, mis_weight, share
from pbrnet.pipeline.render.drjit_arrays import met_emitter, partner
from pbrnet.pipeline.transport.cells import CELL, LightTable
from pbrnet.pipeline.transport.rays import ShapeTables, facing_normal, first_surface, surface_point

_GLOSS_ALBEDO = 0.05  # part of what the base colour absorbs that gloss reflects


@dataclass(eq=False)
class World:
    """Scene and tables of the kernels; a dataclass, so that Dr.Jit finds its arrays."""

    scene: mi.Scene
    tables: ShapeTables
    lights: PlannedLights
    lobes: mi.BSDFPtr  # table of the BSDFs' diffuse lobes
    environment: mi.EmitterPtr  # from `environment_pointer`


@dataclass
class Gathered:
    """Light at surface points; radiance of a white diffuse surface, `mi.Color3f`."""

    direct: mi.Color3f  # of one emitter sample and of emission along the direction
    weight: mi.Float  # the surface met counts with its diffuse radiance times this
    si: mi.SurfaceInteraction3f  # what the direction meets
    direction: mi.Vector3f
    cosine: mi.Vector3f  # another direction, cosine-distributed, to which no ray is traced


def gather(
    world: World, sampler: mi.Sampler, position: mi.Point3f, normal: mi.Vector3f, active: mi.Bool
) -> Gathered:
    """Gather light at surface points with these unit normals, on the side of these."""
    point = surface_point(position, normal)
    choice = world.lights.choice(point.p, point.n)
    ds, light = world.lights.sample(world.scene, point, choice, sampler.next_2d(), active)
    arriving = dr.select(active & (ds.pdf > 0), mi.Color3f(light), 0)
    guidance = world.lights.guidance(point, active)
    random, square = sampler.next_1d(), sampler.next_2d()
    cosine = point.sh_frame.to_world(mi.warp.square_to_cosine_hemisphere(square))
    direction = mi.Vector3f(cosine)
    towards = dr.maximum(dr.dot(ds.d, normal), 0) * dr.inv_pi
    pdf = towards
    if guidance is not None:
        guided, random = guidance.split(random)
        direction = dr.select(guided, guidance.direction(random, square), direction)
        pdf = guidance.mixed_density(pdf, ds.d)
    mis = mis_weight(ds.pdf, pdf, ds.delta)
    direct = arriving * (towards * mis)

    along = dr.maximum(dr.dot(direction, normal), 0) * dr.inv_pi
    pdf = along
    if guidance is not None:
        pdf = guidance.mixed_density(pdf, direction)
    weight = dr.select(active & (pdf > 0), along / pdf, 0)
    si, emitted, density = met(world, point, direction, weight > 0, dr.full(mi.Bool, True))
    direct += emitted * (weight * mis_weight(pdf, density))
    return Gathered(direct, weight, si, direction, cosine)


def reflected(world: World, sampler: mi.Sampler, found: Gathered, active: mi.Bool) -> mi.Color3f:
    """Return the direct light that the surfaces met reflect, times the weight, `mi.Color3f`.

    By one emitter sample and one cosine-distributed direction on each, combined as in `gather`.
    They reflect their `rough_albedo`.
    """
    si = found.si
    normal = world.tables.lit_side(sampler, si, facing_normal(si, found.direction), active)
    point = surface_point(si.p, normal)
    choice = world.lights.choice(point.p, point.n)
    ds, light = world.lights.sample(world.scene, point, choice, sampler.next_2d(), active)
    arriving = dr.select(active & (ds.pdf > 0), mi.Color3f(light), 0)
    towards = dr.maximum(dr.dot(ds.d, normal), 0) * dr.inv_pi
    arriving *= towards * mis_weight(ds.pdf, towards, ds.delta)
    cosine = mi.warp.square_to_cosine_hemisphere(sampler.next_2d())
    pdf = mi.warp.square_to_cosine_hemisphere_pdf(cosine)
    direction = point.sh_frame.to_world(cosine)
    _, emitted, density = met(world, point, direction, active, mi.Bool(True))
    arriving += emitted * mis_weight(pdf, density)
    albedo = rough_albedo(world.tables, si, active)
    return dr.select(active, arriving * albedo * found.weight, 0)


def rough_albedo(tables: ShapeTables, si: mi.SurfaceInteraction3f, active: mi.Bool) -> mi.Color3f:
    """Return the albedo of surfaces with `_GLOSS_ALBEDO` in place of their gloss, `mi.Color3f`."""
    colour = tables.reflectance_at(si, active)
    return colour + dr.select(active & is_glossy(si.bsdf()), _GLOSS_ALBEDO, 0) * (1 - colour)


def met(
    world: World,
    point: mi.SurfaceInteraction3f,
    direction: mi.Vector3f,
    active: mi.Bool,
    sampled: mi.Bool,
) -> tuple[mi.SurfaceInteraction3f, mi.Color3f, mi.Float]:
    """Return what a direction meets, its emission, and the density of emitter sampling there.

    The density is evaluated where `sampled`: elsewhere no emitter sample could give the direction.
    Nor could it where the direction leads through glass.
    """
    si, passed = first_surface(world.scene, world.tables, point.spawn_ray(direction), active)
    ds = mi.DirectionSample3f(world.scene, si=si, ref=point)
    ds.emitter = met_emitter(si, world.environment)
    emitted = dr.select(active, mi.Color3f(ds.emitter.eval(si, active)), 0)
    sampled &= ~passed
    choice = world.lights.choice(point.p, point.n)
    density = world.lights.density(world.scene, point, choice, ds, active & sampled)
    return si, emitted, dr.select(sampled, density, 0)


def look_up(
    cache: LightTable,
    si: mi.SurfaceInteraction3f,
    direction: mi.Vector3f,
    sampler: mi.Sampler,
    active: mi.Bool,
) -> mi.UInt32:
    """Return the entries of `cache` for the surfaces that a direction meets, `mi.UInt32`.

    Places are moved on their plane, by up to half a cell, so that cells do not show as such.
    """
    normal = facing_normal(si, direction)
    shift = mi.Vector2f(sampler.next_2d()) - 0.5
    frame = mi.Frame3f(mi.Normal3f(normal))
    moved = (frame.s * shift.x + frame.t * shift.y) * CELL
    return cache.find(si.p, moved, normal, active & si.is_valid())


def lit_texture(
    tables: ShapeTables,
    cache: LightTable,
    si: mi.SurfaceInteraction3f,
    direction: mi.Vector3f,
    sampler: mi.Sampler,
    active: mi.Bool,
) -> mi.Color3f:
    """Return the diffuse radiance of the surfaces that a direction meets, `mi.Color3f`.

    For what shows their texture: cells give light alone. They reflect their `rough_albedo`.
    """
    lit = active & si.is_valid()
    entry = look_up(cache, si, direction, sampler, lit)
    irradiance = dr.gather(mi.Color3f, cache.irradiance, entry, lit)
    return dr.select(lit, irradiance * rough_albedo(tables, si, lit), 0)


def diffuse_albedo(
    world: World, si: mi.SurfaceInteraction3f, cosine: mi.Vector3f, active: mi.Bool
) -> mi.Color3f:
    """Estimate the albedo of the diffuse lobes at `si`, towards the rays that met it.

    `cosine` are cosine-distributed directions in
    world space: BSDF times cosine over their density. Of cloth it is what it reflects and transmits
    together.
    """
    own = si.bsdf()
    through = mi.Bool(False)
    if world.tables.translucent:
        through = world.tables.transmits(si, active) > 0
    uneven = active & (is_glossy(own) | through)
    diffuse = diffuse_lobes()
    towards = si.to_local(cosine)
    density = dr.maximum(dr.abs(mi.Frame3f.cos_theta(towards)), 1e-4) * dr.inv_pi
    lobe = partner(world.lobes, own, uneven)
    value = mi.Color3f(lobe.eval(diffuse, si, towards, uneven))
    if world.tables.translucent:
        behind = mi.Vector3f(towards.x, towards.y, -towards.z)
        value += mi.Color3f(lobe.eval(diffuse, si, behind, through))
    return dr.select(uneven, value / density, world.tables.reflectance_at(si, active & ~uneven))


def reflect(
    world: World, sampler: mi.Sampler, si: mi.SurfaceInteraction3f, active: mi.Bool
) -> tuple[mi.BSDFSample3f, mi.Color3f]:
    """Sample the BSDF where it is glossy: a `mi.BSDFSample3f`, and the weight of its other lobes.

    The mean of the weight is the albedo of all lobes but the diffuse ones.
    """
    own = si.bsdf()
    active = active & is_glossy(own)
    diffuse = diffuse_lobes()
    sample, weight = own.sample(mi.BSDFContext(), si, sampler.next_1d(), sampler.next_2d(), active)
    delta = mi.has_flag(sample.sampled_type, mi.BSDFFlags.Delta)
    smooth = active & ~delta
    whole = own.eval(mi.BSDFContext(), si, sample.wo, smooth)
    part = partner(world.lobes, own, smooth).eval(diffuse, si, sample.wo, smooth)
    weight = weight * (1 - dr.select(delta, 0, share(part, whole)))
    return sample, dr.select(active & (sample.pdf > 0), weight, 0)


def is_glossy(bsdf: mi.BSDFPtr) -> mi.Bool:
    """Test for BSDFs with lobes that are not diffuse."""
    flags = bsdf.flags()
    return mi.has_flag(flags, mi.BSDFFlags.Glossy) | mi.has_flag(flags, mi.BSDFFlags.Delta)


def sampler_of(spp: int, count: int, seed: mi.UInt32) -> mi.Sampler:
    """Return a sampler with `spp` stratified samples for each of `count` points."""
    sampler = mi.load_dict({"type": "multijitter"})
    sampler.set_sample_count(spp)
    sampler.set_samples_per_wavefront(spp)
    sampler.seed(seed, spp * count)
    return sampler
