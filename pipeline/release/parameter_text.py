"""Text of parameter files: every key with its value and its meaning, as in `params.yaml`."""

from __future__ import annotations

import textwrap
from collections.abc import Iterator
from dataclasses import dataclass, fields, is_dataclass
from typing import Any

import yaml

from pbrnet.pipeline.params import Params, texture_size_for
from pbrnet.scenes.checked import plain

QUICK = "Quick start: every stage on a small scale, for a machine with two cores."
_COLUMN, _WIDTH = 24, 100


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
