"""Loss study: both networks trained with each of four losses (Figure 7 of the paper)."""

from __future__ import annotations

from pbrnet.model.studies.trials.command import TrialRequest, trial_command
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
        crop=0.5,
    )


@trial_command(
    "loss",
    """
  pbrnet study loss --dry-run             list the trainings and their expected time
  pbrnet study loss --steps 2000          both networks, 2000 steps each, with each of four losses
  pbrnet study loss --seeds 3 --params params/reference.yaml
""",
)
def command(request: TrialRequest) -> None:
    """Compare four losses (Figure 7).

    L1, the fifth feature layer, all layers, and the part-perceptual loss, for both networks.
    """
    request.run(loss_study())
