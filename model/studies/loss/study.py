"""Variants of the loss study: both networks with each variant of the loss (Figure 7)."""

from __future__ import annotations

from pbrnet.model.studies.loss.results import LABELS
from pbrnet.model.studies.trials.plan import STAGES, TrialStudy, Variant


def loss_study() -> TrialStudy:
    """Return the study: four values of `train.loss.kind`, compared with `part`."""
    return TrialStudy(
        name="loss",
        variants=tuple(
            Variant(kind, STAGES, {"pbrnet": kind}, {"train.loss.kind": kind})
            for kind in ("l1", "fifth", "full", "part")
        ),
        reference="part",
        labels=LABELS,
        crop=0.5,
    )
