"""Command-line options shared by the commands on networks."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import wraps
from pathlib import Path
from typing import Any

import click

from pbrnet.pipeline.commands.options import FOLDER, Decorator, Request, common_options


def folders_options(help_text: str = "Folder of trained networks.") -> Decorator:
    """Options of `common_options` and `--models`; the command receives `request` and `folders`."""

    def add(command: Callable[..., Any]) -> Callable[..., Any]:
        @models_option(help_text)
        @common_options
        @wraps(command)
        def wrapped(request: Request, models: Path, **others: Any) -> Any:
            from pbrnet.model.training.train import Folders

            folders = Folders.beside(request.data, models)
            return command(request=request, folders=folders, **others)

        return wrapped

    return add


def models_option(help_text: str = "Folder of trained networks.") -> Decorator:
    """Option `--models`: a folder, by default `models/`."""
    return click.option("--models", type=FOLDER, default=Path("models"), help=help_text)


def found_models_option() -> Decorator:
    """Option `--models` of commands that may use the pretrained networks; by default None.

    `pbrnet.model.release.pretrained.find_models` turns it into a folder.
    """
    return click.option(
        "--models",
        type=FOLDER,
        help="Folder of trained networks.  [default: models, else the pretrained networks]",
    )


def methods_option(names: Sequence[str], help_text: str, **more: Any) -> Decorator:
    """Option `--method`, repeatable: some of these names, passed as a tuple `methods`."""
    return click.option(
        "--method", "methods", type=click.Choice(names), multiple=True, help=help_text, **more
    )


def renders_option(help_text: str) -> Decorator:
    """Option `--renders`: a folder, or None."""
    return click.option("--renders", type=FOLDER, help=help_text)
