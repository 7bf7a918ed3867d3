"""Ground truth of a view: the path-traced image, in colour, of the scene's neutral twin, or both.

Samples are taken in blocks, each an independent stratified estimate (multi-jittered, box filter)
with random numbers of its own, and averaged in float64. That bounds memory, makes the image
equal whatever the number of threads, and yields the noise estimate, by which a view may stop
early (`groundtruth.noise`). Left out: participating media,
lens blur, motion blur, wavelengths, and pixels that are not square.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from typing import Any
from weakref import WeakKeyDictionary

import mitsuba as mi
import numpy as np

from pipeline.frames import Channels
from pipeline.params import GroundTruthParams
from pipeline.pathtrace import integrator as joint
from pipeline.pathtrace.guiding import plan_bounces
from pipeline.pathtrace.launches import FrozenTracer
from pipeline.pathtrace.light_pilot import EVERYWHERE, plan_lights
from pipeline.pathtrace.light_sampling import PlannedLights, UniformLights
from pipeline.pathtrace.noise import Tally
from pipeline.render.material_sets import Wardrobe
from pipeline.render.scene import RenderScene
from pipeline.render.sensors import make_sensor
from pipeline.views import View
from scenes.arrays import Float64Array
from scenes.contract import Room
from scenes.seeds import derive32

REVISION = 10
_LAUNCH = 1 << 21  # samples; changing it changes pixels
_TRACERS: WeakKeyDictionary[Wardrobe, FrozenTracer] = WeakKeyDictionary()

Launch = Callable[[int, int, int], Any]  # of copies side by side, samples, seed: mi.TensorXf
Truth = tuple[Channels, dict[str, Any]]  # an image and its statistics


@dataclass(frozen=True)
class Truths:
    """A view's image in the scene's own colours and that of its neutral twin.

    Each as `render_truth` returns it: channels and statistics.
    """

    color: Truth
    shading: Truth


def render_truth(
    render_scene: RenderScene, view: View, params: GroundTruthParams, seed: int
) -> Truth:
    """Path-trace a view; `render_scene.neutral(albedo)` gives shading, the scene itself colour.

    Returns channels `R`, `G`, `B`, float32 (H, W), linear radiance >= 0, and statistics:

    * `spp`: samples a pixel that were taken; `blocks`: in how many blocks;
    * `noise`: root mean square over the pixels of the relative standard error of luminance,
      see `pipeline.pathtrace.noise.Tally.relative_error`;
    * `nan_pixels`: pixels where a block was not finite (replaced by the other blocks' mean, by 0
      if no block was finite: `lost_pixels`); `negative_pixels`: pixels with a negative mean
      in any band (set to 0; skies may be slightly negative);
    * `black`, `blown`, `fireflies`: shares of pixels at exactly 0, at or above half the largest
      half float, and far brighter than all around by chance; `firefly_light`: the share of all
      light that lies in the brightest of those last, at most a thousandth of the pixels.

    `seed` is the view's own seed, see `scenes.seeds`. Raises `InputError` for a view whose
    pixels are not square.
    """
    integrator = _integrator(params.max_depth, params.rr_depth)
    scene = render_scene.mitsuba

    def launch(copies: int, spp: int, seed: int) -> Any:
        sensor = make_sensor(view, copies)
        return mi.render(scene, sensor=sensor, integrator=integrator, spp=spp, seed=seed)

    (truth,) = _render(launch, view, params, seed, 1)
    return truth


def render_both(
    render_scene: RenderScene, view: View, params: GroundTruthParams, albedo: float, seed: int
) -> Truths:
    """Path-trace colour and the shading of the grey `albedo` from one trace of paths.

    Each image has the expectation of its own `render_truth`; see `pipeline.pathtrace.integrator`.
    Only where `joint.available()`. Raises `InputError` as `render_truth` does, and for a material
    that has no neutral twin.
    """
    table = joint.twin_table(render_scene.twins(albedo))
    scene = render_scene.neutral(None).mitsuba
    lights: UniformLights | PlannedLights = UniformLights()
    if params.lights == "planned" and scene.emitters():
        home = render_scene.scene
        plan = plan_lights(scene, view, home.portals, seed, _box_of(home.rooms))
        lights = PlannedLights(scene, plan, plan_bounces(scene, plan, seed))
    path = joint.JointPath(table, params.max_depth, params.rr_depth, lights)
    suit = render_scene.wardrobe.suit
    tracer = tracer_of(render_scene)

    def launch(copies: int, spp: int, seed: int) -> Any:
        return tracer.launch(scene, suit, view, copies, path, spp, seed)

    color, shading = _render(launch, view, params, seed, 2)
    return Truths(color, shading)


def tracer_of(render_scene: RenderScene) -> FrozenTracer:
    """The recorded launches of an open scene, shared by its forms; they end with the scene."""
    return _TRACERS.setdefault(render_scene.wardrobe, FrozenTracer())


def _box_of(rooms: tuple[Room, ...]) -> Float64Array:
    """Lowest and highest coordinates of all rooms, (2, 3), world metres; infinite without any."""
    if not rooms:
        return EVERYWHERE
    low = np.min([[*np.min(room.floor, axis=0), room.floor_z] for room in rooms], axis=0)
    high = np.max([[*np.max(room.floor, axis=0), room.ceiling_z] for room in rooms], axis=0)
    return np.array([low, high])


def _render(
    launch: Launch, view: View, params: GroundTruthParams, seed: int, images: int
) -> list[Truth]:
    """Render all blocks by launches that give so many `images`, three bands each."""
    spp, blocks = block_sizes(params)
    least = blocks
    if params.noise:
        least = min(blocks, max(2, -(-params.min_spp // spp)))
    at_once = blocks_at_once(least, spp * view.width * view.height)
    tallies = [Tally(view.height, view.width) for _ in range(images)]
    for first in range(0, blocks, at_once):
        if first >= least and all(tally.noise() <= params.noise for tally in tallies):
            break
        copies = min(at_once, blocks - first)  # fewer in the last launch, so that none is left out
        pixels = launch(copies, spp, derive32(seed, "block", first))
        bands = np.asarray(pixels, dtype=np.float64)
        bands = bands.reshape(view.height, copies, view.width, images, 3)
        for block in range(copies):
            for image, tally in enumerate(tallies):
                tally.add(bands[:, block, :, image])
    return [(tally.image(), {"spp": spp * tally.blocks, **tally.statistics()}) for tally in tallies]


def block_sizes(params: GroundTruthParams) -> tuple[int, int]:
    """Samples a pixel in one block, and the number of blocks: two or more unless `spp` is 1.

    A noise estimate needs two independent blocks, so samples that would fit into one block are
    shared by two (or, if odd, taken one by one). The sampler wants a number with a factor
    near its root; other numbers are rounded up.
    """
    spp, size = params.spp, min(params.block_spp, params.spp)
    if spp // size < 2 and spp > 1:
        size = spp // 2 if spp % 2 == 0 else 1
    return stratified(size), spp // size


def blocks_at_once(blocks: int, samples: int) -> int:
    """How many blocks of so many samples are traced in one launch: a divisor of `blocks`.

    Each launch has a fixed cost (see `pipeline.pathtrace.launches`), so small images take several
    blocks at once, as many as `_LAUNCH` allows.
    """
    fitting = (n for n in range(1, blocks + 1) if blocks % n == 0 and n * samples <= _LAUNCH)
    return max(fitting, default=1)


def stratified(spp: int) -> int:
    """`spp` as the `multijitter` sampler takes it: rounded up to a grid of nearly equal sides."""
    side = int(np.sqrt(spp))
    return side * -(-spp // side)


@lru_cache(maxsize=8)
def _integrator(max_depth: int, rr_depth: int) -> Any:
    # A fixed block size: the scalar variant seeds by block and would choose it by thread count.
    return mi.load_dict(
        {
            "type": "path",
            "max_depth": max_depth,
            "rr_depth": rr_depth,
            "hide_emitters": False,
            "block_size": 16,
        }
    )
