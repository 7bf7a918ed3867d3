"""Builders of Mitsuba 3 XML elements."""

from __future__ import annotations

from xml.etree.ElementTree import Element

import numpy as np

from pbrnet.scenes.arrays import Float64Array

Value = Element | tuple[float, ...] | Float64Array | bool | int | float | str
_TAGS: dict[type, str] = {bool: "boolean", int: "integer", float: "float", str: "string"}


def plugin(tag: str, kind: str, name: str = "", /, **values: Value | None) -> Element:
    """A plugin element whose properties are the keyword `values`, typed by their Python type.

    Tuples of three become colours, arrays (4, 4) transforms, and elements are nested under the
    keyword's name. None is skipped.
    """
    made = Element(tag, {"type": kind})
    if name:
        made.set("name", name)
    for key, value in values.items():
        if value is not None:
            made.append(prop(key, value))
    return made


def prop(name: str, value: Value) -> Element:
    """One property element, see `plugin`."""
    if isinstance(value, Element):
        value.set("name", name)
        return value
    if isinstance(value, tuple):
        return Element("rgb", {"name": name, "value": " ".join(map(number, value))})
    if isinstance(value, np.ndarray):
        made = Element("transform", {"name": name})
        text = " ".join(number(item) for item in value.ravel())
        made.append(Element("matrix", {"value": text}))
        return made
    if isinstance(value, bool):
        return Element("boolean", {"name": name, "value": "true" if value else "false"})
    text = number(value) if isinstance(value, float) else str(value)
    return Element(_TAGS[type(value)], {"name": name, "value": text})


def number(value: float) -> str:
    """A number with 9 significant digits, enough to read the same float32 back."""
    return f"{float(value):.9g}"
