"""Comparison of predicted and rendered changes of a view between two lights.

The paper's networks receive light without its scale (`pbrnet.model.data.encoding`): doubling all
light does not change their inputs. So they predict the distribution of light in an image, not its
overall brightness, which is restored from the panorama, see `log_average`. Light transport has a
scale, and `plus` and `radiosity` keep it.
"""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np

from pbrnet.model.data.direct_light import direct_shading
from pbrnet.model.data.encoding import (
    NEUTRAL,
    color_exposure,
    neutral_background,
    shading_exposure,
)
from pbrnet.model.data.reader import Example
from pbrnet.model.evaluation.inference import Networks
from pbrnet.model.evaluation.predict import images_of
from pbrnet.model.evaluation.product import linear_product
from pbrnet.model.studies.illumination.agreement import agreement, block_means, log_change, sums
from pbrnet.model.studies.illumination.results import Change
from pbrnet.pipeline.frames import Channels
from pbrnet.pipeline.tonemap import Exposure, ToneParams, exposure_of, untonemap
from pbrnet.scenes.arrays import AnyArray
from pbrnet.scenes.color import luminance
from pbrnet.scenes.seeds import derive

ROWS = 2  # of the sheet, for every kind of change
Images = dict[str, AnyArray]  # method -> linear radiance (H, W, 3)


@dataclass(frozen=True)
class LitView:
    """View under one light: its panorama and, if rendered, light transport and ground truth."""

    original: Example  # row of the dataset, with the exposure of all images
    intensity: AnyArray
    distance: AnyArray
    tint: AnyArray | None = None
    visibility: AnyArray | None = None
    shading: AnyArray | None = None  # linear float32 (H, W, 3)
    color: AnyArray | None = None
    transport: Channels | None = None

    @property
    def example(self) -> Example:
        """Input of the networks."""
        original = self.original
        if self.transport is not None:
            original = original.having(**images_of("transport", self.transport))
        original = original.having(intensity=self.intensity, distance=self.distance)
        for name, image in (("tint", self.tint), ("visibility", self.visibility)):
            original = original.without(name)
            if image is not None:
                original = original.having(**{name: image})
        return original


@dataclass(frozen=True)
class Comparison:
    """One change of light: logarithmic changes of block means (rows, columns), and images."""

    name: str
    original: Example
    reference: str  # source of `true`: "rendered", or "direct light" of the panorama
    true: dict[str, AnyArray]  # of "shading" and "color"
    predicted: dict[str, AnyArray]  # by method
    before: LitView
    after: LitView
    images: tuple[Images, Images]  # predicted radiance before and after, in the renderer's unit


class AgreementTally:
    """Accumulator of agreement over views; keeps a few comparisons for the sheet."""

    def __init__(self) -> None:
        self._sums: dict[str, dict[str, dict[str, list[AnyArray]]]] = defaultdict(
            lambda: defaultdict(lambda: defaultdict(list))
        )
        self._views: Counter[str] = Counter()
        self._references: dict[str, str] = {}
        self._shown: dict[str, list[Comparison]] = defaultdict(list)

    def add(self, changes: Iterator[Comparison]) -> None:
        """Add the changes of one view."""
        for found in changes:
            scene = found.original.scene_id
            rendered = found.reference == "rendered"
            names = (found.name, "all") if rendered else (found.name,)
            for name in names:
                self._references[name] = found.reference
                self._views[name] += 1
                for method, change in found.predicted.items():
                    true = found.true["shading" if method in ("shading", "direct") else "color"]
                    self._sums[name][method][scene].append(sums(true, change))
            shown = self._shown[found.name]
            if len(shown) < ROWS and all(scene != other.original.scene_id for other in shown):
                shown.append(found)

    def rows(self) -> list[Comparison]:
        """Return comparisons for the sheet: up to `ROWS` of each change, of different scenes."""
        return [found for group in self._shown.values() for found in group]

    def changes(self, skipped: Mapping[str, Mapping[str, int]], seed: int) -> dict[str, Change]:
        """Return all measures by kind of change; `skipped`: kind -> reason -> number of views."""
        result = {}
        for name in sorted({*self._sums, *skipped}):
            methods = {
                method: figures
                for method, views in self._sums[name].items()
                if (figures := agreement(views, derive(seed, "study", "illumination", name)))
            }
            result[name] = Change(
                views=self._views[name],
                skipped=dict(skipped.get(name, {})),
                methods=methods,
                reference=self._references.get(name, "rendered"),
            )
        return result


