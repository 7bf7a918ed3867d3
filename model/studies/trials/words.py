"""Words of the studies that compare trainings: title of the section, titles of the row labels."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from pbrnet.model.titles import METHOD_TITLES

# Titles of row labels that are common to all of these studies; a study adds its own.
LABELS = {**METHOD_TITLES, "truth": "The ground truth itself"}


@dataclass(frozen=True)
class Comparison:
    """Words of a study that compares trainings."""

    title: str  # of its section of the report
    labels: Mapping[str, str] = field(default_factory=dict)  # titles of its row labels

    @property
    def titles(self) -> dict[str, str]:
        """Titles of all row labels, those that the studies have in common included."""
        return LABELS | dict(self.labels)


_CEILING = {"ceiling": "Reflectance × true shading"}
_PRODUCT = "The same, reflectance × predicted shading"
COMPARISONS = {
    "loss": Comparison(
        "Loss functions",
        {
            "l1": "L1 loss on the image only",
            "fifth": "Deepest of the five feature layers only",
            "full": "Image and all five feature layers",
            "part": "Part-perceptual: image and three feature layers",
        },
    ),
    "decomposition": Comparison(
        "Two stages or one",
        {
            "two_stage": "Two stages, shading supervised",
            "end_to_end": "The same networks, trained on colour only",
        },
    ),
    "composition": Comparison(
        "Composition network or multiplication",
        {
            "network": "Composition network",
            "product_linear": "The same, projected linearly",
            **_CEILING,
        },
    ),
    "table": Comparison("All methods"),
    "noise": Comparison("Noisy ground truth", {"clean": "The dataset's own ground truth"}),
    "generalisation": Comparison(
        "Another source",
        {
            "before": "Trained without the source",
            "before, product": _PRODUCT,
            "tuned": "Fine-tuned on the source",
            "tuned, product": _PRODUCT,
            "alone": "Trained on the tuning views only",
            "alone, product": _PRODUCT,
            **_CEILING,
        },
    ),
}
