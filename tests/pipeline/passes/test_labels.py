"""Labels: analytic boxes, occlusion and truncation, and counts against objects rendered alone."""

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pbrnet.pipeline.channels import channels_of
from pbrnet.pipeline.frames import Channels
from pbrnet.pipeline.passes.inputs import render_inputs
from pbrnet.pipeline.passes.labels import RENDERERS
from pbrnet.pipeline.passes.surfaces import render_surfaces
from pbrnet.pipeline.render.boxes import Box, box_around
from pbrnet.pipeline.render.scene import open_scene
from pbrnet.scenes.contract import Light
from pbrnet.scenes.importing.categories import CATEGORIES
from pbrnet.scenes.importing.semantics import (
    CATEGORY_LABELS,
    NYU13_NAMES,
    NYU13_OF_NYU40,
    NYU40_NAMES,
    NYU40_OF_CATEGORY,
    category_number,
)
from tests.fixtures.encoded import picture
from tests.fixtures.render import ball, diffuse, glow, make_view, quad, write_scene
from tests.fixtures.xml import bitmap, bsdf

pytestmark = pytest.mark.usefixtures("variant")


def labels(
    folder: Path, shapes: dict[str, str], **more: Any
) -> tuple[Channels, dict[str, dict[str, Any]]]:
    """The channels, and the instances by the id of their object, one for each shape."""
    objects = {name: (name,) for name in shapes}
    body = "".join(shapes.values())
    scene = open_scene(write_scene(folder / "scene", body, objects, **more))
    channels, facts = render_surfaces(scene, make_view(), ["labels"])["labels"]
    return channels, {entry["object"]: entry for entry in facts["instances"]}


def crate(
    name: str, centre: tuple[float, float, float], half: tuple[float, float, float], degrees: float
) -> str:
    """A box that is turned about the vertical."""
    x, y, z = centre
    return (
        f'<shape type="cube" id="{name}"><transform name="to_world">'
        f'<scale x="{half[0]}" y="{half[1]}" z="{half[2]}"/>'
        f'<rotate z="1" angle="{degrees}"/><translate x="{x}" y="{y}" z="{z}"/></transform>'
        f"{diffuse()}</shape>"
    )


@pytest.mark.parametrize("degrees", [0, 30, 75, 120, 200])
def test_the_box_of_a_turned_crate_is_its_pose(degrees: float, tmp_path: Path) -> None:
    centre, half = (0.2, 3.0, 1.4), (0.5, 0.2, 0.3)
    _, seen = labels(tmp_path, {"crate": crate("crate", centre, half, degrees)})
    entry = seen["crate"]
    np.testing.assert_allclose(entry["centre"], centre, atol=1e-5)
    axes = np.array(entry["axes"])
    angle = math.degrees(math.atan2(axes[0, 1], axes[0, 0]))
    assert 0 <= angle < 90 and abs((angle - degrees + 1e-4) % 90) < 1e-3
    quarter_turns = round((degrees - angle) / 90)
    sizes = half if quarter_turns % 2 == 0 else (half[1], half[0], half[2])
    np.testing.assert_allclose(entry["half_sizes"], sizes, atol=1e-5)
    # In camera axes: x right, y down, z forward; the camera is at (0, 0, 1.5) and looks along +y.
    np.testing.assert_allclose(entry["centre_camera"], (0.2, 0.1, 3.0), atol=1e-5)
    x, y = axes[0, :2]
    expected = [(x, 0, y), (-y, 0, x), (0, -1, 0)]
    np.testing.assert_allclose(entry["axes_camera"], expected, atol=1e-6)
    assert entry["visible_fraction"] == 1 and entry["occlusion"] == 0 and entry["truncation"] == 0


def test_a_crate_half_hidden_behind_another(tmp_path: Path) -> None:
    """A board covers the right half of the crate's front, as the camera sees it."""
    target = quad("target", (0, 4, 1.5), (0, -1, 0), (1, 1), diffuse())
    board = quad("board", (1, 2, 1.5), (0, -1, 0), (1, 1), diffuse())
    channels, seen = labels(tmp_path, {"target": target, "board": board})
    assert seen["target"]["visible_fraction"] == seen["target"]["occlusion"] == 0.5
    assert seen["board"]["visible_fraction"] == 1
    assert seen["target"]["pixels"] == (channels["instance"] == 1).sum()
    first, _, last, _ = seen["target"]["extent"]
    assert (first, last) == (16 - 6, 16)  # 25.6 pixels wide at 1 m: 6.4 left of the middle
    assert seen["target"]["pixels_alone"] == 2 * seen["target"]["pixels"]


