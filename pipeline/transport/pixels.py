"""Final gathering: the light at what each pixel sees, averaged over its samples.

Three kernels, each with camera rays of its own, because they need unlike numbers of them. Surfaces
give textures and edges and cost least. Light takes an emitter sample and one gathered direction,
and another emitter sample on the surface that this meets, from which cells learn what they reflect
(`pbrnet.pipeline.transport.radiosity`) before pixels look them up. Gloss, where the material has
any, takes an emitter sample and one direction of its own sampling; it costs most and adds least.
Gloss sees the diffuse light of what that direction meets, and of its gloss one emitter sample; of
what a window pane reflects, the diffuse light alone. A perfect mirror shows what a camera ray meets
behind it. Values that are not finite become 0 and are counted.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple, TypeAlias

import drjit as dr
import mitsuba as mi

from pbrnet.pipeline.pathtrace.panes import PaneMirror, Panes
from pbrnet.pipeline.pathtrace.scattering import diffuse_lobes, mis_weight, share
from pbrnet.pipeline.render.drjit_arrays import met_emitter, partner
from pbrnet.pipeline.transport.cells import LightTable
from pbrnet.pipeline.transport.gather import (
    World,
    diffuse_albedo,
    gather,
    is_glossy,
    lit_texture,
    look_up,
    met,
    reflect,
    reflected,
    sampler_of,
)
from pbrnet.pipeline.transport.radiosity import camera_ray
from pbrnet.pipeline.transport.rays import facing_normal, first_surface, seen_surface, surface_point

Image: TypeAlias = "dict[str, mi.Color3f | mi.Vector3f | list[mi.Float]]"  # bands by name

# Means over a pixel's samples, with the number of bands of each.
IMAGES = {
    "emitted": 3,  # radiance of lamps and sky
    "albedo": 3,  # of the diffuse lobes
    "normal": 3,
    "position": 3,
    "panes": 3,  # radiance that window panes reflect
    "seen": 1,  # 1 where a surface is seen
    "lost_surfaces": 1,  # 1 where a value is not finite: it counts as 0
    "direct": 3,  # light on the surface: radiance of a white diffuse one; times `weight`
    "indirect": 3,
    "weight": 3,  # reflectance and a little more, 0 where no surface is seen
    "lit": 1,  # `seen` by the samples of light
    "light_means": 2,  # luminance of direct and indirect, without weights
    "light_squares": 2,
    "lost_light": 1,
    "specular": 3,  # radiance that the surface reflects by its other lobes
    "specular_squares": 1,
    "lost_gloss": 1,
}
LOST = ("lost_surfaces", "lost_light", "lost_gloss")

_LEAST_WEIGHT = 0.005  # of light on a black surface
_GLOSS_SAMPLES = {64: 8, 32: 8, 16: 8, 8: 4, 4: 2}  # by those of the rest


class Samples(NamedTuple):
    """Samples per pixel: of surfaces and light, and of gloss."""

    light: int
    gloss: int

    @classmethod
    def of(cls, spp: int) -> Samples:
        """Return the samples for images with this many camera rays a pixel."""
        return cls(spp, _GLOSS_SAMPLES.get(spp, spp))


class LightSamples(NamedTuple):
    """Samples of light, one for each camera ray."""

    direct: mi.Color3f  # on the surface seen: radiance of a white diffuse one
    weight: mi.Color3f  # its reflectance and a little more
    lit: mi.Float  # 1 where a surface is seen
    lost: mi.Float  # 1 where a value is not finite: all are 0
    entry: mi.UInt32  # in the table of cells: of the surface that the gathered direction meets
    share: mi.Float  # that surface counts with its radiance times this
    once: mi.Color3f  # direct light that it reflects, times `share`


@dataclass(eq=False)
class Kernel:
    """Inputs of the kernels; a dataclass, so that Dr.Jit finds its arrays.

    `camera` as in `trace_surfels` for pixels of an image of `size` (width, height), `panes` are the
    scene's window panes.
    """

    world: World
    cache: LightTable
    camera: tuple[mi.Float, mi.Float]
    size: tuple[int, int]
    panes: Panes | None

    def rays(
        self, spp: int, seed: mi.UInt32
    ) -> tuple[mi.Sampler, mi.SurfaceInteraction3f, mi.Ray3f, mi.Color3f, PaneMirror | None]:
        """Trace camera rays.

        Returns the sampler, what they see and from where, what is left of their light there, and
        `Panes.mirror` or None.
        """
        width, height = self.size
        sampler = sampler_of(spp, width * height, seed)
        pixel = dr.arange(mi.UInt32, width * height * spp) // spp
        offset = sampler.next_2d()
        x, y = mi.Float(pixel % width) + offset.x, mi.Float(pixel // width) + offset.y
        ray = camera_ray(self.camera, x, y)
        si, onward, left = seen_surface(self.world.scene, self.world.tables, ray)
        pane = None
        if self.panes is not None:
            pane = self.panes.mirror(self.world.scene, ray, mi.Bool(True))
            left = left * dr.select(pane.met, 1 - pane.reflected, 1)
        return sampler, si, onward, left, pane

    def reflected(self, pane: PaneMirror | None, sampler: mi.Sampler) -> mi.Color3f:
        """Return the radiance that panes reflect, `mi.Color3f`; `pane` is from `Panes.mirror`."""
        if pane is None:
            return dr.zeros(mi.Color3f, sampler.wavefront_size())
        met, share, ray = pane
        si, _ = first_surface(self.world.scene, self.world.tables, ray, met)
        radiance = mi.Color3f(met_emitter(si, self.world.environment).eval(si, met))
        radiance += lit_texture(self.world.tables, self.cache, si, ray.d, sampler, met)
        return dr.select(met, share * radiance, 0)


def light_samples(kernel: Kernel, samples: Samples, seed: mi.UInt32) -> tuple[dr.ArrayBase, ...]:
    """Trace the `LightSamples` of an image; of the kernel's `cache`, light is unused."""
    sampler, si, ray, _, _ = kernel.rays(samples.light, seed)
    found = tuple(_light(kernel, sampler, si, ray))
    dr.eval(found)
    return found


