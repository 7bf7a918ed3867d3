"""Illumination panorama of a view: the light sources visible from the camera position.

Sources are lamps, and openings to the outdoors: through these comes the light of sky and sun, and
what lit surfaces outdoors reflect (`pbrnet.pipeline.passes.outdoors.radiance`).

Energy is conserved: a pixel's `intensity` is the luminance of the sources visible there, averaged
over the pixel's solid angle, so that the sum of intensity x solid angle over the panorama is the
illuminance by the visible sources. `tint` is the colour of that light, which the paper's panorama
does not have. There are two estimators:

* Sources at least about a pixel wide, and openings: rays on a fixed stratified grid in each pixel.
* Narrower sources (bulbs, tubes, the sun's disc, point and spot lights), which a grid would miss or
  hit by chance: points sampled on the source. Each represents a solid angle; if it is visible, it
  is added to the pixel that it falls in. A grid ray that hits such a source adds no emission.

All samples are fixed: equal input gives equal bits. Not included: light that surfaces indoors
reflect, also those of other rooms seen through open doors; light through frosted glass; what clear
glass reflects or absorbs.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from pbrnet.pipeline.channels import TINT
from pbrnet.pipeline.frames import Channels
from pbrnet.pipeline.passes.outdoors.radiance import outdoor_radiance
from pbrnet.pipeline.passes.settings import IlluminationParams
from pbrnet.pipeline.render import raycast
from pbrnet.pipeline.render.lights import Lights
from pbrnet.pipeline.render.scene import RenderScene
from pbrnet.pipeline.views import View
from pbrnet.scenes.arrays import BoolArray, Float64Array, Int64Array
from pbrnet.scenes.color import luminance
from pbrnet.scenes.contract import Portal
from pbrnet.scenes.geometry.directions import turned, unit

_NARROW = 1.5  # pixels: sources of less mean width are narrow
_MAX_MULTIPLE = 64  # of `light_samples`: most points on one long, thin source
_PROBE_WIDTH = 128  # columns of the coarse panorama that searches for openings
_BEHIND = 0.02  # metres beyond a portal from which surfaces are outdoors: no frame or closed leaf
_SHADED = 4096  # rays of a panorama for which the light of surfaces outdoors is computed, about
_GOLDEN = (0.7548776662466927, 0.5698402909980532)  # R2 sequence: 1/g, 1/g^2, g^3 = g + 1


def render_illumination(
    render_scene: RenderScene, view: View, params: IlluminationParams
) -> Channels:
    """Return the channels of an `illumination` frame, float32 (width / 2, width).

    `intensity.Y`: Rec. 709 luminance, `distance.Z`: its intensity-weighted mean distance in
    metres; `tint.R/G/B`: linear RGB of luminance 1, so that intensity x tint is the mean radiance.
    All are 0 where no light is visible. Equirectangular in the camera's own tilted frame: the
    centre column is straight ahead, right of it is the camera's right, the top row is its up.
    The distance of light from outdoors is that of the outermost portal that the ray passes. If it
    passes none, the sky's is that of the scene's bounding box.
    """
    panorama = Panorama(params.width, view.pose[:3, :3])
    narrow, multiples = _narrow_lamps(render_scene.lights, view.eye, panorama)
    sums = PanoramaSums(panorama.size)
    _add_narrow(render_scene, view.eye, panorama, params, narrow, multiples, sums)
    _add_wide(render_scene, view.eye, panorama, params, narrow, sums)
    solid = np.repeat(panorama.solid_angles, panorama.width)
    energy = luminance(sums.energy)
    divisor = np.where(energy > 0, energy, 1)
    bands = {
        "intensity.Y": energy / solid,
        "distance.Z": sums.weighted_distance / divisor,
        **{name: sums.energy[:, i] / divisor for i, name in enumerate(TINT)},
    }
    shape = (panorama.height, panorama.width)
    return {name: band.astype(np.float32).reshape(shape) for name, band in bands.items()}


class PanoramaSums:
    """Sums over the samples in each of `size` pixels.

    `energy` (size, 3) is linear RGB radiance times steradians, `weighted_distance` (size,) its
    luminance times metres.
    """

    def __init__(self, size: int) -> None:
        self.energy = np.zeros((size, 3))
        self.weighted_distance = np.zeros(size)

    def add(self, pixels: Int64Array, light: Float64Array, metres: Float64Array) -> None:
        """Add light (N, 3), in the unit of `energy`, at distances (N,) to pixels (N,)."""
        size = len(self.weighted_distance)
        for band in range(3):
            self.energy[:, band] += np.bincount(pixels, light[:, band], size)
        self.weighted_distance += np.bincount(pixels, luminance(light) * metres, size)


@dataclass(frozen=True)
class Panorama:
    """Equirectangular pixels around a camera.

    The columns of `rotation` (3, 3) are the camera's axes in the world.
    """

    width: int
    rotation: Float64Array

    @property
    def height(self) -> int:
        return self.width // 2

    @property
    def size(self) -> int:
        return self.width * self.height

    @property
    def pitch(self) -> float:
        """Angle between pixels, radians."""
        return 2 * math.pi / self.width

    @property
    def solid_angles(self) -> Float64Array:
        """Steradians of a pixel in each row, (H,)."""
        return self.pitch * -np.diff(np.sin(self._elevations(self.height)))

    @cached_property
    def centres(self) -> Float64Array:
        """World directions (H x W, 3) through the centres of all pixels."""
        return self.directions(np.arange(self.size), 1)[:, 0]

    def directions(self, pixels: Int64Array, per_axis: int) -> Float64Array:
        """Return world directions (len(pixels), per_axis^2, 3) to the centres of parts of pixels.

        The parts have equal solid angles, hence equal weights; they are in row-major order.
        """
        inner = (np.arange(per_axis) + 0.5) / per_axis
        inner = np.broadcast_to(inner, (len(pixels), per_axis))
        return self._directions(pixels, inner, inner)

    def subdivided(
        self, pixels: Int64Array, part: Int64Array, per_axis: int, steps: int
    ) -> Float64Array:
        """Return world directions (N, steps^2, 3) within part `part[i]` of pixel i."""
        row, column = np.divmod(part[:, None], per_axis)
        inner = (np.arange(steps) + 0.5) / steps
        return self._directions(pixels, (row + inner) / per_axis, (column + inner) / per_axis)

    def _directions(
        self, pixels: Int64Array, down: Float64Array, across: Float64Array
    ) -> Float64Array:
        """Return directions (N, A B, 3) for all pairs of `down` (N, A) and `across` (N, B).

        Both are fractions of the pixel, in [0, 1].
        """
        row, column = np.divmod(pixels, self.width)
        sines = np.sin(self._elevations(self.height))
        sine = sines[row, None] + (sines[row + 1] - sines[row])[:, None] * down
        azimuth = (column[:, None] + across) * self.pitch - math.pi
        flat = np.sqrt(np.maximum(1 - sine**2, 0))[:, :, None]
        local = np.empty((len(pixels), down.shape[1], across.shape[1], 3))
        local[..., 0] = flat * np.sin(azimuth)[:, None, :]
        local[..., 1] = -sine[:, :, None]
        local[..., 2] = flat * np.cos(azimuth)[:, None, :]
        return turned(local.reshape(len(pixels), -1, 3), self.rotation)

    def pixels(self, directions: Float64Array) -> Int64Array:
        """Return the pixel of each world direction (N, 3), of length 1."""
        x, y, z = turned(directions, self.rotation.T).T
        column = np.floor((np.arctan2(x, z) / (2 * math.pi) + 0.5) * self.width).astype(np.int64)
        row = np.floor((0.5 + np.arcsin(np.clip(y, -1, 1)) / math.pi) * self.height)
        row = np.clip(row, 0, self.height - 1).astype(np.int64)
        return row * self.width + column % self.width

    def cone(self, centre: Float64Array, angle: float) -> BoolArray:
        """Return a mask (H x W,) of the pixels that a cone around `centre` (world) may touch."""
        if angle >= math.pi:
            return np.ones(self.size, dtype=bool)
        axis = unit(centre)
        touched: BoolArray = self.centres @ axis >= math.cos(min(angle + self.pitch, math.pi))
        return touched

    @staticmethod
    def _elevations(height: int) -> Float64Array:
        rows = np.arange(height + 1, dtype=np.float64)
        return math.pi / 2 - rows * (math.pi / height)


def outside_distance(
    eye: Float64Array, directions: Float64Array, portals: tuple[Portal, ...], bbox: Float64Array
) -> Float64Array:
    """Return metres along each ray (N, 3) to the outermost portal that it passes, else to `bbox`.

    `bbox` (2, 3) is the scene's bounding box.
    """
    with np.errstate(divide="ignore", invalid="ignore"):
        exits = np.where(directions > 0, bbox[1] - eye, bbox[0] - eye) / directions
    far = np.nanmin(np.where(directions == 0, np.inf, exits), axis=1)
    through = np.zeros(len(directions))
    for portal in portals:
        through = np.maximum(through, _portal_distance(eye, directions, portal, np.inf))
    return np.where(through > 0, through, np.maximum(far, 0))


def _entered(
    eye: Float64Array, directions: Float64Array, metres: Float64Array, portals: tuple[Portal, ...]
) -> Float64Array:
    """Return the distances (N,) of places outdoors cut at the outermost portal before."""
    through = np.zeros(len(metres))
    for portal in portals:
        through = np.maximum(through, _portal_distance(eye, directions, portal, metres))
    return np.where(through > 0, through, metres)


def _portal_distance(
    eye: Float64Array, directions: Float64Array, portal: Portal, limit: Float64Array | float
) -> Float64Array:
    """Return metres along each ray to a portal that it leaves by before `limit`, else 0."""
    polygon, normal = np.array(portal.polygon), np.array(portal.normal)
    slope = directions @ normal
    leaves = slope > 1e-9
    metres = np.where(leaves, (polygon[0] - eye) @ normal / np.where(leaves, slope, 1), 0)
    inside = (metres > 0) & leaves & (metres < limit)
    rows = np.flatnonzero(inside)
    points = eye + metres[rows, None] * directions[rows]
    inside[rows] = _in_polygon(points, polygon, normal)
    return np.where(inside, metres, 0)


def _in_polygon(points: Float64Array, polygon: Float64Array, normal: Float64Array) -> BoolArray:
    """Test whether points (N, 3) of a polygon's plane lie in it, by counting crossings."""
    keep = [axis for axis in range(3) if axis != int(np.argmax(np.abs(normal)))]
    flat, corners = points[:, keep], polygon[:, keep]
    inside = np.zeros(len(points), dtype=bool)
    for (x0, y0), (x1, y1) in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        if y0 == y1:
            continue
        spans = (y0 > flat[:, 1]) != (y1 > flat[:, 1])
        inside ^= spans & (flat[:, 0] < x0 + (flat[:, 1] - y0) * (x1 - x0) / (y1 - y0))
    return inside


