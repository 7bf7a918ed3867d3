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
from collections.abc import Callable, Collection, Mapping
from functools import cache, partial
from itertools import cycle
from pathlib import Path
from typing import Any, Literal, TypeGuard, TypeVar, Union, get_args, get_origin, get_type_hints

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
    try:
        return _read(cls, data, base)
    except _RefusedError as refused:
        raise error(refused.described(where)) from None


class _RefusedError(Exception):
    """A value that is not accepted: what to say of it, given its key, and the keys that lead there.

    `words` returns that or, as the `verify` of dataclasses does, raises it as a ValueError. Whoever
    reads a part of the data adds its key, so that keys are only joined for a message.
    """

    def __init__(self, words: Callable[[str], object]) -> None:
        self.words, self.keys = words, list[object]()

    def described(self, where: str) -> str:
        """Words about the value, whose outermost key is `where`."""
        for key in reversed(self.keys):
            where = f"{where}[{key}]" if isinstance(key, int) else _join(where, key)
        try:
            return str(self.words(where))
        except ValueError as error:
            return str(error)


def _read(cls: type[T], data: Any, base: T | None = None) -> T:
    """The dataclass `cls` of a mapping, as `build` describes it."""
    if not isinstance(data, dict):
        raise _RefusedError(
            lambda where: f"{where or cls.__name__}: expected a mapping of keys, got {shown(data)}"
        )
    fields = _readers(cls)  # type: ignore[arg-type]
    for key in data:
        if key not in fields:
            raise _unknown(key, fields)
    values = {}
    for name, (field, section, read) in fields.items():
        if name in data:
            usual = getattr(base, name) if base is not None else field.default
            try:
                if section is not None and isinstance(usual, section):
                    values[name] = _read(section, data[name], usual)
                else:
                    values[name] = read(data[name])
            except _RefusedError as refused:
                refused.keys.append(name)
                raise
        elif base is not None:
            values[name] = getattr(base, name)
        elif field.default is dataclasses.MISSING and field.default_factory is dataclasses.MISSING:
            raise _missing(name, _types(cls)[name])  # type: ignore[arg-type]
    built = cls(**values)
    verify: Callable[[str], None] | None = getattr(built, "verify", None)
    if verify is not None:
        try:
            verify("")
        except ValueError:
            raise _RefusedError(verify) from None
    return built


def _unknown(key: object, fields: Collection[str]) -> _RefusedError:
    close = difflib.get_close_matches(str(key)[:100], fields, n=1)
    hint = f"; did you mean {close[0]!r}?" if close else ""
    known = ", ".join(fields)
    return _RefusedError(lambda where: f"{_join(where, key)}: unknown key{hint} (known: {known})")


def _missing(name: str, hint: Any) -> _RefusedError:
    return _RefusedError(lambda where: f"{_join(where, name)}: missing; expected {_describe(hint)}")


Field = tuple[dataclasses.Field[Any], type | None, Callable[[Any], Any]]


@cache
def _readers(cls: type) -> dict[str, Field]:
    """Fields of a dataclass by name: each with its own class, if that is one, and its reader."""
    return {
        name: (
            field,
            hint if _is_class(hint) else None,
            _reader(hint, field.metadata),
        )
        for name, field in _fields(cls).items()
        for hint in (_types(cls)[name],)
    }


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


def _reader(hint: Any, metadata: Mapping[str, Any]) -> Callable[[Any], Any]:
    """Function from a value to what a field of this type holds; it raises `_RefusedError`."""
    origin = get_origin(hint)
    if _is_class(hint):
        return partial(_read, hint)
    if origin in (Union, types.UnionType):
        return _union_reader(get_args(hint), metadata)
    if origin is tuple:
        return _tuple_reader(hint, metadata)
    if origin is dict:
        return _dict_reader(hint, metadata)
    if origin is Literal:
        return partial(_one_of, get_args(hint))
    if hint is Any:
        return lambda value: value
    return _scalar_reader(hint, metadata)


