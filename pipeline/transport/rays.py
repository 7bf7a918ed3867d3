"""Surfaces that rays meet, in Dr.Jit kernels: past clear glass, and what mirrors show.

The fast counterpart of `pbrnet.pipeline.render.raycast`: hits are Embree's own, in single
precision, and stay in the kernel. Where faces of several shapes lie in one plane, either may be
hit.
"""

from __future__ import annotations

from dataclasses import dataclass

import drjit as dr
import mitsuba as mi
import numpy as np

from pbrnet.pipeline.render.drjit_arrays import reflectance_table, shape_table
from pbrnet.pipeline.render.raycast.meshes import Triangles, ray_intersect, triangles_of
from pbrnet.pipeline.render.scene_geometry import MAX_LAYERS, SceneGeometry

_WHOLE = 1 << 16  # unit of `ShapeTables.transmitted`
_MIRRORS = 2  # that a camera ray may meet one after the other


@dataclass(init=False, eq=False)
class ShapeTables:
    """Properties of a scene's shapes by registry id."""

    clear: mi.UInt32  # 1 if rays pass the shape, 2 if it has a mask
    reflectance: mi.BSDFPtr  # the reflectance twin of its BSDF
    passable: bool  # whether any shape is clear or masked
    mirror: mi.UInt32  # sides that are a perfect mirror, none, the front, or both
    mirrored: bool  # whether any shape is one
    transmitted: mi.UInt32  # of 2^16, the part of its diffuse light that goes through
    translucent: bool  # whether any shape transmits light so
    meshes: Triangles | None  # all shapes' triangles, if all are meshes

    def __init__(self, geometry: SceneGeometry) -> None:
        sides = [("", "front", "both").index(mirror) for mirror in geometry.mirrors]
        through = [round(_WHOLE * share) for share in geometry.transmitted.tolist()]
        kinds = np.where(geometry.clear, 1, 2 * geometry.masked)
        self.clear = shape_table(geometry.shapes, kinds)
        self.reflectance = reflectance_table(geometry)
        self.passable = bool(geometry.clear.any() or geometry.masked.any())
        self.mirror = shape_table(geometry.shapes, sides)
        self.mirrored = any(sides)
        self.transmitted = shape_table(geometry.shapes, through)
        self.translucent = bool(geometry.transmitted.any())
        self.meshes = triangles_of(geometry.scene)

    def reflectance_at(self, si: mi.SurfaceInteraction3f, active: mi.Bool) -> mi.Color3f:
        """Return the base colour in [0, 1] of the surface at `si`, `mi.Color3f`."""
        shape = dr.reinterpret_array(mi.UInt32, si.shape)
        bsdf = dr.gather(mi.BSDFPtr, self.reflectance, shape, active)
        colour = mi.unpolarized_spectrum(bsdf.eval_diffuse_reflectance(si, active))
        return dr.clip(mi.Color3f(colour), 0, 1)

    def mirrors(self, si: mi.SurfaceInteraction3f, active: mi.Bool) -> mi.Bool:
        """Test whether the surface at `si` is a perfect mirror on the side that the ray met."""
        active = active & si.is_valid()
        sides = dr.gather(mi.UInt32, self.mirror, dr.reinterpret_array(mi.UInt32, si.shape), active)
        return active & ((sides == 2) | ((sides == 1) & (mi.Frame3f.cos_theta(si.wi) > 0)))

    def transmits(self, si: mi.SurfaceInteraction3f, active: mi.Bool) -> mi.Float:
        """Return the part of the diffuse light that leaves `si` on the other side, `mi.Float`."""
        if not self.translucent:
            return mi.Float(0)
        shape = dr.reinterpret_array(mi.UInt32, si.shape)
        return mi.Float(dr.gather(mi.UInt32, self.transmitted, shape, active)) * (1 / _WHOLE)

    def lit_side(
        self, sampler: mi.Sampler, si: mi.SurfaceInteraction3f, normal: mi.Vector3f, active: mi.Bool
    ) -> mi.Vector3f:
        """Return the normal of the side from which light at `si` comes: `normal`, or its opposite.

        Through cloth comes what lights its other side. Sides are drawn, by their share in the
        light that leaves on the side of `normal`.
        """
        if not self.translucent:
            return normal
        through = sampler.next_1d() < self.transmits(si, active)
        return dr.select(through, -normal, normal)

    def passes(self, si: mi.SurfaceInteraction3f, active: mi.Bool) -> mi.Bool:
        """Test whether rays go on behind the surface at `si`: clear glass, or cut out."""
        active = active & si.is_valid()
        shape = dr.reinterpret_array(mi.UInt32, si.shape)
        kind = dr.gather(mi.UInt32, self.clear, shape, active)
        masked = active & (kind == 2)
        share = si.bsdf().eval_null_transmission(si, masked)
        cut = dr.mean(mi.Color3f(mi.unpolarized_spectrum(share))) > 0.5
        return active & ((kind == 1) | (masked & cut))


