"""Figures of rendered views that are known of photographs, too: do homes look photographed?

Everything is measured on what a data folder holds: cameras, scenes and frames of colour, drawn by
`pbrnet.pipeline.photograph`. Counts are of the objects that a view's id image shows (`View.seen`),
or of its labels where there are any, without parts of the building. Beside them stand figures of
real photographs as published, where there are some.
"""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from scipy import stats

from pbrnet.pipeline.dataset.diversity import summary_of
from pbrnet.pipeline.frames import frame_path, read_frame
from pbrnet.pipeline.photograph import photograph
from pbrnet.pipeline.views import View, load_cameras
from pbrnet.scenes.arrays import Float64Array, FloatingArray, UInt8Array
from pbrnet.scenes.color import REC709, decode_srgb, luminance
from pbrnet.scenes.contract import Scene, SceneObject, load_scene
from pbrnet.scenes.errors import InputError
from pbrnet.scenes.importing.semantics import NYU40_NAMES, NYU40_OF_CATEGORY, category_number

_BANDS = (0.02, 0.35)  # cycles a pixel, of the fit to the power spectrum
_BLACK = 3.0  # luma of 255 up to which a pixel is black
_LEAST_PIXELS = 2e-4  # share of a view, from which labels count an object
_SMALL = 0.6  # metres, longest side of the box of a thing
_FIXED = (
    *("lamp", "picture", "curtain", "radiator", "sink", "wash basin", "mirror", "toilet"),
    # furniture, and what belongs to it or to the building
    *("night table", "stool", "table", "chair", "shelf", "cushion", "books", "switch", "cable"),
)
_FITTINGS = (
    *("tap", "smoke detector", "thermostat", "intercom", "vent", "keyboard", "computer mouse"),
    *("pair of shoes", "towel"),
)
_FEW = 5  # rooms of a type, fewer say nothing about repeats
_SMALLEST = 1e-6  # of the brightest pixel, luminance below which logarithms are cut off


@dataclass(frozen=True)
class Measure:
    """A figure of a view: name, axis label, and what is known of photographs with its source."""

    name: str
    label: str
    photographs: str = "no published figure found"


FIGURES = (
    Measure(
        "instances",
        "objects in view, excluding the building",
        "24.2 in NYUv2 (35,064 objects in 1,449 images, Silberman et al. 2012) and 14.2 in "
        "SUN RGB-D (146,617 polygons in 10,335 images, Song et al. 2015), both with the building",
    ),
    Measure("categories", "categories in view"),
    Measure("stops", "spread of log luminance, stops (standard deviation)"),
    Measure("clipped", "share of pixels with a clipped channel"),
    Measure("black", "share of black pixels"),
    Measure("darkest", "luma of the darkest 1 %, of 255"),
    Measure("luma", "mean luma, of 255", "117, from the band means of ImageNet (torchvision)"),
    Measure(
        "slope",
        "slope of the power spectrum",
        "-2.4 on average, -1.6 to -3.0 (amplitudes -1.2, -0.8 to -1.5; Tolhurst et al. 1992); "
        "about -2 (Field 1987, Torralba and Oliva 2003)",
    ),
    Measure("chroma", "mean CIELAB chroma"),
    Measure("hues", "spread of hues, degrees (circular standard deviation)"),
    Measure(
        "kurtosis",
        "kurtosis of differences of log luminance",
        "far above 3, that of a normal distribution (Huang 2000); no figure for rooms found",
    ),
)


@dataclass(frozen=True)
class Realism:
    """Figures of all views, and of all homes together."""

    views: dict[str, Float64Array]  # figure -> values (N,)
    classes: dict[str, float]  # NYU40 class -> share of all pixels
    repeats: list[dict[str, Any]]  # the most frequent things: thing, room type, rooms, share

    def table(self) -> list[dict[str, Any]]:
        """Return a row per figure: quantiles, mean, and what is known of photographs."""
        return [
            {
                "figure": figure.label,
                **summary_of(self.views[figure.name]),
                "photographs": figure.photographs,
            }
            for figure in FIGURES
        ]