def gather_pixels(
    kernel: Kernel, samples: Samples, seed: mi.UInt32, light: tuple[dr.ArrayBase, ...]
) -> list[mi.Float]:
    """Return the bands of `IMAGES`, `mi.Float` (H * W,) each.

    `light` is what `light_samples` returned, with the same samples.
    """
    sampler, si, onward, left, pane = kernel.rays(samples.light, seed + 1)
    surfaces = _surfaces(kernel, sampler, si, onward, left)
    surfaces["panes"] = kernel.reflected(pane, sampler)
    bands = means(surfaces, samples.light)
    found = LightSamples(*light)
    bands += means(_light_images(kernel.cache, found), samples.light, found.lost)
    sampler, si, onward, left, _ = kernel.rays(samples.gloss, seed + 2)
    return bands + means(_gloss(kernel, sampler, si, onward, left), samples.gloss)


def means(images: Image, spp: int, lost: mi.Float = 0.0) -> list[mi.Float]:
    """Return the bands of images, means over `spp` samples of each pixel, (H * W,) each.

    Values that are not finite count as 0. A last band is the part of samples with such values, or
    the mean of `lost`.
    """
    bands = [band for image in images.values() for band in image]
    finite = mi.Bool(True)
    for band in bands:
        finite &= dr.isfinite(band)
    bands = [dr.select(dr.isfinite(band), band, 0) for band in bands]
    bands.append(dr.select(finite, mi.Float(lost), 1))
    dr.eval(bands)  # in one kernel: a sum over blocks evaluates what it is given by itself
    return [dr.block_sum(band, spp) / spp for band in bands]


def _surfaces(
    kernel: Kernel,
    sampler: mi.Sampler,
    si: mi.SurfaceInteraction3f,
    ray: mi.Ray3f,
    left: mi.Color3f,
) -> Image:
    seen = si.is_valid()
    normal = facing_normal(si, ray.d)
    cosine = mi.warp.square_to_cosine_hemisphere(sampler.next_2d())
    towards = mi.Frame3f(mi.Normal3f(normal)).to_world(cosine)
    emitter = met_emitter(si, kernel.world.environment)
    return {
        "emitted": left * mi.Color3f(emitter.eval(si, mi.Bool(True))),
        "albedo": left * diffuse_albedo(kernel.world, si, towards, seen),
        "normal": dr.select(seen, normal, 0),
        "position": dr.select(seen, mi.Vector3f(si.p), 0),
        "panes": mi.Color3f(0),  # by `gather_pixels`
        "seen": [dr.select(seen, mi.Float(1), 0)],
    }


