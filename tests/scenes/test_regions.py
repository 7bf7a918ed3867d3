"""Polygon operations end for every finite input, and with the right region where one is known."""

import ast
from collections.abc import Callable

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from shapely.errors import GEOSException
from shapely.geometry import LineString, Polygon, box
from shapely.geometry.base import BaseGeometry

from pbrnet.scenes.geometry import regions
from pbrnet.scenes.sweethome.building.solids import polygonal
from tests.project.imports import modules

BOWTIE = Polygon([(0, 0), (2, 2), (2, 0), (0, 2)])  # two triangles of area 1
SPIKE = Polygon([(0, 0), (1, 0), (1, 1), (3, 1), (1, 1), (0, 1)])  # a square with a thorn
OPERATIONS: dict[str, Callable[[Polygon, Polygon], object]] = {
    "union": lambda a, b: regions.union([a, b]),
    "difference": regions.difference,
    "intersection": regions.intersection,
    "symmetric_difference": regions.symmetric_difference,
    "grown": lambda a, _: regions.buffered(a, 0.1, join_style="mitre"),
    "shrunk": lambda a, _: regions.buffered(a, -0.1),
    "thickened": lambda a, b: regions.thickened([a, b], 0.03, cap_style="square"),
    "simplified": lambda a, _: regions.simplified(a, 0.1),
    "on_grid": lambda a, _: regions.on_grid(a, 1e-6),
    "deepest_point": lambda a, _: regions.deepest_point(a),
    "meets": regions.meets,
    "covers": regions.covers,
}
COMBINING = {"buffer", "difference", "intersection", "symmetric_difference", "simplify"}
RAISING = {"unary_union", "union_all", "make_valid", "set_precision", "maximum_inscribed_circle"}


def jumbled(rng: np.random.Generator) -> Polygon:
    """A polygon that crosses itself, has spikes, no area, or corners of extreme size."""
    points = rng.uniform(-5, 5, (int(rng.integers(3, 12)), 2))
    kind = rng.integers(5)
    if kind == 1:
        points = np.round(points)
    elif kind == 2:
        points = np.round(points) + rng.normal(0, 1e-12, points.shape)
    elif kind == 3:
        points = points * [1, 1e-14]
    elif kind == 4:
        points = points * 10.0 ** rng.integers(-300, 300)
    return Polygon(points)


@pytest.mark.filterwarnings("ignore:.*encountered:RuntimeWarning")
def test_jumbled_polygons_stop_no_operation() -> None:
    refused = 0
    for seed in range(150):
        rng = np.random.default_rng(seed)
        first, second = jumbled(rng), jumbled(rng)
        try:
            shapely.union_all([first, second])
        except GEOSException:
            refused += 1
        for operation in OPERATIONS.values():
            operation(first, second)
        polygonal(first)
    assert refused > 50  # the inputs are bad enough to test something


corners = st.lists(
    st.tuples(st.integers(-4, 4), st.integers(-4, 4)), min_size=3, max_size=8, unique=True
)


@settings(max_examples=60, deadline=None, derandomize=True)
@given(corners, corners)
def test_areas_of_jumbled_polygons_add_up(one: list[tuple[int, int]], two: list[tuple[int, int]]):
    first, second = (shapely.make_valid(Polygon(points)) for points in (one, two))
    shared = regions.intersection(Polygon(one), Polygon(two)).area
    whole = regions.union([Polygon(one), Polygon(two)]).area
    assert whole + shared == pytest.approx(first.area + second.area, rel=1e-2, abs=1e-2)
    rest = regions.difference(Polygon(one), Polygon(two)).area
    assert rest + shared == pytest.approx(first.area, rel=1e-2, abs=1e-2)


@pytest.mark.parametrize("nasty", [BOWTIE, SPIKE])
def test_overlays_of_invalid_outlines(nasty: Polygon) -> None:
    with pytest.raises(GEOSException):
        shapely.union_all([nasty, Polygon([(1, 0), (3, 2), (3, 0), (1, 2)])])
    half = box(1, -1, 4, 3)
    area = {id(BOWTIE): (1.0, 1.0), id(SPIKE): (0.0, 1.0)}[id(nasty)]
    assert regions.intersection(nasty, half).area == pytest.approx(area[0])
    assert regions.difference(nasty, half).area == pytest.approx(area[1])
    assert regions.union([nasty, half]).area == pytest.approx(half.area + area[1])


def test_valid_polygons_give_exactly_what_shapely_gives() -> None:
    first, second = box(0, 0, 2, 1), box(1, 0.3, 3, 2)
    expected: dict[str, BaseGeometry] = {
        "union": shapely.union_all([first, second]),
        "difference": first.difference(second),
        "intersection": first.intersection(second),
        "symmetric_difference": first.symmetric_difference(second),
        "grown": first.buffer(0.1, join_style="mitre"),
        "shrunk": first.buffer(-0.1),
    }
    for name, shape in expected.items():
        made = OPERATIONS[name](first, second)
        assert isinstance(made, BaseGeometry)
        assert shapely.to_wkb(made) == shapely.to_wkb(shape)


def test_what_has_no_area_is_kept_small() -> None:
    flat = Polygon([(0, 0), (1, 0), (2, 0)])
    assert regions.union([]).is_empty
    assert regions.deepest_point(flat).shape == (2,)
    assert regions.polygon_parts(shapely.union_all([LineString([(0, 0), (1, 1)])])) == []
    assert regions.largest_part(shapely.union_all([box(0, 0, 1, 1), box(2, 0, 4, 1)])).area == 2


def direct_calls(source: str) -> list[int]:
    """Lines of calls that combine polygons without `pbrnet.scenes.geometry.regions`."""
    found = []
    for node in ast.walk(ast.parse(source)):
        if not isinstance(node, ast.Call):
            continue
        name = node.func.attr if isinstance(node.func, ast.Attribute) else ""
        name = node.func.id if isinstance(node.func, ast.Name) else name
        is_method = isinstance(node.func, ast.Attribute) and name in COMBINING
        if name in RAISING or is_method:
            found.append(node.lineno)
    return found


def test_polygons_are_combined_in_one_module_only() -> None:
    found = {
        name: lines
        for name, path in modules().items()
        if name.startswith("pbrnet.scenes.") and name != "pbrnet.scenes.geometry.regions"
        and "shapely" in (text := path.read_text())
        and (lines := direct_calls(text))
    }  # fmt: skip
    assert found == {}
    assert direct_calls("a.buffer(1)\nunary_union(b)\nbuffered(a, 1)") == [1, 2]
