"""Inputs and outputs of `pbrnet predict`: views from a scene or from frames, images, radiance.

Path tracing is only used for the truth, if it is compared with the prediction, and for methods that
take noisy samples. Light transport is computed for the methods that take it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from itertools import product
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from pbrnet.model.methods import METHODS, Method
from pbrnet.pipeline.channels import RGB, TRUTHS, Kind, channels_of, column_channel
from pbrnet.pipeline.frames import (
    Channels,
    Frame,
    Result,
    check_frame,
    frame_path,
    read_frame,
    read_meta,
    view_of,
    write_pixels,
)
from pbrnet.pipeline.images import Picture, contact_sheet, error_picture, reflectance_picture
from pbrnet.pipeline.params import Params
from pbrnet.pipeline.passes.registry import QUICK, render, settings_of
from pbrnet.pipeline.passes.settings import NoisyParams
from pbrnet.pipeline.photograph import meter, photograph
from pbrnet.pipeline.render.scene import RenderScene, free_memory, open_scene, set_variant
from pbrnet.pipeline.tonemap import Exposure, ToneParams, exposure_of, tonemap
from pbrnet.pipeline.views import View
from pbrnet.scenes.arrays import AnyArray
from pbrnet.scenes.checked import plain
from pbrnet.scenes.contract import load_scene
from pbrnet.scenes.errors import InputError, ParameterError
from pbrnet.scenes.seeds import derive

if TYPE_CHECKING:  # with torch, which light transport does without
    from pbrnet.model.data.reader import Example
    from pbrnet.model.evaluation.inference import Networks, Prediction
    from pbrnet.model.training.store import ModelCard

_SHADOWS = (
    "pbrnet illumination, with illumination.shadow_rays above 0, renders visibility beside it"
)
Loader = Callable[["ModelCard"], "Example"]  # takes the card of the network that gets the example


@dataclass(frozen=True)
class ViewSource:
    """A view to predict; `load` renders or reads its images for a network."""

    view: View
    load: Loader


@dataclass(frozen=True)
class Rendered:
    """Frames of a view by kind, and the samples per pixel of `noisy`."""

    frames: Mapping[Kind, Channels]
    noisy_spp: int = 0


@dataclass
class ViewRenderer:
    """Renders views of a scene, which is opened for the first of them: for networks, and truth.

    `source` is the scene's folder, or the open scene; true images may be below `data`.
    """

    source: Path | RenderScene
    params: Params
    data: Path | None = None

    @cached_property
    def scene(self) -> RenderScene:
        """The open scene."""
        if isinstance(self.source, RenderScene):
            return self.source
        set_variant(self.params.farm.variant)
        return open_scene(load_scene(self.source))

    def truth(self, view: View) -> tuple[Channels, Channels]:
        """Shading and colour of a view: those in `data`, or path traced now."""
        frames = known_truth(self.data, view) if self.data else None
        if frames:
            return _channels(frames)
        seed = derive(self.params.seed, "predict", view.scene_id, view.view_id)
        truths = render(self.scene, view, settings_of(self.params, TRUTHS), seed)
        return truths["shading"][0], truths["color"][0]

    def inputs(self, view: View, cards: Sequence[ModelCard], samples: int = 0) -> Rendered:
        """Inputs of a view that the networks of these cards require.

        A network that takes noisy samples gets `samples` per pixel; 0: the median of its training.
        """
        methods = [METHODS[card.name] for card in cards if card.name in METHODS]
        taken: dict[Kind, list[str]] = {"inputs": [], **columns_taken(methods, cards)}
        trained_with = max((card.training.get("noisy_spp", 0) for card in cards), default=0)
        spp = trained_with and (samples or trained_with)
        params = replace(self.params, noisy=NoisyParams(spp))
        frames: dict[Kind, Result] = {}
        for trace in QUICK:
            settings = {
                kind: own or taken[kind]  # surfaces have no settings but the columns
                for kind, own in trace.settings(params).items()
                if kind in taken and (spp or kind != "noisy")
            }
            if settings:
                frames |= trace.render(self.scene, view, settings, params.seed)
        return Rendered({kind: channels for kind, (channels, _) in frames.items()}, spp)


@dataclass
class Renderers:
    """Renderers of views by their scenes' folders; only the last scene stays open."""

    open: Callable[[Path], ViewRenderer]
    folders: Mapping[str, Path]
    _last: ViewRenderer | None = field(default=None, init=False)

    def of(self, view: View) -> ViewRenderer:
        """Renderer of a view's scene."""
        scene = self.folders[view.scene_id]
        if self._last is None or self._last.source != scene:
            if self._last is not None:
                self._last = None
                free_memory()
            self._last = self.open(scene)
        return self._last


