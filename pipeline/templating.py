"""Jinja environments for the templates of a package."""

from __future__ import annotations

import re

from jinja2 import Environment, PackageLoader, StrictUndefined

from pbrnet.pipeline.terminal import visible


def templates(package: str, *, markup: bool = True) -> Environment:
    """Return an environment for the folder `templates` of `package`.

    An undefined name in a template is an error. With `markup` values are escaped for HTML; without,
    the filter `plain` is `plain_markdown`.
    """
    environment = Environment(
        loader=PackageLoader(package),
        undefined=StrictUndefined,
        autoescape=markup,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
    )
    environment.filters["plain"] = plain_markdown
    return environment


def plain_markdown(text: object) -> str:
    """Return text from outside that means itself in Markdown, in a sentence or a table's cell.

    Without tags, links, code, further cells, lines or headings; emphasis is left.
    """
    line = visible(str(text).replace("\n", " "))
    line = re.sub(r"[\\|`\[]", r"\\\g<0>", line).replace("<", "&lt;")
    return re.sub(r"^[-#+=~>*]", r"\\\g<0>", line)
