"""Options that the networks' commands share."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import click

FOLDER = click.Path(path_type=Path, file_okay=False)
FILE = click.Path(path_type=Path, dir_okay=False)
Decorator = Callable[[Callable[..., Any]], Callable[..., Any]]


class Size(click.ParamType):
    """`640x480` as (width, height)."""

    name = "size"

    def convert(self, value: Any, param: Any, ctx: Any) -> tuple[int, int]:
        """Raises click's BadParameter."""
        match = re.fullmatch(r"(\d{1,5})[xX](\d{1,5})", value)
        if match is None or min(int(match[1]), int(match[2])) < 1:
            self.fail(f"{value!r} is no size; write it like 640x480", param, ctx)
        return int(match[1]), int(match[2])


def models_option(help_text: str = "Trained networks.") -> Decorator:
    """`--models`, a folder; `models/` unless given."""
    return click.option(
        "--models", type=FOLDER, default=Path("models"), show_default=True, help=help_text
    )


def found_models_option() -> Decorator:
    """`--models` of commands that use pretrained networks too, see `find_models`; None if not
    given."""
    return click.option(
        "--models",
        type=FOLDER,
        default=None,
        help="Trained networks.  [default: models, or else the pretrained ones]",
    )


def size_option(help_text: str) -> Decorator:
    """`--size`, (width, height) or None."""
    return click.option("--size", type=Size(), default=None, metavar="WxH", help=help_text)
