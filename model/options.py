"""Command-line options shared by the commands on networks."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import click

from pbrnet.pipeline.commands.options import Size

FOLDER = click.Path(path_type=Path, file_okay=False)
FILE = click.Path(path_type=Path, dir_okay=False)
Decorator = Callable[[Callable[..., Any]], Callable[..., Any]]


def models_option(help_text: str = "Folder of trained networks.") -> Decorator:
    """Option `--models`: a folder, by default `models/`."""
    return click.option(
        "--models", type=FOLDER, default=Path("models"), show_default=True, help=help_text
    )


def found_models_option() -> Decorator:
    """Option `--models` of commands that may use the pretrained networks; by default None.

    `pbrnet.model.release.pretrained.find_models` turns it into a folder.
    """
    return click.option(
        "--models",
        type=FOLDER,
        default=None,
        help="Folder of trained networks.  [default: models, else the pretrained networks]",
    )


def size_option(help_text: str) -> Decorator:
    """Option `--size`: (width, height) or None."""
    return click.option("--size", type=Size(), default=None, metavar="WxH", help=help_text)


def renders_option(help_text: str) -> Decorator:
    """Option `--renders`: a folder, or None."""
    return click.option("--renders", type=FOLDER, default=None, help=help_text)
