"""Ground truth of a view as its frames hold it: traced, denoised, with the parts of its light.

Also `noisy` frames, whose few samples are independent of the ground truth's.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

from pbrnet.pipeline.channels import DENOISED, DENOISED_SHADING, HALF, NOISY_SHADING, RGB, Kind
from pbrnet.pipeline.frames import Channels, Result
from pbrnet.pipeline.lenses.settings import OpticsParams
from pbrnet.pipeline.passes.denoise import (
    Guides,
    Quality,
    denoise,
    denoiser_version,
    grey_guide,
    guides,
)
from pbrnet.pipeline.passes.groundtruth import (
    color_blocks,
    planned_lights,
    render_both,
    render_color,
    render_truth,
    truth_of,
)
from pbrnet.pipeline.passes.light import light_of
from pbrnet.pipeline.passes.settings import (
    GroundTruthParams,
    LightParams,
    NoisyParams,
    ShadingParams,
)
from pbrnet.pipeline.pathtrace import integrator
from pbrnet.pipeline.pathtrace.light_parts import group_lights
from pbrnet.pipeline.pathtrace.light_sampling import PlannedLights
from pbrnet.pipeline.pathtrace.noise import BlockStatistics, residual_noise
from pbrnet.pipeline.pathtrace.optics import Optics, facts_of, optics_of
from pbrnet.pipeline.render.scene import RenderScene
from pbrnet.pipeline.transport.guides import fast_guides, optics_guides
from pbrnet.pipeline.views import View
from pbrnet.scenes.checked import OPTIONAL
from pbrnet.scenes.errors import InputError


@dataclass(frozen=True, kw_only=True)
class _Through:
    """Lens and shutter of a trace of colour; None for a pinhole that stands still."""

    optics: OpticsParams | None = field(default=None, metadata=OPTIONAL)

    @property
    def moves(self) -> bool:
        """True if the camera moves while colour is exposed."""
        return self.optics is not None and self.optics.moves


@dataclass(frozen=True)
class TruthSettings(_Through):
    """Settings of a trace of shading, colour or their light.

    `albedo` is the grey of shading, None for colour that is traced alone; `denoiser` is the
    denoiser's version, None without one; `groups` is the number of lamps with an image of their
    own in a frame of light.
    """

    trace: GroundTruthParams
    albedo: float | None
    denoiser: str | None
    groups: int = 0

    @property
    def joint(self) -> bool:
        """True if colour and shading come from one trace: requested, and supported here."""
        return self.trace.joint and not self.optics and integrator.available()


@dataclass(frozen=True)
class NoisySettings(_Through):
    """Settings of a trace of a `noisy` frame."""

    trace: GroundTruthParams
    albedo: float
    denoiser: str

    @property
    def joint(self) -> bool:
        """As that of `TruthSettings`."""
        return self.trace.joint and integrator.available()


@dataclass(frozen=True)
class Preparation:
    """Guides for the denoiser, and emitter sampling and path guiding of a view.

    `lights` is None where nothing is planned: in a scene without lights, and in a scalar variant.
    """

    guides: Guides
    lights: PlannedLights | None


def prepare(scene: RenderScene, view: View, seed: int) -> Preparation:
    """Prepare a view in the scene's own colours; `seed` is that of the light plan."""
    own = scene.neutral(None)
    planned = integrator.available() and own.mitsuba.emitters()
    lights = planned_lights(own, view, seed) if planned else None
    return Preparation(sample_guides(scene, view), lights)


def sample_guides(scene: RenderScene, view: View) -> Guides:
    """Return guides that cost less than the samples they guide, where the variant has them."""
    if integrator.available() and view.lens.is_pinhole:
        return fast_guides(scene, view)
    return guides(scene, view)


