"""Path guiding towards bright indirect emitters: targets of a view, and directions to them.

Emitter sampling covers direct light. It does not find what the emitters light up: sunlit ground
behind a window, a patch of sun on the floor, the wall beside a lamp. Paths meet such surfaces by
chance only. If they are small, few paths carry much light, and by day that is most of the noise.

This module finds such surfaces from the light's side, by rays from lamps and by the sun's rays
through the portals, and estimates what lies beyond each portal. It then keeps the guiding targets
that cause most irradiance at the light plan's pilot points.
At a vertex, `Guidance` mixes directions to them with sampling of the BSDF.

As in the light plan, no material is evaluated, so that shading depends on no colour.
"""

from __future__ import annotations

from dataclasses import dataclass

import drjit as dr
import mitsuba as mi
import numpy as np

from pbrnet.pipeline.pathtrace.irradiance import (
    RAY_OFFSET,
    environment_luminance,
    first_hits,
    in_sun_disc,
    rms,
    sun_irradiance,
    sunlit_surfaces,
)
from pbrnet.pipeline.pathtrace.light_plan import ASSUMED_ALBEDO, LightPlan
from pbrnet.pipeline.pathtrace.portals import (
    Rectangles,
    RectangleSampler,
    below_one,
    choose,
    cross,
    geometry_factor,
    perpendicular,
    sample_rectangles,
)
from pbrnet.pipeline.render.drjit_arrays import column, vector
from pbrnet.scenes.arrays import Float64Array
from pbrnet.scenes.color import luminance
from pbrnet.scenes.seeds import generator

MAX_TARGETS = 12  # guiding targets in one view
_RAYS = 512  # from each lamp, and from the sun through each portal
_MAX_LAMP_RAYS = 1 << 16  # about the most from all lamps together
_CELL = 0.4  # metres: size of the cells that collect the hits of light rays
_MAX_CELLS = 512  # cells tested against every `_STRIDE`-th pilot point: the brightest
_STRIDE = 9
_CANDIDATES = 48  # cells tested against all pilot points: the best of those
_MIN_HALF_SIDE = 0.05  # metres, of a target
_TOLERANCE = 0.05  # metres before a target within which a shadow ray has arrived

_MAX_GUIDED = 0.4  # probability of a guided direction where all indirect light is from targets

LitSurfaces = tuple[Float64Array, Float64Array, Float64Array]  # points, normals, flux


@dataclass(frozen=True)
class GuidingPlan:
    """Guiding targets of a view: rectangles and their strengths (G,).

    Normals point in the direction of the paths: outdoors through portals, into lit surfaces. A
    strength times the geometry factor and the cosine at the target approximates the irradiance
    that the target causes at a surface.
    """

    targets: Rectangles
    strengths: Float64Array


def plan_guiding(scene: mi.Scene, plan: LightPlan, seed: int) -> GuidingPlan | None:
    """Return the guiding targets of the view with this light plan; None if there are none.

    `scene` is the Mitsuba scene.
    """
    if plan.pilot is None:
        return None
    points, normals, hit = plan.pilot.points[::2], plan.pilot.normals[::2], plan.pilot.hit[::2]
    if not hit.any():
        return None
    points = points + RAY_OFFSET * normals
    random = generator(seed, "bounces")
    few = slice(None, None, _STRIDE)
    lit, flux = _lit_cells(scene, plan, points[few], normals[few], random)
    targets = plan.rectangles.joined(lit)
    irradiance = np.concatenate(
        [
            _outdoor_irradiance(scene, points, normals, plan, random),
            _lit_surface_irradiance(scene, points, normals, lit.centre, -lit.normal, flux)[0],
        ],
        axis=1,
    )
    irradiance = irradiance[hit]
    factors, metres = _geometry_factors(points[hit], normals[hit], targets)
    # BSDF sampling finds a target the more rarely, the smaller it is as seen from the surface.
    score = rms(irradiance * metres) / np.sqrt(targets.area)
    best = np.argsort(-score, kind="stable")[:MAX_TARGETS]
    best = best[score[best] > 0]
    if not len(best):
        return None
    return GuidingPlan(targets.take(best), rms(irradiance[:, best]) / rms(factors[:, best]))


def _geometry_factors(
    points: Float64Array, normals: Float64Array, targets: Rectangles
) -> tuple[Float64Array, Float64Array]:
    """Return geometry factors times the cosine at the target, (P, G), and distances (P, G)."""
    directions = targets.centre[None] - points[:, None]
    squared = (directions**2).sum(axis=-1)
    metres = np.sqrt(squared)
    directions = directions / np.maximum(metres, 1e-6)[..., None]
    cosine = np.maximum((directions * normals[:, None]).sum(axis=-1), 0)
    target_cosine = np.maximum((directions * targets.normal).sum(axis=-1), 0)
    return np.asarray(target_cosine * geometry_factor(cosine, squared, targets.spread)), metres