def _sequence(count: int) -> Float64Array:
    """Return the first `count` points of the R2 sequence in [0, 1)^2 (Roberts 2018)."""
    return (0.5 + np.arange(1, count + 1)[:, None] * np.array(_GOLDEN)) % 1


def _narrow_lamps(
    lights: Lights, eye: Float64Array, panorama: Panorama
) -> tuple[BoolArray, Int64Array]:
    """Return which lamps are narrow, and the multiples of `light_samples` that they need."""
    count, tries = len(lights.lamps), 64
    if not count:
        return np.zeros(0, dtype=bool), np.zeros(0, dtype=np.int64)
    indices = np.repeat(np.arange(count), tries)
    _, _, light, density = raycast.sample_emitters(
        lights.lamps, indices, eye, np.tile(_sequence(tries), (count, 1))
    )
    facing = (luminance(light) > 0) & (density > 0)
    parts = np.where(facing, 1 / np.where(facing, density, 1), 0)
    solid = parts.reshape(count, tries).mean(axis=1)
    away = np.linalg.norm(lights.centre - eye, axis=1)
    across = 2 * np.arcsin(np.minimum(lights.radius / np.maximum(away, 1e-9), 1))
    width = solid / np.maximum(across, 1e-9)
    narrow = (lights.shape < 0) | (width < _NARROW * panorama.pitch)
    multiples = np.ceil(solid / panorama.pitch**2).astype(np.int64)
    multiples = np.where((lights.shape < 0) | (solid > 0), np.clip(multiples, 1, _MAX_MULTIPLE), 0)
    return narrow, multiples


