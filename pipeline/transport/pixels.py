"""Final gathering: the light at what each pixel sees, averaged over its samples.

Three kernels, each with camera rays of its own, because they need unlike numbers of them. Surfaces
give textures and edges and cost least. Light takes an emitter sample and one gathered direction.
Gloss, where the material has any, takes an emitter sample and one direction of its own sampling; it
costs most and adds least. Gloss sees the diffuse light of what that direction meets, and so does
what a window pane reflects. A perfect mirror shows what a camera ray meets behind it. Values that
are not finite become 0 and are counted.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import drjit as dr
import mitsuba as mi

from pipeline.pathtrace.integrator import power_heuristic
from pipeline.pathtrace.light_sampling import PlannedLights
from pipeline.pathtrace.panes import Panes
from pipeline.render.bsdf_tables import partner
from pipeline.transport.cells import LightTable
from pipeline.transport.gather import (
    diffuse_albedo,
    gather,
    is_glossy,
    lit_texture,
    look_up,
    met,
    reflect,
    reflected,
    sampler_of,
    share,
)
from pipeline.transport.radiosity import camera_ray
from pipeline.transport.rays import (
    ShapeTables,
    facing_normal,
    first_surface,
    seen_surface,
    surface_point,
)

Image = dict[str, Any]

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
_FEWER = {64: 16, 16: 8, 8: 4, 4: 2}  # grids of nearly equal sides, as stratified samples need


class Samples(NamedTuple):
    """Samples per pixel of each kernel."""

    surfaces: int
    light: int
    gloss: int

    @classmethod
    def of(cls, spp: int) -> Samples:
        """Return the samples for images with this many camera rays a pixel."""
        light = _FEWER.get(spp, spp)
        return cls(spp, light, _FEWER.get(light, light))


class Kernel(NamedTuple):
    """Inputs of the kernels.

    `lobes` is the table of the BSDFs' diffuse lobes, `camera` as in `trace_surfels` for pixels of
    an image of `size` (width, height), `panes` are the scene's window panes.
    """

    scene: Any
    tables: ShapeTables
    lights: PlannedLights
    lobes: Any
    cache: LightTable
    camera: tuple[Any, Any]
    size: tuple[int, int]
    panes: Panes | None

    def means(self, image: Any, spp: int, seed: Any) -> list[Any]:
        """Return the bands of a kernel's images, means over `spp` samples, (H * W,) each."""
        width, height = self.size
        sampler = sampler_of(spp, width * height, seed)
        pixel = dr.arange(mi.UInt32, width * height * spp) // spp
        offset = sampler.next_2d()
        x, y = mi.Float(pixel % width) + offset.x, mi.Float(pixel // width) + offset.y
        ray = camera_ray(self.camera, x, y)
        si, onward, left = seen_surface(self.scene, self.tables, ray)
        pane = None
        if self.panes is not None:
            pane = self.panes.mirror(self.scene, ray, mi.Bool(True))
            left = left * dr.select(pane[0], 1 - pane[1], 1)
        images = image(self, sampler, si, onward, left)
        if "panes" in images:
            images["panes"] = self.reflected(pane, sampler)
        bands = [band for bands in images.values() for band in bands]
        finite = dr.full(mi.Bool, True, width * height * spp)
        for band in bands:
            finite &= dr.isfinite(band)
        bands = [dr.select(dr.isfinite(band), band, 0) for band in bands]
        bands.append(dr.select(finite, mi.Float(0), 1))
        dr.eval(bands)  # in one kernel: a sum over blocks evaluates what it is given by itself
        return [dr.block_sum(band, spp) / spp for band in bands]

    def reflected(self, pane: tuple[Any, Any, Any] | None, sampler: Any) -> Any:
        """Return the radiance that panes reflect, `mi.Color3f`; `pane` is from `Panes.mirror`."""
        if pane is None:
            return dr.zeros(mi.Color3f, sampler.wavefront_size())
        met, share, ray = pane
        si, _ = first_surface(self.scene, self.tables, ray, met)
        radiance = mi.Color3f(si.emitter(self.scene, met).eval(si, met))
        radiance += lit_texture(self.tables, self.cache, si, ray.d, sampler, met)
        return dr.select(met, share * radiance, 0)


def gather_pixels(
    scene: Any,
    tables: ShapeTables,
    lights: PlannedLights,
    lobes: Any,
    cache: LightTable,
    camera: tuple[Any, Any],
    size: tuple[int, int],
    panes: Panes | None,
    samples: Samples,
    seed: Any,
) -> list[Any]:
    """Return the bands of `IMAGES`, `mi.Float` (H * W,) each; inputs as in `Kernel`."""
    kernel = Kernel(scene, tables, lights, lobes, cache, camera, size, panes)
    return [
        band
        for number, (image, spp) in enumerate(
            zip((_surfaces, _light, _gloss), samples, strict=True)
        )
        for band in kernel.means(image, spp, seed + number)
    ]


def _surfaces(kernel: Kernel, sampler: Any, si: Any, ray: Any, left: Any) -> Image:
    seen = si.is_valid()
    normal = facing_normal(si, ray.d)
    cosine = mi.warp.square_to_cosine_hemisphere(sampler.next_2d())
    towards = mi.Frame3f(mi.Normal3f(normal)).to_world(cosine)
    return {
        "emitted": left * mi.Color3f(si.emitter(kernel.scene).eval(si, mi.Bool(True))),
        "albedo": left * diffuse_albedo(kernel.tables, kernel.lobes, si, towards, seen),
        "normal": dr.select(seen, normal, 0),
        "position": dr.select(seen, mi.Vector3f(si.p), 0),
        "panes": mi.Color3f(0),  # by `Kernel.means`
        "seen": [dr.select(seen, mi.Float(1), 0)],
    }


def _light(kernel: Kernel, sampler: Any, si: Any, ray: Any, left: Any) -> Image:
    seen = si.is_valid()
    scene, tables, lights, cache = kernel.scene, kernel.tables, kernel.lights, kernel.cache
    normal = tables.lit_side(sampler, si, facing_normal(si, ray.d), seen)
    found = gather(scene, tables, lights, sampler, si.p, normal, seen)
    reflecting = (found.weight > 0) & found.si.is_valid()
    entry = look_up(cache, found.si, found.direction, sampler, reflecting)
    radiosity = dr.gather(mi.Color3f, cache.radiosity, entry, reflecting)
    indirect = dr.select(reflecting, radiosity * found.weight, 0)
    large = reflecting & (dr.gather(mi.UInt32, cache.large, entry, reflecting) > 0)
    indirect += reflected(scene, tables, lights, sampler, found, large)
    # Where a white curtain hides half of a dark wall in the sun, mean reflectance times mean light
    # would be too bright: light counts as much as it is reflected.
    weight = dr.select(seen, tables.reflectance_at(si, seen) + _LEAST_WEIGHT, 0)
    luminance = [mi.luminance(each) for each in (found.direct, indirect)]
    return {
        "direct": weight * found.direct,
        "indirect": weight * indirect,
        "weight": weight,
        "lit": [dr.select(seen, mi.Float(1), 0)],
        "light_means": luminance,
        "light_squares": [dr.square(each) for each in luminance],
    }


def _gloss(kernel: Kernel, sampler: Any, si: Any, ray: Any, left: Any) -> Image:
    scene, tables, lights, cache = kernel.scene, kernel.tables, kernel.lights, kernel.cache
    own = si.bsdf()
    glossy = si.is_valid() & is_glossy(own)
    point = surface_point(si.p, facing_normal(si, ray.d))
    ds, light = lights.sample(scene, point, sampler.next_2d(), glossy)
    towards = si.to_local(ds.d)
    value, pdf = own.eval_pdf(mi.BSDFContext(), si, towards, glossy)
    diffuse = mi.BSDFContext()
    diffuse.type_mask = mi.BSDFFlags.Diffuse
    lobe = partner(kernel.lobes, own, glossy)
    rest = 1 - share(lobe.eval(diffuse, si, towards, glossy), value)
    mis = dr.select(ds.delta, 1, power_heuristic(ds.pdf, pdf))
    arriving = dr.select(glossy & (ds.pdf > 0), mi.Color3f(light), 0)
    specular = arriving * value * rest * mis

    sample, weight = reflect(kernel.lobes, sampler, si, glossy)
    delta = mi.has_flag(sample.sampled_type, mi.BSDFFlags.Delta)
    active = glossy & dr.any(weight > 0)
    direction = si.to_world(sample.wo)
    other, emission, density = met(scene, tables, lights, point, direction, active, ~delta)
    emission *= dr.select(delta, 1, power_heuristic(sample.pdf, density))
    radiance = lit_texture(tables, cache, other, direction, sampler, active)
    specular += dr.select(active, weight * (emission + radiance), 0)
    return {
        "specular": left * specular,
        "specular_squares": [dr.square(mi.luminance(left * specular))],
    }
