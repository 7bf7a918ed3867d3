"""Conversion of plain data (YAML, JSON) to frozen dataclasses, with checks of keys and values."""

from __future__ import annotations

import dataclasses
import difflib
import importlib
import math
import re
import reprlib
import types
import typing
from collections.abc import Callable, Mapping
from functools import cache
from pathlib import Path
from typing import Any, Literal, TypeVar, Union, get_args, get_origin, get_type_hints

from pbrnet.scenes.errors import ParameterError, PbrnetError

T = TypeVar("T")

_SHORT = reprlib.Repr()
_SHORT.maxlevel, _SHORT.maxstring, _SHORT.maxother = 2, 200, 200
_SHORT.maxlist = _SHORT.maxtuple = _SHORT.maxdict = _SHORT.maxset = 12
_LONGEST = 400  # characters of a value in a message


def within(
    low: float = -math.inf, high: float = math.inf, *, above: float = -math.inf
) -> dict[str, Any]:
    """Field metadata: the value (or each element) must lie in [low, high] and exceed `above`."""
    words = []
    if math.isfinite(above):
        words.append(f"above {_digits(above)}")
    if math.isfinite(low) and math.isfinite(high):
        words.append(f"from {_digits(low)} to {_digits(high)}")
    elif math.isfinite(low):
        words.append(f"at least {_digits(low)}")
    elif math.isfinite(high):
        words.append(f"at most {_digits(high)}")
    return {
        "check": lambda value: low <= value <= high and value > above,
        "allowed": " and ".join(words),
    }


def _digits(value: float) -> str:
    return str(int(value)) if float(value).is_integer() else f"{value:g}"


# Field metadata: `plain(..., brief=True)` leaves the field out while it has its default value, so
# that files and fingerprints of before the field existed stay as they are.
OPTIONAL = {"optional": True}
# Field metadata: a parameter file may say `auto`, for a value that follows from others.
AUTO = {"auto": True}
# Field metadata: a parameter file has the whole section in one line.
INLINE = {"inline": True}


def param(default: T, meaning: str = "", *rules: Mapping[str, Any]) -> T:
    """A dataclass field that is a parameter: its default, one line of meaning, `within` and so on.

    Dataclass fields are the only place of a default; `params.yaml` is written from them.
    """
    metadata: dict[str, Any] = {"meaning": meaning}
    for rule in rules:
        metadata |= rule
    return dataclasses.field(default=default, metadata=metadata)


def section(name: str, meaning: str = "") -> Any:
    """A dataclass field that is a section of parameters, of the class `name`: "module:class".

    The class is imported when an instance is made, so that sections stand beside the code they
    steer, which may import this dataclass. The annotation's name is for type checkers alone.
    """
    return dataclasses.field(
        default_factory=lambda: imported(name)(), metadata={"section": name, "meaning": meaning}
    )


@cache
def imported(name: str) -> Any:
    """Return the class or function `name`, "module:attribute"; its module is imported now."""
    module, attribute = name.split(":")
    return getattr(importlib.import_module(module), attribute)


def shown(value: object) -> str:
    """Return a value from outside for a message: its `repr`, shortened if it is long or deep."""
    if isinstance(value, int) and value.bit_length() > 4096:
        return "a number of over 1,200 digits"
    try:
        text = _SHORT.repr(value)
    except ValueError:  # it holds such a number
        text = f"a {type(value).__name__}"
    return text if len(text) <= _LONGEST else f"{text[:_LONGEST]}..."


def check_name(
    name: str, what: str, where: str = "", error: type[Exception] = ParameterError
) -> str:
    """Return a name from outside that becomes part of a path, or raise `error`.

    Letters, digits, '.', '_' and '-', at most 128, not beginning with one of the signs: so no
    name climbs out of its folder, is hidden or is taken for an option. Names of devices of
    Windows, such as CON, are refused, since datasets are carried there.
    """
    if re.fullmatch(r"(con|prn|aux|nul|com\d|lpt\d)(\..*)?", name, re.IGNORECASE):
        raise error(
            f"{f'{where}: ' if where else ''}{shown(name)} cannot be {what}: it is the name of a "
            "device on some systems; choose another"
        )
    if not re.fullmatch(r"[A-Za-z0-9][A-Za-z0-9._-]{0,127}", name):
        raise error(
            f"{f'{where}: ' if where else ''}{shown(name)} cannot be {what}: use letters, digits, "
            "'.', '_' and '-' only, a letter or digit first, at most 128"
        )
    return name


def build(
    cls: type[T],
    data: Any,
    where: str = "",
    error: type[PbrnetError] = ParameterError,
    base: T | None = None,
) -> T:
    """Read `data` (mappings, lists, scalars) as the dataclass `cls`.

    Missing keys take the value of `base`, or else the field's default; an unknown key, a wrong
    type or a value outside the field's `within(...)` raises `error`, naming key, value and what is
    allowed.
    """
    if not isinstance(data, dict):
        raise error(f"{where or cls.__name__}: expected a mapping of keys, got {shown(data)}")
    hints, fields = _types(cls), _fields(cls)  # type: ignore[arg-type]
    for key in data:
        if key not in fields:
            close = difflib.get_close_matches(str(key)[:100], fields, n=1)
            hint = f"; did you mean {close[0]!r}?" if close else ""
            raise error(f"{_join(where, key)}: unknown key{hint} (known: {', '.join(fields)})")
    values = {}
    for name, field in fields.items():
        key = _join(where, name)
        if name in data:
            usual = getattr(base, name) if base is not None else field.default
            if dataclasses.is_dataclass(hints[name]) and isinstance(usual, hints[name]):
                values[name] = build(hints[name], data[name], key, error, usual)
            else:
                values[name] = _convert(hints[name], data[name], key, field.metadata, error)
        elif base is not None:
            values[name] = getattr(base, name)
        elif field.default is dataclasses.MISSING and field.default_factory is dataclasses.MISSING:
            raise error(f"{key}: missing; expected {_describe(hints[name])}")
    built = cls(**values)
    verify: Callable[[str], None] | None = getattr(built, "verify", None)
    if verify is not None:
        try:
            verify(where)
        except ValueError as wrong:
            raise error(str(wrong)) from None
    return built


