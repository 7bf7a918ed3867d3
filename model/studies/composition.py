"""Composition study: a network against multiplication (Figure 9 of the paper)."""

from __future__ import annotations

from pbrnet.model.studies.trials.command import TrialRequest, trial_command
from pbrnet.model.studies.trials.plan import STAGES, TrialStudy, Variant


def composition_study() -> TrialStudy:
    """Return the study: network, products and ceiling, under both exposure policies."""
    same = ("product", "product_linear", "ceiling")
    methods = {"pbrnet": "network", **{name: name for name in same}}
    return TrialStudy(
        name="composition",
        variants=tuple(
            Variant(policy, STAGES, methods, {"train.exposure": policy}, f"{policy} exposure")
            for policy in ("shared", "own")
        ),
        reference="network",
    )


@trial_command(
    "composition",
    """
  pbrnet study composition --dry-run
  pbrnet study composition --steps 2000 --seeds 2
""",
)
def command(request: TrialRequest) -> None:
    """Compare composition by a network with the product (Figure 9).

    Under both exposure policies: colour exposed like shading, and every image by itself.
    """
    request.run(composition_study())
