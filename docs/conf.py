"""Configuration of the documentation site, which `make docs` builds from these pages."""

from __future__ import annotations

import re
import sys
from collections.abc import Iterator
from pathlib import Path

import click
from docutils import nodes
from sphinx.application import Sphinx
from sphinx.util.docutils import SphinxDirective

DOCS = Path(__file__).resolve().parent
ROOT = DOCS.parent
sys.path.insert(0, str(ROOT))

project = "pbrnet"
author = copyright = "The pbrnet authors"
extensions = ["myst_parser", "sphinx.ext.autodoc"]
myst_heading_anchors = 4
exclude_patterns = ["data"]

autodoc_mock_imports = ["drjit", "manifold3d", "mapbox_earcut", "mitsuba", "shapely", "trimesh"]
autodoc_typehints = "signature"
autodoc_typehints_format = "short"
autodoc_member_order = "bysource"
autodoc_default_options = {"members": True}
default_role = "literal"  # of `text` in docstrings

html_theme = "furo"
html_title = "pbrnet"
html_static_path = ["site.css"]
html_css_files = ["site.css"]
html_show_sphinx = False
pygments_style = "friendly"
pygments_dark_style = "monokai"

# Pages about folders of the repository, which readers of the site do not have at hand.
FOLDERS = {"examples/consume": "dataset.md#read-it", "examples/tasks": "tasks.md"}
LINK = re.compile(r"\[([^\]]*)\]\(([^)\s:#]+)\)")


class Commands(SphinxDirective):
    """Help of every command, as `--help` prints it."""

    def run(self) -> list[nodes.Node]:
        """Return a section a command."""
        from pbrnet.pipeline.cli import cli

        return [self._section(path, text) for path, text in sorted(helps(cli, "pbrnet"))]

    def _section(self, path: str, text: str) -> nodes.section:
        section = nodes.section(ids=[nodes.make_id(path)])
        section += nodes.title(text=path)
        section += nodes.literal_block(text, text, language="text")
        return section


def helps(command: click.Command, path: str) -> Iterator[tuple[str, str]]:
    """Yield path and help of a command and of those below it."""
    context = click.Context(command, info_name=path, max_content_width=88, show_default=True)
    yield path, command.get_help(context)
    if isinstance(command, click.Group):
        for name in command.list_commands(context):
            below = command.get_command(context, name)
            if below is not None and not below.hidden:
                yield from helps(below, f"{path} {name}")


def within_the_site(app: Sphinx, page: str, source: list[str]) -> None:
    """Change links to the repository: to a page about the folder, or to a copy of the file."""
    source[0] = LINK.sub(_link, source[0])


def _link(found: re.Match[str]) -> str:
    text, path = found.groups()
    target = (DOCS / path).resolve()
    if target.is_dir():
        about = FOLDERS.get(str(target.relative_to(ROOT)))
        return f"[{text}]({about})" if about else text
    if target.suffix == ".md" and target.parent != DOCS:
        return f"[{text}](path:{path})"
    return found[0]


def setup(app: Sphinx) -> None:
    """Add the directive and what changes the links."""
    app.add_directive("commands", Commands)
    app.connect("source-read", within_the_site)