@cache
def _types(cls: type) -> dict[str, Any]:
    sections = {
        str(field.type): imported(field.metadata["section"])
        for field in dataclasses.fields(cls)
        if "section" in field.metadata
    }
    return get_type_hints(cls, localns=sections)


@cache
def _fields(cls: type) -> dict[str, dataclasses.Field[Any]]:
    return {field.name: field for field in dataclasses.fields(cls) if field.init}


def plain(value: Any, brief: bool = False) -> Any:
    """Convert dataclasses, tuples and paths to mappings, lists and text for JSON.

    With `brief`, `OPTIONAL` fields that have their default value are left out.
    """
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        return {
            name: plain(getattr(value, name), brief)
            for name, field in _fields(type(value)).items()
            if not (
                brief and "optional" in field.metadata and getattr(value, name) == field.default
            )
        }
    if isinstance(value, dict):
        return {str(key): plain(item, brief) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [plain(item, brief) for item in value]
    return str(value) if isinstance(value, Path) else value


def _join(where: str, key: object) -> str:
    name = key if isinstance(key, str) and len(key) <= 100 else shown(key)
    return f"{where}.{name}" if where else str(name)


def _convert(hint: Any, value: Any, key: str, metadata: Any, error: type[PbrnetError]) -> Any:
    origin = get_origin(hint)
    if dataclasses.is_dataclass(hint):
        return build(hint, value, key, error)  # type: ignore[arg-type]
    if origin in (Union, types.UnionType):
        options = [option for option in get_args(hint) if option is not type(None)]
        if value is None and type(None) in get_args(hint):
            return None
        # A mapping is for the dataclass among them, a list for the tuple, and nothing else is.
        shape = (isinstance(value, dict), isinstance(value, (list, tuple)))
        fitting = [
            one
            for one in options
            if (dataclasses.is_dataclass(one), get_origin(one) is tuple) == shape
        ]
        return _convert((fitting or options)[0], value, key, metadata, error)
    if origin is tuple:
        return _convert_tuple(hint, value, key, metadata, error)
    if origin is dict:
        if not isinstance(value, dict):
            raise error(f"{key}: expected {_describe(hint)}, got {shown(value)}")
        item_hint = get_args(hint)[1]
        return {
            str(name): _convert(item_hint, item, _join(key, name), metadata, error)
            for name, item in value.items()
        }
    if origin is Literal:
        if not any(type(value) is type(one) and value == one for one in get_args(hint)):
            # YAML reads on, off, yes and no without quotes as truth values.
            quote = "; quote it" if isinstance(value, bool) else ""
            allowed = ", ".join(map(repr, get_args(hint)))
            raise error(f"{key}: {shown(value)} is not one of {allowed}{quote}")
        return value
    if hint is Any:
        return value
    if hint is Path and isinstance(value, str):
        return Path(value)
    if hint is float and isinstance(value, int) and not isinstance(value, bool):
        try:
            value = float(value)
        except OverflowError:
            raise error(f"{key}: expected a finite number, got {shown(value)}") from None
    if not isinstance(value, hint) or (isinstance(value, bool) and hint is not bool):
        raise error(f"{key}: expected {_describe(hint, metadata)}, got {shown(value)}")
    if hint is float and not math.isfinite(value):
        raise error(f"{key}: expected a finite number, got {shown(value)}")
    if "check" in metadata and not metadata["check"](value):
        raise error(f"{key}: {shown(value)} is not allowed; must be {metadata['allowed']}")
    return value


def _convert_tuple(
    hint: Any, value: Any, key: str, metadata: Any, error: type[PbrnetError]
) -> tuple[Any, ...]:
    if not isinstance(value, (list, tuple)):
        raise error(f"{key}: expected {_describe(hint)}, got {shown(value)}")
    item_hints = get_args(hint)
    if len(item_hints) == 2 and item_hints[1] is Ellipsis:
        item_hints = (item_hints[0],) * len(value)
    if len(item_hints) != len(value):
        raise error(f"{key}: expected {len(item_hints)} values, got {shown(value)}")
    return tuple(
        item
        if _needs_no_check(item_hint, item, metadata)
        else _convert(item_hint, item, f"{key}[{index}]", metadata, error)
        for index, (item_hint, item) in enumerate(zip(item_hints, value, strict=True))
    )


def _needs_no_check(hint: Any, value: Any, metadata: Any) -> bool:
    """Return whether a value clearly is of a plain type: most of a long list are."""
    if type(value) is not hint or metadata:
        return False
    return hint is str or (hint is float and math.isfinite(value))


def _describe(hint: Any, metadata: Any = types.MappingProxyType({})) -> str:
    names = {
        int: "a whole number",
        float: "a number",
        str: "text",
        bool: "true or false",
        Path: "text",
    }
    if dataclasses.is_dataclass(hint):
        return "a mapping"
    if hint in names:
        allowed = metadata.get("allowed", "")
        return f"{names[hint]} {allowed}".strip()
    origin = get_origin(hint)
    if origin is tuple:
        return "a list"
    if origin is dict:
        return "a mapping"
    if origin in (Union, types.UnionType):
        return " or ".join(
            "nothing" if option is type(None) else _describe(option, metadata)
            for option in get_args(hint)
        )
    return str(getattr(hint, "__name__", typing.cast(Any, hint)))
