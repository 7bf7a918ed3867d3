"""Final gathering: the light at what each pixel sees, averaged over its samples.

Every sample of a pixel is a camera ray, an emitter sample, one gathered direction, and where the
material has a gloss one direction of its own sampling. Gloss sees the diffuse light of what that
direction meets. A perfect mirror shows what a camera ray meets behind it.
"""

from __future__ import annotations

from typing import Any

import drjit as dr
import mitsuba as mi

from pipeline.pathtrace.integrator import power_heuristic
from pipeline.pathtrace.light_sampling import PlannedLights
from pipeline.render.bsdf_tables import partner
from pipeline.transport.cells import LightTable
from pipeline.transport.gather import (
    Gathered,
    gather,
    is_glossy,
    look_up,
    met,
    reflect,
    sampler_of,
    share,
)
from pipeline.transport.radiosity import camera_ray
from pipeline.transport.rays import ShapeTables, facing_normal, seen_surface, surface_point

# Means over a pixel's samples, with the number of bands of each.
IMAGES = {
    "direct": 3,  # light on the surface: radiance of a white diffuse one
    "indirect": 3,
    "specular": 3,  # radiance that the surface reflects by its other lobes
    "emitted": 3,  # radiance of lamps and sky
    "albedo": 3,  # of the diffuse lobes
    "normal": 3,
    "position": 3,
    "seen": 1,  # 1 where a surface is seen
    "squares": 3,  # of the luminance of direct, indirect, specular
}


def gather_pixels(
    scene: Any,
    tables: ShapeTables,
    lights: PlannedLights,
    lobes: Any,
    cache: LightTable,
    camera: tuple[Any, Any],
    size: tuple[int, int],
    spp: int,
    seed: Any,
) -> list[Any]:
    """Return the bands of `IMAGES`, `mi.Float` (H * W,) each.

    `lobes` is the table of the BSDFs' diffuse lobes, `camera` as in `trace_surfels` for pixels of
    an image of `size` (width, height).
    """
    width, height = size
    sampler = sampler_of(spp, width * height, seed)
    pixel = dr.arange(mi.UInt32, width * height * spp) // spp
    offset = sampler.next_2d()
    ray = camera_ray(
        camera, mi.Float(pixel % width) + offset.x, mi.Float(pixel // width) + offset.y
    )
    si, ray, left = seen_surface(scene, tables, ray)
    seen = si.is_valid()
    emitted = left * mi.Color3f(si.emitter(scene).eval(si, mi.Bool(True)))
    normal = facing_normal(si, ray.d)
    found = gather(scene, tables, lights, sampler, si.p, normal, seen)
    met_surface = (found.weight > 0) & found.si.is_valid()
    entry = look_up(cache, found.si, found.direction, sampler, met_surface)
    radiosity = dr.gather(mi.Color3f, cache.radiosity, entry, met_surface)
    indirect = dr.select(met_surface, radiosity * found.weight, 0)
    albedo, specular = _gloss(scene, tables, lights, lobes, cache, sampler, si, normal, found, seen)

    images = {
        "direct": found.direct,
        "indirect": indirect,
        "specular": left * specular,
        "emitted": emitted,
        "albedo": left * albedo,
        "normal": dr.select(seen, normal, 0),
        "position": dr.select(seen, mi.Vector3f(si.p), 0),
        "seen": [dr.select(seen, mi.Float(1), 0)],
        "squares": [dr.square(mi.luminance(each)) for each in (found.direct, indirect, specular)],
    }
    bands = [band for image in images.values() for band in image]
    bands = [dr.select(dr.isfinite(band), band, 0) for band in bands]
    dr.eval(bands)  # in one kernel: a sum over blocks evaluates what it is given by itself
    return [dr.block_sum(band, spp) / spp for band in bands]


def _gloss(
    scene: Any,
    tables: ShapeTables,
    lights: PlannedLights,
    lobes: Any,
    cache: LightTable,
    sampler: Any,
    si: Any,
    normal: Any,
    found: Gathered,
    seen: Any,
) -> tuple[Any, Any]:
    """Return the albedo of the diffuse lobes, and the radiance of all other lobes."""
    own = si.bsdf()
    context, diffuse = mi.BSDFContext(), mi.BSDFContext()
    diffuse.type_mask = mi.BSDFFlags.Diffuse
    glossy = seen & is_glossy(own)
    reflection = reflect(tables, lobes, sampler, si, found.cosine, seen)

    towards = si.to_local(found.emitter.d)
    value, pdf = own.eval_pdf(context, si, towards, glossy)
    lobe = partner(lobes, own, seen)
    rest = 1 - share(lobe.eval(diffuse, si, towards, glossy), value)
    mis = dr.select(found.emitter.delta, 1, power_heuristic(found.emitter.pdf, pdf))
    specular = dr.select(glossy, found.arriving * value * rest * mis, 0)

    sample, weight = reflection.sample, reflection.gloss
    delta = mi.has_flag(sample.sampled_type, mi.BSDFFlags.Delta)
    active = glossy & dr.any(weight > 0)
    point = surface_point(si.p, normal)
    direction = si.to_world(sample.wo)
    other, emission, density = met(scene, tables, lights, point, direction, active, ~delta)
    emission *= dr.select(delta, 1, power_heuristic(sample.pdf, density))
    # Gloss shows the texture of what it meets, so cells give light alone.
    lit = active & other.is_valid()
    entry = look_up(cache, other, direction, sampler, lit)
    light = dr.gather(mi.Color3f, cache.irradiance, entry, lit)
    radiance = dr.select(lit, light * tables.reflectance_at(other, lit), 0)
    specular += dr.select(active, weight * (emission + radiance), 0)
    return reflection.diffuse, specular
