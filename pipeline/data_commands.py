"""`pbrnet dataset`, `pbrnet inspect` and `pbrnet report`: what becomes of the frames."""

from __future__ import annotations

from pathlib import Path

import click

from pipeline.card import DatasetSummary
from pipeline.dataset import pack_dataset
from pipeline.options import common_options
from pipeline.params import Params


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
        f"{split} {rows} from {summary.scenes[split]} scenes"
        for split, rows in summary.rows.items()
    )
    lines = [
        f"{summary.sampled} views sampled, {summary.total} rows ({splits})",
        f"{len(summary.files)} shards, {summary.bytes / 1e6:.1f} MB in {folder}",
    ]
    if summary.rejected:
        reasons = ", ".join(f"{reason} {count}" for reason, count in summary.rejected.items())
        lines.append(f"rejected: {reasons}; see {folder / 'rejected.csv'}")
    return lines
