"""Options that commands share, turned into checked parameters before any work starts."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import wraps
from pathlib import Path
from typing import Any

import click

from pipeline.params import load_params

Command = Callable[..., Any]


def common_options(command: Command) -> Command:
    """Add `--params`, `--seed` and `--data`; the command receives `params` and `data`."""

    @click.option(
        "--params",
        "params_file",
        type=click.Path(path_type=Path),
        default=Path("params.yaml"),
        show_default=True,
        help="Parameter file.",
    )
    @click.option("--seed", type=int, default=None, help="Root seed, instead of the file's.")
    @click.option(
        "--data",
        type=click.Path(path_type=Path, file_okay=False),
        default=Path("data"),
        show_default=True,
        help="Data folder.",
    )
    @wraps(command)
    def wrapped(params_file: Path, seed: int | None, **others: Any) -> Any:
        asked = {name: others.pop(name, None) for name in ("workers", "transfer")}
        given = {name: value for name, value in asked.items() if value is not None}
        params = load_params(params_file, seed)
        params = replace(params, farm=replace(params.farm, **given))
        return command(params=params, **others)

    return wrapped


def farm_options(command: Command) -> Command:
    """Add `--scheduler`, `--transfer` and `--workers`; use above `common_options`, see there."""
    command = click.option(
        "--scheduler",
        metavar="ADDRESS",
        default=None,
        help="Dask scheduler to use; else DASK_SCHEDULER_ADDRESS, else workers of our own.",
    )(command)
    command = click.option(
        "--transfer",
        type=click.Choice(["auto", "shared", "send"]),
        default=None,
        help="Scenes and frames by the shared data folder, sent by dask, or (auto) as can be.",
    )(command)
    return click.option(
        "--workers",
        type=click.IntRange(0),
        default=None,
        help="Own workers to start; 0 is one per allowed CPU.",
    )(command)
