"""`pbrnet study loss`, `decomposition`, `composition` and `table`: trainings side by side."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from model.methods import BASELINES
from model.studies.comparisons.study import (
    composition_study,
    decomposition_study,
    loss_study,
    table_study,
)
from model.studies.trials.options import carry_out, one_size, trial_options
from model.studies.trials.plan import Study, Wish, plan
from model.training.train import Folders
from pipeline.params import Params


@click.command(
    epilog="""\b
Examples:
  pbrnet study loss --dry-run             what would be trained, and for how long
  pbrnet study loss --steps 2000          both networks, 2000 steps each, with each of four losses
  pbrnet study loss --seeds 3 --params params/reference.yaml

Stopped, the same command goes on where it was. Writes metrics/studies/loss.json and .png."""
)
@trial_options()
def loss(params: Params, data: Path, models: Path, **wishes: Any) -> None:
    """Compare four losses (Figure 7).

    L1, the fifth layer, all layers, and the part-perceptual loss, for both networks.
    """
    _study(loss_study(params), params, data, models, **wishes)


@click.command(
    epilog="""\b
Examples:
  pbrnet study decomposition --dry-run
  pbrnet study decomposition --steps 2000                 a quarter, half, and all of the views
  pbrnet study decomposition --views 20 --views 80 --seeds 3
  pbrnet study decomposition --method plus                the curve of our own network, too

Views are taken by whole floor plans, drawn by lot, until there are as many as asked for. Stopped,
the same command goes on where it was. Writes metrics/studies/decomposition.json and .png."""
)
@click.option(
    "--method",
    "methods",
    type=click.Choice(BASELINES),
    multiple=True,
    help="A method to train beside the three, again for each.",
)
@click.option(
    "--views",
    type=click.IntRange(1),
    multiple=True,
    help="Training views, again for each size.  [default: a quarter, half, all]",
)
@trial_options()
def decomposition(
    params: Params, data: Path, models: Path, methods: tuple[str, ...], **wishes: Any
) -> None:
    """Compare two stages with one (Figure 8).

    Shading supervised, the same layers on colour alone, and one U-Net, by the number of views;
    and what each one's curve promises for ten times as many.
    """
    _study(decomposition_study(params, methods), params, data, models, **wishes)


@click.command(
    epilog="""\b
Examples:
  pbrnet study composition --dry-run
  pbrnet study composition --steps 2000 --seeds 2

Stopped, the same command goes on where it was. Writes metrics/studies/composition.json and .png."""
)
@trial_options()
def composition(params: Params, data: Path, models: Path, **wishes: Any) -> None:
    """Compare composition by network and by product (Figure 9).

    Under both exposure policies: as shading was exposed, and each image by itself.
    """
    _study(composition_study(params), params, data, models, **wishes)


@click.command(
    epilog="""\b
Examples:
  pbrnet study table --dry-run
  pbrnet study table --steps 2000 --views 200       train.baselines, three trainings of each
  pbrnet study table --method unet --method can_own --method plus

Stopped, the same command goes on where it was. Writes metrics/studies/table.json and .png."""
)
@click.option(
    "--method",
    "methods",
    type=click.Choice(BASELINES),
    multiple=True,
    help="A method to train beside ours, again for each.  [default: train.baselines]",
)
@one_size
@trial_options(seeds=3)
def table(
    params: Params,
    data: Path,
    models: Path,
    methods: tuple[str, ...],
    views: int | None,
    **wishes: Any,
) -> None:
    """Train every method alike and compare them (Table I).

    Each with the same views and steps, several times. Intervals say what other scenes would change,
    the spread what another training would.
    """
    study = table_study(methods or params.train.baselines)
    _study(study, params, data, models, views=() if views is None else (views,), **wishes)


def _study(
    study: Study, params: Params, data: Path, models: Path, dry_run: bool, **wishes: Any
) -> None:
    folders = Folders.beside(data, models, models)
    trials = plan(study, params, folders, Wish(**wishes))
    carry_out(study, params, folders, trials, dry_run)
