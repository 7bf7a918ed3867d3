"""`pbrnet report`: the HTML page of a run."""

from __future__ import annotations

from pathlib import Path

import click

from pbrnet.model.report.page import Places, write_report
from pbrnet.pipeline.commands.options import FILE, FOLDER, Request, common_options
from pbrnet.pipeline.terminal import say


@click.command(
    epilog="""\b
Examples:
  pbrnet report                        write report/index.html
  pbrnet report --out /tmp/page.html   write it elsewhere

The page works offline. Where results are missing, it names the command that creates them."""
)
@click.option("--out", type=FILE, default=Path("report/index.html"), help="Page to write.")
@click.option(
    "--root",
    type=FOLDER,
    default=Path(),
    help="Folder with models, metrics, plots and predictions.",
)
@common_options
def report(request: Request, out: Path, root: Path) -> None:
    """Write a self-contained HTML page with the results of a run."""
    places = Places(
        request.data, *(root / name for name in ("models", "metrics", "plots", "predictions"))
    )
    for sentence in write_report(places, request.params, out):
        say(f"note: {sentence}", err=True)
    say(f"Written: {out} ({out.stat().st_size / 1e6:.1f} MB)")
