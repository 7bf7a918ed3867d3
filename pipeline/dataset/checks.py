"""Checks that reject views from the dataset, each with a named reason and its measured value.

`load_frames` reads a view's frames and reports missing or damaged ones; `check_surfaces` and
`check_light` are pure functions of pixels and limits. Every rejected view is listed in
`rejected.csv`.

A panorama without any light is not rejected: a room lit through an open door is a valid view, and
the dataset card counts such views.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from pbrnet.pipeline.channels import HALF_MAX, SURFACES, TRUTHS, Kind, channels_of, layout
from pbrnet.pipeline.dataset.agreement import (
    environment_fault,
    flow_fault,
    label_fault,
    material_fault,
)
from pbrnet.pipeline.dataset.light import light_fault
from pbrnet.pipeline.dataset.settings import CheckParams
from pbrnet.pipeline.frames import EXPOSURE_TIME, Channels, Frame, frame_path, read_frame
from pbrnet.pipeline.views import View
from pbrnet.scenes.arrays import Float32Array
from pbrnet.scenes.checked import plain, shown
from pbrnet.scenes.color import luminance
from pbrnet.scenes.errors import InputError
from pbrnet.scenes.files import read_json

Size = tuple[int, int]  # width, height
Frames = dict[Kind, Frame]

REASONS = {
    "failed": "rendering failed, and failed again when retried",
    "missing": "a frame is not there",
    "damaged": "a frame cannot be read, or its pixels do not match their checksum",
    "stale": "a frame was rendered for another camera than the one listed now",
    "size": "the frames do not have the size that this dataset has",
    "not_finite": "NaN or infinity in a channel, or in all samples of a pixel",
    "negative": "a negative radiance, depth or distance",
    "inconsistent": "depth or normal make no sense where a surface is seen, or differ between the "
    "view and its panorama",
    "mislabelled": "materials or labels do not agree with what is seen",
    "misaligned": "flow or occlusion do not agree with depth and cameras",
    "light": "the parts of the light do not add up to color",
    "few_surfaces": "too few pixels see a surface",
    "black": "too many pixels without any light",
    "blown_out": "too many pixels at the limit of half floats",
    "noise": "the noise estimate is above the limit",
    "walk": "another frame of its walk is rejected, and dataset.checks.whole_walks is true",
    "fireflies": "too many pixels far brighter than all around them, or too much of the light",
}

# A firefly outshines its neighbours this many times, where they count for at least so much.
_FIREFLY_RATIO = 16.0
_FIREFLY_FLOOR = 0.5  # of the image's mean luminance


@dataclass(frozen=True)
class Rejection:
    """Reason for which a view is rejected: a key of `REASONS`, and the measured values."""

    reason: str
    detail: str

    def __post_init__(self) -> None:
        if self.reason not in REASONS:
            raise ValueError(f"{self.reason!r} is not a known reason")


def read_failures(data: Path) -> dict[tuple[str, str], str]:
    """Return the failures of the rendering stages: (scene_id, view_id) -> stage and message.

    Reads `data/failures/*.json`, each a list of objects with `scene_id`, `view_id`, `error`.
    Entries without a view concern a whole scene and are left to the stage's own report.
    """
    failures: dict[tuple[str, str], str] = {}
    for path in sorted((Path(data) / "failures").glob("*.json")):
        content = read_json(path)
        entries = content.get("failures", []) if isinstance(content, dict) else content
        if not isinstance(entries, list) or not all(isinstance(entry, dict) for entry in entries):
            raise InputError(f"{path}: expected a list of failures; delete it and render again")
        for entry in entries:
            if entry.get("view_id"):
                key = (str(entry.get("scene_id", "")), str(entry["view_id"]))
                failures.setdefault(key, f"{path.stem}: {entry.get('error', 'no message')}")
    return failures


def load_frames(
    data: Path, view: View, failures: Mapping[tuple[str, str], str], kinds: Sequence[Kind]
) -> Frames | Rejection:
    """Read and verify a view's frames of these kinds, or return the reason of its rejection.

    A sound frame counts, even if an earlier run listed the view as failed.
    """
    frames: Frames = {}
    for kind in kinds:
        path = frame_path(data, kind, view)
        if not path.exists():
            failure = failures.get((view.scene_id, view.view_id))
            if failure:
                return Rejection("failed", _one_line(failure))
            return Rejection("missing", f"no {kind} frame")
        try:
            frame = read_frame(path)
        except InputError as error:
            # Without the path: the list must not depend on where the data lie.
            message = str(error).removeprefix(f"{path}: ").replace(str(path), path.name)
            return Rejection("damaged", f"{kind}: {_one_line(message)}")
        if frame.meta.get("kind") != kind:
            return Rejection(
                "damaged", f"{kind}: contains a frame of kind {shown(frame.meta.get('kind'))}"
            )
        names = frame.meta.get("light_names")
        expected = layout(kind, len(names) if isinstance(names, list) else 0)
        missing = [name for name in expected if name not in frame.channels]
        if missing:
            return Rejection("damaged", f"{kind}: the channel {missing[0]!r} is missing")
        frames[kind] = frame
    return frames


def check_light(
    view: View,
    frames: Mapping[Kind, Frame],
    sizes: Mapping[Kind, Size],
    limits: CheckParams,
    lights: int,
) -> Rejection | None:
    """Return the first reason to reject the frames with light, or None.

    `sizes` are (width, height) of the dataset's kinds of frames, `lights` is its number of light
    groups. Noisy frames and panoramas are not rejected for their noise.
    """
    others = {kind: frame for kind, frame in frames.items() if kind not in SURFACES}
    renders = {kind: frames[kind].rgb for kind in TRUTHS if kind in frames}
    stored = {kind: image / frames[kind].radiance_scale for kind, image in renders.items()}
    return (
        _stale(view, others)
        or _wrong_size(others, sizes)
        or _not_finite(others)
        or _negative(others)
        or _elsewhere(view, frames)
        or _unbalanced(frames, lights)
        or _over("black", "pixels are black", renders, black_share, limits.max_black)
        or _over("blown_out", "pixels are at the limit", stored, blown_share, limits.max_blown)
        or _noisy(frames, limits.max_noise)
        or _over("fireflies", "pixels are fireflies", renders, firefly_share, limits.max_fireflies)
        or _chance_light(frames, limits.max_firefly_light)
    )


def check_surfaces(
    view: View,
    frames: Mapping[Kind, Frame],
    size: Size,
    limits: CheckParams,
    neighbours: dict[str, Channels],
) -> Rejection | None:
    """Return the first reason to reject the frames without light, or None.

    `neighbours` holds the inputs of the next (`forward`) and the previous frame of a trajectory,
    where they are known.
    """
    seen = {kind: frames[kind] for kind in SURFACES if kind in frames}
    inputs = frames["inputs"].channels
    return (
        _stale(view, seen)
        or _wrong_size(seen, dict.fromkeys(seen, size))
        or _not_finite(seen)
        or _negative(seen)
        or _inconsistent(inputs)
        or _mislabelled(view, seen)
        or _misaligned(view, seen, neighbours, limits)
        or _few_surfaces(inputs, limits.min_valid)
    )


def surfaces_of(
    data: Path,
    view: View,
    trajectory: Iterable[View],
    failures: Mapping[tuple[str, str], str],
    kinds: Sequence[Kind],
    size: Size,
    limits: CheckParams,
) -> Frames | Rejection:
    """Read the frames without light of a view and check them.

    `trajectory` holds the views of its scene, among them its neighbours.
    """
    frames = load_frames(data, view, failures, [kind for kind in SURFACES if kind in kinds])
    if isinstance(frames, Rejection):
        return frames
    neighbours = _neighbours(data, view, trajectory) if "video" in frames else {}
    return check_surfaces(view, frames, size, limits, neighbours) or frames


def _neighbours(data: Path, view: View, trajectory: Iterable[View]) -> dict[str, Channels]:
    """Return the inputs of the next (`forward`) and the previous frame that can be read.

    A frame that cannot be read is its own view's fault.
    """
    found = {}
    for other in trajectory if view.trajectory else ():
        way = {1: "forward", -1: "backward"}.get(other.frame - view.frame)
        if other.trajectory == view.trajectory and way:
            with suppress(InputError):
                frame = read_frame(frame_path(data, "inputs", other))
                shapes = {values.shape for values in frame.channels.values()}
                if shapes == {(view.height, view.width)} and layout("inputs").keys() <= set(
                    frame.channels
                ):
                    found[way] = frame.channels
    return found


def broken_walks(views: Iterable[View], rejected: Iterable[View]) -> dict[tuple[str, str], int]:
    """Return the walks of which some frames are rejected, by scene and name: how many."""
    counts = Counter(view.walk for view in rejected if view.trajectory)
    lengths = Counter(view.walk for view in views)
    return {walk: count for walk, count in sorted(counts.items()) if count < lengths[walk]}


def black_share(image: Float32Array) -> float:
    """Return the share of pixels of linear RGB (H, W, 3) that are exactly zero."""
    return float((image == 0).all(axis=-1).mean())


def blown_share(image: Float32Array) -> float:
    """Return the share of pixels of linear RGB (H, W, 3) with a channel at half's maximum."""
    return float((image >= HALF_MAX).any(axis=-1).mean())