def from_scenes(
    renderers: Renderers, views: Sequence[View], with_truth: bool, samples: int = 0
) -> list[ViewSource]:
    """Views of scenes; what the network takes is rendered, see `ViewRenderer`."""

    def load(view: View, card: ModelCard) -> Example:
        renderer = renderers.of(view)
        truth = renderer.truth(view) if with_truth else None
        return example_of(view, renderer.inputs(view, [card], samples), card, truth)

    return [ViewSource(view, partial(load, view)) for view in views]


def from_frames(paths: Mapping[Kind, Path], truth: Path | None = None) -> ViewSource:
    """A view from its frames by kind; `truth` is the data folder to read its true images from.

    Raises `InputError` for frames that are missing, damaged, or of different views; loading raises
    `ParameterError` for a network that takes others.
    """
    first = next(iter(paths.values()))
    view = view_of(read_meta(first), first)
    for path in list(paths.values())[1:]:
        other = view_of(read_meta(path), path)
        if (view.scene_id, view.view_id) != (other.scene_id, other.view_id):
            raise InputError(
                f"the frames are of different views: {first} of {view.view_id!r} and "
                f"{path} of {other.view_id!r}"
            )

    def load(card: ModelCard) -> Example:
        lacking = columns_taken([METHODS[card.name]], [card]).keys() - paths.keys()
        if lacking:
            raise ParameterError(
                f"{card.name} also takes frames of {' and '.join(sorted(lacking))}: give their "
                "paths, predict from the SCENE, or choose another --method"
                + (f"; {_SHADOWS}" if "visibility" in lacking else "")
            )
        frames = {kind: read_frame(path) for kind, path in paths.items()}
        for kind, frame in frames.items():
            size = None if kind == "illumination" else (view.width, view.height)
            check_frame(frame, paths[kind], _needed_bands(kind), size)
        known = known_truth(truth, view) if truth else None
        if truth and known is None:
            raise InputError(
                f"{truth}: no shading and colour frames of {view.scene_id}/{view.view_id} for "
                "--compare; render them, or predict from the scene"
            )
        spp = _samples_of(frames["noisy"]) if "noisy" in frames else 0
        given = Rendered({kind: frame.channels for kind, frame in frames.items()}, spp)
        return example_of(view, given, card, _channels(known) if known else None)

    return ViewSource(view, load)


def _needed_bands(kind: Kind) -> tuple[str, ...]:
    """Channels of a kind of frame that networks take."""
    columns = columns_taken(METHODS.values()).get(kind, [kind])
    return tuple(band for name in columns for band in column_channel(name).bands)


def columns_taken(
    methods: Iterable[Method], cards: Sequence[ModelCard] | None = None
) -> dict[Kind, list[str]]:
    """Image columns that these methods take, by kind of frame.

    With `cards`, optional inputs only if one of the networks was trained with them.
    """
    from pbrnet.model.data.encoding import input_named
    from pbrnet.model.data.reader import NOISY_SPP

    def taken(name: str) -> bool:
        if cards is None or not input_named(name).optional:
            return True
        return any(card.training.get(name) for card in cards)

    joins = sorted({card.architecture.panorama for card in cards or ()}) or ["normal"]
    names = [
        name
        for method, join in product(methods, joins)
        for name in method.inputs_with(join)
        if taken(name)
    ]
    found: dict[Kind, list[str]] = {}
    columns = dict.fromkeys(column for name in names for column in input_named(name).columns)
    for column in columns:
        if column not in (NOISY_SPP, "K"):
            found.setdefault(column_channel(column).kind, []).append(column)
    return found


def known_truth(data: Path, view: View) -> tuple[Frame, Frame] | None:
    """Shading and colour frames of this camera at this size below `data`, or None."""
    paths = (frame_path(data, "shading", view), frame_path(data, "color", view))
    if not all(path.is_file() for path in paths):
        return None
    frames = (read_frame(paths[0]), read_frame(paths[1]))
    for path, frame in zip(paths, frames, strict=True):
        stored = view_of(frame.meta, path)
        same = (
            (stored.width, stored.height) == (view.width, view.height)
            and np.allclose(stored.intrinsics, view.intrinsics)
            and np.allclose(stored.pose, view.pose)
        )
        if not same:
            return None
        check_frame(frame, path, RGB, (view.width, view.height))
    return frames


