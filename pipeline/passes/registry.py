"""Registry of render passes: each kind of frame, its renderer and its fingerprint.

A frame's fingerprint is a digest of everything that determines its pixels: the pass and its
key, the parameters that it reads, the view's camera and size, the scene's content, the
renderer, the seed. Everything else (view scores, the farm, training) is excluded.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

from pbrnet.pipeline.channels import DENOISED, DENOISED_SHADING, HALF, NOISY_SHADING, RGB, Kind
from pbrnet.pipeline.frames import Channels, fingerprint
from pbrnet.pipeline.keys import key
from pbrnet.pipeline.params import Params
from pbrnet.pipeline.passes.denoise import (
    Guides,
    Quality,
    denoise,
    denoiser_version,
    grey_guide,
    guides,
)
from pbrnet.pipeline.passes.environment import render_environment
from pbrnet.pipeline.passes.groundtruth import render_both, render_color, render_truth
from pbrnet.pipeline.passes.illumination import render_illumination
from pbrnet.pipeline.passes.inputs import inputs_of, render_inputs, visible_surfaces
from pbrnet.pipeline.passes.labels import labels_of, render_labels
from pbrnet.pipeline.passes.light import light_of
from pbrnet.pipeline.passes.materials import materials_of, render_materials
from pbrnet.pipeline.passes.preparation import Preparation, sample_guides
from pbrnet.pipeline.passes.settings import GroundTruthParams
from pbrnet.pipeline.passes.transport import render_transport
from pbrnet.pipeline.passes.video import render_video, video_of
from pbrnet.pipeline.passes.visibility import render_visibility
from pbrnet.pipeline.pathtrace import integrator
from pbrnet.pipeline.pathtrace.light_groups import group_lights
from pbrnet.pipeline.pathtrace.noise import residual_noise
from pbrnet.pipeline.render.scene import RenderScene
from pbrnet.pipeline.views import View
from pbrnet.scenes.checked import plain
from pbrnet.scenes.errors import InputError
from pbrnet.scenes.seeds import derive

Result = tuple[Channels, dict[str, Any]]  # channels, and further entries of the attribute
Render = Callable[[RenderScene, View, Params, int], Result]
TRUTHS: tuple[Kind, ...] = ("shading", "color")
TRACED: tuple[Kind, ...] = (*TRUTHS, "light")  # of one trace of paths
# Of one trace of pixel centres.
SURFACES: tuple[Kind, ...] = ("inputs", "materials", "labels", "video")


@dataclass(frozen=True)
class Pass:
    """One kind of frame.

    `render` returns its channels and further entries of its `pbrnet` attribute. `key` names the
    number of its code in `keys.yaml`. `determined_by` returns the parameters that determine pixels.
    """

    key: str
    determined_by: Callable[[Params], dict[str, Any]]
    render: Render
    seeded: bool = False  # True if the pass uses random numbers


def _inputs(scene: RenderScene, view: View, params: Params, seed: int) -> Result:
    return render_inputs(scene, view), {}


def _materials(scene: RenderScene, view: View, params: Params, seed: int) -> Result:
    return render_materials(scene, view)


def _labels(scene: RenderScene, view: View, params: Params, seed: int) -> Result:
    return render_labels(scene, view)


def _video(scene: RenderScene, view: View, params: Params, seed: int) -> Result:
    return render_video(scene, view), {}


def _illumination(scene: RenderScene, view: View, params: Params, seed: int) -> Result:
    return render_illumination(scene, view, params.illumination), {}


def _visibility(scene: RenderScene, view: View, params: Params, seed: int) -> Result:
    return render_visibility(scene, view, params.illumination), {}


def _environment(scene: RenderScene, view: View, params: Params, seed: int) -> Result:
    return render_environment(scene, view, params.environment, params.groundtruth, seed)


def _transport(scene: RenderScene, view: View, params: Params, seed: int) -> Result:
    return render_transport(scene, view, params.transport, seed)


def _truth(kind: Kind) -> Render:
    """Return the renderer of shading or colour alone."""

    def render(scene: RenderScene, view: View, params: Params, seed: int) -> Result:
        albedo = params.shading.albedo
        if traced_together(params) and (kind == "shading" or _has_twin(scene, params)):
            truths = render_both(scene, view, params.groundtruth, albedo, seed)
            half = truths.halves.get(kind)
            return postprocessed(kind, getattr(truths, kind), scene, view, params, half)
        form = scene.neutral(albedo if kind == "shading" else None)
        truth = render_truth(form, view, params.groundtruth, seed)
        return postprocessed(kind, truth, scene, view, params)

    return render


def _light(scene: RenderScene, view: View, params: Params, seed: int) -> Result:
    return render_truths(scene, view, params, seed, light=True)["light"]


def render_truths(
    scene: RenderScene, view: View, params: Params, seed: int, light: bool = False
) -> dict[Kind, Result]:
    """Render shading and colour of a view, with `light` also the parts of its light.

    Each is bit-identical to that of its own pass. Raises `InputError` for a material without
    neutral twin, even though colour alone could be rendered; and with `light` where colour and
    shading are not traced together.
    """
    if not traced_together(params):
        if light:
            raise InputError(
                "channels: light needs colour and shading in one trace, groundtruth.joint: true "
                "and a variant other than scalar_rgb"
            )
        return {kind: PASSES[kind].render(scene, view, params, seed) for kind in TRUTHS}
    groups = None
    if light and params.light.groups:
        home, shapes = scene.scene, scene.geometry.shapes
        most = params.light.groups
        groups = group_lights(scene.neutral(None).mitsuba, shapes, home.lights, view.room, most)
    settings, albedo = params.groundtruth, params.shading.albedo
    truths = render_both(scene, view, settings, albedo, seed, light, groups)
    guided = None if params.groundtruth.denoise == "none" else guides(scene, view)
    made = {
        kind: _denoised(kind, getattr(truths, kind), guided, view, params, truths.halves.get(kind))
        for kind in TRUTHS
    }
    if light:
        made["light"] = light_of(truths, made["color"][0], guided, groups, view.is_panorama)
    return made


def render_surfaces(scene: RenderScene, view: View, kinds: Sequence[Kind]) -> dict[Kind, Result]:
    """Render some of `SURFACES` from one trace; each is bit-identical to that of its own pass."""
    surfaces = visible_surfaces(
        scene, view, colors="inputs" in kinds, textures="materials" in kinds
    )
    made: dict[Kind, Callable[[], Result]] = {
        "inputs": lambda: (inputs_of(surfaces), {}),
        "materials": lambda: materials_of(surfaces),
        "labels": lambda: labels_of(surfaces),
        "video": lambda: (video_of(surfaces), {}),
    }
    return {kind: made[kind]() for kind in kinds}


def render_noisy(scene: RenderScene, view: View, params: Params, seed: int) -> Result:
    """Render colour and shading with `noisy.spp` samples per pixel, unbiased and denoised.

    Returns the channels of the kind `noisy` and the statistics of colour. Raises `InputError` for a
    material without neutral twin.
    """
    settings, albedo = _noisy_trace(params), params.shading.albedo
    if traced_together(params):
        truths = render_both(scene, view, settings, albedo, seed)
        color, shading = truths.color, truths.shading
        half = truths.halves.get("color", color[0])
    else:
        color, shading = (
            render_truth(scene.neutral(grey), view, settings, seed) for grey in (None, albedo)
        )
        half = color[0]  # of all samples
    reflectance, normal = sample_guides(scene, view)
    clean = denoise(color[0], reflectance, normal, around=view.is_panorama)
    image, stats = shading
    grey = denoise(image, grey_guide(normal, albedo), normal, around=view.is_panorama)
    channels = {
        **_samples(color[0], half, clean),
        **_named(NOISY_SHADING, image),
        **_named(DENOISED_SHADING, grey),
    }
    lost = max(color[1]["lost_pixels"], stats["lost_pixels"])
    return channels, {**color[1], "lost_pixels": lost, "denoiser": denoiser_version()}


def render_samples(
    scene: RenderScene,
    view: View,
    params: Params,
    seed: int,
    prepared: Preparation | None = None,
) -> Channels:
    """Render the channels of colour in a `noisy` frame, for a picture rather than for a frame.

    Colour is traced alone, so its samples are others than those of `render_noisy`. `prepared`:
    what `prepare` returns for this view, if it is known already.
    """
    color, half, clean = trace_denoised(scene, view, _noisy_trace(params), seed, prepared)
    return _samples(color, half, clean)


def trace_denoised(
    scene: RenderScene,
    view: View,
    settings: GroundTruthParams,
    seed: int,
    prepared: Preparation | None = None,
    quality: Quality = "high",
) -> tuple[Channels, Channels, Channels]:
    """Path-trace colour alone: the image, that of every second block, and the image denoised.

    Guides cost less than few samples do. In a scalar variant the first two are the same.
    `prepared` as in `render_samples`, `quality` the denoiser's.
    """
    if integrator.available():
        lights = prepared.lights if prepared else None
        color, half = render_color(scene, view, settings, seed, lights)
    else:
        color, _ = render_truth(scene.neutral(None), view, settings, seed)
        half = color
    guided = prepared.guides if prepared else sample_guides(scene, view)
    clean = denoise(color, *guided, quality, view.is_panorama)
    return color, half, clean


def _samples(color: Channels, half: Channels, clean: Channels) -> Channels:
    """Return the channels of colour in a `noisy` frame."""
    return {**color, **_named(HALF, half), **_named(DENOISED, clean)}


def _named(names: Sequence[str], image: Channels) -> Channels:
    """Return the bands of an image under other names."""
    return {name: image[band] for name, band in zip(names, RGB, strict=True)}


def _noisy_trace(params: Params) -> GroundTruthParams:
    """Return the parameters of the ground truth, with few samples."""
    spp = params.noisy.spp
    return replace(params.groundtruth, spp=spp, block_spp=spp, noise=0.0, denoise="none")


def traced_together(params: Params) -> bool:
    """Test whether colour and shading come from one trace: requested, and supported here."""
    return params.groundtruth.joint and integrator.available()


def _has_twin(scene: RenderScene, params: Params) -> bool:
    try:
        scene.twins(params.shading.albedo)
    except InputError:
        return False
    return True


def postprocessed(
    kind: Kind,
    truth: Result,
    scene: RenderScene,
    view: View,
    params: Params,
    half: Channels | None = None,
) -> Result:
    """Return a traced image as its pass stores it: denoised, if the parameters say so.

    `half` is the image of half of its blocks.
    """
    if params.groundtruth.denoise == "none":
        return truth
    return _denoised(kind, truth, guides(scene, view), view, params, half)


def _denoised(
    kind: Kind,
    truth: Result,
    guided: Guides | None,
    view: View,
    params: Params,
    half: Channels | None = None,
) -> Result:
    """Return a traced image after the denoiser, given its guides; as it is without them.

    With `half` also an estimate of the noise that is left, see `residual_noise`.
    """
    if guided is None:
        return truth
    channels, stats = truth
    albedo, normal = guided
    if kind == "shading":
        albedo = grey_guide(normal, params.shading.albedo)
    clean = denoise(channels, albedo, normal, around=view.is_panorama)
    stats = {**stats, "denoiser": denoiser_version()}
    if half is not None:
        # The quality `fast` gives the same figure within a fifth, in half the time of `high`.
        whole, part = (
            denoise(image, albedo, normal, "fast", view.is_panorama) for image in (channels, half)
        )
        stats["residual_noise"] = residual_noise(whole, part, stats["blocks"])
    return clean, stats


def _panorama_determined_by(params: Params) -> dict[str, Any]:
    return {name: v for name, v in plain(params.illumination).items() if name != "shadow_rays"}


def _truth_determined_by(params: Params) -> dict[str, Any]:
    used = params.groundtruth.denoise != "none"
    return {
        "truth": plain(params.groundtruth, brief=True),
        "denoiser": [denoiser_version(), key("inputs")] if used else None,
    }


def _color_determined_by(params: Params) -> dict[str, Any]:
    # In a joint trace, Russian roulette depends on the neutral twin.
    twin = {"shading": plain(params.shading)} if params.groundtruth.joint else {}
    return {**_truth_determined_by(params), **twin}


def _light_determined_by(params: Params) -> dict[str, Any]:
    return {
        **_color_determined_by(params),
        "light": plain(params.light),
        "made_of": [key("groundtruth"), key("inputs")],
    }


def _transport_determined_by(params: Params) -> dict[str, Any]:
    guided = {"denoiser": denoiser_version(), "guides": key("guides")}
    return {**plain(params.transport), **guided}


def _noisy_determined_by(params: Params) -> dict[str, Any]:
    trace, shading = _noisy_trace(params), plain(params.shading)
    used = ("spp", "max_depth", "rr_depth", "joint", "lights")
    return {
        "trace": {name: getattr(trace, name) for name in used},
        "guides": key("guides"),
        "halves": True,
        "shading": shading,
        "denoiser": [denoiser_version(), key("inputs")],
    }


def _environment_determined_by(params: Params) -> dict[str, Any]:
    truth = params.groundtruth
    used = ("block_spp", "max_depth", "rr_depth", "lights", "denoise")
    return {
        **plain(params.environment),
        "trace": {name: getattr(truth, name) for name in used},
        "made_of": [key("groundtruth"), key("inputs")],
        "denoiser": denoiser_version() if truth.denoise != "none" else None,
    }


PASSES: dict[Kind, Pass] = {
    "inputs": Pass("inputs", lambda params: {}, _inputs),
    "illumination": Pass("illumination", _panorama_determined_by, _illumination),
    "visibility": Pass(
        "visibility",
        lambda params: {
            **plain(params.illumination),
            "made_of": [key("inputs"), key("illumination")],
        },
        _visibility,
    ),
    "shading": Pass(
        "groundtruth",
        lambda params: {**_truth_determined_by(params), "shading": plain(params.shading)},
        _truth("shading"),
        seeded=True,
    ),
    "color": Pass(
        "groundtruth",
        _color_determined_by,
        _truth("color"),
        seeded=True,
    ),
    "materials": Pass("materials", lambda params: {"made_of": [key("inputs")]}, _materials),
    "labels": Pass("labels", lambda params: {"made_of": [key("inputs")]}, _labels),
    "video": Pass("video", lambda params: {"made_of": [key("inputs")]}, _video),
    "environment": Pass("environment", _environment_determined_by, _environment, seeded=True),
    "transport": Pass("transport", _transport_determined_by, _transport, seeded=True),
    "light": Pass("light", _light_determined_by, _light, seeded=True),
    "noisy": Pass("groundtruth", _noisy_determined_by, render_noisy, seeded=True),
}


def pass_seed(kind: Kind, view: View, root: int) -> int:
    """Return the seed of one pass over one view, derived from the root seed.

    Shading, colour and light share a seed, because they come from one trace. Noisy frames have
    their own: a network that sees the ground truth's own samples would learn its noise.
    """
    name = "truth" if kind in TRACED else kind
    return derive(root, "scene", view.scene_id, "view", view.view_id, name)


def camera_of(view: View, kind: Kind) -> View:
    """Return the part of a view that determines pixels: without its score and object counts.

    The neighbours in a trajectory determine frames of `video` alone.
    """
    camera = replace(view, score=0.0, seen={}, stereo_partner="", stereo_offset=0.0)
    camera = replace(camera, view_set="", set_overlap=0.0)
    if kind == "video":
        return camera
    return replace(camera, trajectory="", frame=-1, pose_before=(), pose_after=())


def frame_fingerprint(
    kind: Kind, view: View, params: Params, scene_digest: str, renderer: str
) -> str:
    """Return the fingerprint of a frame; see this module's docstring."""
    render_pass = PASSES[kind]
    return fingerprint(
        kind=kind,
        key=key(render_pass.key),
        params=render_pass.determined_by(params),
        view=camera_of(view, kind),
        scene=scene_digest,
        renderer=renderer,
        seed=pass_seed(kind, view, params.seed) if render_pass.seeded else None,
    )