def firefly_share(image: Float32Array) -> float:
    """Return the share of fireflies among the pixels of linear RGB (H, W, 3).

    A firefly is 16 times brighter than all but two of its eight neighbours, and than half the
    image's mean. This detects speckles of path tracing, but neither the grain of an undersampled
    image, which is `noise`, nor the corner of a bright window, which has three bright neighbours.
    """
    lum = luminance(image)
    height, width = lum.shape
    padded = np.pad(lum, 1, mode="edge")
    around = np.stack(
        [
            padded[row : row + height, column : column + width]
            for row in range(3)
            for column in range(3)
            if (row, column) != (1, 1)
        ]
    )
    third_brightest = np.partition(around, 5, axis=0)[5]
    around_it = np.maximum(third_brightest, _FIREFLY_FLOOR * lum.mean())
    return float((lum > _FIREFLY_RATIO * around_it).mean())


def noise_of(frame: Frame) -> float | None:
    """Return a rendered frame's relative noise estimate, or None if it has none."""
    return _figure(frame, "noise")


def _figure(frame: Frame, name: str) -> float | None:
    value = frame.meta.get(name)
    return float(value) if isinstance(value, (int, float)) else None


def _stale(view: View, frames: Mapping[Kind, Frame]) -> Rejection | None:
    for kind, frame in frames.items():
        stated = frame.meta.get("view")
        made_for: dict[str, Any] = stated if isinstance(stated, dict) else {}
        for key in ("scene_id", "view_id"):
            if made_for.get(key) != getattr(view, key):
                return Rejection("stale", f"{kind}: its {key} is {shown(made_for.get(key))}")
        moves = kind == "video" or EXPOSURE_TIME in frame.meta
        neighbours = ("pose_before", "pose_after") if moves else ()
        for key in ("camera_to_world", "K", "projection", "distortion", *neighbours):
            rendered_with = made_for.get(key, getattr(View, key, ()))
            if plain(rendered_with) != plain(getattr(view, key)):
                return Rejection("stale", f"{kind}: rendered with another {key}; render it again")
    return None


