"""`pbrnet cost`: core-hours that a run will take, before it starts."""

from __future__ import annotations

import json
import math
from pathlib import Path

import click

from pipeline.cost import fit_costs, overall_error, samples_of
from pipeline.ledger import read_ledger
from pipeline.options import common_options
from pipeline.params import Params
from scenes.errors import ParameterError


@click.command(
    epilog="""\b
Examples:
  pbrnet cost                                 what params.yaml asks for
  pbrnet cost --views 500000 --cores 1000     the paper's scale
  pbrnet cost --params params/paper.yaml --data small/data"""
)
@click.option("--views", type=click.IntRange(1), default=None, help="Views, instead of params'.")
@click.option("--scenes", type=click.IntRange(1), default=None, help="Scenes, instead of params'.")
@click.option("--cores", type=click.IntRange(1), default=None, help="Cores that will work.")
@click.option("--json", "as_json", is_flag=True, help="Print JSON.")
@common_options
def cost(
    params: Params,
    data: Path,
    views: int | None,
    scenes: int | None,
    cores: int | None,
    as_json: bool,
) -> None:
    """Say how many core-hours the rendering stages will take.

    The estimate comes from what earlier views cost, in DATA/ledger.parquet: render a few first,
    on the machines that will do the work. How far it may be off is measured by predicting one
    half of those scenes from the other. Views are expected to be as many in each scene as
    cameras.views_per_scene allows.
    """
    costs = fit_costs(read_ledger(data))
    each = params.cameras.views_per_scene
    if scenes is None:
        wanted = params.scenes
        made = (wanted.homes + wanted.furnished_homes) * wanted.variants + len(wanted.imports)
        scenes = made if views is None else math.ceil(views / each)
    if not scenes:
        raise ParameterError("the parameters ask for no scenes; say how many with --scenes")
    views = views or scenes * each
    seconds = {
        cost.stage: cost.total(scenes, views, samples_of(cost.stage, params)) for cost in costs
    }
    hours = sum(seconds.values()) / 3600
    error = overall_error(costs, scenes, views, params)
    if as_json:
        facts = {
            "scenes": scenes,
            "views": views,
            "core_hours": hours,
            "relative_error": None if math.isnan(error) else error,
            "stages": {stage: value / 3600 for stage, value in seconds.items()},
        }
        click.echo(json.dumps(facts, indent=2))
        return
    click.echo(f"{views:,} views of {scenes:,} scenes, {params.image.width}x{params.image.height}")
    click.echo(f"{'stage':14}{'core-hours':>12}{'a view, s':>12}   measured")
    for cost in costs:
        told = "" if math.isnan(cost.error) else f", unseen scenes within {cost.error:.0%}"
        spent = seconds[cost.stage]
        click.echo(
            f"{cost.stage:14}{spent / 3600:>12,.2f}{spent / views:>12.3f}   {cost.measured}{told}"
        )
    off = "too few scenes to say how sure" if math.isnan(error) else f"within {error:.0%}"
    click.echo(f"{'together':14}{hours:>12,.2f}{hours * 3600 / views:>12.3f}   {off}")
    if cores:
        click.echo(f"on {cores:,} cores: {_span(hours / cores)}, if all are busy all the time")


def _span(hours: float) -> str:
    if hours < 1:
        return f"{60 * hours:.0f} minutes"
    return f"{hours:.1f} hours" if hours < 48 else f"{hours / 24:.1f} days"