def truth_settings(
    trace: GroundTruthParams,
    shading: ShadingParams,
    light: LightParams,
    optics: OpticsParams | None = None,
) -> dict[Kind, TruthSettings]:
    """Return the settings of shading, colour and light.

    Those of colour in a joint trace hold the grey of shading: Russian roulette depends on the twin.
    With lens or shutter colour has a trace of its own.
    """
    denoiser = None if trace.denoise == "none" else denoiser_version()
    grey = TruthSettings(trace, shading.albedo, denoiser)
    color = grey if trace.joint else replace(grey, albedo=None)
    light_settings = replace(color, groups=light.groups)
    if optics and optics.active:
        color = replace(grey, albedo=None, optics=optics)
    return {"shading": grey, "color": color, "light": light_settings}


def noisy_trace(params: GroundTruthParams, spp: int) -> GroundTruthParams:
    """Return the parameters of a trace with `spp` samples; what it does not read is fixed."""
    return replace(
        params, spp=spp, block_spp=spp, noise=0.0, min_spp=1, train_spp=0, denoise="none"
    )


def noisy_settings(
    truth: GroundTruthParams,
    shading: ShadingParams,
    noisy: NoisyParams,
    optics: OpticsParams | None = None,
) -> dict[Kind, NoisySettings]:
    """Return the settings of a `noisy` frame."""
    trace, through = noisy_trace(truth, noisy.spp), optics if optics and optics.active else None
    return {"noisy": NoisySettings(trace, shading.albedo, denoiser_version(), optics=through)}


def render_truths(
    scene: RenderScene, view: View, settings: Mapping[Kind, TruthSettings], seed: int
) -> dict[Kind, Result]:
    """Render shading, colour and light of a view, those that `settings` names.

    Each has the same bits alone and with the others. Raises `InputError` for a material without
    neutral twin, unless only colour is asked for; and for light, where colour and shading are not
    traced together.
    """
    optics = {kind: own for kind, own in settings.items() if own.optics}
    if optics:
        rest = {kind: own for kind, own in settings.items() if kind not in optics}
        sharp = render_truths(scene, view, rest, seed) if rest else {}
        through = {kind: _render_through(scene, view, own, seed) for kind, own in optics.items()}
        return {kind: {**sharp, **through}[kind] for kind in settings}
    first = next(iter(settings.values()))
    if not first.joint or (set(settings) == {"color"} and not _has_twin(scene, first)):
        if "light" in settings:
            raise InputError(
                "channels: light needs colour and shading in one trace, groundtruth.joint: true "
                "and a variant other than scalar_rgb"
            )
        return {kind: _render_alone(kind, scene, view, own, seed) for kind, own in settings.items()}
    light, groups = settings.get("light"), None
    if light and light.groups:
        home, shapes = scene.scene, scene.geometry.shapes
        form = scene.neutral(None).mitsuba
        groups = group_lights(form, shapes, home.lights, view.room, light.groups)
    albedo = _grey(first)
    truths = render_both(scene, view, first.trace, albedo, seed, light is not None, groups)
    guided = guides(scene, view) if first.denoiser else None
    traced: dict[Kind, Result] = {"shading": truths.shading, "color": truths.color}
    made = {
        kind: _denoised(kind, truth, guided, view, albedo, truths.halves.get(kind))
        for kind, truth in traced.items()
        if kind in settings or (light and kind == "color")
    }
    if light:
        made["light"] = light_of(truths, made["color"][0], guided, groups, view.is_panorama)
    return {kind: made[kind] for kind in settings}


def _render_through(scene: RenderScene, view: View, settings: TruthSettings, seed: int) -> Result:
    """Render colour through a lens and a shutter, in a trace of its own."""
    blocks, optics, facts = _trace_through(scene, view, settings, seed)
    truth = truth_of(blocks, settings.trace)
    guided = optics_guides(scene, view, optics, seed) if settings.denoiser else None
    channels, stats = _denoised("color", truth, guided, view, 0.0, blocks.half_image())
    return channels, stats | facts


def _trace_through(
    scene: RenderScene, view: View, settings: TruthSettings | NoisySettings, seed: int
) -> tuple[BlockStatistics, Optics, dict[str, Any]]:
    """Path-trace colour through the lens and the shutter of the settings.

    Returns its blocks, the optics of this view, and entries of its frame's attribute.
    """
    if settings.optics is None or not integrator.available():
        raise InputError(
            "optics: needs a variant other than scalar_rgb, or f_number, exposure and readout 0"
        )
    optics = optics_of(scene, view, settings.optics)
    blocks = color_blocks(scene, view, settings.trace, seed, optics=optics)
    return blocks, optics, facts_of(optics, settings.optics)


