"""Ground truth of a view: path-traced colour, shading of the neutral twin, or both.

Samples are taken in blocks. Each block is an independent stratified estimate (box filter) with
random numbers of its own; blocks are averaged in float64. This bounds memory, makes
the image independent of the number of threads, and provides the noise estimate by which a view may
stop early (`groundtruth.noise`). Not supported: participating media, moving objects, and spectral
rendering.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import lru_cache
from typing import Any

import mitsuba as mi
import numpy as np

from pbrnet.pipeline.frames import Channels
from pbrnet.pipeline.lenses.model import Lens
from pbrnet.pipeline.passes.settings import GroundTruthParams
from pbrnet.pipeline.pathtrace import integrator
from pbrnet.pipeline.pathtrace.guiding import plan_guiding
from pbrnet.pipeline.pathtrace.integrator import Bases, JointPath
from pbrnet.pipeline.pathtrace.launches import PathTracer, make_sensor, trace_scalar
from pbrnet.pipeline.pathtrace.light_parts import LightGroups, LightParts, NoParts
from pbrnet.pipeline.pathtrace.light_plan import EVERYWHERE, plan_lights
from pbrnet.pipeline.pathtrace.light_sampling import PlannedLights, UniformLights
from pbrnet.pipeline.pathtrace.noise import BlockStatistics
from pbrnet.pipeline.pathtrace.optics import Optics
from pbrnet.pipeline.pathtrace.panes import panes_of, with_panes
from pbrnet.pipeline.render.drjit_arrays import environment_pointer, partner_table
from pbrnet.pipeline.render.material_sets import MaterialSets
from pbrnet.pipeline.render.raycast.meshes import triangles_of
from pbrnet.pipeline.render.scene import RenderScene
from pbrnet.pipeline.render.variants import cards, on_card
from pbrnet.pipeline.views import View
from pbrnet.scenes.arrays import Float64Array
from pbrnet.scenes.contract import Room
from pbrnet.scenes.seeds import derive32

# Powers of two; the larger ones are squares, as Mitsuba's `multijitter` sampler needs it.
_BLOCK_SIZES = (1, 2, 4, 8, 16, 64, 256, 1024, 4096)
_LAUNCH_SAMPLES = 1 << 21  # most samples of one launch; changing it changes pixels
_CARD_BYTES = 512  # of a card's memory for each sample of a launch: half of it stays free

REMAINDERS = ("indirect", "specular")  # of colour without direct and diffuse light

Launch = Callable[[int, int, int], "mi.TensorXf | Float64Array"]  # copies side by side, spp, seed
Truth = tuple[Channels, dict[str, Any]]  # an image and its statistics


@dataclass(frozen=True)
class Truths:
    """Images of a view in the scene's own colours and in its neutral twin.

    Each is a pair of channels and statistics, as `render_truth` returns it. `parts` holds parts of
    colour by name: those of `LightParts` and what they leave of colour, if they were asked for.
    `halves` holds colour and shading of every second block, if there are two or more.
    """

    color: Truth
    shading: Truth
    parts: dict[str, Truth] = field(default_factory=dict)
    halves: dict[str, Channels] = field(default_factory=dict)


def render_truth(
    render_scene: RenderScene, view: View, params: GroundTruthParams, seed: int
) -> Truth:
    """Path-trace a view: colour, or shading if `render_scene` is a neutral twin.

    Returns channels `R`, `G`, `B`, float32 (H, W), linear radiance >= 0, and statistics:

    * `spp`: samples per pixel taken; `blocks`: number of blocks;
    * `noise`: root mean square over the pixels of the relative standard error of luminance,
      see `pbrnet.pipeline.pathtrace.noise.BlockStatistics.relative_error`;
    * `nan_pixels`: number of pixels where a block was not finite; the mean of the other blocks
      replaces it. `lost_pixels`: those where no block was finite; they are 0;
    * `negative_pixels`: number of pixels with a negative mean in any band. They are set to 0; skies
      may be slightly negative;
    * `black`, `blown`, `fireflies`: shares of pixels that are exactly 0, at or above half the
      largest half float, and far brighter than their surroundings by chance;
    * `firefly_light`: share of all light in the brightest fireflies, at most a thousandth of the
      pixels.

    `seed` is the view's own seed, see `pbrnet.scenes.seeds`.
    """
    if not view.lens.is_pinhole:
        through = lens_launch(render_scene, view, view.lens, params, seed)
        return render_blocks(through, view, params, seed)
    path = path_integrator(params.max_depth, params.rr_depth)
    path = with_panes(path, render_scene.scene.portals)
    scene = render_scene.mitsuba

    def launch(copies: int, spp: int, seed: int) -> mi.TensorXf:
        sensor = make_sensor(view, copies)
        return mi.render(scene, sensor=sensor, integrator=path, spp=spp, seed=seed)

    return render_blocks(launch, view, params, seed)


def render_both(
    render_scene: RenderScene,
    view: View,
    params: GroundTruthParams,
    albedo: float,
    seed: int,
    light: bool = False,
    groups: LightGroups | None = None,
) -> Truths:
    """Path-trace colour and the shading of the grey `albedo` in one trace.

    Each image has the same expectation as that of `render_truth`; see
    `pbrnet.pipeline.pathtrace.integrator`. With `light` also the parts of colour, see
    `pbrnet.pipeline.pathtrace.light_parts`, and with `groups` an image of each; colour and shading
    keep their bits. Requires `integrator.available()`. Raises `InputError` for a material that has
    no neutral twin.
    """
    bases = render_scene.materials.bases(albedo)
    table = partner_table([(each.own, each.twin) for each in bases])
    parts = LightParts(render_scene.materials.lobes(), groups) if light else NoParts()
    lights = _lights(render_scene.neutral(None), view, params, seed)
    path = _joint_path(render_scene, table, params, lights, parts=parts, bases=Bases(bases, albedo))
    launch = _joint_launch(render_scene.neutral(None), view, path)
    names: tuple[str, ...] = ()
    if light:
        launch, names = _with_remainders(launch), (*parts.names, *REMAINDERS)
    blocks = trace_blocks(launch, view, params, seed, 2 + len(names))
    color, shading, *images = (truth_of(each, params) for each in blocks)
    return Truths(color, shading, dict(zip(names, images, strict=True)), _halves(blocks))


def render_color(
    render_scene: RenderScene,
    view: View,
    params: GroundTruthParams,
    seed: int,
    planned: PlannedLights | None = None,
) -> tuple[Channels, Channels]:
    """Path-trace colour alone: the image of all blocks, and that of every second one.

    The same expectation as colour of `render_both`, by other samples and in some 0.85 of the
    time, without statistics. With one block both images are the same. `planned`: what
    `planned_lights` returns for this view, if it is known already. Requires
    `integrator.available()`. Raises `InputError` as `render_truth` does.
    """
    blocks = color_blocks(render_scene, view, params, seed, planned)
    image = blocks.image()
    half = blocks.half_image()
    return image, image if half is None else half


def color_blocks(
    render_scene: RenderScene,
    view: View,
    params: GroundTruthParams,
    seed: int,
    planned: PlannedLights | None = None,
    optics: Optics | None = None,
) -> BlockStatistics:
    """Path-trace colour alone, with the lens and shutter of `optics`; as `render_color`."""
    table = _own(render_scene.materials)
    lights = _lights(render_scene.neutral(None), view, params, seed, planned=planned)
    path = _joint_path(render_scene, table, params, lights, alone=True)
    launch = _joint_launch(render_scene.neutral(None), view, path, optics=optics)
    (blocks,) = trace_blocks(launch, view, params, seed, 1)
    return blocks


def _joint_launch(
    render_scene: RenderScene,
    view: View,
    path: JointPath,
    lens: Lens | None = None,
    optics: Optics | None = None,
) -> Launch:
    """Return launches of the joint path tracer for a view, through its own or another lens."""
    scene, version = render_scene.mitsuba, render_scene.materials.version
    tracer = render_scene.materials.kept(PathTracer)
    camera = (view.pose, lens or view.lens, optics)
    return lambda copies, spp, seed: tracer.launch(scene, version, camera, copies, path, spp, seed)


def _joint_path(
    render_scene: RenderScene,
    table: mi.BSDFPtr,
    params: GroundTruthParams,
    lights: UniformLights | PlannedLights,
    **more: Any,
) -> JointPath:
    """Return the joint path tracer of a scene; `table` and `lights` are its first arguments."""
    return JointPath(
        table,
        params.max_depth,
        params.rr_depth,
        lights,
        panes=panes_of(render_scene.scene.portals),
        meshes=triangles_of(render_scene.geometry.scene),
        environment=environment_pointer(render_scene.mitsuba),
        **more,
    )


def _own(materials: MaterialSets) -> mi.BSDFPtr:
    """Return a table in which every material is its own twin."""
    return partner_table([(bsdf, bsdf) for bsdf in materials.own])


def _halves(blocks: list[BlockStatistics]) -> dict[str, Channels]:
    images = zip(("color", "shading"), (each.half_image() for each in blocks), strict=False)
    return {name: image for name, image in images if image is not None}


def lens_launch(
    render_scene: RenderScene, view: View, lens: Lens, params: GroundTruthParams, seed: int
) -> Launch:
    """Return launches of one image from a view's pose, through any lens."""
    scene = render_scene.mitsuba
    if not integrator.available():
        path = path_integrator(params.max_depth, params.rr_depth)
        path = with_panes(path, render_scene.scene.portals)
        return lambda copies, spp, seed: trace_scalar(
            scene, path, view.pose, lens, copies, spp, seed
        )
    lights = _lights(render_scene, view, params, seed, lens)
    materials = render_scene.materials
    joint = _joint_path(render_scene, _own(materials), params, lights, alone=True)
    return _joint_launch(render_scene, view, joint, lens)


