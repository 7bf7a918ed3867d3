"""Variants of the method table: every method with the same views and steps (Table I)."""

from __future__ import annotations

from collections.abc import Sequence

from pbrnet.model.methods import METHODS
from pbrnet.model.studies.table.results import LABELS
from pbrnet.model.studies.trials.plan import STAGES, TrialStudy, Variant


def table_study(methods: Sequence[str]) -> TrialStudy:
    """Return the study: both networks beside these methods, each with its own loss if it has one.

    Every method gets as many steps as both networks together. A method that takes noisy samples is
    compared with the denoised samples, too.
    """
    both = Variant("pbrnet", STAGES, {"pbrnet": "pbrnet", "product": "product"})
    others = []
    for name in dict.fromkeys(methods):
        denoised = {"denoised": "denoised"} if METHODS[name].takes_samples else {}
        others.append(Variant(name, (name,), {name: name, **denoised}))
    return TrialStudy("table", (both, *others), reference="pbrnet", labels=LABELS)