def _render_alone(
    kind: Kind, scene: RenderScene, view: View, settings: TruthSettings, seed: int
) -> Result:
    """Render shading or colour in a trace of its own."""
    form = scene.neutral(settings.albedo if kind == "shading" else None)
    truth = render_truth(form, view, settings.trace, seed)
    return postprocessed(kind, truth, scene, view, settings)


def postprocessed(
    kind: Kind, truth: Result, scene: RenderScene, view: View, settings: TruthSettings
) -> Result:
    """Return a traced image as its frame holds it: denoised, if the settings say so."""
    guided = guides(scene, view) if settings.denoiser else None
    return _denoised(kind, truth, guided, view, settings.albedo or 0.0)


def _grey(settings: TruthSettings) -> float:
    """Return the albedo of shading in a joint trace."""
    if settings.albedo is None:
        raise ValueError("settings of colour alone in a joint trace")
    return settings.albedo


def _has_twin(scene: RenderScene, settings: TruthSettings) -> bool:
    try:
        scene.materials.bases(_grey(settings))
    except InputError:
        return False
    return True


def render_noisy(
    scene: RenderScene, view: View, settings: Mapping[Kind, NoisySettings], seed: int
) -> dict[Kind, Result]:
    """Render the channels of a `noisy` frame, unbiased and denoised, and the statistics of colour.

    Raises `InputError` for a material without neutral twin.
    """
    own = settings["noisy"]
    reflectance, normal = sample_guides(scene, view)
    seen = reflectance, normal
    facts: dict[str, Any] = {}
    if own.joint:
        truths = render_both(scene, view, own.trace, own.albedo, seed)
        color, shading = truths.color, truths.shading
        half = truths.halves.get("color", color[0])
    else:
        color, shading = (
            render_truth(scene.neutral(grey), view, own.trace, seed) for grey in (None, own.albedo)
        )
        half = color[0]  # of all samples
    if own.optics:
        blocks, optics, facts = _trace_through(scene, view, own, seed)
        color = truth_of(blocks, own.trace)
        half = blocks.half_image() or color[0]
        seen = optics_guides(scene, view, optics, seed)
    clean = denoise(color[0], *seen, around=view.is_panorama)
    image, stats = shading
    grey = denoise(image, grey_guide(normal, own.albedo), normal, around=view.is_panorama)
    channels = {
        **_samples(color[0], half, clean),
        **_named(NOISY_SHADING, image),
        **_named(DENOISED_SHADING, grey),
    }
    lost = max(color[1]["lost_pixels"], stats["lost_pixels"])
    stats = {**color[1], "lost_pixels": lost, "denoiser": denoiser_version(), **facts}
    return {"noisy": (channels, stats)}


def render_samples(
    scene: RenderScene,
    view: View,
    settings: GroundTruthParams,
    seed: int,
    prepared: Preparation | None = None,
) -> Channels:
    """Render the channels of colour in a `noisy` frame, for a picture rather than for a frame.

    Colour is traced alone, so its samples are others than those of `render_noisy`. `prepared`:
    what `prepare` returns for this view, if it is known already.
    """
    color, half, clean = trace_denoised(scene, view, settings, seed, prepared)
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


def _denoised(
    kind: Kind,
    truth: Result,
    guided: Guides | None,
    view: View,
    grey: float,
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
        albedo = grey_guide(normal, grey)
    clean = denoise(channels, albedo, normal, around=view.is_panorama)
    stats = {**stats, "denoiser": denoiser_version()}
    if half is not None:
        # The quality `fast` gives the same figure within a fifth, in half the time of `high`.
        whole, part = (
            denoise(image, albedo, normal, "fast", view.is_panorama) for image in (channels, half)
        )
        stats["residual_noise"] = residual_noise(whole, part, stats["blocks"])
    return clean, stats
