"""`pbrnet study loss`."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from pbrnet.model.studies.loss.study import loss_study
from pbrnet.model.studies.trials.options import run_study, trial_options
from pbrnet.pipeline.params import Params


@click.command(
    "loss",
    epilog="""\b
Examples:
  pbrnet study loss --dry-run             list the trainings and their expected time
  pbrnet study loss --steps 2000          both networks, 2000 steps each, with each of four losses
  pbrnet study loss --seeds 3 --params params/reference.yaml

An interrupted study resumes when the command is run again. Writes metrics/studies/loss.json and
loss.png.""",
)
@trial_options()
def command(params: Params, data: Path, models: Path, **options: Any) -> None:
    """Compare four losses (Figure 7).

    L1, the fifth feature layer, all layers, and the part-perceptual loss, for both networks.
    """
    run_study(loss_study(), params, data, models, **options)
