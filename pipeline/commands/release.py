"""`pbrnet release`: datasets made from recipes."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import click

from pbrnet.pipeline.commands.options import FOLDER, Request, chosen, farm_options
from pbrnet.pipeline.commands.stages import STAGES
from pbrnet.pipeline.commands.start import start_lines
from pbrnet.pipeline.costs.ledger import read_ledger
from pbrnet.pipeline.dataset.description.card import DatasetSummary
from pbrnet.pipeline.dataset.pack import pack_dataset
from pbrnet.pipeline.dataset.shards import SUMS, read_sums
from pbrnet.pipeline.farm.versions import instruction_set, processor
from pbrnet.pipeline.records import run_lock
from pbrnet.pipeline.release.recipe import (
    Record,
    add_to_card,
    compare,
    core_seconds,
    load_recipe,
    load_record,
    recipe_names,
    save_record,
)
from pbrnet.pipeline.release.scenes import FORMATS, add_scenes
from pbrnet.pipeline.release.verify import verify_rows
from pbrnet.pipeline.stages.runner import StageError
from pbrnet.pipeline.terminal import counted, say
from pbrnet.scenes.errors import PbrnetError
from pbrnet.scenes.files import resolved

_STAGES = tuple(stage for name, stage in STAGES.items() if name != "dataset")


@click.command(
    epilog="""\b
Examples:
  pbrnet release                          list the recipes
  pbrnet release tiny                     make the dataset and compare it with its record
  pbrnet release quick --record           make it and record its checksums and cost
  pbrnet release tiny --scenes glb        with its scenes as GLB, in OUT/dataset/scenes
  pbrnet release quick --verify 5 --dataset COPY   render 5 of its rows anew and compare
  pbrnet cost --recipe indoor-75k         estimate the cost of a large one

The dataset is in OUT/dataset. An interrupted release resumes. Exit code 1 if files differ
from the record, some views failed, or a row that was rendered anew is another."""
)
@click.argument("name", required=False)
@click.option(
    "--out", type=FOLDER, help="Data folder of the release.  [default: data/releases/NAME]"
)
@click.option(
    "--recipes",
    type=FOLDER,
    help="Folder with the recipes.  [default: recipes, then those of the package]",
)
@click.option(
    "--record", is_flag=True, help="Record checksums and cost beside the recipe, for later runs."
)
@click.option(
    "--scenes",
    type=click.Choice(FORMATS),
    help="Put the scenes beside the dataset, in this format of pbrnet export-scene. Scenes whose "
    "licence or author is unknown are left out.",
)
@click.option(
    "--verify",
    "rows",
    type=click.IntRange(1),
    metavar="N",
    help="Make nothing; render N random rows of the dataset anew and compare them.",
)
@click.option(
    "--dataset", type=FOLDER, help="Dataset that --verify checks.  [default: OUT/dataset]"
)
@click.option(
    "--seed", type=int, default=0, help="Draws the rows of --verify; the recipe has its own."
)
@farm_options
def release(
    name: str | None,
    out: Path | None,
    recipes: Path | None,
    record: bool,
    scenes: str | None,
    rows: int | None,
    dataset: Path | None,
    seed: int,
    scheduler: str | None,
    **farm: Any,
) -> None:
    """Make the dataset of the recipe NAME and compare its checksums with the recorded ones.

    Without NAME, list the recipes. With --verify, check a dataset that exists already, such as a
    copy by someone else.
    """
    if name is None:
        for label, title in recipe_names(recipes).items():
            say(f"{label:12} {title}")
        return
    recipe = load_recipe(name, recipes)
    known = load_record(name, recipes)
    out = resolved(out or Path("data") / "releases" / name)
    params = replace(recipe.parameters, farm=chosen(recipe.parameters.farm, **farm))
    if rows is not None:
        with run_lock(out, "release"):
            verdict = verify_rows(
                dataset or out / "dataset", params, rows, seed, out / "verify", scheduler
            )
        say(*verdict.lines)
        if verdict.faults:
            raise PbrnetError(f"{name}: {counted(len(verdict.faults), 'row')} unlike the recipe's")
        return
    if dataset is not None:
        raise click.UsageError("--dataset goes with --verify")
    request = Request(params, out, scheduler)
    say(*start_lines(request), err=True)
    summary, failure = _make(request)
    dataset = out / "dataset"
    made = Record(
        recipe.version,
        core_seconds(read_ledger(out)),
        summary.total,
        sum(path.stat().st_size for path in dataset.iterdir() if path.is_file()),
        processor(),
        instruction_set(),
        {},
    )
    if record:
        known = made
    add_to_card(dataset, name, recipe, known)
    sums = read_sums(dataset / SUMS)
    say(
        f"{name} {recipe.version}: {counted(summary.total, 'row')}, {made.bytes / 1e6:.1f} MB, "
        f"{made.core_hours:.2f} core-hours, in {dataset}"
    )
    if scenes is not None:
        _with_scenes(out, scenes)
    if record:
        say(f"recorded in {save_record(name, replace(made, sums=sums), recipes)}")
    elif known is None:
        say(f"nothing to compare with; record it with: pbrnet release {name} --record")
    else:
        _compared(name, recipe.version, known, sums)
    if failure is not None:
        raise failure


def _make(request: Request) -> tuple[DatasetSummary, StageError | None]:
    """Run all stages; returns what the dataset holds, and the first stage's failures."""
    failure = None
    with run_lock(request.data, "release"):
        for stage in _STAGES:
            try:
                say(*str(stage(request.data, request.params, request.scheduler)).split("\n"))
            except StageError as error:  # some views failed; the dataset holds the others
                say(*error.args, err=True)
                failure = failure or error
        return pack_dataset(request.data, request.params), failure


def _with_scenes(out: Path, format_: str) -> None:
    beside = add_scenes(out, format_)
    scenes, files = counted(len(beside.files), "scene"), counted(beside.count, "file")
    say(f"{scenes}, {files}, in {out / 'dataset' / 'scenes'}")
    if beside.unlicensed:
        say("left out, licence or author unknown: " + ", ".join(beside.unlicensed))


def _compared(name: str, version: str, known: Record, sums: dict[str, str]) -> None:
    difference = compare(known, sums)
    if not difference:
        say(f"all {len(sums)} files have the recorded checksums")
        return
    reasons = []
    if known.version != version:
        reasons.append(f"the record is of version {known.version}")
    if known.instruction_set != instruction_set():
        reasons.append(
            f"the record was made with {known.instruction_set}, and light frames depend on it in "
            "their last bits"
        )
    because = f" ({'; '.join(reasons)})" if reasons else ""
    raise PbrnetError(f"{name}: differs from the record{because}: {difference}")
