"""Light plan of a view: probabilities for emitter sampling, estimated by a small pilot.

In a home most lamps stand in other rooms, and nearly all of the sky is hidden behind walls. If
every emitter is sampled with the same probability, most samples are occluded. The pilot estimates
the irradiance that every lamp, every portal (window), the sun and the rest of the environment
cause at points in view and at points one bounce further. The plan gives each of them a
probability proportional to the root mean square of its contribution to the pixels, relative to
their brightness, which minimises the variance of a one-sample estimate; a share of 5 % is
distributed uniformly. Where portals and sun provide nearly all of the environment's light, its
own sampling, which costs as much as a ray, is left out.

These probabilities belong to the view. At each path vertex,
`pbrnet.pipeline.pathtrace.light_sampling` combines them with weights of that vertex: each light's
strength times a geometry factor. The strength is chosen such that the product matches the pilot's
irradiance, occlusion included.

The pilot depends on geometry and emitters, not on materials. Therefore plans, like shading,
depend on no colour.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import mitsuba as mi
import numpy as np
import numpy.typing as npt

from pbrnet.pipeline.lenses.model import Lens
from pbrnet.pipeline.pathtrace.irradiance import (
    RAY_OFFSET,
    EmitterExtents,
    Environment,
    SunDisc,
    emitter_irradiance,
    environment_of,
    first_hits,
    portal_irradiance,
    rms,
    sun_irradiance,
    sun_strength,
)
from pbrnet.pipeline.pathtrace.portals import (
    Rectangles,
    geometry_factor,
    portal_rectangles,
    rectangle_densities,
)
from pbrnet.pipeline.views import View
from pbrnet.scenes.arrays import BoolArray, Float64Array, Int64Array
from pbrnet.scenes.contract import Portal
from pbrnet.scenes.geometry.directions import fibonacci_sphere
from pbrnet.scenes.seeds import generator

ASSUMED_ALBEDO = 0.5  # of all surfaces, for light that bounces once
OUTDOOR_MARGIN = 0.05  # metres beyond the box around the rooms
EVERYWHERE: Float64Array = np.array([[-np.inf] * 3, [np.inf] * 3])  # an unbounded box

MAX_PORTALS = 12  # portals sampled in one view: the brightest
_GRID = (24, 18)  # camera rays of the pilot
_SPHERE = 3456  # for a panorama, where sunlit ground outdoors is a small part of what is seen
_SAMPLES = 4  # of each light at each point
_UNIFORM = 0.05  # share of the probability that is distributed uniformly
_NEGLIGIBLE = 0.02  # share of all light below which the environment's own sampling is left out
_DARK = 0.01  # of the mean brightness: regularises the relative contribution at dark points
_MAX_CONTRIBUTION = 10.0  # of one point, relative to the pixels' brightness


@dataclass(frozen=True)
class PilotPoints:
    """Surface points (P, 3), normals facing the ray (P, 3), and hit flags (P,).

    The first half are seen by the camera, the second half are one bounce further. P is the same
    for every view, because kernels are compiled for the number of rays.
    """

    points: Float64Array
    normals: Float64Array
    hit: BoolArray


@dataclass(frozen=True)
class LightStrengths:
    """Strengths that, times a geometry factor, approximate irradiance at a surface.

    `emitters` (2, N): indoors, and outside the box around the rooms; `portals` (K,); `sun`.
    """

    emitters: Float64Array
    portals: Float64Array
    sun: float


@dataclass(frozen=True)
class LightPlan:
    """Probabilities for emitter sampling in one view; `emitters`, `portals` and `sun` sum to 1.

    `emitters` (N,): the environment's entry is the probability of its own sampling and may be 0.
    `portals` (K,): of directions through each of `rectangles`. `sun`: of directions to `sun_disc`.
    If `strengths` and `extents` are given, each vertex computes weights of its own from them.
    `indoors` is the box (2, 3) around the rooms; inside it, the sun is expected through portals
    only. `indirect` estimates the irradiance by light that has bounced once, in W/m^2, at surfaces
    in view. `pilot` holds the points of the estimate.
    """

    emitters: Float64Array
    portals: Float64Array
    rectangles: Rectangles
    sun: float = 0.0
    sun_disc: SunDisc | None = None
    indoors: Float64Array = field(default_factory=lambda: EVERYWHERE)
    extents: EmitterExtents | None = None
    strengths: LightStrengths | None = None
    indirect: float = 0.0
    pilot: PilotPoints | None = None


def plan_lights(
    scene: mi.Scene,
    view: View,
    portals: tuple[Portal, ...],
    seed: int,
    indoors: npt.ArrayLike = EVERYWHERE,
    lens: Lens | None = None,
) -> LightPlan:
    """Return the light plan of a view; `scene` is the Mitsuba scene.

    `indoors` (2, 3) is the box around the rooms: inside it, the sun is hardly sampled where its
    rays do not pass a portal. With `lens` the plan is for what that one sees from the pose of the
    view, instead of the view's own.
    """
    pilot = _trace_pilot(scene, *_grid_rays(view, lens or view.lens), seed)
    hit, seen = pilot.hit, len(pilot.hit) // 2
    environment = environment_of(scene)
    rectangles = portal_rectangles(portals if environment is not None else ())
    irradiance, extents = _irradiance(scene, pilot, rectangles, environment, seed)
    contributions = _contributions(irradiance[hit], int(hit[:seen].sum()))
    if not contributions.any():
        equal = np.full(len(scene.emitters()), 1 / len(scene.emitters()))
        return LightPlan(equal, np.zeros(0), rectangles.take(np.arange(0)))
    plan, kept = _probabilities(contributions, rectangles, environment)
    plan = replace(plan, indoors=np.asarray(indoors, dtype=np.float64))
    strengths = _strengths(
        irradiance[hit], pilot.points[hit], pilot.normals[hit], extents, plan, kept
    )
    if not strengths.sun:  # the pilot has too few points to meet every sunlit patch
        found = sun_strength(scene, plan.rectangles, plan.sun_disc, generator(seed, "sun"))
        strengths = replace(strengths, sun=found)
    indirect = ASSUMED_ALBEDO * float(irradiance[seen:][hit[seen:]].sum())
    indirect = indirect / max(1, int(hit[:seen].sum()))
    return replace(plan, extents=extents, strengths=strengths, indirect=indirect, pilot=pilot)


def is_outdoors(points: Float64Array, indoors: Float64Array) -> BoolArray:
    """Test which points (P, 3) lie outside the box (2, 3) around the rooms."""
    low, high = indoors
    return np.asarray(
        ((points < low - OUTDOOR_MARGIN) | (points > high + OUTDOOR_MARGIN)).any(axis=1)
    )


def _grid_rays(view: View, lens: Lens) -> tuple[Float64Array, Float64Array]:
    """Return world origins and directions (P, 3) of a grid of camera rays of a lens."""
    if lens.is_panorama:
        directions = fibonacci_sphere(_SPHERE)
        return np.tile(view.eye, (len(directions), 1)), directions
    width, height = _GRID
    columns, rows = np.meshgrid(np.arange(width) + 0.5, np.arange(height) + 0.5)
    pixels = np.stack([columns * lens.width / width, rows * lens.height / height], axis=-1)
    pixels = pixels.reshape(-1, 2)
    turn = view.pose[:3, :3].T
    if not lens.is_pinhole:
        rays = lens.rays(pixels)
        return view.eye + rays.origins[rays.valid] @ turn, rays.directions[rays.valid] @ turn
    local = np.concatenate([pixels, np.ones((width * height, 1))], axis=1)
    directions = local @ np.linalg.inv(np.array(lens.K)).T @ turn
    directions = directions / np.linalg.norm(directions, axis=1, keepdims=True)
    return np.tile(view.eye, (len(directions), 1)), directions


def _trace_pilot(
    scene: mi.Scene, origins: Float64Array, directions: Float64Array, seed: int
) -> PilotPoints:
    """Trace camera rays (P, 3) and one cosine-distributed bounce from each hit."""
    random = generator(seed, "pilot")
    points, normals, hit = first_hits(scene, origins, directions)
    # A point of the unit sphere on top of the normal: cosine-distributed.
    bounce = random.normal(size=points.shape)
    bounce = bounce / np.linalg.norm(bounce, axis=1, keepdims=True) + normals
    lengths = np.linalg.norm(bounce, axis=1, keepdims=True)
    bounce = np.where(lengths > 1e-3, bounce / np.maximum(lengths, 1e-3), normals)
    next_points, next_normals, next_hit = first_hits(scene, points + RAY_OFFSET * normals, bounce)
    return PilotPoints(
        np.concatenate([points, next_points]),
        np.concatenate([normals, next_normals]),
        np.concatenate([hit, hit & next_hit]),
    )


def _irradiance(
    scene: mi.Scene,
    pilot: PilotPoints,
    rectangles: Rectangles,
    environment: Environment | None,
    seed: int,
) -> tuple[Float64Array, EmitterExtents]:
    """Estimate irradiance at each pilot point, (P, N + K + 1): emitters, portals, sun.

    A smooth environment is divided among the sun (its disc), the portals (directions through
    them) and its own sampling (the rest); any other by the balance heuristic.
    """
    random = generator(seed, "asked")
    points = np.repeat(pilot.points + RAY_OFFSET * pilot.normals, _SAMPLES, axis=0)
    normals = np.repeat(pilot.normals, _SAMPLES, axis=0)
    by_emitter, extents = emitter_irradiance(
        scene, points, normals, rectangles, environment, random
    )
    parts = [
        by_emitter,
        portal_irradiance(scene, points, normals, rectangles, environment, random),
        sun_irradiance(
            scene, points, normals, environment.sun if environment is not None else None, random
        ),
    ]
    shape = (-1, len(pilot.points), _SAMPLES)
    return np.concatenate([part.reshape(shape).mean(axis=-1) for part in parts]).T, extents


def _contributions(irradiance: Float64Array, seen: int) -> Float64Array:
    """Return the rms contribution of each light, (N + K + 1,), relative to the pixels' brightness.

    The first `seen` points are in the image: there the light's share of the irradiance counts.
    The others are one bounce away. The light that they reflect adds to pixels of any brightness,
    so a small patch in the sun, which lights the whole room, has a large contribution.
    """
    total = irradiance.sum(axis=1)
    if not total.any():
        return np.zeros(irradiance.shape[1])
    reflected = ASSUMED_ALBEDO * total[seen:].mean() if len(total) > seen else 0.0
    brightness = total[:seen].mean() + reflected
    near = irradiance[:seen] / (total[:seen] + reflected + _DARK * brightness)[:, None]
    far = np.minimum(ASSUMED_ALBEDO * irradiance[seen:] / brightness, _MAX_CONTRIBUTION)
    return np.asarray(np.sqrt((near**2).mean(axis=0) + (far**2).sum(axis=0) / max(1, len(far))))


def _probabilities(
    contributions: Float64Array, rectangles: Rectangles, environment: Environment | None
) -> tuple[LightPlan, Int64Array]:
    """Turn contributions (N + K + 1,) into a plan; also return the indices of the portals kept."""
    count = len(contributions) - len(rectangles.area) - 1
    emitters, portals, sun = contributions[:count], contributions[count:-1], contributions[-1]
    best = np.argsort(-portals, kind="stable")[:MAX_PORTALS]
    kept = np.concatenate([np.ones(count), np.ones(len(best)), [0.0]])
    if environment is not None and environment.sun is not None:
        kept[-1] = 1  # even if the pilot missed it: BSDF sampling hardly ever finds the sun
    if (
        environment is not None
        and environment.smooth
        and (len(best) or environment.sun is not None)
    ):
        rest = emitters[environment.row] + portals.sum() - portals[best].sum()
        kept[environment.row] = rest > _NEGLIGIBLE * contributions.sum()
    chosen = kept * np.concatenate([emitters, portals[best], [float(sun)]])
    uniform = kept / kept.sum()
    chosen = chosen / chosen.sum() if chosen.sum() > 0 else uniform
    chosen = (1 - _UNIFORM) * chosen + _UNIFORM * uniform
    plan = LightPlan(
        chosen[:count],
        chosen[count:-1],
        rectangles.take(best),
        float(chosen[-1]),
        environment.sun if environment is not None else None,
    )
    return plan, best


def _strengths(
    irradiance: Float64Array,
    points: Float64Array,
    normals: Float64Array,
    extents: EmitterExtents,
    plan: LightPlan,
    kept: Int64Array,
) -> LightStrengths:
    """Return the ratios of rms irradiance to rms geometry factor over the pilot's points.

    That of the sun is 0 if the pilot met it nowhere, or only where it is not expected.
    """
    count = len(extents.spread)

    def factors(centre: Float64Array, spread: Float64Array) -> tuple[Float64Array, Float64Array]:
        directions = centre[None] - points[:, None]
        squared = (directions**2).sum(axis=-1)
        directions /= np.sqrt(squared + 1e-12)[..., None]
        cosine = np.abs((directions * normals[:, None]).sum(axis=-1))
        return np.asarray(geometry_factor(cosine, squared, spread)), directions

    of_emitters, _ = factors(extents.centre, extents.spread)
    of_portals, directions = factors(plan.rectangles.centre, plan.rectangles.spread)
    of_portals = of_portals * np.maximum((directions * plan.rectangles.normal).sum(axis=-1), 0)
    sun = np.zeros(3) if plan.sun_disc is None else plan.sun_disc.direction
    of_sun = geometry_factor(np.abs(normals @ sun), 0.0, 1.0) * _may_see_sun(sun, points, plan)
    met = (of_sun > 0) & (irradiance[:, -1] > 0)
    outdoors = is_outdoors(points, plan.indoors)
    sides = [side if side.any() else np.ones_like(side) for side in (~outdoors, outdoors)]
    return LightStrengths(
        np.array([rms(irradiance[side, :count]) / rms(of_emitters[side]) for side in sides]),
        rms(irradiance[:, count:-1][:, kept]) / np.maximum(rms(of_portals), 1e-30),
        float(rms(irradiance[:, -1]) / rms(of_sun)) if met.any() else 0.0,
    )


def _may_see_sun(sun: Float64Array, points: Float64Array, plan: LightPlan) -> BoolArray:
    """Test which points (P, 3) may be sunlit: through a portal, or from the open sky."""
    outdoors = is_outdoors(points, plan.indoors)
    directions = np.broadcast_to(sun, points.shape)
    through = rectangle_densities(plan.rectangles, points, directions) > 0
    return np.asarray(outdoors | through.any(axis=1))
