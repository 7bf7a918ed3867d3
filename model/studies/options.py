"""Configuration of a study as options of its command: one field says name, range, default, help."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import MISSING, field, fields
from typing import Any

import click


def option(default: Any, kind: Any, help_text: str, shown: bool = True) -> Any:
    """Field of a configuration that `config_options` turns into an option.

    `kind`: a click type, or bool for a flag; `shown`: whether the help shows the default.
    """
    return field(default=default, metadata={"option": (kind, help_text, shown)})


def config_options(config: type) -> Callable[[Callable[..., Any]], Callable[..., Any]]:
    """Add an option for each `option` field of a configuration, in their order.

    The command gets them by keyword, under the names of the fields.
    """

    def add(command: Callable[..., Any]) -> Callable[..., Any]:
        for one in reversed(fields(config)):
            if "option" in one.metadata:
                command = _added(command, one.name, one.default, *one.metadata["option"])
        return command

    return add


def _added(
    command: Callable[..., Any], name: str, default: Any, kind: Any, help_text: str, shown: bool
) -> Callable[..., Any]:
    assert default is not MISSING
    words = f"--{name.replace('_', '-')}"
    if kind is bool:
        return click.option(words, name, is_flag=True, help=help_text)(command)
    return click.option(
        words, name, type=kind, default=default, show_default=shown, help=help_text
    )(command)
