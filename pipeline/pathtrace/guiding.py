"""Where bounced light comes from: a plan of where the paths of a view had better go.

Light sampling finds what emitters bring. What they light up it does not find: sunlit ground
behind a window, a patch of sun on the floor, the wall beside a lamp. Paths meet such a `glow` by
chance only, seldom if it is small, and then bring much: by day that is most of the noise. Glows are
looked for from the lights' side, by rays from lamps and from the sun through the windows, and
through each window from indoors; then it is asked which of them the pilot's points see.

As in the light plan, no material is looked at, so that shading depends on no colour.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np

from pipeline.pathtrace.light_pilot import (
    ALBEDO,
    LIFT,
    LightPlan,
    Panes,
    first_hits,
    from_sun,
    in_disc,
    perpendicular,
    reach,
    rms,
    seen,
    towards_panes,
)
from pipeline.render.raycast import column, vector
from scenes.arrays import Float64Array
from scenes.color import luminance
from scenes.seeds import generator

GLOWS = 12  # at most so many in a view
_RAYS = 512  # from each lamp, and from the sun through each window,
_IN_ALL = 1 << 16  # but from all lamps together no more than about this
_CELL = 0.4  # metres: what is lit is gathered into cells of this size
_LOOKED_AT = 512  # of the cells, the brightest: a few points are asked whether they see them,
_FEW = 9  # every so many of the points,
_CANDIDATES = 48  # and all points about the most promising
_SMALLEST = 0.05  # metres, half the side of the smallest glow
_NEAR = 0.05  # metres before a glow that count as having reached it


@dataclass(frozen=True)
class BouncePlan:
    """Glows as rectangles whose normals point the way that paths go: through panes outwards, into
    what is lit. Times `reach` and the cosine there, a strength (G,) is about what the glow brings
    to a place."""

    glows: Panes
    strengths: Float64Array


def plan_bounces(scene: Any, plan: LightPlan, seed: int) -> BouncePlan | None:
    """The glows of a view, whose light plan is given; None where there are none."""
    if plan.pilot is None:
        return None
    points, normals, hit = plan.pilot.points[::2], plan.pilot.normals[::2], plan.pilot.hit[::2]
    if not hit.any():
        return None
    points = points + LIFT * normals
    random = generator(seed, "bounces")
    few = slice(None, None, _FEW)
    lit, flux = _lit_cells(scene, plan, points[few], normals[few], random)
    glows = _joined(plan.panes, lit)
    brought = np.concatenate(
        [
            _from_outdoors(scene, points, normals, plan, random),
            _from_spots(scene, points, normals, lit.centre, -lit.normal, flux)[0],
        ],
        axis=1,
    )
    brought, (reached, metres) = brought[hit], _reached(points[hit], normals[hit], glows)
    # A material finds a glow the more rarely, the smaller it is for the place that it lights.
    score = rms(brought * metres) / np.sqrt(glows.area)
    best = np.argsort(-score, kind="stable")[:GLOWS]
    best = best[score[best] > 0]
    if not len(best):
        return None
    return BouncePlan(glows.take(best), rms(brought[:, best]) / rms(reached[:, best]))


def _reached(
    points: Float64Array, normals: Float64Array, glows: Panes
) -> tuple[Float64Array, Float64Array]:
    """`reach` times the cosine at the glow, (P, G), and the distances, (P, G)."""
    towards = glows.centre[None] - points[:, None]
    squared = (towards**2).sum(axis=-1)
    metres = np.sqrt(squared)
    towards = towards / np.maximum(metres, 1e-6)[..., None]
    cosine = np.maximum((towards * normals[:, None]).sum(axis=-1), 0)
    slope = np.maximum((towards * glows.normal).sum(axis=-1), 0)
    return np.asarray(slope * reach(cosine, squared, glows.spread)), metres


def _joined(one: Panes, other: Panes) -> Panes:
    first, second = (np.concatenate([a, b]) for a, b in zip(one.edges, other.edges, strict=True))
    return Panes(
        np.concatenate([one.corner, other.corner]),
        (first, second),
        np.concatenate([one.normal, other.normal]),
    )


def _from_outdoors(
    scene: Any,
    points: Float64Array,
    normals: Float64Array,
    plan: LightPlan,
    random: np.random.Generator,
) -> Float64Array:
    """One estimate of what surfaces beyond each pane, lit by sun and sky, send to each point,
    (P, K)."""
    panes, count = plan.panes, len(plan.panes.area)
    if not count or scene.environment() is None:
        return np.zeros((len(points), count))
    towards, worth = towards_panes(points, normals, panes, random)
    spots, facing, hit = first_hits(scene, np.tile(points, (count, 1)), towards.reshape(-1, 3))
    away = spots.reshape(towards.shape) - panes.corner[:, None]
    beyond = (away * panes.normal[:, None]).sum(axis=-1) > 0  # what is nearer stands indoors
    spots = spots + LIFT * facing
    upwards = random.normal(size=facing.shape)
    upwards = upwards / np.linalg.norm(upwards, axis=1, keepdims=True) + facing
    upwards = upwards / np.maximum(np.linalg.norm(upwards, axis=1, keepdims=True), 1e-3)
    light = np.pi * seen(scene, spots, upwards) * ~in_disc(plan.sun, upwards)
    light = light + from_sun(scene, spots, facing, plan.sun, random)[0]
    sent = ALBEDO / np.pi * np.nan_to_num(light) * hit
    return np.asarray((sent.reshape(count, -1) * beyond * worth).T)


def _from_spots(
    scene: Any,
    points: Float64Array,
    normals: Float64Array,
    spots: Float64Array,
    facing: Float64Array,
    flux: Float64Array,
) -> tuple[Float64Array, Float64Array]:
    """What the light that falls on each spot brings to each point, (P, C), and from how far."""
    count = len(flux)
    if not count:
        return np.zeros((len(points), 0)), np.zeros((len(points), 0))
    towards = (spots + LIFT * facing)[None] - points[:, None]
    metres = np.linalg.norm(towards, axis=-1)
    towards = towards / np.maximum(metres, 1e-6)[..., None]
    ray = mi.Ray3f(
        vector(mi.Point3f, np.repeat(points, count, axis=0)),
        vector(mi.Vector3f, towards.reshape(-1, 3)),
    )
    ray.maxt = column(mi.Float, np.maximum(metres.ravel() - _NEAR, 0))
    free = ~np.array(scene.ray_test(ray)).reshape(metres.shape)
    cosine = np.maximum((towards * normals[:, None]).sum(axis=-1), 0)
    slope = np.maximum(-(towards * facing).sum(axis=-1), 0)
    return free * ALBEDO / np.pi * flux * cosine * slope / (metres**2 + _CELL**2), metres


def _lit_cells(
    scene: Any,
    plan: LightPlan,
    points: Float64Array,
    normals: Float64Array,
    random: np.random.Generator,
) -> tuple[Panes, Float64Array]:
    """Patches that lamps and the sun light indoors, those that bring some of the points (P, 3) the
    most; and the light that falls on each, (C,)."""
    spots, facing, light = (
        np.concatenate(parts)
        for parts in zip(
            _lit_by_lamps(scene, random), _lit_by_sun(scene, plan, random), strict=True
        )
    )
    spots, facing, light = (each[light > 0] for each in (spots, facing, light))
    side = np.argmax(np.abs(facing), axis=1)
    ahead = facing[np.arange(len(facing)), side] > 0
    keys = np.column_stack([np.floor(spots / _CELL).astype(int), 2 * side + ahead])
    _, cell = np.unique(keys, axis=0, return_inverse=True)
    cell = cell.ravel()
    flux = np.asarray(np.bincount(cell, light), dtype=np.float64)
    brightest = np.argsort(-flux, kind="stable")[:_LOOKED_AT]
    middles, ahead_of = (
        np.stack([np.bincount(cell, light * each[:, axis]) for axis in range(3)], axis=1)[brightest]
        / flux[brightest, None]
        for each in (spots, facing)
    )
    brought, metres = _from_spots(scene, points, normals, middles, ahead_of, flux[brightest])
    most = np.argsort(-rms(brought * metres), kind="stable")[:_CANDIDATES]
    chosen = brightest[most]
    rows = [
        _rectangle(spots[cell == one], facing[cell == one], light[cell == one]) for one in chosen
    ]
    corner, first, second, normal = np.array(rows).reshape(-1, 4, 3).transpose(1, 0, 2)
    return Panes(corner, (first, second), normal), flux[chosen]


def _rectangle(
    spots: Float64Array, facing: Float64Array, light: Float64Array
) -> tuple[Float64Array, ...]:
    """Corner, edges and the normal, inwards, of the rectangle that is lit as wide as the spots."""
    share = light / light.sum()
    normal = share @ facing
    normal = normal / np.linalg.norm(normal)
    aside = perpendicular(normal)
    upwards = np.cross(aside, normal)
    centre = share @ spots
    halves = [
        np.maximum(np.sqrt(3 * share @ ((spots - centre) @ axis) ** 2), _SMALLEST) * axis
        for axis in (aside, upwards)
    ]
    return centre - halves[0] - halves[1], 2 * halves[0], 2 * halves[1], -normal


def _lit_by_lamps(
    scene: Any, random: np.random.Generator
) -> tuple[Float64Array, Float64Array, Float64Array]:
    """Where rays from the lamps fall: places and normals (R, 3), and light (R,)."""
    lamps = [emitter for emitter in scene.emitters() if not emitter.is_environment()]
    if not lamps:
        return np.zeros((0, 3)), np.zeros((0, 3)), np.zeros(0)
    each = min(_RAYS, max(16, _IN_ALL // len(lamps)))
    which = column(mi.UInt32, np.repeat(np.arange(len(lamps)), each))
    numbers = random.random((len(lamps) * each, 5))
    ray, light = dr.gather(mi.EmitterPtr, mi.EmitterPtr(lamps), which).sample_ray(
        0.0,
        column(mi.Float, numbers[:, 0]),
        vector(mi.Point2f, numbers[:, 1:3]),
        vector(mi.Point2f, numbers[:, 3:]),
    )
    origins, directions = (np.array(each).T.astype(np.float64) for each in (ray.o, ray.d))
    power = luminance(np.array(light).T.astype(np.float64)) / each
    fine = np.isfinite(power) & np.isfinite(origins).all(axis=1) & np.isfinite(directions).all(1)
    origins, directions = (
        np.where(fine[:, None], origins, 0),
        np.where(fine[:, None], directions, 0),
    )
    directions[~fine, 2] = 1
    spots, facing, hit = first_hits(scene, origins + LIFT * directions, directions)
    return spots, facing, np.where(fine & hit, power, 0)


def _lit_by_sun(
    scene: Any, plan: LightPlan, random: np.random.Generator
) -> tuple[Float64Array, Float64Array, Float64Array]:
    """The same of the sun's rays through the panes."""
    panes, count = plan.panes, len(plan.panes.area)
    if plan.sun is None or not count:
        return np.zeros((0, 3)), np.zeros((0, 3)), np.zeros(0)
    numbers = random.random((count, _RAYS, 2, 1))
    first, second = (edge[:, None] for edge in panes.edges)
    spots = panes.corner[:, None] + numbers[:, :, 0] * first + numbers[:, :, 1] * second
    spots = spots.reshape(-1, 3)
    inwards = np.tile(-plan.sun.towards, (len(spots), 1))
    spots, facing, hit = first_hits(scene, spots, inwards)
    radiance = seen(scene, spots + LIFT * facing, -inwards)
    through = np.maximum(panes.normal @ plan.sun.towards, 0) * panes.area / _RAYS
    light = np.nan_to_num(radiance) / plan.sun.density * np.repeat(through, _RAYS)
    return spots, facing, np.where(hit, light, 0)
