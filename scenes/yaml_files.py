"""YAML files from outside: parsed within bounds of memory and time."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import yaml

from pbrnet.scenes.checked import shown
from pbrnet.scenes.errors import InputError, ParameterError, in_one_line
from pbrnet.scenes.files import read_text

_MAX_BYTES = 2**20
_MAX_NODES = 2**17  # values in it, with all aliases written out
_NUMBERS = (":int", ":float")
_MAX_COLONS = 100  # in numbers such as 1:00:00, for which PyYAML takes quadratic time


class BoundedLoader(yaml.SafeLoader):
    """Loader of YAML from outside: small also when all aliases and merge keys are written out.

    Aliases of aliases double, or more, with every line: a short file would otherwise be one of
    more values than fit into memory.
    """

    def __init__(self, text: str) -> None:
        super().__init__(text)
        self._nodes = 0  # written out, so far
        self._sizes: dict[int, int] = {}  # id of a complete node -> nodes in it, written out

    def compose_node(self, parent: Any, index: Any) -> Any:
        """Compose a node and count it; an alias counts like what it stands for."""
        alias, before = self.check_event(yaml.AliasEvent), self._nodes
        node = super().compose_node(parent, index)
        if alias and id(node) not in self._sizes:
            raise yaml.YAMLError("an alias of what it is inside of")
        self._nodes += self._sizes[id(node)] if alias else 1
        self._sizes.setdefault(id(node), self._nodes - before)
        if self._nodes > _MAX_NODES:
            raise yaml.YAMLError(f"more than {_MAX_NODES:,} values with all aliases written out")
        return node

    def construct_object(self, node: Any, deep: bool = False) -> Any:
        """Construct a value; what its tag cannot be made from is a YAML error of its line."""
        try:
            if node.tag.endswith(_NUMBERS) and node.value.count(":") > _MAX_COLONS:
                raise ValueError
            return super().construct_object(node, deep)
        except (ArithmeticError, AttributeError, LookupError, TypeError, ValueError):
            kind, line = node.tag.rpartition(":")[2], node.start_mark.line + 1
            raise yaml.YAMLError(f"line {line}: {shown(node.value)} is no {kind}") from None


def read_yaml(path: Path) -> Any:
    """Return the content of a YAML file; raises `ParameterError` that names it."""
    try:
        text = read_text(path, _MAX_BYTES)
    except InputError as error:
        raise ParameterError(str(error)) from None
    return parse_yaml(text, path)


def parse_yaml(text: str, path: Path, loader: type[BoundedLoader] = BoundedLoader) -> Any:
    """Return the content of YAML text; raises `ParameterError` that names its file."""
    try:
        return yaml.load(text, loader)
    except RecursionError:
        raise ParameterError(f"{path}: not valid YAML (nested too deep)") from None
    except yaml.YAMLError as error:
        reason = in_one_line(error)  # PyYAML writes several
        raise ParameterError(f"{path}: not valid YAML ({reason})") from None
