"""Sections of the report, rendered from HTML templates."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from jinja2 import Environment
from markupsafe import Markup

from pbrnet.pipeline.templating import templates


@dataclass(frozen=True)
class Section:
    """A section of the report: `<section id="anchor">`, with `title` in the navigation bar."""

    anchor: str
    title: str
    html: Markup


def page_templates(package: str) -> Environment:
    """Return the environment of a package's HTML templates.

    Filters: `thousands` groups digits by three, `duration` formats seconds.
    """
    environment = templates(package)
    environment.filters["thousands"] = lambda number: f"{number:,}".replace(",", " ")
    environment.filters["duration"] = format_duration
    return environment


def render_section(package: str, anchor: str, title: str, **context: Any) -> Section:
    """Render `section.html` of a package; the template gets `anchor`, `title` and `context`."""
    template = page_templates(package).get_template("section.html")
    html = template.render(anchor=anchor, title=title, **context)
    return Section(anchor, title, Markup(html))


def format_duration(seconds: float) -> str:
    """Format a duration in ms, s, min or h."""
    if seconds < 1:
        return f"{1000 * seconds:.0f} ms"
    if seconds < 120:
        return f"{seconds:.1f} s"
    return f"{seconds / 60:.1f} min" if seconds < 7200 else f"{seconds / 3600:.1f} h"
