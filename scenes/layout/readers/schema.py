"""JSON Schema of pbrnet's own layouts, made from the dataclasses that read them."""

from __future__ import annotations

import dataclasses
import types
from typing import Any, Literal, Union, get_args, get_origin, get_type_hints

from pbrnet.scenes.layout.readers.own import OwnLayout

_PLAIN = {float: "number", int: "integer", str: "string", bool: "boolean"}


def layout_schema() -> dict[str, Any]:
    """Return the schema, draft 2020-12; ranges of numbers are left to the reader."""
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": "Layout of pbrnet",
        **_object(OwnLayout),
    }


def _object(cls: type) -> dict[str, Any]:
    hints = get_type_hints(cls)
    fields = dataclasses.fields(cls)
    return {
        "type": "object",
        "properties": {one.name: _value(hints[one.name]) for one in fields},
        "required": [one.name for one in fields if one.default is dataclasses.MISSING],
        "additionalProperties": False,
    }


def _value(hint: Any) -> dict[str, Any]:
    """The schema of a value of a type."""
    parts = get_args(hint)
    if dataclasses.is_dataclass(hint):
        return _object(hint)  # type: ignore[arg-type]
    if get_origin(hint) in (Union, types.UnionType):
        return {"anyOf": [{"type": "null"} if each is type(None) else _value(each)
                          for each in parts]}  # fmt: skip
    if get_origin(hint) is Literal:
        return {"enum": list(parts)}
    if get_origin(hint) is not tuple:
        return {"type": _PLAIN[hint]}
    if parts[-1] is Ellipsis:
        return {"type": "array", "items": _value(parts[0])}
    size = len(parts)
    return {"type": "array", "items": _value(parts[0]), "minItems": size, "maxItems": size}
