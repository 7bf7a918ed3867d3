"""Pages and cards are filled in from the templates that lie beside their packages."""

from __future__ import annotations

from jinja2 import Environment, PackageLoader, StrictUndefined


def templates(package: str, *, markup: bool = True) -> Environment:
    """What renders the templates of `package`; a name that a template misses is an error.

    With `markup` values are escaped for HTML.
    """
    return Environment(
        loader=PackageLoader(package),
        undefined=StrictUndefined,
        autoescape=markup,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
    )