def measure(data: Path) -> Realism:
    """Measure all views of a data folder that have a frame of colour.

    Raises `InputError` if there is none.
    """
    scenes: dict[str, Scene] = {}
    found: list[dict[str, float]] = []
    classes: Counter[str] = Counter()
    for path in sorted((data / "cameras").glob("*.json")):
        cameras = load_cameras(path)
        for view in cameras.views:
            frame = frame_path(data, "color", view)
            if not frame.is_file():
                continue
            if cameras.scene_id not in scenes:
                scenes[cameras.scene_id] = load_scene(data / "scenes" / cameras.scene_id)
            scene = scenes[cameras.scene_id]
            seen = _seen(data, view)
            found.append({**counts(seen, scene), **picture_figures(read_frame(frame).rgb)})
            classes += class_pixels(view.seen, scene)
    if not found:
        raise InputError(f"{data}: contains no colour frames to measure")
    total = max(1, sum(classes.values()))
    return Realism(
        {figure.name: np.array([view[figure.name] for view in found]) for figure in FIGURES},
        {name: pixels / total for name, pixels in classes.most_common()},
        repeats(scenes.values()),
    )


def picture_figures(color: FloatingArray) -> dict[str, float]:
    """Return the figures of one picture from its linear radiance (H, W, 3)."""
    picture = photograph(color)
    luma = picture.astype(np.float64) @ REC709
    logs = _log2(luminance(np.asarray(color, dtype=np.float64)))
    chroma, hues = _chroma_and_hues(picture)
    return {
        "stops": float(logs.std()),
        "clipped": float((picture == 255).any(axis=-1).mean()),
        "black": float((luma < _BLACK).mean()),
        "darkest": float(np.quantile(luma, 0.01)),
        "luma": float(luma.mean()),
        "slope": spectrum_slope(luma),
        "chroma": chroma,
        "hues": hues,
        "kurtosis": _kurtosis(logs),
    }


def spectrum_slope(image: FloatingArray) -> float:
    """Return the exponent of the power spectrum of an image (H, W), by frequency.

    Of the square in its middle, without its mean, under a Hann window: a line through the mean
    power of octave-third rings, in logarithms. 0 for a constant image.
    """
    side = min(image.shape)
    top, left = (image.shape[0] - side) // 2, (image.shape[1] - side) // 2
    square = np.asarray(image[top : top + side, left : left + side], dtype=np.float64)
    window = np.hanning(side)[:, None] * np.hanning(side)
    power = np.abs(np.fft.fft2((square - square.mean()) * window)) ** 2
    frequency = np.hypot(np.fft.fftfreq(side)[:, None], np.fft.fftfreq(side))
    edges = _BANDS[0] * 2 ** np.arange(0, np.log2(_BANDS[1] / _BANDS[0]) + 1e-9, 1 / 3)
    ring = np.digitize(frequency, edges)
    count = np.bincount(ring.ravel(), minlength=len(edges) + 1)[1:-1]
    total = np.bincount(ring.ravel(), power.ravel(), len(edges) + 1)[1:-1]
    valid = (count > 0) & (total > 0)
    if valid.sum() < 2:
        return 0.0
    logs = np.log(np.maximum(frequency, 1 / side))
    middle = np.bincount(ring.ravel(), logs.ravel(), len(edges) + 1)[1:-1][valid] / count[valid]
    return float(np.polyfit(middle, np.log(total[valid] / count[valid]), 1)[0])


def counts(seen: Iterable[str], scene: Scene) -> dict[str, float]:
    """Return the numbers of objects and of their categories among those seen."""
    objects = {item.id: item for item in scene.objects if not item.is_structure}
    categories = [objects[name].category for name in seen if name in objects]
    return {"instances": float(len(categories)), "categories": float(len(set(categories)))}


def class_pixels(seen: Mapping[str, int], scene: Scene) -> Counter[str]:
    """Return the pixels of each NYU40 class in a view."""
    classes: Counter[str] = Counter()
    categories = {item.id: item.category for item in scene.objects}
    for name, pixels in seen.items():
        label = NYU40_OF_CATEGORY[category_number(categories.get(name, ""))]
        classes[NYU40_NAMES[label] or "none"] += pixels
    return classes


