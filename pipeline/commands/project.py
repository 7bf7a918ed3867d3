"""`pbrnet init`, `pbrnet preset` and `pbrnet params`: a project's folder and its parameters."""

from __future__ import annotations

import json
import subprocess
import sys
from dataclasses import replace
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import click

from pbrnet.pipeline.commands.options import (
    FOLDER,
    PATH,
    Request,
    common_options,
    farm_options,
    idle_seed_option,
    json_option,
)
from pbrnet.pipeline.params import Params, read_yaml
from pbrnet.pipeline.release.presets import (
    Parameter,
    find_preset,
    flow,
    parameter_text,
    parameters,
    presets,
)
from pbrnet.pipeline.terminal import say
from pbrnet.scenes.errors import InputError, MachineError, ParameterError
from pbrnet.scenes.files import exists, read_text, regular_file, write_text
from pbrnet.scenes.installation import PACKAGE

_CODE = ("dvc.yaml", "keys.yaml")  # what a newer version of pbrnet renews


@click.command(
    epilog="""\b
Examples:
  pbrnet init                the current folder, which may contain other files
  pbrnet init rooms          a new folder
  pbrnet init --update       update dvc.yaml and keys.yaml to this version of pbrnet"""
)
@click.argument("folder", type=FOLDER, default=Path())
@click.option("--update", is_flag=True, help="Update only dvc.yaml and keys.yaml.")
@idle_seed_option
def init(folder: Path, update: bool) -> None:
    """Turn FOLDER into a project: params.yaml, dvc.yaml, keys.yaml, .gitignore, and DVC's files.

    Does not overwrite anything; a .gitignore gets the lines that it lacks. `dvc repro` then runs
    the quick start.
    """
    texts = {name: _text(name) for name in _CODE}
    if not update:
        texts["params.yaml"] = parameter_text(Params())
        there = [name for name in texts if exists(folder / name)]
        if there:
            raise ParameterError(f"{folder}: already has {', '.join(there)}; nothing was written")
        texts[".gitignore"] = _ignored(folder / ".gitignore")
    written: list[Path] = []
    try:
        for name, text in texts.items():
            write_text(folder / name, text)
            written.append(folder / name)
    except BaseException:  # a full disk: half a project could not be initialised again
        for path in () if update else written:
            path.unlink()
        raise
    say(f"{folder}: wrote {', '.join(texts)}")
    if not update:
        _init_dvc(folder)


def _text(name: str) -> str:
    return (PACKAGE / "project" / name).read_text(encoding="utf-8")


def _ignored(path: Path) -> str:
    """Return a .gitignore with what there is in one, and the lines of a project that it lacks."""
    own = _text("gitignore")
    known = read_text(path) if exists(path) else ""
    if not known:
        return own
    lines = known.splitlines()
    return "\n".join([*lines, *(line for line in own.splitlines() if line not in lines)]) + "\n"


def _init_dvc(folder: Path) -> None:
    """Initialise DVC in a folder, for its git repository if it is in one."""
    if exists(folder / ".dvc"):
        return
    if find_spec("dvc") is None:
        say("DVC is not installed; dvc repro requires: pip install 'pbrnet[dvc]'. Next: pbrnet run")
        return
    try:
        found = subprocess.run(
            ["git", "rev-parse", "--show-toplevel"], cwd=folder, capture_output=True, text=True
        )
        top = found.stdout.strip() if found.returncode == 0 else ""
    except FileNotFoundError:
        top = ""
    options = [] if top else ["--no-scm"]
    if top and Path(top) != folder.resolve():
        options = ["--subdir"]
    done = subprocess.run(
        [sys.executable, "-m", "dvc", "init", "--quiet", *options],
        cwd=folder,
        capture_output=True,
        text=True,
    )
    if done.returncode:
        raise MachineError(f"dvc init failed: {done.stderr.strip() or done.stdout.strip()}")
    say("Next: dvc repro")