def _light(
    kernel: Kernel, sampler: mi.Sampler, si: mi.SurfaceInteraction3f, ray: mi.Ray3f
) -> LightSamples:
    seen = si.is_valid()
    world, tables = kernel.world, kernel.world.tables
    normal = tables.lit_side(sampler, si, facing_normal(si, ray.d), seen)
    found = gather(world, sampler, si.p, normal, seen)
    reflecting = (found.weight > 0) & found.si.is_valid()
    entry = look_up(kernel.cache, found.si, found.direction, sampler, reflecting)
    once = reflected(world, sampler, found, reflecting)
    # Where a white curtain hides half of a dark wall in the sun, mean reflectance times mean light
    # would be too bright: light counts as much as it is reflected.
    weight = dr.select(seen, tables.reflectance_at(si, seen) + _LEAST_WEIGHT, 0)
    share = dr.select(reflecting, found.weight, 0)
    finite = dr.isfinite(share)
    for each in (found.direct, weight, once):
        finite &= dr.all(dr.isfinite(each))
    return LightSamples(
        direct=dr.select(finite, found.direct, 0),
        weight=dr.select(finite, weight, 0),
        lit=dr.select(seen & finite, mi.Float(1), 0),
        lost=dr.select(finite, mi.Float(0), 1),
        entry=entry,
        share=dr.select(finite, share, 0),
        once=dr.select(finite, once, 0),
    )


def _light_images(cache: LightTable, light: LightSamples) -> Image:
    reflecting = light.share > 0
    radiosity = dr.gather(mi.Color3f, cache.radiosity, light.entry, reflecting)
    indirect = dr.select(reflecting, radiosity * light.share, 0)
    large = reflecting & (dr.gather(mi.UInt32, cache.large, light.entry, reflecting) > 0)
    indirect += dr.select(large, light.once, 0)
    luminance = [mi.luminance(each) for each in (light.direct, indirect)]
    return {
        "direct": light.weight * light.direct,
        "indirect": light.weight * indirect,
        "weight": light.weight,
        "lit": [light.lit],
        "light_means": luminance,
        "light_squares": [dr.square(each) for each in luminance],
    }


def _gloss(
    kernel: Kernel,
    sampler: mi.Sampler,
    si: mi.SurfaceInteraction3f,
    ray: mi.Ray3f,
    left: mi.Color3f,
) -> Image:
    glossy = si.is_valid() & is_glossy(si.bsdf())
    point = surface_point(si.p, facing_normal(si, ray.d))
    specular = _sampled_gloss(kernel, sampler, si, point, glossy)

    sample, weight = reflect(kernel.world, sampler, si, glossy)
    delta = mi.has_flag(sample.sampled_type, mi.BSDFFlags.Delta)
    active = glossy & dr.any(weight > 0)
    direction = si.to_world(sample.wo)
    other, emission, density = met(kernel.world, point, direction, active, ~delta)
    emission *= mis_weight(sample.pdf, density, delta)
    radiance = lit_texture(kernel.world.tables, kernel.cache, other, direction, sampler, active)
    active_there = active & other.is_valid() & is_glossy(other.bsdf())
    there = surface_point(other.p, facing_normal(other, direction))
    radiance += _sampled_gloss(kernel, sampler, other, there, active_there)
    specular += dr.select(active, weight * (emission + radiance), 0)
    return {
        "specular": left * specular,
        "specular_squares": [dr.square(mi.luminance(left * specular))],
    }


def _sampled_gloss(
    kernel: Kernel,
    sampler: mi.Sampler,
    si: mi.SurfaceInteraction3f,
    point: mi.SurfaceInteraction3f,
    active: mi.Bool,
) -> mi.Color3f:
    """Return the radiance of one emitter sample that gloss at `si` reflects, `mi.Color3f`.

    Weighted against sampling of the BSDF. `point` is `surface_point` at `si`.
    """
    own = si.bsdf()
    world = kernel.world
    choice = world.lights.choice(point.p, point.n)
    ds, light = world.lights.sample(world.scene, point, choice, sampler.next_2d(), active)
    towards = si.to_local(ds.d)
    value, pdf = own.eval_pdf(mi.BSDFContext(), si, towards, active)
    lobe = partner(kernel.world.lobes, own, active)
    rest = 1 - share(lobe.eval(diffuse_lobes(), si, towards, active), value)
    mis = mis_weight(ds.pdf, pdf, ds.delta)
    arriving = dr.select(active & (ds.pdf > 0), mi.Color3f(light), 0)
    return arriving * value * rest * mis