def repeats(scenes: Iterable[Scene], most: int = 12) -> list[dict[str, Any]]:
    """Return the things that most rooms of a type have, the most frequent first.

    A thing is a small object that is no fixture; its name tells what it is.
    """
    rooms: Counter[str] = Counter()
    having: Counter[tuple[str, str]] = Counter()
    for scene in scenes:
        inside: dict[str, set[str]] = defaultdict(set)
        for item in scene.objects:
            if item.room and is_thing(item):
                inside[item.room].add(item.name)
        for room in scene.rooms:
            rooms[room.type] += 1
            having.update((name, room.type) for name in inside[room.id])
    shares: list[dict[str, Any]] = [
        {"thing": name, "room": kind, "rooms": number, "share": round(number / rooms[kind], 3)}
        for (name, kind), number in having.items()
        if rooms[kind] >= _FEW
    ]
    return sorted(shares, key=lambda row: (-row["share"], row["thing"], row["room"]))[:most]


def is_thing(item: SceneObject) -> bool:
    """Test whether an object is a small thing that may stand anywhere."""
    size = np.subtract(item.bbox_max, item.bbox_min).max()
    fixed = item.is_structure or item.category in _FIXED or item.name in _FITTINGS
    return bool(size < _SMALL) and not fixed


def draw_realism(found: Realism) -> Figure:
    """Draw a histogram of each figure, as shares of the views."""
    page = Figure(figsize=(13, 8), dpi=100, layout="constrained")
    axes = page.subplots(3, 4).ravel()
    for place, figure in zip(axes, FIGURES, strict=False):
        values = found.views[figure.name]
        place.hist(values, bins=24, weights=np.full(len(values), 1 / len(values)), color="#3b76af")
        place.axvline(float(np.median(values)), color="#c9682d")
        place.set_xlabel(figure.label, fontsize=8)
    names = [name for name in found.classes if name != "none"][:14]
    axes[-1].barh(names[::-1], [found.classes[name] for name in names[::-1]], color="#4f9a54")
    axes[-1].set_xlabel("share of pixels by NYU40 class", fontsize=8)
    axes[-1].tick_params(labelsize=7)
    return page


def _seen(data: Path, view: View) -> Sequence[str]:
    """Return the ids of the objects in view: by its labels, or else by its small id image."""
    labels = frame_path(data, "labels", view)
    if not labels.is_file():
        return list(view.seen)
    least = _LEAST_PIXELS * view.width * view.height
    described = read_frame(labels).meta.get("instances", [])
    return [str(entry["object"]) for entry in described if entry["pixels"] >= least]


def _log2(light: FloatingArray) -> Float64Array:
    floor = max(float(light.max()) * _SMALLEST, 1e-30)
    return np.asarray(np.log2(np.maximum(light, floor)))


def _kurtosis(logs: Float64Array) -> float:
    differences = np.diff(logs, axis=1).ravel()
    return float(stats.kurtosis(differences, fisher=False)) if differences.std() > 0 else 0.0


def _chroma_and_hues(picture: UInt8Array) -> tuple[float, float]:
    """Return the mean CIELAB chroma and the circular standard deviation of hues, degrees.

    Hues count with their chroma.
    """
    linear = decode_srgb(picture.astype(np.float64) / 255)
    to_xyz = np.array(  # of linear Rec. 709, over the white point D65
        [
            [0.4124564 / 0.95047, 0.3575761 / 0.95047, 0.1804375 / 0.95047],
            [0.2126729, 0.7151522, 0.0721750],
            [0.0193339 / 1.08883, 0.1191920 / 1.08883, 0.9503041 / 1.08883],
        ]
    )
    ratio = linear @ to_xyz.T
    curve = np.where(ratio > (6 / 29) ** 3, np.cbrt(ratio), ratio / (3 * (6 / 29) ** 2) + 4 / 29)
    a, b = 500 * (curve[..., 0] - curve[..., 1]), 200 * (curve[..., 1] - curve[..., 2])
    chroma = np.hypot(a, b)
    length = np.hypot(a.sum(), b.sum()) / max(float(chroma.sum()), 1e-12)
    spread = np.sqrt(-2 * np.log(min(max(float(length), 1e-12), 1.0)))
    return float(chroma.mean()), float(np.degrees(spread))
