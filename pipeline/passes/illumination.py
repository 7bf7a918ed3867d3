"""Illumination panorama of a view: every light source that the camera position can see.

The rule is one of energy: a pixel's `intensity` is the mean, over the pixel's solid angle, of
the luminance emitted by what is visible there, so that the sum of intensity x solid angle over
the panorama is the illuminance that the visible sources give. `tint` is the colour of that light,
which the paper's panorama has not. Two estimators serve them:

* sources at least a pixel or so wide, and the sky: rays on a fixed stratified grid of each pixel;
* narrower ones (bulbs, tubes, the sun's disc, point and spot lights), which a grid would miss or
  hit by luck: points on the source, each with the solid angle it stands for, traced to and added
  to the pixel they fall in. A grid ray that hits such a source sees no light there.

Everything is fixed, nothing random: equal input gives equal bits. Left out: light that arrives
by reflection or through frosted glass, and what tinted clear glass takes away.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from pipeline.frames import TINT, Channels
from pipeline.params import IlluminationParams
from pipeline.render import raycast
from pipeline.render.lights import Lights
from pipeline.render.scene import RenderScene
from pipeline.views import View
from scenes.arrays import BoolArray, Float64Array, Int64Array
from scenes.color import luminance
from scenes.contract import Portal
from scenes.geometry.directions import unit

REVISION = 2
_NARROW = 1.5  # pixels: sources of less mean width are sampled from the light's side
_MOST_SHARES = 64  # times `light_samples` points at most for one long, thin source
_PROBE_WIDTH = 128  # columns of the coarse look for openings
_GOLDEN = (0.7548776662466927, 0.5698402909980532)  # R2 sequence: 1/g, 1/g^2, g^3 = g + 1


def render_illumination(
    render_scene: RenderScene, view: View, params: IlluminationParams
) -> Channels:
    """Channels of an `illumination` frame, float32 (width / 2, width).

    `intensity.Y`: Rec. 709 luminance, `distance.Z`: its intensity-weighted mean distance in
    metres; `tint.R/G/B`: linear RGB of luminance 1, so that intensity x tint is the mean radiance.
    All 0 where no light is visible. Equirectangular in the camera's own tilted frame: the centre
    column is straight ahead, right of it the camera's right, the top row its up.
    The sky's distance is that of the outermost portal the ray leaves through, or where it
    leaves through none, of the scene's bounding box.
    """
    panorama = Panorama(params.width, view.pose[:3, :3])
    lights = render_scene.lights
    narrow, shares = _narrow_lamps(lights, view.eye, panorama)
    gathered = Gathered(panorama.size)
    _add_narrow(render_scene, lights, view.eye, panorama, params, narrow, shares, gathered)
    _add_wide(render_scene, lights, view.eye, panorama, params, narrow, gathered)
    solid = np.repeat(panorama.solid_angles, panorama.width)
    energy = luminance(gathered.energy)
    some = np.where(energy > 0, energy, 1)
    bands = {
        "intensity.Y": energy / solid,
        "distance.Z": gathered.weighted / some,
        **{name: gathered.energy[:, i] / some for i, name in enumerate(TINT)},
    }
    shape = (panorama.height, panorama.width)
    return {name: band.astype(np.float32).reshape(shape) for name, band in bands.items()}


class Gathered:
    """What has been found so far in each of `size` pixels.

    `energy` (size, 3) is linear RGB radiance times steradians, `weighted` (size,) its luminance
    times metres.
    """

    def __init__(self, size: int) -> None:
        self.energy = np.zeros((size, 3))
        self.weighted = np.zeros(size)

    def add(self, pixels: Int64Array, light: Float64Array, metres: Float64Array) -> None:
        """Light (N, 3), as `energy`, from `metres` (N,) away into pixels (N,)."""
        size = len(self.weighted)
        for band in range(3):
            self.energy[:, band] += np.bincount(pixels, light[:, band], size)
        self.weighted += np.bincount(pixels, luminance(light) * metres, size)


@dataclass(frozen=True)
class Panorama:
    """Equirectangular pixels around a camera whose axes are the columns of `turn` (3, 3)."""

    width: int
    turn: Float64Array

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
    def middles(self) -> Float64Array:
        """World directions (H x W, 3) through the middles of all pixels."""
        return self.directions(np.arange(self.size), 1)[:, 0]

    def directions(self, pixels: Int64Array, per_axis: int) -> Float64Array:
        """World directions (len(pixels), per_axis^2, 3) to the centres of equal parts of pixels.

        Parts have equal solid angles, so equal weights; they run row by row.
        """
        inner = (np.arange(per_axis) + 0.5) / per_axis
        inner = np.broadcast_to(inner, (len(pixels), per_axis))
        return self._directions(pixels, inner, inner)

    def finer(
        self, pixels: Int64Array, part: Int64Array, per_axis: int, steps: int
    ) -> Float64Array:
        """World directions (N, steps^2, 3) within part `part[i]` of `directions`' parts."""
        row, column = np.divmod(part[:, None], per_axis)
        inner = (np.arange(steps) + 0.5) / steps
        return self._directions(pixels, (row + inner) / per_axis, (column + inner) / per_axis)

    def _directions(
        self, pixels: Int64Array, down: Float64Array, across: Float64Array
    ) -> Float64Array:
        """Every pairing of `down` (N, A) and `across` (N, B), shares of each pixel: (N, A B, 3)."""
        row, column = np.divmod(pixels, self.width)
        sines = np.sin(self._elevations(self.height))
        sine = sines[row, None] + (sines[row + 1] - sines[row])[:, None] * down
        azimuth = (column[:, None] + across) * self.pitch - math.pi
        flat = np.sqrt(np.maximum(1 - sine**2, 0))[:, :, None]
        local = np.empty((len(pixels), down.shape[1], across.shape[1], 3))
        local[..., 0] = flat * np.sin(azimuth)[:, None, :]
        local[..., 1] = -sine[:, :, None]
        local[..., 2] = flat * np.cos(azimuth)[:, None, :]
        return local.reshape(len(pixels), -1, 3) @ self.turn.T

    def pixels(self, directions: Float64Array) -> Int64Array:
        """The pixel in which each world direction (N, 3), of length 1, falls."""
        x, y, z = (directions @ self.turn).T
        column = np.floor((np.arctan2(x, z) / (2 * math.pi) + 0.5) * self.width).astype(np.int64)
        row = np.floor((0.5 + np.arcsin(np.clip(y, -1, 1)) / math.pi) * self.height)
        row = np.clip(row, 0, self.height - 1).astype(np.int64)
        return row * self.width + column % self.width

    def cone(self, centre: Float64Array, angle: float) -> BoolArray:
        """Pixels that a cone around the world direction `centre` touches, (H x W,), generous."""
        if angle >= math.pi:
            return np.ones(self.size, dtype=bool)
        axis = unit(centre)
        reach: BoolArray = self.middles @ axis >= math.cos(min(angle + self.pitch, math.pi))
        return reach

    @staticmethod
    def _elevations(height: int) -> Float64Array:
        rows = np.arange(height + 1, dtype=np.float64)
        return math.pi / 2 - rows * (math.pi / height)