def first_surface(
    scene: mi.Scene, tables: ShapeTables, ray: mi.Ray3f, active: mi.Bool, coherent: bool = False
) -> tuple[mi.SurfaceInteraction3f, mi.Bool]:
    """Return the first surface interaction along each ray, past clear glass and cut-outs.

    And whether the ray passed any: no shadow ray does.
    """
    si = ray_intersect(scene, tables.meshes, ray, coherent, active)
    if not tables.passable:
        return si, mi.Bool(False)

    def step(
        passing: mi.Bool, si: mi.SurfaceInteraction3f, layer: mi.UInt32
    ) -> tuple[mi.Bool, mi.SurfaceInteraction3f, mi.UInt32]:
        onward = si.spawn_ray(ray.d)
        behind = ray_intersect(scene, tables.meshes, onward, coherent, passing)
        return tables.passes(behind, passing) & (layer < MAX_LAYERS), behind, layer + 1

    _, si, layer = dr.while_loop(
        state=(tables.passes(si, active), si, mi.UInt32(1)),
        cond=lambda passing, si, layer: passing,
        body=step,
        labels=("passing", "si", "layer"),
    )
    return si, layer > 1


def seen_surface(
    scene: mi.Scene, tables: ShapeTables, ray: mi.Ray3f
) -> tuple[mi.SurfaceInteraction3f, mi.Ray3f, mi.Color3f]:
    """Return the first surface that is no perfect mirror, the ray to it, and what mirrors left.

    The last is the product of the mirrors' reflectances, `mi.Color3f`, 1 where there is none.
    """
    si, _ = first_surface(scene, tables, ray, mi.Bool(True), coherent=True)
    left = mi.Color3f(1)
    if not tables.mirrored:
        return si, ray, left

    # By formula: a call to sample the mirror's BSDF would compile the sampling of all others, too.
    def step(
        mirror: mi.Bool,
        si: mi.SurfaceInteraction3f,
        ray: mi.Ray3f,
        left: mi.Color3f,
        count: mi.UInt32,
    ) -> tuple[mi.Bool, mi.SurfaceInteraction3f, mi.Ray3f, mi.Color3f, mi.UInt32]:
        left = left * tables.reflectance_at(si, mirror)
        ray = si.spawn_ray(si.to_world(mi.reflect(si.wi)))
        si, _ = first_surface(scene, tables, ray, mirror)
        count = count + 1
        return tables.mirrors(si, mirror) & (count < _MIRRORS), si, ray, left, count

    _, si, ray, left, _ = dr.while_loop(
        state=(tables.mirrors(si, mi.Bool(True)), si, mi.Ray3f(ray), left, mi.UInt32(0)),
        cond=lambda mirror, si, ray, left, count: mirror,
        body=step,
        labels=("mirror", "si", "ray", "left", "count"),
    )
    return si, ray, left


def facing_normal(si: mi.SurfaceInteraction3f, direction: mi.Vector3f) -> mi.Vector3f:
    """Return the shading normal on the side from which a ray of this direction arrives.

    Where it would still point away, it is bent until it is perpendicular to the ray.
    """
    geometric = dr.select(dr.dot(si.n, direction) > 0, -si.n, si.n)
    shading = mi.Vector3f(si.sh_frame.n)
    shading = dr.select(dr.dot(shading, geometric) < 0, -shading, shading)
    return dr.normalize(shading - dr.maximum(dr.dot(shading, direction), 0) * direction)


def surface_point(position: mi.Point3f, normal: mi.Vector3f) -> mi.SurfaceInteraction3f:
    """Return an interaction at a point with this normal, as emitter sampling needs it."""
    si = dr.zeros(mi.SurfaceInteraction3f, dr.width(position))
    si.t = mi.Float(1)
    si.p = position
    si.n = mi.Normal3f(normal)
    si.sh_frame = mi.Frame3f(mi.Normal3f(normal))
    si.wi = mi.Vector3f(0, 0, 1)
    return si