def test_what_the_border_cuts_is_truncation_not_occlusion(tmp_path: Path) -> None:
    # The image ends 0.625 m beside the axis for each metre of depth: at x = 2.5.
    thin = (1.0, 1e-4, 0.2)
    channels, seen = labels(tmp_path, {"bench": crate("bench", (2.5, 4, 1.5), thin, 0)})
    assert seen["bench"]["truncation"] == 0.5 and seen["bench"]["visible_fraction"] == 1
    assert seen["bench"]["extent"][2] == 32 and (channels["instance"] == 1).any()


def test_pixels_alone_are_those_of_the_object_rendered_alone(tmp_path: Path) -> None:
    """Through glass, cut-out leaves, a ball inside a box, and three boards one behind another."""
    opacity = np.full((8, 8), 255, np.uint8)
    opacity[:, ::2] = 0
    holes = bitmap("opacity", "textures/leaf.png", raw=True, filter_type="nearest")
    leaf = bsdf("mask", holes, diffuse())
    shapes = {
        "pane": quad("pane", (0, 1, 1.5), (0, -1, 0), (3, 3), '<bsdf type="thindielectric"/>'),
        "leaf": quad("leaf", (-0.2, 1.5, 1.5), (0, -1, 0), (0.4, 0.4), leaf),
        "ball": ball("ball", (0.1, 2.5, 1.5), 0.4, diffuse()),
        "box": crate("box", (0, 3, 1.4), (0.6, 1, 0.4), 20),
        **{
            f"board{i}": quad(
                f"board{i}", (0.3 * i - 0.5, 5 + i, 1.5), (0, -1, 0), (1, 1.4), diffuse()
            )
            for i in range(3)
        },
    }
    files = {"textures/leaf.png": picture(opacity)}
    _, seen = labels(tmp_path / "all", shapes, files=files)
    assert seen.keys() >= {"leaf", "box", "board0", "board2"} and "pane" not in seen
    for name, entry in seen.items():
        alone, _ = labels(tmp_path / name, {name: shapes[name]}, files=files)
        assert entry["pixels_alone"] == (alone["instance"] > 0).sum(), name
    assert seen["leaf"]["visible_fraction"] == 1 and seen["board2"]["occlusion"] > 0.3


