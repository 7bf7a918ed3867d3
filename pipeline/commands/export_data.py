"""`pbrnet export-data`: the dataset in formats that other projects read."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from pbrnet.pipeline.commands.options import FOLDER, NumberRange, data_option, idle_seed_option
from pbrnet.pipeline.export.parts import ExportOptions, Job, run_export
from pbrnet.pipeline.export.registry import FORMATS
from pbrnet.pipeline.export.rows import DatasetRows
from pbrnet.pipeline.splits import SPLITS
from pbrnet.pipeline.terminal import counted, say
from pbrnet.scenes.errors import ParameterError

_DEFAULT = ExportOptions()


@click.command(
    "export-data",
    epilog="""\b
Examples:
  pbrnet export-data --to nerfstudio --scene home-0000     transforms.json, images, depths, points
  pbrnet export-data --to colmap --points 100000           cameras, images, points3D as text
  pbrnet export-data --to coco --classes nyu40             masks and boxes of objects
  pbrnet export-data --to coco-panoptic                    segments of things and stuff
  pbrnet export-data --to webdataset --split train         tars of OpenEXR images
  pbrnet export-data --to hypersim --out hypersim          HDF5 files and CSVs of Hypersim
  pbrnet export-data --to tum --fps 30                     RGB-D sequences of the walks
  pbrnet export-data --to renderformer --scene home-0000   triangles and cameras of each room

docs/exports.md describes each format: axes, units, and what is lost. An interrupted export
resumes; one with other options or another dataset replaces the earlier files.""",
)
@click.option(
    "--to",
    "name",
    type=click.Choice(list(FORMATS)),
    required=True,
    help="Format: " + "; ".join(f"{form.name}: {form.title}" for form in FORMATS.values()) + ".",
)
@data_option
@click.option("--dataset", type=FOLDER, help="Folder of the dataset.  [default: DATA/dataset]")
@click.option("--out", type=FOLDER, help="Folder to write.  [default: DATA/exports/FORMAT]")
@click.option(
    "--split",
    "splits",
    type=click.Choice(SPLITS),
    multiple=True,
    help="Only this split (repeatable).",
)
@click.option("--scene", "scenes", multiple=True, help="Only this scene (repeatable).")
@click.option(
    "--images",
    type=click.Choice(["png", "exr"]),
    default=_DEFAULT.images,
    help="nerfstudio: tone-mapped or linear images.",
)
@click.option(
    "--exposure",
    type=click.Choice(["scene", "view"]),
    default=_DEFAULT.exposure,
    help="Tone-mapped images: one exposure per scene, or one per view.",
)
@click.option(
    "--points",
    type=click.IntRange(1, 100_000_000),
    default=_DEFAULT.points,
    help="nerfstudio, colmap: maximum number of points per scene.",
)
@click.option(
    "--classes",
    type=click.Choice(["category", "nyu40", "nyu13"]),
    default=_DEFAULT.classes,
    help="coco, coco-panoptic: classes.",
)
@click.option(
    "--fps", type=NumberRange(0.001, 1e6), default=_DEFAULT.fps, help="tum: frames per second."
)
@click.option(
    "--tar-views",
    type=click.IntRange(1, 1_000_000),
    default=_DEFAULT.tar_views,
    help="webdataset: views per tar.",
)
@click.option(
    "--triangles",
    type=click.IntRange(64, 1_000_000),
    default=_DEFAULT.triangles,
    help="renderformer: maximum number of triangles per room.",
)
@click.option("--partial", is_flag=True, help="hypersim: leave out what the dataset lacks.")
@idle_seed_option
def export_data(
    name: str,
    data: Path,
    dataset: Path | None,
    out: Path | None,
    splits: tuple[str, ...],
    scenes: tuple[str, ...],
    **options: Any,
) -> None:
    """Write the packed dataset in a format of another project."""
    context = click.get_current_context()
    for option in options:
        given = context.get_parameter_source(option) is click.core.ParameterSource.COMMANDLINE
        if given and option not in FORMATS[name].uses:
            raise ParameterError(f"--{option.replace('_', '-')}: not for {name}")
    rows = DatasetRows(dataset or data / "dataset", splits, scenes)
    out = out or data / "exports" / name
    done = run_export(FORMATS[name], Job(rows, data / "scenes", ExportOptions(**options), out))
    kept = f", {done.kept} of {done.parts} parts existed already" if done.kept else ""
    left = f", {len(rows.rows) - done.views} left out" if done.views < len(rows.rows) else ""
    say(f"{counted(done.views, 'view')} as {name} in {out}{left}{kept}")
