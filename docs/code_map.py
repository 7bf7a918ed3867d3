"""Map of the code: modules, imports between them, the picture of the packages.

Everything is derived
from the source text; nothing of the project
is imported.
"""

from __future__ import annotations

import ast
import io
import re
from collections import defaultdict
from collections.abc import Iterable
from dataclasses import dataclass
from graphlib import TopologicalSorter
from pathlib import Path

import matplotlib as mpl
from matplotlib.figure import Figure
from matplotlib.patches import FancyBboxPatch, Rectangle

from pbrnet.pipeline.imports import LAYERS, ROOT, imported_files, modules

COLORS = {"scenes": "#dcebd9", "pipeline": "#dae6f3", "model": "#f3e2d5"}
WIDTH, ROW, CELL = 13.0, 0.62, 1.62  # inches: the picture, a row of boxes, a box
Edge = tuple[str, str]  # importer, imported


@dataclass(frozen=True)
class Code:
    """Modules of the project and the imports between them."""

    modules: dict[str, Path]  # dotted name (a package's without `__init__`) -> file
    edges: frozenset[Edge]

    @classmethod
    def read(cls, root: Path = ROOT) -> Code:
        """Parse every file below the layers' folders."""
        found = modules(root)
        names = {path: name for name, path in found.items()}
        edges = {
            (name, names[other])
            for name, path in found.items()
            for other in imported_files(path, root)
            if other in names  # not `pbrnet/__init__.py`
        }
        for name, path in found.items():  # commands are imported by name when they are used
            named = set(re.findall(r'"([\w.]+):\w+"', path.read_text()))
            edges |= {(name, other) for other in named & set(found)}
        return cls(found, frozenset(edges))

    def summary(self, module: str) -> str:
        """First sentence of a module's docstring."""
        text = ast.get_docstring(ast.parse(self.modules[module].read_text())) or ""
        return " ".join(text.split("\n\n")[0].split())


def parts_of(layer: str, code: Code) -> dict[str, set[str]]:
    """Packages and modules directly in a layer -> those of the same layer that they import.

    Imports that follow from others (a -> b -> c gives a -> c) are left out.
    """
    graph: dict[str, set[str]] = defaultdict(set)
    for module in code.modules:
        if module.startswith(f"pbrnet.{layer}."):
            graph[module.split(".")[2]]
    for importer, imported in code.edges:
        a, b = importer.split("."), imported.split(".")
        if a[1] == b[1] == layer and len(a) > 2 and len(b) > 2 and a[2] != b[2]:
            graph[a[2]].add(b[2])
    reach: dict[str, set[str]] = {}
    for part in TopologicalSorter(graph).static_order():
        reach[part] = graph[part].union(*(reach[other] for other in graph[part]))
    return {
        part: {one for one in used if not any(one in reach[other] for other in used)}
        for part, used in sorted(graph.items())
    }


def rows_of(graph: dict[str, set[str]]) -> list[list[str]]:
    """Parts by level, the top level first: each imports only parts of lower rows."""
    level: dict[str, int] = {}
    for part in TopologicalSorter(graph).static_order():
        level[part] = 1 + max((level[other] for other in graph[part]), default=-1)
    rows: list[list[str]] = [[] for _ in range(max(level.values()) + 1)]
    for part in sorted(graph):
        rows[level[part]].append(part)
    place = dict.fromkeys(graph, 0.0)
    for row in rows:  # a part stands above the middle of what it imports
        row.sort(key=lambda part: (_mean(place[other] for other in graph[part]), part))
        for number, part in enumerate(row):
            place[part] = number - (len(row) - 1) / 2
    return rows[::-1]


def _mean(values: Iterable[float]) -> float:
    found = list(values)
    return sum(found) / len(found) if found else 0.0


