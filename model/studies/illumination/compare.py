"""A view in two lights, rendered and predicted: by how much every block of pixels got brighter.

The networks are given light without its scale (`model.data.encoding`): doubling all of it changes
nothing they see. So how bright a picture is as a whole they cannot say, only where in it light is.
That whole is put back from the panorama, see `level`.
"""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace

import numpy as np

from model.data.direct_light import direct_shading
from model.data.encoding import NEUTRAL, neutral_background
from model.data.reader import Example
from model.evaluation.inference import Networks
from model.evaluation.product import linear_product
from model.studies.illumination.agreement import agreement, block_means, log_change, sums
from model.studies.illumination.results import Change
from pipeline.params import ToneParams
from pipeline.tonemap import Exposure, exposure_of, untonemap
from scenes.arrays import AnyArray
from scenes.color import luminance
from scenes.seeds import derive

ROWS = 2  # of the picture, for every kind of change
Images = dict[str, AnyArray]  # method -> linear radiance (H, W, 3)


@dataclass(frozen=True)
class Lit:
    """A view in one light: its panorama, and what was rendered of it, if anything was."""

    original: Example  # the dataset's row, whose exposure is kept
    intensity: AnyArray
    distance: AnyArray
    tint: AnyArray | None = None
    visibility: AnyArray | None = None
    shading: AnyArray | None = None  # linear float32 (H, W, 3)
    color: AnyArray | None = None

    @property
    def example(self) -> Example:
        """What the networks are given."""
        return replace(
            self.original,
            intensity=self.intensity,
            distance=self.distance,
            tint=self.tint,
            visibility=self.visibility,
        )


@dataclass(frozen=True)
class Compared:
    """One change: logarithmic changes of block means (rows, columns), and the pictures."""

    name: str
    original: Example
    reference: str  # what `true` is: "rendered", or the "direct light" of the panorama
    true: dict[str, AnyArray]  # of "shading" and "color"
    predicted: dict[str, AnyArray]  # by method
    before: Lit
    after: Lit
    images: tuple[Images, Images]  # predicted radiance, in the unit of what was rendered


class Tally:
    """Gathers what all views say, and a few of them to be shown."""

    def __init__(self) -> None:
        self._sums: dict[str, dict[str, dict[str, list[AnyArray]]]] = defaultdict(
            lambda: defaultdict(lambda: defaultdict(list))
        )
        self._views: Counter[str] = Counter()
        self._references: dict[str, str] = {}
        self._shown: dict[str, list[Compared]] = defaultdict(list)

    def add(self, changes: Iterator[Compared]) -> None:
        """Take in the changes of one view."""
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

    def rows(self) -> list[Compared]:
        """Some of each kind of change, of different scenes."""
        return [found for group in self._shown.values() for found in group]

    def changes(self, skipped: Mapping[str, Mapping[str, int]], seed: int) -> dict[str, Change]:
        """All figures, by the kind of change; `skipped`: kind -> reason -> views."""
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


def compare(networks: Networks, before: Lit, lit: Mapping[str, Lit]) -> Iterator[Compared]:
    """Every changed light in `lit` against the light `before`, predicted and rendered.

    Where nothing was rendered, the change of the panorama's direct light stands for the truth: it
    knows no shadows and no bounces, but which surfaces face the light.
    """
    light = direct_image(before.example)
    bright = level(light)
    unit = 1 / (before.original.exposure_shading.scale * bright) if bright else 0.0
    first = {**predictions(networks, before.example, bright * unit), "direct": light}
    for name, after in lit.items():
        light = direct_image(after.example)
        then = {**predictions(networks, after.example, level(light) * unit), "direct": light}
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
        yield Compared(
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
    """Linear radiance by method, and of `shading`: what the networks show, times `scale`.

    Their pictures are made linear as if exposed like the original view: the white point of a light
    that nobody has rendered is not known.
    """
    card = networks.card
    exposure = Exposure(1.0, example.exposure_shading.white)
    of_color = exposure
    if card.exposure == "own":
        of_color = Exposure(1.0, example.exposure_color.white)
    shading = networks.shading(example)
    images = {
        "shading": untonemap(shading, exposure),
        "pbrnet": untonemap(networks.predict("pbrnet", example, shading).color, of_color),
        "product": linear_product(
            neutral_background(example, card.albedo), shading, exposure, card
        ),
    }
    for name in networks.baselines:
        images[name] = untonemap(networks.predict(name, example).color, of_color)
    return {name: image * np.float32(scale) for name, image in images.items()}


def direct_image(example: Example) -> AnyArray:
    """The panorama's direct light on the view, (H, W, 3): what no network is needed for."""
    return direct_shading(example, NEUTRAL)


def level(direct: AnyArray) -> float:
    """How bright a view is as a whole, by its panorama: the log average of its direct light.

    `direct_shading` sends the light of the sources in the panorama to every pixel, with its
    shadows; it is linear in the light, as the renderer is. 0 where the panorama shows no source.
    """
    return 1 / exposure_of(direct, ToneParams(key=1.0)).scale if direct.any() else 0.0


def _change(before: AnyArray, after: AnyArray) -> AnyArray:
    return log_change(block_means(before), block_means(after))