def _outdoor_irradiance(
    scene: mi.Scene,
    points: Float64Array,
    normals: Float64Array,
    plan: LightPlan,
    random: np.random.Generator,
) -> Float64Array:
    """Estimate the irradiance (P, K) by surfaces beyond each portal, lit by sun and sky."""
    portals, count = plan.rectangles, len(plan.rectangles.area)
    if not count or scene.environment() is None:
        return np.zeros((len(points), count))
    directions, weight = sample_rectangles(portals, points, normals, random)
    hits, facing, hit = first_hits(scene, np.tile(points, (count, 1)), directions.reshape(-1, 3))
    offset = hits.reshape(directions.shape) - portals.corner[:, None]
    beyond = (offset * portals.normal[:, None]).sum(axis=-1) > 0  # nearer surfaces stand indoors
    hits = hits + RAY_OFFSET * facing
    upwards = random.normal(size=facing.shape)
    upwards = upwards / np.linalg.norm(upwards, axis=1, keepdims=True) + facing
    upwards = upwards / np.maximum(np.linalg.norm(upwards, axis=1, keepdims=True), 1e-3)
    light = np.pi * environment_luminance(scene, hits, upwards)
    light = light * ~in_sun_disc(plan.sun_disc, upwards)
    light = light + sun_irradiance(scene, hits, facing, plan.sun_disc, random)[0]
    radiance = ASSUMED_ALBEDO / np.pi * np.nan_to_num(light) * hit
    return np.asarray((radiance.reshape(count, -1) * beyond * weight).T)


def _lit_surface_irradiance(
    scene: mi.Scene,
    points: Float64Array,
    normals: Float64Array,
    surfaces: Float64Array,
    facing: Float64Array,
    flux: Float64Array,
) -> tuple[Float64Array, Float64Array]:
    """Estimate the irradiance (P, C) by light reflected once; also return distances (P, C).

    `flux` (C,) falls on surface points `surfaces` (C, 3) with normals `facing` (C, 3).
    """
    count = len(flux)
    if not count:
        return np.zeros((len(points), 0)), np.zeros((len(points), 0))
    directions = (surfaces + RAY_OFFSET * facing)[None] - points[:, None]
    metres = np.linalg.norm(directions, axis=-1)
    directions = directions / np.maximum(metres, 1e-6)[..., None]
    ray = mi.Ray3f(
        vector(mi.Point3f, np.repeat(points, count, axis=0)),
        vector(mi.Vector3f, directions.reshape(-1, 3)),
    )
    ray.maxt = column(mi.Float, np.maximum(metres.ravel() - _TOLERANCE, 0))
    visible = ~np.array(scene.ray_test(ray)).reshape(metres.shape)
    cosine = np.maximum((directions * normals[:, None]).sum(axis=-1), 0)
    surface_cosine = np.maximum(-(directions * facing).sum(axis=-1), 0)
    irradiance = visible * ASSUMED_ALBEDO / np.pi * flux * cosine * surface_cosine
    return irradiance / (metres**2 + _CELL**2), metres


def _lit_cells(
    scene: mi.Scene,
    plan: LightPlan,
    points: Float64Array,
    normals: Float64Array,
    random: np.random.Generator,
) -> tuple[Rectangles, Float64Array]:
    """Return lit patches indoors as rectangles and the flux that falls on each, (C,).

    The patches kept are those that cause most irradiance at some of the points (P, 3).
    """
    hits, facing, flux = (
        np.concatenate(parts)
        for parts in zip(
            _lit_by_lamps(scene, random),
            sunlit_surfaces(scene, plan.rectangles, plan.sun_disc, _RAYS, random),
            strict=True,
        )
    )
    hits, facing, flux = (each[flux > 0] for each in (hits, facing, flux))
    axis = np.argmax(np.abs(facing), axis=1)
    positive = facing[np.arange(len(facing)), axis] > 0
    keys = np.column_stack([np.floor(hits / _CELL).astype(int), 2 * axis + positive])
    _, cell = np.unique(keys, axis=0, return_inverse=True)
    cell = cell.ravel()
    cell_flux = np.asarray(np.bincount(cell, flux), dtype=np.float64)
    brightest = np.argsort(-cell_flux, kind="stable")[:_MAX_CELLS]
    centres, cell_normals = (
        np.stack([np.bincount(cell, flux * each[:, axis]) for axis in range(3)], axis=1)[brightest]
        / cell_flux[brightest, None]
        for each in (hits, facing)
    )
    irradiance, metres = _lit_surface_irradiance(
        scene, points, normals, centres, cell_normals, cell_flux[brightest]
    )
    best = np.argsort(-rms(irradiance * metres), kind="stable")[:_CANDIDATES]
    chosen = brightest[best]
    rows = [
        _fitted_rectangle(hits[cell == one], facing[cell == one], flux[cell == one])
        for one in chosen
    ]
    corner, first, second, normal = np.array(rows).reshape(-1, 4, 3).transpose(1, 0, 2)
    return Rectangles(corner, (first, second), normal), cell_flux[chosen]


