"""`pbrnet study composition`."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from pbrnet.model.studies.composition.study import composition_study
from pbrnet.model.studies.trials.options import run_study, trial_options
from pbrnet.pipeline.params import Params


@click.command(
    "composition",
    epilog="""\b
Examples:
  pbrnet study composition --dry-run
  pbrnet study composition --steps 2000 --seeds 2

An interrupted study resumes when the command is run again. Writes
metrics/studies/composition.json and composition.png.""",
)
@trial_options()
def command(params: Params, data: Path, models: Path, **options: Any) -> None:
    """Compare composition by a network with the product (Figure 9).

    Under both exposure policies: colour exposed like shading, and every image by itself.
    """
    run_study(composition_study(), params, data, models, **options)