def planned_lights(
    render_scene: RenderScene, view: View, seed: int, lens: Lens | None = None
) -> PlannedLights:
    """Return emitter sampling and path guiding planned for a view, or for another lens at its pose.

    The scene is in the colours that are traced; it has emitters.
    """
    scene, home = render_scene.mitsuba, render_scene.scene
    plan = plan_lights(scene, view, home.portals, seed, rooms_box(home.rooms), lens)
    return PlannedLights(scene, plan, plan_guiding(scene, plan, seed))


def _lights(
    render_scene: RenderScene,
    view: View,
    params: GroundTruthParams,
    seed: int,
    lens: Lens | None = None,
    planned: PlannedLights | None = None,
) -> UniformLights | PlannedLights:
    """Return the emitter sampling that the parameters choose; see `planned_lights`."""
    if params.lights == "uniform":
        return UniformLights()
    if planned is not None:
        return planned
    if not render_scene.mitsuba.emitters():
        return UniformLights()
    return planned_lights(render_scene, view, seed, lens)


def _with_remainders(launch: Launch) -> Launch:
    """Return launches of a joint trace with its parts, and what two of them leave of colour.

    Images are colour, shading, direct, diffuse, irradiance and light groups; `REMAINDERS` follow.
    """

    def launch_all(copies: int, spp: int, seed: int) -> Float64Array:
        images = launch(copies, spp, seed)
        color, direct, diffuse = images[..., :3], images[..., 6:9], images[..., 9:12]
        return np.concatenate([images, color - direct, color - diffuse], axis=-1)

    return launch_all