def _is_class(hint: Any) -> TypeGuard[type]:
    return dataclasses.is_dataclass(hint)


def _union_reader(hints: tuple[Any, ...], metadata: Mapping[str, Any]) -> Callable[[Any], Any]:
    options = [one for one in hints if one is not type(None)]
    readers = [_reader(one, metadata) for one in options]
    # A mapping is for the dataclass among them, a list for the tuple, and nothing else is.
    shapes = [(dataclasses.is_dataclass(one), get_origin(one) is tuple) for one in options]
    optional = len(options) < len(hints)

    def read(value: Any) -> Any:
        if value is None and optional:
            return None
        shape = (isinstance(value, dict), isinstance(value, (list, tuple)))
        return readers[shapes.index(shape) if shape in shapes else 0](value)

    return read


def _tuple_reader(hint: Any, metadata: Mapping[str, Any]) -> Callable[[Any], Any]:
    hints = get_args(hint)
    endless = len(hints) == 2 and hints[1] is Ellipsis
    readers = [_reader(one, metadata) for one in (hints[:1] if endless else hints)]

    def read(value: Any) -> Any:
        if not isinstance(value, (list, tuple)):
            raise _expected(hint, value)
        if not endless and len(value) != len(readers):
            raise _RefusedError(
                lambda key: f"{key}: expected {len(readers)} values, got {shown(value)}"
            )
        items = list[Any]()
        try:
            for reader, item in zip(cycle(readers), value, strict=False):
                items.append(reader(item))
        except _RefusedError as refused:
            refused.keys.append(len(items))
            raise
        return tuple(items)

    return read


def _dict_reader(hint: Any, metadata: Mapping[str, Any]) -> Callable[[Any], Any]:
    reader = _reader(get_args(hint)[1], metadata)

    def read(value: Any) -> Any:
        if not isinstance(value, dict):
            raise _expected(hint, value)
        items = {}
        for name, item in value.items():
            try:
                items[str(name)] = reader(item)
            except _RefusedError as refused:
                refused.keys.append(name if isinstance(name, str) else shown(name))
                raise
        return items

    return read


def _one_of(allowed: tuple[Any, ...], value: Any) -> Any:
    if any(type(value) is type(one) and value == one for one in allowed):
        return value
    # YAML reads on, off, yes and no without quotes as truth values.
    quote = "; quote it" if isinstance(value, bool) else ""
    words = f"{shown(value)} is not one of {', '.join(map(repr, allowed))}{quote}"
    raise _RefusedError(lambda key: f"{key}: {words}")


def _scalar_reader(hint: Any, metadata: Mapping[str, Any]) -> Callable[[Any], Any]:
    check = metadata.get("check")

    def read(value: Any) -> Any:
        if hint is float and type(value) is int:
            try:
                value = float(value)
            except OverflowError:
                raise _not_finite(value) from None
        if type(value) is not hint:
            if hint is Path and isinstance(value, str):
                return Path(value)
            if not isinstance(value, hint) or (isinstance(value, bool) and hint is not bool):
                raise _expected(hint, value, metadata)
        if hint is float and not math.isfinite(value):
            raise _not_finite(value)
        if check is not None and not check(value):
            words = f"{shown(value)} is not allowed; must be {metadata['allowed']}"
            raise _RefusedError(lambda key: f"{key}: {words}")
        return value

    return read


def _expected(
    hint: Any, value: Any, metadata: Mapping[str, Any] = types.MappingProxyType({})
) -> _RefusedError:
    return _RefusedError(
        lambda key: f"{key}: expected {_describe(hint, metadata)}, got {shown(value)}"
    )


def _not_finite(value: Any) -> _RefusedError:
    return _RefusedError(lambda key: f"{key}: expected a finite number, got {shown(value)}")


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
