"""`pbrnet dataset` and `pbrnet inspect`: pack frames, describe and draw files."""

from __future__ import annotations

from pathlib import Path

import click

from pipeline.commands.options import common_options
from pipeline.dataset.card import DatasetSummary
from pipeline.dataset.checksums import verify_sums
from pipeline.dataset.pack import pack_dataset
from pipeline.images import png_bytes
from pipeline.inspection.describe import inspect_diversity, inspect_path, with_leaks
from pipeline.params import Params
from scenes.files import atomic_file


@click.command(
    epilog="""\b
Examples:
  pbrnet dataset                       check the frames in data/ and pack them
  pbrnet dataset --data /mnt/big/data  the same, elsewhere

Views that do not pass the checks are listed in data/dataset/rejected.csv with the reason."""
)
@common_options
def dataset(params: Params, data: Path) -> None:
    """Check every view's frames and pack them into Parquet shards with a dataset card."""
    summary = pack_dataset(data, params)
    for line in _summary_lines(summary, data / "dataset"):
        click.echo(line)


def _summary_lines(summary: DatasetSummary, folder: Path) -> list[str]:
    splits = ", ".join(
        f"{split} {rows} of {summary.scenes[split]} scenes" for split, rows in summary.rows.items()
    )
    lines = [
        f"{summary.sampled} views sampled, {summary.total} rows ({splits})",
        f"{len(summary.files)} shards, {summary.bytes / 1e6:.1f} MB in {folder}",
    ]
    if summary.rejected:
        reasons = ", ".join(f"{reason} {count}" for reason, count in summary.rejected.items())
        lines.append(f"rejected: {reasons}; see {folder / 'rejected.csv'}")
    return lines


@click.command(
    epilog="""\b
Examples:
  pbrnet inspect data/scenes/home-0000                 rooms, sizes, lights, and pictures
  pbrnet inspect data/cameras/home-0000.json           views, and why others were dropped
  pbrnet inspect data/color/home-0000/000.exr          figures of every channel, and pictures
  pbrnet inspect data/dataset --out sheet.png          columns, sizes, and a contact sheet
  pbrnet inspect data/dataset --diversity              histograms of what its views show
  pbrnet inspect data/dataset --verify --text-only      its files against their checksums
  pbrnet inspect data/ledger.parquet                   what everything cost
  pbrnet inspect data/scenes/flat --leaks --text-only  gaps that let light through
  pbrnet inspect models/shading.safetensors --json     layers and card, machine-readable
  pbrnet inspect data/assets                           catalogues, and a sheet of their pieces"""
)
@click.argument("path", type=click.Path(path_type=Path))
@click.option(
    "--out",
    type=click.Path(path_type=Path, dir_okay=False),
    default=None,
    help="Where to draw it.  [default: inspect-<name>.png, here]",
)
@click.option("--text-only", is_flag=True, help="Draw nothing.")
@click.option("--plan-only", is_flag=True, help="Of a scene draw the plan, without rendering.")
@click.option("--json", "as_json", is_flag=True, help="Print JSON instead of text.")
@click.option(
    "--diversity",
    is_flag=True,
    help="Of a dataset: objects, depth, brightness, colour and lights of its views, by source.",
)
@click.option("--verify", is_flag=True, help="Of a dataset: compare its files' checksums first.")
@click.option("--leaks", is_flag=True, help="Of a scene: where light gets in besides by portals.")
@click.option(
    "--seed", type=int, default=None, expose_value=False, help="Not used: nothing is random."
)
def inspect(
    path: Path,
    out: Path | None,
    text_only: bool,
    plan_only: bool,
    as_json: bool,
    diversity: bool,
    verify: bool,
    leaks: bool,
) -> None:
    """Say what PATH holds (scene, frame, shard, dataset, model, catalogues ...), and draw it.

    Of a scene the picture shows the plan, a dollhouse view from above and two quick renders.
    """
    if verify:
        count = verify_sums(path if path.is_dir() else path.parent)
        click.echo(f"{count} files are as they were written", err=as_json)
    inspection = inspect_diversity(path) if diversity else inspect_path(path, renders=not plan_only)
    if leaks:
        inspection = with_leaks(inspection, path)
    click.echo(inspection.json if as_json else inspection.text)
    if not text_only:
        target = out or Path(f"inspect-{path.resolve().stem}.png")
        picture = png_bytes(inspection.draw())
        with atomic_file(target) as partial:
            partial.write_bytes(picture)
        click.echo(f"\nDrawn: {target}", err=as_json)