def rooms_box(rooms: tuple[Room, ...]) -> Float64Array:
    """Return the bounding box of all rooms, (2, 3), world metres; infinite if there are none."""
    if not rooms:
        return EVERYWHERE
    low = np.min([[*np.min(room.floor, axis=0), room.floor_z] for room in rooms], axis=0)
    high = np.max([[*np.max(room.floor, axis=0), room.ceiling_z] for room in rooms], axis=0)
    return np.array([low, high])


def render_blocks(launch: Launch, view: View, params: GroundTruthParams, seed: int) -> Truth:
    """Render blocks of one image until the noise target or `spp` is reached; return their mean.

    See `trace_blocks`.
    """
    (blocks,) = trace_blocks(launch, view, params, seed, 1)
    return truth_of(blocks, params)


def truth_of(blocks: BlockStatistics, params: GroundTruthParams) -> Truth:
    """Return the mean of an image's blocks and its statistics."""
    spp, _ = block_sizes(params, blocks.mean.size)
    return blocks.image(), {"spp": spp * blocks.blocks, **blocks.statistics()}


def trace_blocks(
    launch: Launch, view: View, params: GroundTruthParams, seed: int, images: int
) -> list[BlockStatistics]:
    """Render blocks until the noise target or `spp` is reached; return each image's statistics.

    `launch(copies, spp, seed)` returns that many blocks side by side, each of `images` images of
    three bands. The target is that of the first two: parts of colour do not change the samples.
    """
    spp, blocks = block_sizes(params, view.width * view.height)
    min_blocks = blocks
    if params.noise:
        min_blocks = min(blocks, max(2, -(-params.min_spp // spp)))
    per_launch = blocks_per_launch(min_blocks, spp * view.width * view.height)
    statistics = [BlockStatistics(view.height, view.width) for _ in range(images)]
    for first in range(0, blocks, per_launch):
        if first >= min_blocks and all(each.noise() <= params.noise for each in statistics[:2]):
            break
        copies = min(per_launch, blocks - first)  # the last launch may be smaller
        pixels = launch(copies, spp, derive32(seed, "block", first))
        bands = np.asarray(pixels, dtype=np.float64)
        bands = bands.reshape(view.height, copies, view.width, images, 3)
        for block in range(copies):
            for image, each in enumerate(statistics):
                each.add(bands[:, block, :, image])
    return statistics


def block_sizes(params: GroundTruthParams, pixels: int) -> tuple[int, int]:
    """Return samples per pixel in one block and the number of blocks.

    A block is one launch, so on a card it also fits into that one's memory.

    There are two or more blocks unless `spp` is 1, because a noise estimate needs two independent
    ones: samples that would fit into one block are divided between two. A block has a power of two
    of samples: threads take pieces of 2^n samples, so other numbers would split a pixel between
    two threads, and its last bit would depend on which adds first.
    """
    spp, most = params.spp, min(params.block_spp, params.spp)
    if spp // most < 2 and spp > 1:
        most = spp // 2
    if on_card():
        most = max(1, min(most, launch_samples() // pixels))
    size = max(number for number in _BLOCK_SIZES if number <= most and spp % number == 0)
    return size, spp // size


def blocks_per_launch(blocks: int, samples: int) -> int:
    """Return the number of blocks that are traced in one launch: a divisor of `blocks`.

    `samples` is the number of samples in one block. Each launch has a fixed cost (see
    `pbrnet.pipeline.pathtrace.launches`), so small images trace several blocks at once, as many as
    `launch_samples` allows.
    """
    limit = launch_samples()
    fitting = (n for n in range(1, blocks + 1) if blocks % n == 0 and n * samples <= limit)
    return max(fitting, default=1)


def launch_samples() -> int:
    """Return the most samples of one launch: on a card a power of two by the least memory of any.

    So the frames of a card are bit-identical on cards of one model.
    """
    if not on_card():
        return _LAUNCH_SAMPLES
    return 1 << max(0, (min(cards().memory) // _CARD_BYTES).bit_length() - 1)


@lru_cache(maxsize=8)
def path_integrator(max_depth: int, rr_depth: int) -> mi.Integrator:
    """Return Mitsuba's `path` integrator; `max_depth` and `rr_depth` are its parameters."""
    # A fixed image block size: the scalar variant seeds by block and chooses it by thread count.
    return mi.load_dict(
        {
            "type": "path",
            "max_depth": max_depth,
            "rr_depth": rr_depth,
            "hide_emitters": False,
            "block_size": 16,
        }
    )