def compare(networks: Networks, example: Example, predicted: Prediction) -> tuple[Picture, str]:
    """Contact sheet of prediction, truth and FLIP error, and a line of metrics.

    Images are photographed alike, with the settings of the truth; metrics are those of display
    values, as in evaluation.
    """
    from pbrnet.model.data.encoding import color_exposure
    from pbrnet.model.evaluation.metrics import flip_map, measure

    exposure = color_exposure(example, networks.card.exposure)
    truth = tonemap(example["color"], exposure)
    values = measure(truth, predicted.color)
    settings = meter(example["color"])
    linear = networks.radiance(example, predicted)
    shown = {
        "prediction": photograph(linear.color, settings),
        "truth": photograph(example["color"], settings),
        f"FLIP error, mean {values['flip']:.3f}": error_picture(flip_map(truth, predicted.color)),
    }
    settings = meter(example["shading"])
    if linear.shading is not None:
        shown["predicted shading"] = photograph(linear.shading, settings)
    shown["true shading"] = photograph(example["shading"], settings)
    shown["reflectance"] = reflectance_picture(example["reflectance"])
    picture = contact_sheet(list(shown.values()), columns=3, labels=tuple(shown))
    words = f"SSIM {values['ssim']:.3f}, PSNR {values['psnr']:.1f} dB, FLIP {values['flip']:.3f}"
    return picture, words


def write_radiance(
    path: Path,
    facts: dict[str, Any],
    networks: Networks,
    view: View,
    example: Example,
    predicted: Prediction,
) -> str:
    """Write linear radiance as OpenEXR by rename; returns a message about unit and clipping.

    Channels: `R`, `G`, `B`, float32; `shading.R/G/B` if the method predicts shading; `clipped`, 1
    where the prediction is white and the radiance therefore a lower bound. `facts` are added to the
    metadata.
    """
    linear = networks.radiance(example, predicted)
    pixels: Channels = {band: linear.color[..., i].copy() for i, band in enumerate(RGB)}
    if linear.shading is not None:
        pixels |= {f"shading.{band}": linear.shading[..., i].copy() for i, band in enumerate(RGB)}
    pixels["clipped"] = linear.clipped.astype(np.float16)
    key = networks.card.tone["key"]
    whose = "shading's" if networks.card.exposure == "shared" else "the picture's"
    unit = "the scene's" if linear.known else f"{whose} log-average luminance is {key:g}"
    share = float(linear.clipped.mean())
    meta = {
        "kind": "prediction",
        "method": predicted.method,
        "unit": unit,
        "exposure": plain(linear.exposure),
        "weights": {name: card.sha256 for name, card in networks.cards.items()},
        "clipped_share": share,
        **facts,
    }
    write_pixels(path, pixels, view, meta)
    return f"unit: {unit}; {share:.2%} of the pixels are white: their values are lower bounds"


def images_of(kind: Kind, channels: Channels) -> dict[str, AnyArray]:
    """Images by column of the channels that a frame holds, as an `Example` has them."""
    images = {
        channel.name: _stack(channels, channel.bands)
        for channel in channels_of(kind)
        if channel.in_dataset and channels.keys() >= set(channel.bands)
    }
    if "valid" in images:
        images["valid"] = images["valid"] > 0
    return images


def example_of(
    view: View,
    given: Rendered,
    card: ModelCard,
    truth: tuple[Channels, Channels] | None,
) -> Example:
    """Example for the networks, from the channels of frames.

    Without `truth` the true images are black, and their exposure has scale 1 and the median white
    point of the training data. Without a panorama no light is visible.
    """
    from pbrnet.model.data.reader import Example

    dark = np.zeros((1, 2), np.float32)
    images: dict[str, AnyArray] = {"intensity": dark, "distance": dark}
    for kind, channels in given.frames.items():
        images |= images_of(kind, channels)
    if given.noisy_spp:
        images["noisy_spp"] = np.array(given.noisy_spp, np.float32)
    black = np.zeros((*images["depth"].shape, 3), np.float32)
    shading, color = (_stack(images, RGB) for images in truth) if truth else (black, black)
    tone = ToneParams(**card.tone)
    unknown = Exposure(1.0, card.white)
    return Example(
        scene_id=view.scene_id,
        view_id=view.view_id,
        images={**images, "shading": shading, "color": color},
        intrinsics=view.intrinsics,
        exposure_shading=exposure_of(shading, tone) if truth else unknown,
        exposure_color=exposure_of(color, tone) if truth else unknown,
    )


def _samples_of(frame: Frame) -> int:
    """Samples per pixel of a frame of noisy samples; 1 if it does not tell."""
    found = frame.meta.get("spp")
    return found if isinstance(found, int) and found > 0 else 1


def _channels(frames: tuple[Frame, Frame]) -> tuple[Channels, Channels]:
    return frames[0].channels, frames[1].channels


def _stack(channels: Channels, names: tuple[str, ...]) -> AnyArray:
    """Channels as float32 (H, W), or (H, W, C) if there are several."""
    bands = [channels[name].astype(np.float32) for name in names]
    return bands[0] if len(bands) == 1 else np.stack(bands, axis=-1)
