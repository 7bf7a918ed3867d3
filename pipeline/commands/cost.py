"""`pbrnet cost`: forecast of the core-hours of a run."""

from __future__ import annotations

import json
import math
from dataclasses import asdict, replace
from pathlib import Path

import click

from pbrnet.pipeline.channels import KINDS, TRACED
from pbrnet.pipeline.commands.options import Request, common_options, json_option, size_option
from pbrnet.pipeline.costs.forecast import (
    TOGETHER,
    HeldOut,
    costs_of,
    fit_costs,
    frame_bytes,
    joined,
    typical_costs,
    view_size,
)
from pbrnet.pipeline.costs.ledger import read_ledger
from pbrnet.pipeline.release.recipe import load_recipe
from pbrnet.pipeline.terminal import say, views_of
from pbrnet.scenes.contract import STAGE_KEY, load_scene, scene_folders
from pbrnet.scenes.errors import ParameterError


@click.command(
    epilog="""\b
Examples:
  pbrnet cost                                 the run described by params.yaml
  pbrnet cost --views 500000 --cores 1000     the paper's number of views
  pbrnet cost --params params/paper.yaml --data small/data
  pbrnet cost --views 75000 --size 1024x768 --cores 256
  pbrnet cost --recipe indoor-75k             a release of recipes/
  pbrnet cost --data small --also large       two measured image sizes, to separate fixed costs
  pbrnet cost --check                         accuracy of the forecast on measured scenes"""
)
@click.option(
    "--views", type=click.IntRange(1), help="Number of views, instead of the parameters'."
)
@click.option(
    "--scenes", type=click.IntRange(1), help="Number of scenes, instead of the parameters'."
)
@click.option(
    "--cores", type=click.IntRange(1), help="Number of cores, to print the duration of the run."
)
@size_option("Image size, instead of the parameters'.")
@click.option(
    "--also",
    type=click.Path(path_type=Path, exists=True, file_okay=False),
    multiple=True,
    help="Additional data folder, for example with another image size (repeatable).",
)
@click.option("--recipe", help="Use the parameters of this recipe.")
@click.option(
    "--check", is_flag=True, help="Print only the accuracy of the forecast on measured scenes."
)
@json_option
@common_options
def cost(
    request: Request,
    views: int | None,
    scenes: int | None,
    cores: int | None,
    size: tuple[int, int] | None,
    also: tuple[Path, ...],
    recipe: str | None,
    check: bool,
    as_json: bool,
) -> None:
    """Forecast the core-hours of the rendering stages.

    The forecast is fitted to the cost of earlier views in DATA/ledger.parquet, so render a few
    first, on the same kind of machines; without any it is that of a typical core, within a factor
    of two. Its error is estimated by cross-validation between halves of those scenes; --check
    prints only these errors. Scenes are those of the parameters and those
    that 'pbrnet import' wrote to DATA/scenes. Without --views, every scene is assumed to have
    cameras.views_per_scene views, its stored cameras, and the frames of its walks.
    """
    ledger = joined([read_ledger(folder) for folder in (request.data, *also)])
    params = request.params if recipe is None else load_recipe(recipe).parameters
    if size is not None:
        params = replace(params, image=replace(params.image, width=size[0], height=size[1]))
    typical = not check and all(cost.stage != "truth" for cost in costs_of(ledger))
    costs, errors = (typical_costs(), {}) if typical else fit_costs(ledger)
    if check:
        _show_check(errors, as_json)
        return
    left_out = {str(kind) for kind in KINDS if kind not in params.kinds}
    left_out |= {"truth"} if left_out >= set(TRACED) else set()
    costs = [cost for cost in costs if cost.stage not in left_out]
    stored = 0
    if scenes is None and views is None:
        imported = _imported(request.data) if recipe is None else []
        scenes, stored = params.scenes.most_scenes + len(imported), sum(imported)
    scenes = scenes or math.ceil((views or 0) / params.cameras.most_views())
    if not scenes:
        raise ParameterError(
            f"the parameters and {request.data / 'scenes'} contain no scenes; give their number "
            "with --scenes"
        )
    views, of_view = views or params.cameras.most_views(scenes, stored), view_size(params)
    seconds = {cost.stage: cost.total(scenes, views, of_view.samples(cost.stage)) for cost in costs}
    hours = sum(seconds.values()) / 3600
    error = errors[TOGETHER].worst if errors else math.nan  # unknown if typical
    kinds = params.kinds
    each_frame = {k: n for k, n in frame_bytes(ledger, of_view).items() if k in kinds}
    size_of_all = views * sum(each_frame.values())
    absent = [kind for kind in kinds if not typical and kind not in each_frame]
    if as_json:
        facts = {
            "scenes": scenes,
            "views": views,
            "core_hours": hours,
            "relative_error": None if math.isnan(error) else error,
            "frame_bytes": round(size_of_all),
            "not_included": absent,
            "stages": {stage: value / 3600 for stage, value in seconds.items()},
        }
        say(*json.dumps(facts, indent=2).split("\n"))
        return
    say(f"{views_of(views, scenes)}, {params.image.width}x{params.image.height}")
    say(f"{'stage':14}{'core-hours':>12}{'s per view':>12}   views or scenes measured")
    for cost in costs:
        worst = errors[cost.stage].worst if errors else math.nan
        note = "" if math.isnan(worst) else f", error within {worst:.0%}"
        spent = seconds[cost.stage]
        say(f"{cost.stage:14}{spent / 3600:>12,.2f}{spent / views:>12.3f}   {cost.measured}{note}")
    for kind in absent:
        say(f"{kind}: not included, because the ledger has no such frames yet")
    note = "error unknown: too few scenes" if math.isnan(error) else f"error within {error:.0%}"
    note = "about, on a typical core: nothing measured here yet" if typical else note
    say(f"{'total':14}{hours:>12,.2f}{hours * 3600 / views:>12.3f}   {note}")
    if size_of_all:
        least = "at least " if absent else ""
        say(f"frames: {least}{_bytes(size_of_all)}; the dataset's shards need about as much again")
    if cores:
        say(f"on {cores:,} cores: {_span(hours / cores)}, if all of them are busy")


def _imported(data: Path) -> list[int]:
    """Return the number of stored cameras of each scene that no stage made."""
    sources = [load_scene(folder).source for folder in scene_folders(data / "scenes")]
    return [len(source.get("views", ())) for source in sources if STAGE_KEY not in source]


def _show_check(found: dict[str, HeldOut], as_json: bool) -> None:
    """Print the errors of the cross-validation."""
    if as_json:
        facts = {
            name: {
                key: None if math.isnan(value) else value for key, value in asdict(error).items()
            }
            for name, error in found.items()
        }
        say(*json.dumps(facts, indent=2).split("\n"))
        return
    say("Error when half of the measured scenes predict the other half (100 random splits):")
    say(f"{'stage':14}{'total: median':>14}{'95 % within':>14}{'scene: median':>17}")
    for name, error in found.items():
        if math.isnan(error.usual):
            say(f"{name:14}   too few scenes")
            continue
        say(f"{name:14}{error.usual:>14.1%}{error.worst:>14.1%}{error.scene:>17.1%}")


def _bytes(count: float) -> str:
    for unit in ("MB", "GB"):
        count /= 1e6 if unit == "MB" else 1e3
        if count < 1000:
            return f"{count:,.1f} {unit}"
    return f"{count / 1e3:,.2f} TB"


def _span(hours: float) -> str:
    if hours < 1:
        return f"{60 * hours:.0f} minutes"
    return f"{hours:.1f} hours" if hours < 48 else f"{hours / 24:.1f} days"