@click.command(
    epilog="""\b
Examples:
  pbrnet preset                list the presets
  pbrnet preset quick          the quick start, for a machine with two cores
  pbrnet preset pbrs           the paper's light and cameras, 245 homes at 160x120
  pbrnet preset paper --force  480x360 at the paper's scale, for a cluster"""
)
@click.argument("name", required=False)
@click.option("--force", is_flag=True, help="Overwrite an edited parameter file.")
@click.option(
    "--params", "target", type=PATH, default=Path("params.yaml"), help="Parameter file to write."
)
@click.option("--seed", type=click.IntRange(0), help="Root seed to write into the file.")
def preset(name: str | None, force: bool, target: Path, seed: int | None) -> None:
    """Write the parameter preset NAME to params.yaml; without NAME, list the presets.

    The file has every key, with a comment where a value differs from the quick start's. Presets are
    the files params/*.yaml of the current folder and of the package.
    """
    if name is None:
        for label, one in presets().items():
            say(f"{label:12} {one.title.split('. ')[0]}")
        return
    found = find_preset(name)
    params = found.params()
    text = parameter_text(params if seed is None else replace(params, seed=seed), found.title)
    if target.is_dir():
        raise ParameterError(f"{target}: a folder; expected a file")
    if exists(target) and not force:
        try:
            current = regular_file(target).read_text(encoding="utf-8", errors="replace")
        except InputError as error:
            raise ParameterError(str(error)) from None
        if current not in (text, *(one.text() for one in presets().values())):
            raise ParameterError(
                f"{target}: was edited and matches no preset; keep a copy, then overwrite it "
                "with --force"
            )
    write_text(target, text)
    say(f"{target} now contains the preset {name!r}; next: dvc repro")


@click.command(
    epilog="""\b
Examples:
  pbrnet params                       every value, its source, and its meaning
  pbrnet params groundtruth           one section
  pbrnet params --changed             values that differ from the quick start's
  pbrnet params --complete            add the keys that params.yaml leaves out, for dvc repro
  pbrnet params --params params/paper.yaml --json"""
)
@click.argument("section", required=False)
@click.option("--changed", is_flag=True, help="Only values that differ from the quick start's.")
@click.option(
    "--complete",
    is_flag=True,
    help="Write every key with its value and meaning to the parameter file, in place of its text. "
    "dvc repro requires all sections.",
)
@json_option
@farm_options
@common_options
def params(
    request: Request, section: str | None, changed: bool, complete: bool, as_json: bool
) -> None:
    """Print the effective parameters with their source and meaning."""
    file = request.params_file
    if complete:
        write_text(file, parameter_text(request.params, "All parameters"))
        say(f"{file} now contains every key; next: dvc repro")
        return
    options = {"seed": "seed", "workers": "farm.workers", "transfer": "farm.transfer"}
    asked = click.get_current_context().params
    given = {key for name, key in options.items() if asked[name] is not None}
    written = set(_keys(read_yaml(file) or {}))
    every = parameters(request.params, inline=False)
    rows = [
        {"key": one.key, "value": one.value, "from": _origin(one, given, written, file),
         "default": one.default, "meaning": one.meaning}
        for one in every
        if not one.is_section and _inside(one.key, section) and (one.differs or not changed)
    ]  # fmt: skip
    if section and not any(_inside(one.key, section) for one in every):
        raise ParameterError(f"{section}: no such section or parameter")
    if as_json:
        say(*json.dumps(rows, indent=1).split("\n"))
        return
    for row in rows:
        value = f"{row['key']} = {flow(row['value'])}"
        say(f"{value:44}  {row['from']:14}  {row['meaning']}".rstrip())


def _inside(key: str, section: str | None) -> bool:
    return section is None or f"{key}.".startswith(f"{section}.")


def _origin(one: Parameter, given: set[str], written: set[str], file: Path) -> str:
    if one.key in given:
        return f"--{one.key.split('.')[-1]}"
    return str(file) if one.key in written else "default"


def _keys(content: Any, prefix: str = "") -> list[str]:
    """Return the dotted keys of the values in nested mappings."""
    if not isinstance(content, dict):
        return [prefix]
    parts = (_keys(item, f"{prefix}.{name}".lstrip(".")) for name, item in content.items())
    return [key for part in parts for key in part]
