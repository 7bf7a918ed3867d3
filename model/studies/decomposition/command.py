"""`pbrnet study decomposition`."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from pbrnet.model.methods import BASELINES
from pbrnet.model.studies.decomposition.study import decomposition_study
from pbrnet.model.studies.trials.options import run_study, trial_options
from pbrnet.pipeline.params import Params


@click.command(
    "decomposition",
    epilog="""\b
Examples:
  pbrnet study decomposition --dry-run
  pbrnet study decomposition --steps 2000                 a quarter, half, and all of the views
  pbrnet study decomposition --views 20 --views 80 --seeds 3
  pbrnet study decomposition --method plus                the learning curve of PBR-Net plus, too

Training views are taken by whole floor plans, in random order, until there are at least as many as
requested. An interrupted study resumes when the command is run again. Writes
metrics/studies/decomposition.json and decomposition.png.""",
)
@click.option(
    "--method",
    "methods",
    type=click.Choice(BASELINES),
    multiple=True,
    help="Another method to train; repeatable.",
)
@click.option(
    "--views",
    type=click.IntRange(1),
    multiple=True,
    help="Number of training views; repeatable.  [default: a quarter, half, all]",
)
@trial_options()
def command(
    params: Params, data: Path, models: Path, methods: tuple[str, ...], **options: Any
) -> None:
    """Compare two stages with one (Figure 8).

    Supervised shading, the same layers trained on colour only, and one U-Net, by the number of
    training views; with an extrapolation to ten times as many views.
    """
    run_study(decomposition_study(params, methods), params, data, models, **options)
