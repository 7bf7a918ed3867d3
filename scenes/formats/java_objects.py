"""Reader of serialised Java objects: class names, field values and nothing else.

The parsing is that of the package `javaobj`, which builds plain records from the stream's grammar
(Java Object Serialization Specification, chapter 6) and neither loads nor runs a class. This
module bounds it: size, depth, and every failure ends as `InputError`.
"""

from __future__ import annotations

import sys
import threading
from typing import Any

import javaobj.v2 as javaobj
from javaobj.v2.beans import JavaArray, JavaInstance

from pbrnet.scenes.errors import InputError

MAX_BYTES = 16 * 2**20
_DEPTH = 400_000  # Python frames: linked objects (joined walls) are nested in the stream
_STACK = 512 * 2**20  # bytes of address space


class JavaRecord:
    """An object of the stream: the name of its class and its fields, those of its bases too.

    Fields are None, bool, int, float, str, `JavaRecord` or a list of these. A record is equal to
    itself alone, as references to one object give one record.
    """

    __slots__ = ("fields", "kind")

    def __init__(self, kind: str) -> None:
        self.kind = kind
        self.fields: dict[str, Any] = {}

    def __getitem__(self, name: str) -> Any:
        """A field's value; None where the writer's class had no such field."""
        return self.fields.get(name)


def read_java_object(data: bytes, where: str) -> Any:
    """Return the object that a serialised stream begins with.

    Raises `InputError` that names `where` for all that is wrong with the stream.
    """
    if len(data) > MAX_BYTES:
        raise InputError(f"{where}: {len(data):,} bytes of Java objects; at most {MAX_BYTES:,}")
    found: list[Any] = []
    failure: list[str] = []

    def work() -> None:
        limit = sys.getrecursionlimit()
        sys.setrecursionlimit(_DEPTH)
        try:
            found.append(_Records().value(javaobj.loads(data)))
        except RecursionError:
            failure.append("objects nested too deeply")
        except MemoryError:
            failure.append("too large")
        except Exception as error:  # the parser meets damage with many kinds of errors
            failure.append(str(error) or type(error).__name__)
        finally:
            sys.setrecursionlimit(limit)

    before = threading.stack_size(_STACK)
    try:
        thread = threading.Thread(target=work)
        thread.start()
        thread.join()
    finally:
        threading.stack_size(before)
    if not failure and not isinstance(found[0], (JavaRecord, str, bool, int, float)):
        failure.append("no object")
    if failure:
        raise InputError(f"{where}: damaged Java objects ({failure[0][:200]})")
    return found[0]


class _Records:
    """Conversion of the parser's objects, each once and without recursion."""

    def __init__(self) -> None:
        self._sources: dict[int, tuple[Any, Any]] = {}  # by id: values to convert, their target
        self._kept: list[Any] = []  # alive, so that no id is used twice

    def value(self, item: Any) -> Any:
        """Return the converted object with all that it refers to."""
        waiting = [item]
        while waiting:
            waiting += self._begin(waiting.pop())
        for values, target in self._sources.values():
            if isinstance(target, JavaRecord):
                target.fields = {name: self._converted(value) for name, value in values.items()}
            else:
                target += [self._converted(value) for value in values]
        return self._converted(item)

    def _begin(self, item: Any) -> list[Any]:
        """Make the empty target of an object; returns what it refers to."""
        if not isinstance(item, (JavaInstance, JavaArray)) or id(item) in self._sources:
            return []
        self._kept.append(item)
        if isinstance(item, dict):
            record = JavaRecord("java.util.Map")
            entries = {self._text(key): value for key, value in item.items()}
            self._sources[id(item)] = (entries, record)
            return list(entries.values())
        if isinstance(item, (list, JavaArray)):
            self._sources[id(item)] = (list(item), [])
            return list(item)
        record = JavaRecord(str(item.classdesc.name))
        values = {
            field.name: value
            for fields in item.field_data.values()
            for field, value in fields.items()
        }
        self._sources[id(item)] = (values, record)
        return list(values.values())

    def _converted(self, item: Any) -> Any:
        if id(item) in self._sources:
            values, target = self._sources[id(item)]
            boxed = isinstance(target, JavaRecord) and target.kind in _BOXES
            return values.get("value") if boxed else target
        if item is None or isinstance(item, (bool, int, float, str)):
            return item
        return self._text(item)

    @staticmethod
    def _text(item: Any) -> str:
        """A string, or the name of an enum's constant."""
        return str(getattr(item, "value", "") or "")


_BOXES = (
    "java.lang.Boolean",
    "java.lang.Double",
    "java.lang.Float",
    "java.lang.Integer",
    "java.lang.Long",
    "java.lang.Short",
)