def _add_narrow(
    render_scene: RenderScene,
    eye: Float64Array,
    panorama: Panorama,
    params: IlluminationParams,
    narrow: BoolArray,
    multiples: Int64Array,
    sums: PanoramaSums,
) -> None:
    """Add narrow lamps by points sampled on them."""
    lights = render_scene.lights
    counts = np.where(narrow, multiples * params.light_samples, 0)
    indices = np.repeat(np.arange(len(counts)), counts)
    if not len(indices):
        return
    samples = np.concatenate([_sequence(count) for count in counts])
    directions, distance, light, _ = raycast.sample_emitters(lights.lamps, indices, eye, samples)
    part = light / counts[indices, None]
    lit = luminance(part) > 0
    indices, directions, distance, part = indices[lit], directions[lit], distance[lit], part[lit]
    distant = lights.distant[indices]
    limit = np.where(distant, 1e9, distance)
    free = raycast.unoccluded(render_scene.geometry, eye, directions, limit)
    metres = distance.astype(np.float64)
    portals = render_scene.scene.portals
    metres[distant] = outside_distance(eye, directions[distant], portals, render_scene.bbox)
    metres = np.where(distant, metres, _entered(eye, directions, metres, portals))
    sums.add(panorama.pixels(directions[free]), part[free], metres[free])


