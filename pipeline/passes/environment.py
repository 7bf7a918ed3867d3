"""Environment of a view: an HDR panorama of all that the camera position sees.

Equirectangular in the camera's own tilted frame, as the illumination panorama: the centre column
is straight ahead, right of it is the camera's right, the top row is its up. Colour is path traced
with the ground truth's emitter sampling, planned for all directions, and denoised if that is. A
pixel is the mean radiance over its solid angle, so that the sum of radiance x solid angle is what
arrives at the camera position. Distance and normal are those of the ray through the pixel's
centre, noise-free and past clear glass as in the inputs.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any
from weakref import WeakKeyDictionary

import numpy as np

from pipeline.channels import NORMAL, RGB
from pipeline.frames import Channels
from pipeline.params import EnvironmentParams, GroundTruthParams
from pipeline.passes.denoise import SUBPIXELS, Image, denoise, denoiser_version
from pipeline.passes.groundtruth import Launch, path_integrator, render_blocks, rooms_box
from pipeline.passes.illumination import Panorama
from pipeline.passes.inputs import VisibleSurfaces, normal, reflectance
from pipeline.pathtrace import integrator
from pipeline.pathtrace.guiding import plan_guiding
from pipeline.pathtrace.integrator import JointPath
from pipeline.pathtrace.light_pilot import plan_lights
from pipeline.pathtrace.light_sampling import PlannedLights, UniformLights
from pipeline.pathtrace.panes import panes_of, with_panes
from pipeline.pathtrace.sphere import SphereTracer, trace_scalar
from pipeline.render import raycast
from pipeline.render.bsdf_tables import partner_table
from pipeline.render.material_sets import MaterialSets
from pipeline.render.scene import RenderScene
from pipeline.views import View
from scenes.arrays import AnyArray, Float32Array, Float64Array
from scenes.geometry.directions import turned

REVISION = 3
_WRAP = 64  # columns of the other edge that the denoiser sees beyond each edge
_MANTISSA = 10  # bits of a stored radiance, as in half floats; the exponent is that of float32
_TRACERS: WeakKeyDictionary[MaterialSets, SphereTracer] = WeakKeyDictionary()


def render_environment(
    render_scene: RenderScene,
    view: View,
    params: EnvironmentParams,
    truth: GroundTruthParams,
    seed: int,
) -> tuple[Channels, dict[str, Any]]:
    """Return the channels of an `environment` frame, (width / 2, width), and their statistics.

    `R`, `G`, `B`: linear radiance >= 0, float32 rounded to the precision of half floats, whose
    range a bare bulb or the sun exceeds. `distance.Z`: distance along the ray in metres, float32,
    not z-depth; `N.X/N.Y/N.Z`: unit normal that faces the camera, in its axes (x right, y down, z
    forward). They are 0 where no surface is. The statistics are those of `render_truth`.

    `truth` has depth, emitter sampling and denoiser; `seed` is the view's own seed.
    """
    settings = replace(truth, spp=params.spp, noise=0.0)
    launch = _launcher(render_scene, view, params.width, settings, seed)
    canvas = replace(view, width=params.width, height=params.width // 2)
    ((image, stats),) = render_blocks(launch, canvas, settings, seed, 1)
    if truth.denoise == "oidn":
        image = _denoised(image, *_guides(render_scene, view, params.width))
        stats = {**stats, "denoiser": denoiser_version()}
    colour = {band: rounded(image[band]) for band in RGB}
    return {**colour, **_geometry(render_scene, view, params.width)}, stats


def centre_directions(width: int) -> Float64Array:
    """Return unit directions (width / 2, width, 3) through pixel centres, in camera axes.

    The azimuth from the forward to the right axis is 2 pi (column + 1/2) / width - pi, the
    elevation towards the camera's up is pi / 2 - pi (row + 1/2) / height.
    """
    pitch = 2 * math.pi / width
    azimuths = [(column + 0.5) * pitch - math.pi for column in range(width)]
    polar = [(row + 0.5) * pitch for row in range(width // 2)]
    # Python's functions: those of NumPy depend on the processor.
    around = np.array([(math.sin(angle), math.cos(angle)) for angle in azimuths])
    down = np.array([(math.sin(angle), -math.cos(angle)) for angle in polar])
    directions = np.empty((width // 2, width, 3))
    directions[..., 0] = down[:, :1] * around[:, 0]
    directions[..., 1] = down[:, 1:]
    directions[..., 2] = down[:, :1] * around[:, 1]
    return directions


def rounded(values: AnyArray) -> Float32Array:
    """Round float32 values to the precision of half floats, in the range of float32.

    The lower mantissa bits are then 0, so that files compress as if the values were half floats.
    """
    lost = np.uint32(23 - _MANTISSA)
    bits = np.ascontiguousarray(values, dtype=np.float32).view(np.uint32)
    half = np.uint32(1) << (lost - np.uint32(1))
    return ((bits + half) >> lost << lost).view(np.float32)


def _launcher(
    render_scene: RenderScene, view: View, width: int, settings: GroundTruthParams, seed: int
) -> Launch:
    scene = render_scene.neutral(None).mitsuba
    if not integrator.available():
        path = path_integrator(settings.max_depth, settings.rr_depth)
        path = with_panes(path, render_scene.scene.portals)
        return lambda copies, spp, seed: trace_scalar(scene, path, view, width, copies, spp, seed)
    lights: UniformLights | PlannedLights = UniformLights()
    if settings.lights == "planned" and scene.emitters():
        home = render_scene.scene
        plan = plan_lights(scene, view, home.portals, seed, rooms_box(home.rooms), panoramic=True)
        lights = PlannedLights(scene, plan, plan_guiding(scene, plan, seed))
    materials = render_scene.materials
    # Every material is its own twin: only colour is needed.
    table = partner_table([(bsdf, bsdf) for bsdf in materials.own])
    panes = panes_of(render_scene.scene.portals)
    joint = JointPath(table, settings.max_depth, settings.rr_depth, lights, panes=panes)
    tracer = _TRACERS.setdefault(materials, SphereTracer())
    version = materials.version
    return lambda copies, spp, seed: tracer.launch(
        scene, version, view, width, copies, joint, spp, seed
    )


def _geometry(render_scene: RenderScene, view: View, width: int) -> Channels:
    """Return distance and normal along the rays through the pixel centres."""
    directions = turned(centre_directions(width).reshape(-1, 3), view.pose[:3, :3])
    surfaces = _surfaces(render_scene, view, directions, colors=False)
    offset = surfaces.hits.position.astype(np.float64) - view.eye
    metres = np.where(surfaces.valid, np.sqrt((offset * offset).sum(axis=-1)), 0)
    normals = normal(surfaces)
    shape = (width // 2, width)
    return {
        "distance.Z": metres.astype(np.float32).reshape(shape),
        **{name: normals[:, axis].reshape(shape) for axis, name in enumerate(NORMAL)},
    }


def _guides(render_scene: RenderScene, view: View, width: int) -> tuple[Image, Image]:
    """Return the means of albedo and camera-frame normal over parts of pixels, (H, W, 3)."""
    panorama = Panorama(width, view.pose[:3, :3])
    directions = panorama.directions(np.arange(panorama.size), SUBPIXELS)
    surfaces = _surfaces(render_scene, view, directions.reshape(-1, 3), colors=True)
    shape = (panorama.height, panorama.width, SUBPIXELS**2, 3)
    albedo, normals = (
        values.astype(np.float32).reshape(shape).mean(axis=2)
        for values in (reflectance(surfaces), normal(surfaces))
    )
    return albedo, normals


def _surfaces(
    render_scene: RenderScene, view: View, directions: Float64Array, colors: bool
) -> VisibleSurfaces:
    hits = raycast.surfaces(render_scene.geometry, view.eye, directions, colors)
    return VisibleSurfaces(render_scene, view, directions, hits, hits.shape >= 0)


def _denoised(image: Channels, albedo: Image, normals: Image) -> Channels:
    """Denoise a panorama whose left and right edges meet."""
    wide = denoise(
        {band: _wrapped(image[band]) for band in RGB}, _wrapped(albedo), _wrapped(normals)
    )
    margin = _margin(image["R"])
    return {band: values[:, margin:-margin] for band, values in wide.items()}


def _wrapped(values: AnyArray) -> Image:
    """Return a panorama (H, W, ...) with columns of the other edge beyond each edge."""
    margin = _margin(values)
    inside: list[tuple[int, int]] = [(0, 0)] * (values.ndim - 2)
    return np.pad(values, [(0, 0), (margin, margin), *inside], mode="wrap")


def _margin(values: AnyArray) -> int:
    return min(_WRAP, values.shape[1])
