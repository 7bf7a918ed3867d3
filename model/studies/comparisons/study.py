"""The paper's comparisons of trainings: the loss (Fig. 7), the decomposition into two stages
(Fig. 8), composition by a network or by multiplication (Fig. 9), all methods (Table I).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from model.baselines.end_to_end import composition_of
from model.methods import METHODS
from model.networks.pbrnet import Architecture
from model.studies.trials.plan import STAGES, Study, Variant
from pipeline.params import Params


def loss_study(_params: Params) -> Study:
    """Both networks, trained with each variant of the loss."""
    return Study(
        name="loss",
        variants=tuple(
            Variant(kind, STAGES, {"pbrnet": kind}, {"train.loss.kind": kind})
            for kind in ("l1", "fifth", "full", "part")
        ),
        reference="part",
        crop=0.5,
    )


def decomposition_study(params: Params, methods: Sequence[str] = ()) -> Study:
    """The same layers with and without supervised shading, and one U-Net; by training-set size.

    All have the width and depth of the parameters' shading network; more `methods` of the registry
    have their own.
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
    return Study(
        name="decomposition",
        variants=(
            Variant("two_stage", STAGES, {"pbrnet": "two_stage"}, changes),
            *(Variant(name, (name,), {name: name}, changes) for name in ("end_to_end", "unet")),
            *(Variant(name, (name,), {name: name}) for name in more),
        ),
        reference="two_stage",
        sized=True,
    )


def composition_study(_params: Params) -> Study:
    """The composition network beside multiplication, under both exposure policies."""
    methods = {
        "pbrnet": "network",
        "product": "product",
        "product_linear": "product_linear",
        "ceiling": "ceiling",
    }
    return Study(
        name="composition",
        variants=tuple(
            Variant(policy, STAGES, methods, {"train.exposure": policy}, f"{policy} exposure")
            for policy in ("shared", "own")
        ),
        reference="network",
    )


def table_study(methods: Sequence[str]) -> Study:
    """Our two networks beside these methods of the registry, each with its own loss if it has one.

    Every method gets as many steps as our two networks have together. Beside a method that takes
    noisy samples stands what the denoiser alone makes of them.
    """
    ours = {"pbrnet": "pbrnet", "product": "product"}
    others = []
    for name in dict.fromkeys(methods):
        beside = {"denoised": "denoised"} if METHODS[name].noisy else {}
        others.append(Variant(name, (name,), {name: name, **beside}))
    return Study("table", (Variant("pbrnet", STAGES, ours), *others), reference="pbrnet")