def test_more_than_32_objects_are_told_apart(tmp_path: Path) -> None:
    boards = {
        f"b{i:02d}": quad(
            f"b{i:02d}",
            (0.25 * (i % 8) - 0.9, 2 + 0.01 * i, 1.0 + 0.22 * (i // 8)),
            (0, -1, 0),
            (0.02 + 0.003 * i,) * 2,
            diffuse(),
        )
        for i in range(40)
    }
    boards["wall"] = quad("wall", (0, 4, 1.5), (0, -1, 0), (3, 3), diffuse())
    channels, seen = labels(tmp_path, boards)
    assert len(seen) > 33 and seen["wall"]["pixels_alone"] == channels["instance"].size
    for entry in seen.values():
        assert entry["pixels"] == (channels["instance"] == entry["instance"]).sum()
        assert entry["visible_fraction"] == 1 or entry["object"] == "wall"
    hidden = channels["instance"].size - seen["wall"]["pixels"]
    assert hidden == sum(entry["pixels"] for name, entry in seen.items() if name != "wall")


def test_every_visible_point_lies_in_the_box(tmp_path: Path) -> None:
    points = np.random.default_rng(1).normal(size=(500, 3)) @ np.diag([2, 0.5, 1])
    turn = math.radians(25)
    points[:, :2] @= np.array([[math.cos(turn), math.sin(turn)], [-math.sin(turn), math.cos(turn)]])
    box = box_around(points)
    local = np.abs((points - box.centre) @ box.axes.T)
    assert (local <= box.half_sizes).all()
    assert (local.max(axis=0) > box.half_sizes - 1e-5).all(), "and no larger than it must be"
    np.testing.assert_allclose(box.axes @ box.axes.T, np.eye(3), atol=2e-6)


def test_round_and_square_things_keep_the_worlds_axes() -> None:
    angle = np.arange(0, 2 * math.pi, 0.05)[:, None]
    circle = np.concatenate([np.cos(angle), np.sin(angle), 0 * angle], axis=1)
    np.testing.assert_array_equal(box_around(circle).axes, np.eye(3))
    line = np.array([[0, 0, 0], [1, 1, 0.0]])
    assert isinstance(box_around(line), Box) and isinstance(box_around(line[:1]), Box)


def test_classes_follow_from_the_category(tmp_path: Path) -> None:
    shapes = {
        "sofa": quad("sofa", (-1, 3, 1.5), (0, -1, 0), (0.5, 0.5), diffuse()),
        "gizmo": quad("gizmo", (1, 3, 1.5), (0, -1, 0), (0.5, 0.5), diffuse()),
    }
    channels, seen = labels(tmp_path, shapes)
    for name, number, category, forty, thirteen in (
        ("sofa", 1, "sofa", "sofa", "sofa"),
        ("gizmo", 2, "other", "other prop", "objects"),
    ):
        here = channels["instance"] == number
        assert set(channels["category"][here]) == {CATEGORY_LABELS.index(category)}
        assert set(channels["nyu40"][here]) == {NYU40_NAMES.index(forty)}
        assert set(channels["nyu13"][here]) == {NYU13_NAMES.index(thirteen)}
        assert seen[name]["nyu40"] == NYU40_NAMES.index(forty)
    nothing = channels["instance"] == 0
    assert nothing.any()
    for name, values in channels.items():
        assert (values[nothing] == 0).all(), name


def test_the_tables_of_classes_are_whole() -> None:
    assert set(CATEGORIES) | {"wall", "floor", "ceiling", "structure"} <= set(CATEGORY_LABELS)
    assert len(set(CATEGORY_LABELS)) == len(CATEGORY_LABELS) == len(NYU40_OF_CATEGORY)
    assert len(NYU40_NAMES) == len(NYU13_OF_NYU40) == 41 and len(NYU13_NAMES) == 14
    assert set(NYU13_OF_NYU40[1:]) == set(range(1, 14)), "every class of 13 is used"
    assert category_number("") == category_number("no such thing") == category_number("other")
    # Numbers of published datasets do not change.
    fixed = {"wall": 1, "floor": 2, "ceiling": 3, "lamp": 17, "sofa": 34, "table": 53, "other": 78}
    assert {name: category_number(name) for name in fixed} == fixed


def test_instances_are_the_objects_of_the_inputs(tmp_path: Path) -> None:
    shapes = {
        "a": ball("a", (0, 2, 1.5), 0.4, diffuse()),
        "b": crate("b", (1, 3, 1.5), (0.3,) * 3, 9),
    }
    objects = {name: (name,) for name in shapes}
    scene = open_scene(write_scene(tmp_path / "s", "".join(shapes.values()), objects))
    channels, _ = render_surfaces(scene, make_view(), ["labels"])["labels"]
    np.testing.assert_array_equal(channels["instance"], render_inputs(scene, make_view())["object"])


def test_lights_have_place_and_power(tmp_path: Path) -> None:
    lamp = quad("lamp", (0, 2, 2.0), (0, 0, -1), (0.5, 0.25), glow("1 2 3"), up=(0, 1, 0))
    bulb = (
        '<emitter type="point" id="bulb"><point name="position" x="1" y="2" z="1"/>'
        '<rgb name="intensity" value="2"/></emitter><emitter type="constant" id="sky"/>'
    )
    lights = (
        Light("panel", "area", ("lamp",), "r", 800.0),
        Light("bulb", "point"),
        Light("sky", "environment"),
    )
    scene = open_scene(write_scene(tmp_path / "s", lamp + bulb, {"lamp": ("lamp",)}, lights=lights))
    panel, point, sky = render_surfaces(scene, make_view(), ["labels"])["labels"][1][
        "light_sources"
    ]
    assert (panel["light"], panel["room"], panel["lumens"]) == ("panel", "r", 800.0)
    np.testing.assert_allclose(panel["centre"], (0, 2, 2), atol=1e-6)
    np.testing.assert_allclose(panel["size"], (1, 0.5, 0), atol=1e-6)
    np.testing.assert_allclose(panel["flux"], math.pi * 0.5 * np.array([1, 2, 3]), rtol=1e-5)
    assert point["centre"] == [1, 2, 1]
    np.testing.assert_allclose(point["flux"], [8 * math.pi] * 3, rtol=1e-5)
    assert sky["centre"] is None and sky["flux"] is None


def test_every_channel_has_a_renderer() -> None:
    assert list(RENDERERS) == [channel.name for channel in channels_of("labels")]