def _fitted_rectangle(
    hits: Float64Array, facing: Float64Array, flux: Float64Array
) -> tuple[Float64Array, ...]:
    """Return corner, edges and inward normal of the rectangle with the hits' mean and variance."""
    share = flux / flux.sum()
    normal = share @ facing
    normal = normal / np.linalg.norm(normal)
    sideways = perpendicular(normal)
    upwards = cross(sideways, normal)
    centre = share @ hits
    halves = [
        np.maximum(np.sqrt(3 * share @ ((hits - centre) @ axis) ** 2), _MIN_HALF_SIDE) * axis
        for axis in (sideways, upwards)
    ]
    return centre - halves[0] - halves[1], 2 * halves[0], 2 * halves[1], -normal


def _lit_by_lamps(scene: mi.Scene, random: np.random.Generator) -> LitSurfaces:
    """Trace rays from the lamps; return hit points (R, 3), normals (R, 3) and flux (R,)."""
    lamps = [emitter for emitter in scene.emitters() if not emitter.is_environment()]
    if not lamps:
        return np.zeros((0, 3)), np.zeros((0, 3)), np.zeros(0)
    rays = min(_RAYS, max(16, _MAX_LAMP_RAYS // len(lamps)))
    index = column(mi.UInt32, np.repeat(np.arange(len(lamps)), rays))
    samples = random.random((len(lamps) * rays, 5))
    ray, light = dr.gather(mi.EmitterPtr, mi.EmitterPtr(lamps), index).sample_ray(
        0.0,
        column(mi.Float, samples[:, 0]),
        vector(mi.Point2f, samples[:, 1:3]),
        vector(mi.Point2f, samples[:, 3:]),
    )
    origins, directions = (np.array(each).T.astype(np.float64) for each in (ray.o, ray.d))
    flux = luminance(np.array(light).T.astype(np.float64)) / rays
    finite = np.isfinite(flux) & np.isfinite(origins).all(axis=1) & np.isfinite(directions).all(1)
    origins, directions = (
        np.where(finite[:, None], origins, 0),
        np.where(finite[:, None], directions, 0),
    )
    directions[~finite, 2] = 1
    hits, facing, hit = first_hits(scene, origins + RAY_OFFSET * directions, directions)
    return hits, facing, np.where(finite & hit, flux, 0)


@dataclass(init=False, eq=False)
class PathGuide:
    """Guiding distribution of a view, from a `GuidingPlan`."""

    targets: RectangleSampler
    indirect: mi.Float  # mean irradiance by indirect light, W/m^2

    def __init__(self, plan: GuidingPlan, indirect: float) -> None:
        self.targets = RectangleSampler(plan.targets, plan.strengths, np.zeros(0), MAX_TARGETS)
        self.indirect = dr.opaque(mi.Float, indirect)

    def at(self, si: mi.SurfaceInteraction3f, active: mi.Bool) -> Guidance:
        """Return the guiding distribution at a vertex."""
        facing = dr.mulsign(si.n, mi.Frame3f.cos_theta(si.wi))
        weights = self.targets.weights(si.p, facing, one_sided=True)
        total = sum(weights, mi.Float(0))
        share = dr.select(active & (total > 0), _MAX_GUIDED * total / (total + self.indirect), 0)
        probabilities = [dr.select(total > 0, weight / total, 0) for weight in weights]
        return Guidance(share, probabilities, self.targets, si.p)


@dataclass(eq=False)
class Guidance:
    """Guiding distribution at a vertex: a direction is guided with the probability `share`."""

    share: mi.Float
    probabilities: list[mi.Float]  # of each target; they sum to 1
    targets: RectangleSampler
    position: mi.Point3f

    def split(self, random: mi.Float) -> tuple[mi.Bool, mi.Float]:
        """Decide with a random number whether to guide; also return the number, stretched anew."""
        guided = random < self.share
        return guided, below_one(
            dr.select(guided, random / self.share, (random - self.share) / (1 - self.share))
        )

    def direction(self, first: mi.Float, second: mi.Point2f) -> mi.Vector3f:
        """Sample a direction to a target with a random number and a random point in [0, 1)^2."""
        target, _ = choose(self.probabilities, first)
        return dr.normalize(self.targets.point(target, second) - self.position)

    def density(self, direction: mi.Vector3f, where: mi.Bool | None = None) -> mi.Float:
        """Return the density by solid angle of a direction that is guided.

        If `where` is given, it is 0 elsewhere, and vectors of paths without any skip the work.
        """
        if where is None:
            return self.targets.density(self.position, direction, self.probabilities)
        return dr.if_stmt(  # type: ignore[no-any-return]
            (direction,), where, self.density, lambda _: mi.Float(0), mode="symbolic"
        )

    def mixed(self, pdf: mi.Float, guided: mi.Float) -> mi.Float:
        """Return the mixture's density of a direction, from those by the BSDF and if guided."""
        return (1 - self.share) * pdf + self.share * guided

    def mixed_density(self, pdf: mi.Float, direction: mi.Vector3f) -> mi.Float:
        """Return the mixture's density of a direction with density `pdf` by the BSDF."""
        return self.mixed(pdf, self.density(direction))
