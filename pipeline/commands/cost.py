"""`pbrnet cost`: core-hours that a run will take, before it starts."""

from __future__ import annotations

import json
import math
from dataclasses import asdict
from pathlib import Path

import click

from pipeline.commands.options import common_options
from pipeline.costs.forecast import TOGETHER, HeldOut, fit_costs, samples_of
from pipeline.costs.ledger import read_ledger
from pipeline.params import Params
from scenes.errors import ParameterError


@click.command(
    epilog="""\b
Examples:
  pbrnet cost                                 what params.yaml asks for
  pbrnet cost --views 500000 --cores 1000     the paper's scale
  pbrnet cost --params params/paper.yaml --data small/data
  pbrnet cost --check                         how far it was off where that is known"""
)
@click.option("--views", type=click.IntRange(1), default=None, help="Views, instead of params'.")
@click.option("--scenes", type=click.IntRange(1), default=None, help="Scenes, instead of params'.")
@click.option("--cores", type=click.IntRange(1), default=None, help="Cores that will work.")
@click.option("--check", is_flag=True, help="Predict measured scenes from others instead.")
@click.option("--json", "as_json", is_flag=True, help="Print JSON.")
@common_options
def cost(
    params: Params,
    data: Path,
    views: int | None,
    scenes: int | None,
    cores: int | None,
    check: bool,
    as_json: bool,
) -> None:
    """Say how many core-hours the rendering stages will take.

    The estimate comes from what earlier views cost, in DATA/ledger.parquet: render a few first,
    on the machines that will do the work. How far it may be off is measured by predicting one
    half of those scenes from the other, again and again; --check shows that alone. Views
    are expected to be as many in each scene as cameras.views_per_scene allows.
    """
    costs, errors = fit_costs(read_ledger(data))
    if check:
        _show_check(errors, as_json)
        return
    asked = {"noisy": params.noisy.spp, "visibility": params.illumination.shadow_rays}
    costs = [cost for cost in costs if asked.get(cost.stage, True)]
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
    error = errors[TOGETHER].worst
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
        worst = errors[cost.stage].worst
        told = "" if math.isnan(worst) else f", unseen scenes within {worst:.0%}"
        spent = seconds[cost.stage]
        click.echo(
            f"{cost.stage:14}{spent / 3600:>12,.2f}{spent / views:>12.3f}   {cost.measured}{told}"
        )
    if params.noisy.spp and all(cost.stage != "noisy" for cost in costs):
        click.echo("noisy: asked for, but the ledger has none yet: not in the sum")
    off = "too few scenes to say how sure" if math.isnan(error) else f"within {error:.0%}"
    click.echo(f"{'together':14}{hours:>12,.2f}{hours * 3600 / views:>12.3f}   {off}")
    if cores:
        click.echo(f"on {cores:,} cores: {_span(hours / cores)}, if all are busy all the time")


def _show_check(found: dict[str, HeldOut], as_json: bool) -> None:
    """How well measured scenes are predicted from others."""
    if as_json:
        facts = {
            name: {
                key: None if math.isnan(value) else value for key, value in asdict(error).items()
            }
            for name, error in found.items()
        }
        click.echo(json.dumps(facts, indent=2))
        return
    click.echo("Half of the measured scenes predict the other half, drawn a hundred times:")
    click.echo(f"{'stage':14}{'total: usual':>14}{'95 % within':>14}{'a scene: usual':>17}")
    for name, error in found.items():
        if math.isnan(error.usual):
            click.echo(f"{name:14}   too few scenes to say")
            continue
        click.echo(f"{name:14}{error.usual:>14.1%}{error.worst:>14.1%}{error.scene:>17.1%}")


def _span(hours: float) -> str:
    if hours < 1:
        return f"{60 * hours:.0f} minutes"
    return f"{hours:.1f} hours" if hours < 48 else f"{hours / 24:.1f} days"
