"""Presets and the text of parameter files; where presets and recipes are found.

A preset, `params/NAME.yaml`, holds what differs from the quick start, whose values are the defaults
of all keys. `pbrnet preset` writes it out whole.
"""

from __future__ import annotations

import textwrap
from collections.abc import Iterator
from dataclasses import dataclass, fields, is_dataclass
from itertools import takewhile
from pathlib import Path
from typing import Any

import yaml

from pbrnet.pipeline.params import Params, load_params, read_yaml, texture_size_for
from pbrnet.scenes.checked import plain
from pbrnet.scenes.errors import ParameterError
from pbrnet.scenes.files import regular_file
from pbrnet.scenes.installation import PACKAGE

QUICK = "Quick start: every stage on a small scale, for a machine with two cores."
_COLUMN, _WIDTH = 24, 100


@dataclass(frozen=True)
class Preset:
    """A preset: its title and its file, which the quick start does without."""

    title: str
    file: Path | None = None

    def params(self) -> Params:
        """Read and check the parameters; raises `ParameterError`."""
        return load_params(self.file) if self.file else Params()

    def content(self) -> Any:
        """Return what differs from the quick start, as it is written."""
        return (read_yaml(self.file) or {}) if self.file else {}

    def text(self) -> str:
        """Return the whole parameter file."""
        return parameter_text(self.params(), self.title)


def presets() -> dict[str, Preset]:
    """Return the presets by name, the quick start first."""
    files = files_of("params")
    return {"quick": Preset(QUICK)} | {
        name: Preset(_title(file), file) for name, file in files.items() if name != "quick"
    }


def find_preset(name: str) -> Preset:
    """Return a preset; raises `ParameterError` that names the others."""
    found = presets()
    if name not in found:
        raise ParameterError(f"{name}: no such preset; available: {', '.join(found)}")
    return found[name]


def files_of(folder: str, suffix: str = ".yaml") -> dict[str, Path]:
    """Return the files of a folder of the package and of the project by name.

    A file of the project goes before one of the package.
    """
    places = (PACKAGE / folder, Path(folder))
    files = [file for place in places for file in sorted(place.glob(f"*{suffix}"))]
    return dict(sorted((file.stem, file) for file in files))


def _title(file: Path) -> str:
    """The comment at a preset's beginning."""
    text = regular_file(file).read_text(encoding="utf-8", errors="replace")
    lines = takewhile(lambda line: line.startswith("#"), text.splitlines())
    return " ".join(line.lstrip("# ") for line in lines)


@dataclass(frozen=True)
class Parameter:
    """A parameter, or the section that the following ones are in."""

    key: str  # of the file: "cameras.grid"
    value: Any  # plain
    default: Any
    meaning: str
    is_section: bool = False

    @property
    def differs(self) -> bool:
        """True if the value is not the default."""
        return bool(self.value != self.default)


def parameters(params: Params, inline: bool = True) -> list[Parameter]:
    """Return all sections and parameters, in the order of the file.

    With `inline`, a section that the file has in one line counts as one parameter.
    """
    found = list(_walk(params, Params(), "", inline))
    if params.scenes.texture_size != texture_size_for(params.image.width):
        return found
    return [
        Parameter(one.key, "auto", "auto", one.meaning) if one.key == "scenes.texture_size" else one
        for one in found
    ]


def _walk(value: Any, default: Any, where: str, inline: bool) -> Iterator[Parameter]:
    for field in fields(value):
        mine, usual = getattr(value, field.name), getattr(default, field.name)
        key = f"{where}{field.name}"
        inside = is_dataclass(mine) and not (inline and "inline" in field.metadata)
        meaning = field.metadata.get("meaning", "")
        yield Parameter(key, plain(mine), plain(usual), meaning, inside)
        if inside:
            yield from _walk(mine, usual, f"{key}.", inline)


def parameter_text(params: Params, title: str = QUICK) -> str:
    """Return a whole parameter file; a comment says where a value is not the quick start's."""
    lines = [f"# {line}" for line in textwrap.wrap(title, _WIDTH - 2)]
    for one in parameters(params):
        depth = one.key.count(".")
        if one.is_section and not depth:
            lines.append("")
        meaning = one.meaning
        if one.differs and not one.is_section:
            meaning = f"{meaning}; quick start: {flow(_differing(one))}".removeprefix("; ")
        value = "" if one.is_section else f" {flow(one.value)}"
        lines += _line(f"{'  ' * depth}{one.key.split('.')[-1]}:{value}", meaning)
    return "\n".join(lines) + "\n"


def _differing(one: Parameter) -> Any:
    """Return the default; of a section in one line, those of the values that differ."""
    if not isinstance(one.default, dict):
        return one.default
    return {name: value for name, value in one.default.items() if one.value[name] != value}


def flow(value: Any) -> str:
    """Return a plain value as one line of YAML."""
    text = yaml.safe_dump(value, default_flow_style=True, width=10**6, sort_keys=False)
    return text.removesuffix("...\n").strip()


def _line(text: str, meaning: str) -> list[str]:
    """Return a key with its comment: at its right, or above if the line would be too long."""
    line = f"{text:{_COLUMN - 2}}  # {meaning}" if meaning else text
    if len(line) <= _WIDTH:
        return [line]
    indent = text[: len(text) - len(text.lstrip())]
    return [
        *textwrap.wrap(
            meaning, _WIDTH, initial_indent=f"{indent}# ", subsequent_indent=f"{indent}# "
        ),
        *textwrap.wrap(text, _WIDTH, subsequent_indent=f"{indent}  ", break_on_hyphens=False),
    ]
