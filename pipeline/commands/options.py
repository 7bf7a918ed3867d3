"""Options that commands share."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import replace
from functools import wraps
from pathlib import Path
from typing import Any

import click

from pbrnet.pipeline.keys import read_table, table
from pbrnet.pipeline.params import load_params
from pbrnet.scenes.files import exists, resolved

Command = Callable[..., Any]


class Size(click.ParamType):
    """Image size like `640x480`, as (width, height)."""

    name = "size"

    def convert(self, value: Any, param: Any, ctx: Any) -> tuple[int, int]:
        """Parse the value; raises click's `BadParameter` for anything else."""
        match = re.fullmatch(r"(\d{1,5})[xX](\d{1,5})", value)
        if match is None or min(int(match[1]), int(match[2])) < 1:
            self.fail(f"{value!r} is not a size; write it like 640x480", param, ctx)
        return int(match[1]), int(match[2])


def common_options(command: Command) -> Command:
    """Add `--params`, `--seed` and `--data` to a command, which receives `params` and `data`.

    The options of `farm_options` are merged into `params.farm`.
    """

    @click.option(
        "--params",
        "params_file",
        type=click.Path(path_type=Path),
        default=Path("params.yaml"),
        show_default=True,
        help="Parameter file.",
    )
    @click.option(
        "--seed",
        type=int,
        default=None,
        help="Root seed, instead of the one in the parameter file.",
    )
    @click.option(
        "--data",
        type=click.Path(path_type=Path, file_okay=False),
        default=Path("data"),
        show_default=True,
        help="Data folder.",
    )
    @wraps(command)
    def wrapped(params_file: Path, seed: int | None, **others: Any) -> Any:
        options = {name: others.pop(name, None) for name in ("workers", "transfer")}
        given = {name: value for name, value in options.items() if value is not None}
        params = load_params(params_file, seed)
        warn_of_keys(Path("keys.yaml"))
        resolved(others["data"])  # refuses links in a circle
        params = replace(params, farm=replace(params.farm, **given))
        return command(params=params, **others)

    return wrapped


def warn_of_keys(file: Path) -> None:
    """Say on stderr that a project's keys are those of another version of pbrnet."""
    if not exists(file):
        return
    known, here = table(), read_table(file)
    for name in sorted(known.keys() | here.keys()):
        if known.get(name) != here.get(name):
            click.echo(
                f"{file}: {name} is {here.get(name, 'missing')}, but {known.get(name, 'missing')} "
                "in this version of pbrnet; renew the file with: pbrnet init --update",
                err=True,
            )
            return


def farm_options(command: Command) -> Command:
    """Add `--scheduler`, `--transfer` and `--workers`; use it above `common_options`."""
    command = click.option(
        "--scheduler",
        metavar="ADDRESS",
        default=None,
        help="Dask scheduler.  [default: DASK_SCHEDULER_ADDRESS, else local workers]",
    )(command)
    command = click.option(
        "--transfer",
        type=click.Choice(["auto", "shared", "send"]),
        default=None,
        help="Scenes and frames in the shared data folder, through dask, or chosen per worker.",
    )(command)
    return click.option(
        "--workers",
        type=click.IntRange(0),
        default=None,
        help="Number of local workers; 0: one per allowed CPU.",
    )(command)