def picture(code: Code) -> bytes:
    """The layers with their packages and modules as SVG, importers above what they import."""
    graphs = {layer: parts_of(layer, code) for layer in LAYERS}
    rows = {layer: _wrapped(rows_of(graph)) for layer, graph in graphs.items()}
    heights = {layer: ROW * len(rows[layer]) + 0.45 for layer in LAYERS}
    total = sum(heights.values()) + 0.35 * (len(LAYERS) - 1)
    figure = Figure(figsize=(WIDTH, total), layout=None)
    axes = figure.add_axes((0, 0, 1, 1))
    axes.set(xlim=(0, WIDTH), ylim=(0, total))
    axes.axis("off")
    top = total
    for layer in reversed(LAYERS):
        _draw_layer(axes, layer, rows[layer], graphs[layer], code, top, heights[layer])
        top -= heights[layer] + 0.35
        if layer != LAYERS[0]:
            axes.annotate(
                "",
                (WIDTH / 2, top),
                (WIDTH / 2, top + 0.35),
                arrowprops={"arrowstyle": "-|>", "color": "#333333", "linewidth": 2},
            )
    buffer = io.BytesIO()
    with mpl.rc_context({"svg.hashsalt": "pbrnet", "svg.fonttype": "none"}):
        figure.savefig(buffer, format="svg", metadata={"Date": None, "Creator": None})
    return buffer.getvalue()


def _wrapped(rows: list[list[str]], most: int = 7) -> list[list[str]]:
    wrapped = []
    for row in rows:
        count = -(-len(row) // most)
        size = -(-len(row) // count)
        wrapped += [row[start : start + size] for start in range(0, len(row), size)]
    return wrapped


def _draw_layer(
    axes: mpl.axes.Axes,
    layer: str,
    rows: list[list[str]],
    graph: dict[str, set[str]],
    code: Code,
    top: float,
    height: float,
) -> None:
    axes.add_patch(Rectangle((0.1, top - height), WIDTH - 0.2, height, color=COLORS[layer]))
    axes.text(0.25, top - 0.1, f"{layer}/", va="top", size=13, weight="bold")
    place = {}
    for number, row in enumerate(rows):
        for column, part in enumerate(row):
            x = WIDTH / 2 + (column - (len(row) - 1) / 2) * (CELL + 0.12)
            place[part] = (x, top - 0.5 - ROW * number)
    for part, used in graph.items():
        for other in sorted(used):
            (x, y), (u, v) = place[part], place[other]
            axes.plot((x, u), (y - 0.15, v + 0.15), color="#8a8a8a", linewidth=0.7, zorder=1)
    for part, (x, y) in place.items():
        package = code.modules[f"{layer}.{part}"].name == "__init__.py"
        axes.add_patch(
            FancyBboxPatch(
                (x - CELL / 2 + 0.06, y - 0.15),
                CELL - 0.12,
                0.3,
                boxstyle="round,pad=0.04",
                facecolor="white" if package else COLORS[layer],
                edgecolor="#555555" if package else "#aaaaaa",
                linewidth=0.9,
                zorder=2,
            )
        )
        label = f"{part}/" if package else part
        axes.text(x, y, label, ha="center", va="center", size=9.5, zorder=3)


def module_index(code: Code) -> str:
    """Every package and module with the first sentence of its docstring, as Markdown."""
    lines = [
        "# Index of modules",
        "",
        "Every package and module with the first sentence of its docstring. Made by `make docs`",
        "from the code; do not edit. What the packages are for and how they fit together:",
        "[architecture.md](architecture.md).",
    ]
    packages = [name for name, path in code.modules.items() if path.name == "__init__.py"]
    for package in sorted(packages, key=lambda name: (LAYERS.index(name.split(".")[1]), name)):
        folder = package.replace(".", "/")
        lines += ["", f"## {folder}/", "", code.summary(package)]
        inside = [
            name
            for name in code.modules
            if name.rpartition(".")[0] == package and name not in packages
        ]
        if inside:
            lines += ["", "| module | holds |", "|---|---|"]
        for name in sorted(inside):
            text = code.summary(name).replace("|", "\\|")
            lines.append(
                f"| [`{name.rpartition('.')[2]}`](../{name.replace('.', '/')}.py) | {text} |"
            )
    return "\n".join(lines) + "\n"
