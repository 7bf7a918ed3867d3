"""Variants of the decomposition study: two stages against one network (Figure 8)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from pbrnet.model.baselines.end_to_end import composition_of
from pbrnet.model.networks.pbrnet import Architecture
from pbrnet.model.studies.decomposition.results import LABELS
from pbrnet.model.studies.trials.plan import STAGES, TrialStudy, Variant
from pbrnet.pipeline.params import Params


def decomposition_study(params: Params, methods: Sequence[str] = ()) -> TrialStudy:
    """Return the study: the same layers with and without supervised shading, and one U-Net.

    The number of training views varies. All three have the width and depth of the parameters'
    shading network; `methods`, further methods of the registry, have their own.
    """
    first = params.train.shading
    second = composition_of(Architecture("shading", first.width, first.levels))
    changes: dict[str, Any] = {
        "train.composition.width": second.width,
        "train.composition.levels": second.levels,
    }
    for name in ("end_to_end", "unet"):
        changes[f"train.{name}.width"] = first.width
        changes[f"train.{name}.levels"] = first.levels
    more = [name for name in dict.fromkeys(methods) if name not in ("end_to_end", "unet")]
    return TrialStudy(
        name="decomposition",
        variants=(
            Variant("two_stage", STAGES, {"pbrnet": "two_stage"}, changes),
            *(Variant(name, (name,), {name: name}, changes) for name in ("end_to_end", "unet")),
            *(Variant(name, (name,), {name: name}) for name in more),
        ),
        reference="two_stage",
        labels=LABELS,
        varies_views=True,
    )