def _wrong_size(frames: Mapping[Kind, Frame], sizes: Mapping[Kind, Size]) -> Rejection | None:
    for kind, frame in frames.items():
        expected = sizes[kind]
        for name, values in frame.channels.items():
            if values.shape != expected[::-1]:
                found = "x".join(map(str, values.shape[::-1]))
                wanted = f"{expected[0]}x{expected[1]}"
                return Rejection("size", f"{kind}: {name} is {found}, the dataset's is {wanted}")
    return None


def _not_finite(frames: Mapping[Kind, Frame]) -> Rejection | None:
    for kind, frame in frames.items():
        for name, values in frame.channels.items():
            wrong = values.size - int(np.isfinite(values).sum())
            if wrong:
                return Rejection("not_finite", f"{kind}: {wrong} pixels of {name}")
        lost = frame.meta.get("lost_pixels", 0)  # the path tracer found no finite sample there
        if lost:
            return Rejection("not_finite", f"{kind}: {lost} pixels without any finite sample")
    return None


def _negative(frames: Mapping[Kind, Frame]) -> Rejection | None:
    for kind, frame in frames.items():
        for channel in channels_of(kind):
            lowest = min(float(frame.channels[band].min()) for band in channel.bands)
            if channel.nonnegative and lowest < 0:
                return Rejection("negative", f"{channel.name}: down to {lowest:.4g}")
    return None


