"""Options that commands share."""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import wraps
from pathlib import Path
from typing import Any

import click

from pbrnet.pipeline.farm.settings import FarmParams
from pbrnet.pipeline.keys import read_table, table
from pbrnet.pipeline.params import Params, load_params
from pbrnet.pipeline.terminal import say
from pbrnet.scenes.files import exists, resolved

Command = Callable[..., Any]
Decorator = Callable[[Command], Command]
PATH = click.Path(path_type=Path)
FOLDER = click.Path(path_type=Path, file_okay=False)
FILE = click.Path(path_type=Path, dir_okay=False)


@dataclass(frozen=True)
class Request:
    """Parameters and places that a command is asked to work with."""

    params: Params
    data: Path
    scheduler: str | None = None  # address of dask's
    params_file: Path = Path("params.yaml")
    dry_run: bool = False  # print the plan only


class Size(click.ParamType):
    """Image size like `640x480`, as (width, height)."""

    name = "size"

    def convert(self, value: Any, param: Any, ctx: Any) -> tuple[int, int]:
        """Parse the value; raises click's `BadParameter` for anything else."""
        match = re.fullmatch(r"(\d{1,5})[xX](\d{1,5})", value)
        if match is None or min(int(match[1]), int(match[2])) < 1:
            self.fail(f"{value!r} is not a size; write it like 640x480", param, ctx)
        return int(match[1]), int(match[2])


class NumberRange(click.FloatRange):
    """A number within limits; NaN, which click finds within any, is refused."""

    def convert(self, value: Any, param: Any, ctx: Any) -> float:
        """Parse the value; raises click's `BadParameter` for anything else."""
        number: float = super().convert(value, param, ctx)
        if math.isnan(number):
            self.fail(f"{value} is not a number", param, ctx)
        return number


def size_option(help_text: str) -> Decorator:
    """Option `--size`: (width, height) or None."""
    return click.option("--size", type=Size(), metavar="WxH", help=help_text)


data_option = click.option("--data", type=FOLDER, default=Path("data"), help="Data folder.")
json_option = click.option("--json", "as_json", is_flag=True, help="Print JSON.")
idle_seed_option = click.option(
    "--seed",
    type=int,
    expose_value=False,
    hidden=True,  # nothing is random
)


def common_options(command: Command) -> Command:
    """Add `--params`, `--seed` and `--data` to a command, which receives a `request`.

    It holds the options of `farm_options` and `stage_options`, too, those of the farm merged into
    `params.farm`.
    """

    @click.option(
        "--params", "params_file", type=PATH, default=Path("params.yaml"), help="Parameter file."
    )
    @click.option(
        "--seed",
        type=int,
        default=None,
        help="Root seed, instead of the one in the parameter file.",
    )
    @data_option
    @wraps(command)
    def wrapped(
        params_file: Path,
        seed: int | None,
        data: Path,
        scheduler: str | None = None,
        workers: int | None = None,
        transfer: str | None = None,
        dry_run: bool = False,
        remove_orphans: bool = False,
        **others: Any,
    ) -> Any:
        # Scenes that `pbrnet scenes` describes are given, and need no parameters.
        params = Params() if others.get("described") else load_params(params_file, seed)
        warn_of_keys(Path("keys.yaml"))
        resolved(data)  # refuses links in a circle
        days = 0.0 if remove_orphans else None
        farm = chosen(params.farm, workers=workers, transfer=transfer, trash_days=days)
        params = replace(params, farm=farm)
        return command(request=Request(params, data, scheduler, params_file, dry_run), **others)

    return wrapped


def chosen(farm: FarmParams, **options: Any) -> FarmParams:
    """Return the parameters of the farm with the options that are given, those not None."""
    return replace(farm, **{name: value for name, value in options.items() if value is not None})


def warn_of_keys(file: Path) -> None:
    """Warn on stderr that a project's keys are those of another version of pbrnet."""
    if not exists(file):
        return
    known, here = table(), read_table(file)
    for name in sorted(known.keys() | here.keys()):
        if known.get(name) != here.get(name):
            say(
                f"{file}: {name} is {here.get(name, 'missing')}, but {known.get(name, 'missing')} "
                "in this version of pbrnet; update the file with: pbrnet init --update",
                err=True,
            )
            return


def farm_options(command: Command) -> Command:
    """Add `--scheduler`, `--transfer` and `--workers`; use it above `common_options`."""
    command = click.option(
        "--scheduler",
        metavar="ADDRESS",
        default=None,
        help="Dask scheduler.  [default: DASK_SCHEDULER_ADDRESS, or local workers]",
    )(command)
    command = click.option(
        "--transfer",
        type=click.Choice(["auto", "shared", "send"]),
        default=None,
        help="Transfer of scenes and frames: shared folder, through dask, or decided per worker.",
    )(command)
    return click.option(
        "--workers",
        type=click.IntRange(0),
        default=None,
        help="Number of local workers; 0 means one per graphics card, otherwise per allowed CPU.",
    )(command)


def stage_options(command: Command) -> Command:
    """Add `--dry-run`, `--remove-orphans` and `farm_options`; use it above `common_options`."""
    command = click.option(
        "--dry-run",
        is_flag=True,
        help="Only print what would be made, kept and removed, and the estimated time.",
    )(command)
    command = click.option(
        "--remove-orphans",
        is_flag=True,
        help="Delete outputs that are no longer required, and everything in DATA/trash.",
    )(command)
    return farm_options(command)