def outside_distance(
    eye: Float64Array, directions: Float64Array, portals: tuple[Portal, ...], bbox: Float64Array
) -> Float64Array:
    """Metres along each ray (N, 3) to the outermost portal it leaves through, else to `bbox`."""
    with np.errstate(divide="ignore", invalid="ignore"):
        exits = np.where(directions > 0, bbox[1] - eye, bbox[0] - eye) / directions
    far = np.nanmin(np.where(directions == 0, np.inf, exits), axis=1)
    through = np.zeros(len(directions))
    for portal in portals:
        polygon, normal = np.array(portal.polygon), np.array(portal.normal)
        slope = directions @ normal
        leaves = slope > 1e-9
        reach = np.where(leaves, (polygon[0] - eye) @ normal / np.where(leaves, slope, 1), 0)
        inside = (
            (reach > 0) & leaves & _in_polygon(eye + reach[:, None] * directions, polygon, normal)
        )
        through = np.where(inside, np.maximum(through, reach), through)
    return np.where(through > 0, through, np.maximum(far, 0))


def _in_polygon(points: Float64Array, polygon: Float64Array, normal: Float64Array) -> BoolArray:
    """Whether points (N, 3) of a polygon's plane lie in it, by counting crossings."""
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
    """The first `count` points of the R2 low-discrepancy sequence in [0, 1)^2 (Roberts 2018)."""
    return (0.5 + np.arange(1, count + 1)[:, None] * np.array(_GOLDEN)) % 1


def _narrow_lamps(
    lights: Lights, eye: Float64Array, panorama: Panorama
) -> tuple[BoolArray, Int64Array]:
    """Which lamps are sampled from the light's side, and with how many times the samples."""
    count, tries = len(lights.lamps), 64
    if not count:
        return np.zeros(0, dtype=bool), np.zeros(0, dtype=np.int64)
    which = np.repeat(np.arange(count), tries)
    _, _, light, density = raycast.towards_lights(
        lights.lamps, which, eye, np.tile(_sequence(tries), (count, 1))
    )
    shown = (luminance(light) > 0) & (density > 0)
    parts = np.where(shown, 1 / np.where(shown, density, 1), 0)
    solid = parts.reshape(count, tries).mean(axis=1)
    away = np.linalg.norm(lights.centre - eye, axis=1)
    across = 2 * np.arcsin(np.minimum(lights.radius / np.maximum(away, 1e-9), 1))
    width = solid / np.maximum(across, 1e-9)
    narrow = (lights.shape < 0) | (width < _NARROW * panorama.pitch)
    shares = np.ceil(solid / panorama.pitch**2).astype(np.int64)
    shares = np.where((lights.shape < 0) | (solid > 0), np.clip(shares, 1, _MOST_SHARES), 0)
    return narrow, shares