def compare(
    networks: Networks, before: LitView, lit: Mapping[str, LitView]
) -> Iterator[Comparison]:
    """Compare every changed light in `lit` with the light `before`.

    Without a rendering, the change of the panorama's direct light is the reference, which has
    neither shadows nor indirect light.
    """
    light = direct_image(before.example)
    brightness = log_average(light)
    unit = 1 / (before.original.exposure_shading.scale * brightness) if brightness else 0.0
    first = {**_images(networks, before, brightness * unit), "direct": light}
    for name, after in lit.items():
        light = direct_image(after.example)
        then = {**_images(networks, after, log_average(light) * unit), "direct": light}
        if before.shading is None or after.shading is None:
            reference = "direct light"
            direct = (luminance(first["direct"]), luminance(then.pop("direct")))
            pairs = {"shading": direct, "color": direct}
        else:
            assert before.color is not None and after.color is not None
            reference = "rendered"
            pairs = {
                "shading": (luminance(before.shading), luminance(after.shading)),
                "color": (luminance(before.color), luminance(after.color)),
            }
        yield Comparison(
            name,
            before.original,
            reference,
            {kind: _change(*pair) for kind, pair in pairs.items()},
            {method: _change(luminance(first[method]), luminance(then[method])) for method in then},
            before,
            after,
            (first, then),
        )


def predictions(networks: Networks, example: Example, scale: float) -> Images:
    """Return linear radiance of the paper's networks, and of `shading`, inversely tone-mapped.

    The result is multiplied by `scale`. All predictions use the exposure of the original view,
    because the white point of a light that was not rendered is unknown.
    """
    card = networks.card
    exposure, of_color = (
        Exposure(1.0, of(example, card.exposure).white) for of in (shading_exposure, color_exposure)
    )
    shading = networks.shading(example)
    images = {
        "shading": untonemap(shading, exposure),
        "pbrnet": untonemap(networks.predict("pbrnet", example, shading).color, of_color),
        "product": linear_product(
            neutral_background(example, card.albedo), shading, exposure, card
        ),
    }
    return {name: image * np.float32(scale) for name, image in images.items()}


def transported(networks: Networks, lit: LitView) -> Images:
    """Return linear radiance of the methods that take light transport, in the renderer's unit.

    Empty where transport is unknown: no scene has the light of an exchanged panorama.
    """
    if lit.transport is None:
        return {}
    example = lit.example
    images: Images = {"radiosity": example["transport_color"]}
    for name in networks.baselines:
        predicted = networks.predict(name, example)
        images[name] = networks.radiance(example, predicted).color
    return images


def _images(networks: Networks, lit: LitView, scale: float) -> Images:
    return {**predictions(networks, lit.example, scale), **transported(networks, lit)}


def direct_image(example: Example) -> AnyArray:
    """Return the panorama's direct light on the view, (H, W, 3); needs no network."""
    return direct_shading(example, NEUTRAL)


def log_average(direct: AnyArray) -> float:
    """Return the log average of a view's direct light, a measure of its overall brightness.

    `direct`: result of `direct_image`, which is linear in the light, as the renderer is. 0 if the
    panorama has no source.
    """
    return 1 / exposure_of(direct, ToneParams(key=1.0)).scale if direct.any() else 0.0


def _change(before: AnyArray, after: AnyArray) -> AnyArray:
    return log_change(block_means(before), block_means(after))
