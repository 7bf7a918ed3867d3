"""An image through the trained networks, from a scene and a camera or from frames.

Nothing is path traced, unless the truth is asked for beside the prediction, or the method takes
a few noisy samples.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from model.data import Array, Example
from model.encoding import color_exposure
from model.inference import Networks, likely_exposure
from model.methods import METHODS
from model.metrics import flip_map, measure
from pipeline.frames import NOISY_SHADING, RGB, Channels, Frame, frame_path, read_frame
from pipeline.illumination import render_illumination
from pipeline.inputs import render_inputs
from pipeline.params import NoisyParams, Params, ToneParams
from pipeline.passes import render_noisy, render_truths
from pipeline.pictures import Picture, contact_sheet, error_picture, reflectance_picture
from pipeline.renderer import RenderScene, open_scene, set_variant
from pipeline.tonemap import exposure_of, to_bytes, tonemap
from pipeline.views import View, as_matrix, load_cameras
from scenes.contract import load_scene
from scenes.errors import InputError
from scenes.seeds import derive

PAIR = "pbrnet"  # the shading network, then the composition network


@dataclass(frozen=True)
class Prediction:
    """Display values, float32 (H, W, 3)."""

    shading: Array
    color: Array


def predict(networks: Networks, example: Example, method: str = PAIR) -> Prediction:
    """Shading and colour of one view by both networks, or by another method of the registry.

    Its true images are not looked at; only, where they are known, radiance is displayed with
    their exposures, and else by its own log average.
    """
    if method == PAIR:
        shading = networks.predict_shading(example)
        return Prediction(shading, networks.predict_color(example, shading))
    if not METHODS[method].noisy:
        color = networks.predict_directly(method, example)
        return Prediction(networks.predict_shading(example), color)
    linear = networks.predict_radiance(method, example)
    if not example.color.any():
        tone = ToneParams(**networks.card.tone)
        own = [exposure_of(image, tone) for image in linear]
        example = replace(example, exposure_shading=own[0], exposure_color=own[1])
    exposure = color_exposure(example, networks.card.exposure)
    return Prediction(tonemap(linear[0], example.exposure_shading), tonemap(linear[1], exposure))


def from_frames(
    inputs: Frame,
    illumination: Frame,
    networks: Networks,
    truth: tuple[Frame, Frame] | None = None,
    noisy: Frame | None = None,
) -> Example:
    """A view from its frames; `truth` is shading and colour where they are known, `noisy` the
    frame of few samples for a method that takes it."""
    pair = (truth[0].channels, truth[1].channels) if truth else None
    frames = [frame for frame in (inputs, illumination, noisy) if frame is not None]
    names = {frame.meta.get("view", {}).get("view_id"): None for frame in frames}
    if len(names) > 1:
        found = " and ".join(repr(name) for name in names)
        raise InputError(f"the frames are of different views: {found}")
    view = inputs.meta["view"]
    return _example(
        (view["scene_id"], view["view_id"]),
        np.asarray(view["K"], dtype=np.float64).reshape(3, 3),
        inputs.channels,
        illumination.channels,
        networks,
        pair,
        noisy.channels if noisy else None,
    )


def find_view(scene: Path, cameras: Path, view_id: str, size: tuple[int, int] | None) -> View:
    """The named view of a camera file, at another (width, height) if asked for."""
    views = load_cameras(cameras).views
    found = next((view for view in views if view.view_id == view_id), None)
    if found is None:
        known = ", ".join(view.view_id for view in views[:8]) or "none"
        raise InputError(f"{cameras}: no view {view_id!r} (there are: {known})")
    if found.scene_id != load_scene(scene).scene_id:
        raise InputError(f"{cameras}: cameras of {found.scene_id!r}, not of the scene {scene}")
    return resized(found, size) if size else found


def resized(view: View, size: tuple[int, int]) -> View:
    """The same camera with (width, height) pixels: equally wide a view, square pixels.

    Another aspect shows more or less above and below.
    """
    width, height = size
    scale = width / view.width
    camera = view.intrinsics
    camera[:2] *= scale
    camera[1, 2] += 0.5 * (height - scale * view.height)
    return replace(view, width=width, height=height, K=as_matrix(camera))


def from_scene(
    scene_folder: Path,
    view: View,
    params: Params,
    networks: Networks,
    data: Path,
    with_truth: bool = False,
    method: str = PAIR,
) -> Example:
    """Render the inputs and the panorama of a view; the truth is read if it is there, or traced.

    For a method that takes noisy samples so many are traced as it was trained with.
    """
    set_variant(params.farm.variant)
    scene = open_scene(load_scene(scene_folder))
    truth: tuple[Channels, Channels] | None = None
    if with_truth:
        frames = known_truth(data, view)
        truth = (frames[0].channels, frames[1].channels) if frames else _traced(scene, view, params)
    return _example(
        (view.scene_id, view.view_id),
        view.intrinsics,
        render_inputs(scene, view),
        render_illumination(scene, view, params.illumination),
        networks,
        truth,
        _sampled(scene, view, params, networks, method),
    )


def known_truth(data: Path, view: View) -> tuple[Frame, Frame] | None:
    """Shading and colour frames of just this camera at this size below `data`, if both are."""
    paths = (frame_path(data, "shading", view), frame_path(data, "color", view))
    if not all(path.is_file() for path in paths):
        return None
    frames = (read_frame(paths[0]), read_frame(paths[1]))
    for frame in frames:
        seen = frame.meta.get("view", {})
        same = (
            seen.get("width") == view.width
            and seen.get("height") == view.height
            and np.allclose(seen.get("K", 0), view.intrinsics)
            and np.allclose(seen.get("camera_to_world", 0), view.pose)
        )
        if not same:
            return None
    return frames


def compare(networks: Networks, example: Example, prediction: Prediction) -> tuple[Picture, str]:
    """Prediction, truth and FLIP error in one picture, and the metrics as a sentence."""
    exposure = color_exposure(example, networks.card.exposure)
    truth = tonemap(example.color, exposure)
    values = measure(truth, prediction.color)
    picture = contact_sheet(
        [
            to_bytes(prediction.color),
            to_bytes(truth),
            error_picture(flip_map(truth, prediction.color)),
            to_bytes(prediction.shading),
            to_bytes(tonemap(example.shading, example.exposure_shading)),
            reflectance_picture(example.reflectance),
        ],
        columns=3,
        labels=(
            *("prediction", "truth", f"FLIP error, mean {values['flip']:.3f}"),
            *("predicted shading", "true shading", "reflectance"),
        ),
    )
    words = f"SSIM {values['ssim']:.3f}, PSNR {values['psnr']:.1f} dB, FLIP {values['flip']:.3f}"
    return picture, words


def _sampled(
    scene: RenderScene, view: View, params: Params, networks: Networks, method: str
) -> Channels | None:
    if method == PAIR or not METHODS[method].noisy:
        return None
    spp = networks.cards[method].training["noisy_spp"]
    seed = derive(params.seed, "predict", view.scene_id, view.view_id, "noisy")
    return render_noisy(scene, view, replace(params, noisy=NoisyParams(spp)), seed)[0]


def _traced(scene: RenderScene, view: View, params: Params) -> tuple[Channels, Channels]:
    seed = derive(params.seed, "predict", view.scene_id, view.view_id)
    truths = render_truths(scene, view, params, seed)
    return truths["shading"][0], truths["color"][0]


def _example(
    name: tuple[str, str],
    intrinsics: Array,
    inputs: Channels,
    illumination: Channels,
    networks: Networks,
    truth: tuple[Channels, Channels] | None,
    noisy: Channels | None = None,
) -> Example:
    depth = inputs["Z"].astype(np.float32)
    card = networks.cards["shading"]
    nothing = np.zeros((*depth.shape, 3), np.float32)
    shading, color = (_stack(images, RGB) for images in truth) if truth else (nothing, nothing)
    tone = ToneParams(**card.tone)
    unknown = likely_exposure(card)
    return Example(
        scene_id=name[0],
        view_id=name[1],
        depth=depth,
        normal=_stack(inputs, ("N.X", "N.Y", "N.Z")),
        reflectance=_stack(inputs, ("albedo.R", "albedo.G", "albedo.B")),
        valid=inputs["valid"] > 0,
        intensity=illumination["intensity.Y"].astype(np.float32),
        distance=illumination["distance.Z"].astype(np.float32),
        intrinsics=intrinsics,
        shading=shading,
        color=color,
        exposure_shading=exposure_of(shading, tone) if truth else unknown,
        exposure_color=exposure_of(color, tone) if truth else unknown,
        noisy_color=_stack(noisy, RGB) if noisy else None,
        noisy_shading=_stack(noisy, NOISY_SHADING) if noisy else None,
    )


def _stack(channels: Channels, names: tuple[str, ...]) -> Array:
    return np.stack([channels[name].astype(np.float32) for name in names], axis=-1)