def _inconsistent(inputs: Channels) -> Rejection | None:
    valid = inputs["valid"] > 0
    if not valid.any():
        return None
    flat = float((inputs["Z"][valid] <= 0).mean())
    if flat > 0:
        return Rejection("inconsistent", f"{flat:.1%} of the surface pixels have no depth")
    lengths = np.sqrt(sum(inputs[f"N.{axis}"][valid].astype(np.float32) ** 2 for axis in "XYZ"))
    crooked = float((np.abs(lengths - 1) > 0.01).mean())
    if crooked > 0:
        return Rejection("inconsistent", f"{crooked:.1%} of the normals are not of unit length")
    return None


def _elsewhere(view: View, frames: Mapping[Kind, Frame]) -> Rejection | None:
    if "environment" not in frames:
        return None
    fault = environment_fault(frames["environment"].channels, frames["inputs"].channels, view)
    return Rejection("inconsistent", f"environment: {fault}") if fault else None


def _mislabelled(view: View, frames: Mapping[Kind, Frame]) -> Rejection | None:
    inputs = frames["inputs"].channels
    materials, labels = frames.get("materials"), frames.get("labels")
    if materials is not None and (fault := material_fault(materials, inputs)):
        return Rejection("mislabelled", f"materials: {fault}")
    if labels is not None and (fault := label_fault(labels, materials, inputs, view)):
        return Rejection("mislabelled", f"labels: {fault}")
    return None


def _misaligned(
    view: View, frames: Mapping[Kind, Frame], neighbours: dict[str, Channels], limits: CheckParams
) -> Rejection | None:
    if "video" not in frames:
        return None
    video, inputs = frames["video"].channels, frames["inputs"].channels
    fault = flow_fault(video, inputs, view, neighbours, limits)
    return Rejection("misaligned", f"video: {fault}") if fault else None


def _unbalanced(frames: Mapping[Kind, Frame], lights: int) -> Rejection | None:
    fault = light_fault(frames, lights) if "light" in frames else None
    return Rejection("light", fault) if fault else None


def _few_surfaces(inputs: Channels, least: float) -> Rejection | None:
    share = float((inputs["valid"] > 0).mean())
    if share < least:
        return Rejection("few_surfaces", f"{share:.1%} of the pixels, at least {least:.1%} needed")
    return None


def _over(
    reason: str, what: str, renders: Mapping[Kind, Float32Array], measure: Any, limit: float
) -> Rejection | None:
    for kind, image in renders.items():
        share = measure(image)
        if share > limit:
            return Rejection(reason, f"{kind}: {share:.1%} of the {what}, limit {limit:.1%}")
    return None


def _noisy(frames: Mapping[Kind, Frame], limit: float) -> Rejection | None:
    for kind in (kind for kind in TRUTHS if kind in frames):
        noise = noise_of(frames[kind])
        if noise is not None and not noise <= limit:
            return Rejection("noise", f"{kind}: relative noise {noise:.3g}, limit {limit:.3g}")
    return None


def _chance_light(frames: Mapping[Kind, Frame], limit: float) -> Rejection | None:
    for kind in (kind for kind in TRUTHS if kind in frames):
        share = _figure(frames[kind], "firefly_light")
        if share is not None and not share <= limit:
            message = f"{kind}: {share:.1%} of the light is in fireflies, limit {limit:.1%}"
            return Rejection("fireflies", message)
    return None


def _one_line(text: str) -> str:
    return " ".join(text.split())[:300]