def _add_wide(
    render_scene: RenderScene,
    eye: Float64Array,
    panorama: Panorama,
    params: IlluminationParams,
    narrow: BoolArray,
    sums: PanoramaSums,
) -> None:
    """Add wide lamps and what openings show, by rays on a grid in each pixel that may show them."""
    geometry, lights = render_scene.geometry, render_scene.lights
    emitting = np.zeros(len(geometry.shapes), dtype=bool)
    emitting[lights.shape[~narrow]] = True
    traced = np.zeros(panorama.size, dtype=bool)
    for lamp in np.flatnonzero(~narrow):
        offset = lights.centre[lamp] - eye
        away = float(np.linalg.norm(offset))
        inside = away <= lights.radius[lamp]
        angle = math.pi if inside else math.asin(lights.radius[lamp] / away)
        traced |= panorama.cone(offset, angle)
    openings: list[BoolArray] = []
    if lights.environment is not None or lights.lamps:
        openings, open_ = _visible_openings(render_scene, eye, panorama)
        traced |= np.any([open_ & (lights.environment is not None), *openings], axis=0)
    pixels = np.flatnonzero(traced)
    if not len(pixels):
        return
    parts = params.supersampling**2
    directions = panorama.directions(pixels, params.supersampling).reshape(-1, 3)
    shape, distance, light = raycast.emitted_radiance(geometry, eye, directions, emitting)
    metres = distance.astype(np.float64)
    missed = shape < 0
    if lights.environment is not None and missed.any():
        metres[missed] = outside_distance(
            eye, directions[missed], render_scene.scene.portals, render_scene.bbox
        )
        light[missed] = _environment_light(lights, panorama, params, pixels, np.flatnonzero(missed))
    solid = np.repeat(panorama.solid_angles[pixels // panorama.width] / parts, parts)
    opening = np.zeros(len(directions))
    for portal, mask in zip(render_scene.scene.portals, openings, strict=False):
        if not (portal.clear and mask.any()):
            continue
        rays = np.flatnonzero(np.repeat(mask[pixels], parts) & ~missed)
        passed = _portal_distance(eye, directions[rays], portal, metres[rays] - _BEHIND)
        opening[rays] = np.maximum(opening[rays], passed)
    outside = np.flatnonzero(opening)
    metres[outside] = opening[outside]
    light[outside] += _outdoors(render_scene, eye, directions, outside, parts, panorama)
    lit = luminance(light) > 0
    part = (light * solid[:, None])[lit]
    sums.add(np.repeat(pixels, parts)[lit], part, metres[lit])


def _outdoors(
    render_scene: RenderScene,
    eye: Float64Array,
    directions: Float64Array,
    rays: Int64Array,
    parts: int,
    panorama: Panorama,
) -> Float64Array:
    """Return the radiance (len(rays), 3) that surfaces outdoors reflect along some of the rays.

    `parts` rays belong to each pixel, in order. Only every so manyth ray of `rays` is computed, at
    least one in each pixel, so that a view needs about `_SHADED` of them; it stands for those of
    its pixel that follow.
    """
    if not len(rays):
        return np.zeros((0, 3))
    pixel = rays // parts
    first = np.flatnonzero(np.append(True, np.diff(pixel) > 0))
    order = np.arange(len(rays)) - np.repeat(first, np.diff(np.append(first, len(rays))))
    step = math.ceil(len(rays) / _SHADED)
    shaded = order % step == 0
    light = outdoor_radiance(render_scene, eye, directions[rays[shaded]])
    return light[np.cumsum(shaded) - 1]


def _environment_light(
    lights: Lights,
    panorama: Panorama,
    params: IlluminationParams,
    pixels: Int64Array,
    rays: Int64Array,
) -> Float64Array:
    """Return the environment's mean radiance (N, 3) over the part of a pixel of each ray.

    `rays` are the indices of rays that hit no surface, `supersampling`^2 per pixel. Each part is
    evaluated often enough to miss no texel of an environment map; this needs no further rays.
    """
    per_axis = params.supersampling
    steps = max(1, math.ceil(panorama.pitch / per_axis / lights.texel_angle))
    light = np.empty((len(rays), 3))
    batch = max(1, raycast.CHUNK // steps**2)
    for start in range(0, len(rays), batch):
        pixel, part = np.divmod(rays[start : start + batch], per_axis**2)
        directions = panorama.subdivided(pixels[pixel], part, per_axis, steps)
        radiance = raycast.environment_radiance(lights.environment, directions.reshape(-1, 3))
        light[start : start + batch] = radiance.reshape(-1, steps**2, 3).mean(axis=1)
    return light


def _visible_openings(
    render_scene: RenderScene, eye: Float64Array, panorama: Panorama
) -> tuple[list[BoolArray], BoolArray]:
    """Return a mask of the pixels that may show each portal, and of those that may show the sky.

    The mask of a portal is empty if no ray through a pixel's centre passes it. Sky beside the
    portals is searched for by coarse probes.
    """
    coarse = Panorama(min(panorama.width, _PROBE_WIDTH), panorama.rotation)
    portals = render_scene.scene.portals
    masks = [_portal_pixels(portal, eye, panorama) for portal in portals]
    shown = np.flatnonzero(np.any(masks, axis=0)) if masks else np.zeros(0, np.int64)
    directions = np.concatenate([coarse.centres, panorama.centres[shown]])
    shape, distance = raycast.nearest(render_scene.geometry, eye, directions)
    limit = np.zeros(panorama.size)
    limit[shown] = distance[coarse.size :]
    for portal, mask in zip(portals, masks, strict=True):
        centres = panorama.centres[mask]
        mask &= bool(_portal_distance(eye, centres, portal, limit[mask]).any())
    open_ = (shape[: coarse.size] < 0).reshape(coarse.height, coarse.width)
    near = open_ | np.roll(open_, 1, axis=1) | np.roll(open_, -1, axis=1)
    near[1:] |= near[:-1].copy()
    near[:-1] |= near[1:].copy()
    near[[0, -1]] = near[[0, -1]].any(axis=1, keepdims=True)
    return masks, near.ravel()[coarse.pixels(panorama.centres)]


def _portal_pixels(portal: Portal, eye: Float64Array, panorama: Panorama) -> BoolArray:
    """Return a mask of the pixels that a portal touches, seen from within, and some around it."""
    corners = np.array(portal.polygon) - eye
    if corners[0] @ np.array(portal.normal) <= 0:
        return np.zeros(panorama.size, dtype=bool)
    centre, towards = unit(corners.mean(axis=0)), unit(corners)
    mask = panorama.cone(centre, float(np.arccos(np.clip(towards @ centre, -1, 1).min())))
    # Planes through the eye and each edge bound it, if it is convex.
    planes = np.cross(towards, np.roll(towards, -1, axis=0))
    planes = planes[(np.abs(planes) > 1e-9).any(axis=1)]
    planes = unit(planes) * np.sign(planes @ centre)[:, None]
    if (towards @ planes.T > -1e-6).all():
        near = np.flatnonzero(mask)
        margin = math.sin(panorama.pitch)
        mask[near] = (panorama.centres[near] @ planes.T > -margin).all(axis=1)
    return mask