def _add_narrow(
    render_scene: RenderScene,
    lights: Lights,
    eye: Float64Array,
    panorama: Panorama,
    params: IlluminationParams,
    narrow: BoolArray,
    shares: Int64Array,
    gathered: Gathered,
) -> None:
    counts = np.where(narrow, shares * params.light_samples, 0)
    which = np.repeat(np.arange(len(counts)), counts)
    if not len(which):
        return
    samples = np.concatenate([_sequence(count) for count in counts])
    directions, distance, light, _ = raycast.towards_lights(lights.lamps, which, eye, samples)
    part = light / counts[which, None]
    seen = luminance(part) > 0
    which, directions, distance, part = which[seen], directions[seen], distance[seen], part[seen]
    distant = lights.distant[which]
    reach = np.where(distant, 1e9, distance)
    free = raycast.reached(render_scene.target, eye, directions, reach)
    metres = distance.astype(np.float64)
    metres[distant] = outside_distance(
        eye, directions[distant], render_scene.scene.portals, render_scene.bbox
    )
    gathered.add(panorama.pixels(directions[free]), part[free], metres[free])


def _add_wide(
    render_scene: RenderScene,
    lights: Lights,
    eye: Float64Array,
    panorama: Panorama,
    params: IlluminationParams,
    narrow: BoolArray,
    gathered: Gathered,
) -> None:
    target = render_scene.target
    glowing = np.zeros(len(target.shapes), dtype=bool)
    glowing[lights.shape[~narrow]] = True
    wanted = np.zeros(panorama.size, dtype=bool)
    for lamp in np.flatnonzero(~narrow):
        offset = lights.centre[lamp] - eye
        away = float(np.linalg.norm(offset))
        inside = away <= lights.radius[lamp]
        angle = math.pi if inside else math.asin(lights.radius[lamp] / away)
        wanted |= panorama.cone(offset, angle)
    if lights.environment is not None:
        wanted |= _open_pixels(render_scene, eye, panorama)
    pixels = np.flatnonzero(wanted)
    if not len(pixels):
        return
    parts = params.supersampling**2
    directions = panorama.directions(pixels, params.supersampling).reshape(-1, 3)
    shape, distance, light = raycast.emitted(target, eye, directions, glowing)
    metres = distance.astype(np.float64)
    escaped = shape < 0
    if lights.environment is not None and escaped.any():
        metres[escaped] = outside_distance(
            eye, directions[escaped], render_scene.scene.portals, render_scene.bbox
        )
        light[escaped] = _sky_light(lights, panorama, params, pixels, np.flatnonzero(escaped))
    solid = np.repeat(panorama.solid_angles[pixels // panorama.width] / parts, parts)
    lit = luminance(light) > 0
    part = (light * solid[:, None])[lit]
    gathered.add(np.repeat(pixels, parts)[lit], part, metres[lit])


def _sky_light(
    lights: Lights,
    panorama: Panorama,
    params: IlluminationParams,
    pixels: Int64Array,
    escaped: Int64Array,
) -> Float64Array:
    """Mean light (N, 3) of the environment over the part of a pixel that each ray stands for.

    `escaped` numbers the rays, `supersampling`^2 to a pixel. A part is looked up as often as it
    takes to miss no texel of an environment map, which needs no further rays.
    """
    per_axis = params.supersampling
    steps = max(1, math.ceil(panorama.pitch / per_axis / lights.texel))
    light = np.empty((len(escaped), 3))
    batch = max(1, raycast.CHUNK // steps**2)
    for start in range(0, len(escaped), batch):
        pixel, part = np.divmod(escaped[start : start + batch], per_axis**2)
        directions = panorama.finer(pixels[pixel], part, per_axis, steps)
        seen = raycast.sky(lights.environment, directions.reshape(-1, 3))
        light[start : start + batch] = seen.reshape(-1, steps**2, 3).mean(axis=1)
    return light


def _open_pixels(render_scene: RenderScene, eye: Float64Array, panorama: Panorama) -> BoolArray:
    """Pixels that may show the environment: around portals, and where coarse probes escape."""
    wanted = np.zeros(panorama.size, dtype=bool)
    for portal in render_scene.scene.portals:
        corners = np.array(portal.polygon) - eye
        middle = unit(corners.mean(axis=0))
        facing = np.clip(unit(corners) @ middle, -1, 1)
        wanted |= panorama.cone(middle, float(np.arccos(facing.min())))
    coarse = Panorama(min(panorama.width, _PROBE_WIDTH), panorama.turn)
    shape, _ = raycast.nearest(render_scene.target, eye, coarse.middles)
    open_ = (shape < 0).reshape(coarse.height, coarse.width)
    near = open_ | np.roll(open_, 1, axis=1) | np.roll(open_, -1, axis=1)
    near[1:] |= near[:-1].copy()
    near[:-1] |= near[1:].copy()
    near[[0, -1]] = near[[0, -1]].any(axis=1, keepdims=True)
    return wanted | near.ravel()[coarse.pixels(panorama.middles)]
