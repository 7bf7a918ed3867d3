"""Jinja environments for the templates of a package."""

from __future__ import annotations

from jinja2 import Environment, PackageLoader, StrictUndefined


def templates(package: str, *, markup: bool = True) -> Environment:
    """Return an environment for the folder `templates` of `package`.

    An undefined name in a template is an error. With `markup` values are escaped for HTML.
    """
    return Environment(
        loader=PackageLoader(package),
        undefined=StrictUndefined,
        autoescape=markup,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
    )
