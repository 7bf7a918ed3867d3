"""Variants of the composition study: composition network against multiplication (Figure 9)."""

from __future__ import annotations

from pbrnet.model.studies.composition.results import LABELS
from pbrnet.model.studies.trials.plan import STAGES, TrialStudy, Variant


def composition_study() -> TrialStudy:
    """Return the study: network, products and ceiling, under both exposure policies."""
    methods = {
        "pbrnet": "network",
        "product": "product",
        "product_linear": "product_linear",
        "ceiling": "ceiling",
    }
    return TrialStudy(
        name="composition",
        variants=tuple(
            Variant(policy, STAGES, methods, {"train.exposure": policy}, f"{policy} exposure")
            for policy in ("shared", "own")
        ),
        reference="network",
        labels=LABELS,
    )
