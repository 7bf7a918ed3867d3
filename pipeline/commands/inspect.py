"""`pbrnet inspect`: description of files."""

from __future__ import annotations

from pathlib import Path

import click

from pbrnet.pipeline.commands.options import FILE, PATH, idle_seed_option, json_option
from pbrnet.pipeline.dataset.shards import verify_sums
from pbrnet.pipeline.images import png_bytes
from pbrnet.pipeline.inspection.datasets import inspect_diversity, inspect_realism
from pbrnet.pipeline.inspection.describe import inspect_path
from pbrnet.pipeline.inspection.scenes import with_leaks
from pbrnet.pipeline.terminal import say
from pbrnet.scenes.files import atomic_file


@click.command(
    epilog="""\b
Examples:
  pbrnet inspect data/scenes/home-0000                 rooms, sizes, lights; plan and renders
  pbrnet inspect data/cameras/home-0000.json           views and rejected candidates
  pbrnet inspect data/color/home-0000/000.exr          statistics and images of the channels
  pbrnet inspect data/dataset --out sheet.png          columns, sizes; a contact sheet of previews
  pbrnet inspect data/dataset --diversity              histograms of view statistics
  pbrnet inspect data --realism                        statistics compared with photographs
  pbrnet inspect data/dataset --verify --text-only     compare files with their checksums
  pbrnet inspect data/ledger.parquet                   costs by stage
  pbrnet inspect data/scenes/flat --leaks --text-only  gaps that let light through
  pbrnet inspect models/shading.safetensors --json     layers and model card as JSON
  pbrnet inspect data/assets                           catalogues; a contact sheet of pieces"""
)
@click.argument("path", type=PATH)
@click.option(
    "--out", type=FILE, help="Image to write.  [default: inspect-NAME.png in the current folder]"
)
@click.option("--text-only", is_flag=True, help="Do not write an image.")
@click.option("--plan-only", is_flag=True, help="For a scene: draw only the plan, without renders.")
@json_option
@click.option(
    "--diversity",
    is_flag=True,
    help="For a dataset: statistics of objects, depth, luminance, colour and lights, by source.",
)
@click.option(
    "--realism",
    is_flag=True,
    help="For a data folder: statistics of its images, compared with photographs.",
)
@click.option("--verify", is_flag=True, help="For a dataset: compare files with their checksums.")
@click.option(
    "--leaks", is_flag=True, help="For a scene: find gaps, other than portals, that let light in."
)
@idle_seed_option
def inspect(
    path: Path,
    out: Path | None,
    text_only: bool,
    plan_only: bool,
    as_json: bool,
    diversity: bool,
    realism: bool,
    verify: bool,
    leaks: bool,
) -> None:
    """Describe PATH (scene, camera file, frame, shard, dataset, ledger, network or catalogues).

    Prints the description and writes an image. The image of a scene has the plan, a dollhouse view
    from above and two quick renders.
    """
    if verify:
        count = verify_sums(path if path.is_dir() else path.parent)
        say(f"{count} files match their checksums", err=as_json)
    if diversity:
        inspection = inspect_diversity(path)
    elif realism:
        inspection = inspect_realism(path)
    else:
        inspection = inspect_path(path, renders=not plan_only)
    if leaks:
        inspection = with_leaks(inspection, path)
    say(*(inspection.json if as_json else inspection.text).split("\n"))
    if not text_only:
        target = out or Path(f"inspect-{path.absolute().stem}.png")
        picture = png_bytes(inspection.draw())
        with atomic_file(target) as partial:
            partial.write_bytes(picture)
        say("", f"Picture: {target}", err=as_json)
