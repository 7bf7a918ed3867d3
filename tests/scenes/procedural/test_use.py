"""Traces of use: they lie where a home was used, and change nothing else."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from pbrnet.scenes.arrays import Float64Array
from pbrnet.scenes.color import decode_srgb
from pbrnet.scenes.procedural.finishes import make_finishes
from pbrnet.scenes.procedural.furnishing.placement import furnish
from pbrnet.scenes.procedural.furniture.style import make_style
from pbrnet.scenes.procedural.materials import MaterialLibrary
from pbrnet.scenes.procedural.piece import Material, PiecePart, Trace, Use
from pbrnet.scenes.procedural.planning import make_plan
from pbrnet.scenes.procedural.scene_item import SceneItem
from pbrnet.scenes.procedural.structure import build_structure
from pbrnet.scenes.procedural.use.home import leave_traces
from pbrnet.scenes.seeds import generator


def library(folder: Path, wear: float) -> MaterialLibrary:
    (folder / "textures").mkdir(parents=True)
    return MaterialLibrary(folder, 256, seed=5, wear=wear)


def shown(made: MaterialLibrary, material: Material, name: str = "") -> np.ndarray:
    """Linear colour, or another image, of a material; rows along v."""
    file = made.folder / "textures" / f"{made.bsdf(material)}{name}.png"
    values = np.asarray(Image.open(file)) / 255.0
    return values if name else decode_srgb(values)


def triangles(items: list[SceneItem]) -> dict[str, Float64Array]:
    """Triangles (N, 3, 3) of each item, in one order."""
    return {
        item.id: np.sort(
            np.concatenate([part.vertices[part.faces].reshape(-1, 9) for part in item.parts]),
            axis=0,
        )
        for item in items
    }


def areas_by_direction(item: SceneItem) -> Float64Array:
    """Area of the faces that look along each axis, either way (2, 3)."""
    corners = np.concatenate([part.vertices[part.faces] for part in item.parts])
    facing = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]) / 2
    return np.stack([np.maximum(facing, 0).sum(axis=0), np.maximum(-facing, 0).sum(axis=0)])


@pytest.mark.parametrize("turned", [False, True])
def test_the_pattern_goes_on_below_the_traces(tmp_path: Path, turned: bool) -> None:
    """A surface without wear shows, at each place, what the repeating texture shows there."""
    made = library(tmp_path / "scene", 0.0)
    plain = Material("stone", (0.5, 0.4, 0.3), accent=(0.1, 0.1, 0.1), family="concrete")
    tile = made.tile(plain)
    x, y = np.meshgrid(np.linspace(0, 2 * tile, 17), np.linspace(0, 1.5 * tile, 13))
    square = np.stack([x.ravel(), y.ravel(), np.zeros(x.size)], axis=1)
    own = np.arange(x.size).reshape(x.shape)
    a, b, c, d = own[:-1, :-1], own[:-1, 1:], own[1:, 1:], own[1:, :-1]
    faces = np.concatenate(
        [np.stack([a, b, c], -1).reshape(-1, 3), np.stack([a, c, d], -1).reshape(-1, 3)]
    )
    uvs = square[:, 1::-1] if turned else square[:, :2]
    part = PiecePart("floor", square, faces, uvs + 0.37, plain)
    floor = SceneItem("rug", "rug", "rug", (part,), False)
    used = leave_traces([floor], make_plan(generator(0, "plan"), 1, 1), 1)[0].parts[0]
    assert isinstance(used.material, Material) and used.material.use is not None
    one, two = shown(made, plain), shown(made, used.material)
    at, there = (
        made.placed(each.material, each.vertices, each.faces, None, each.uvs)
        for each in (part, used)
    )
    # Vertices may be in another order; compare triangles' centres.
    at, there = at[part.faces].mean(axis=1), there[used.faces].mean(axis=1)

    def texels(image: np.ndarray, places: np.ndarray) -> np.ndarray:
        rows, columns = image.shape[:2]
        u, v = np.floor(places % 1 * [columns, rows]).astype(int).T
        return image[v, u]

    repeated, own_image = texels(one, at)[:, 0], texels(two, there)[:, 0]
    # Own images are shifted by whole texels; of another place they are uncorrelated.
    assert np.corrcoef(repeated, own_image)[0, 1] > 0.7
    assert own_image.mean() == pytest.approx(repeated.mean(), rel=0.02)


def test_traces_lie_where_they_are_and_grow_with_wear(tmp_path: Path) -> None:
    walked = Use(
        (0.0, 0.0),
        (2.0, 1.0),
        ((0.0, 0.0, 2.0, 1.0, 0.0, 0.0),),
        (Trace("walk", (0.5, 0.2), (0.5, 0.8), 0.3), Trace("ring", (1.5, 0.5), (1.5, 0.5), 0.1)),
    )
    wood = Material("wood", (0.4, 0.3, 0.2), 0.3, family="birch", wear=None, use=walked)
    colors, roughs = [], []
    for level in (0.0, 0.5, 1.0):
        made = library(tmp_path / str(level), level)
        colors.append(shown(made, replace(wood, wear=level)))
        roughs.append(shown(made, replace(wood, wear=level), "-rough"))
    rows, columns = roughs[0].shape
    assert columns / rows == pytest.approx(2, rel=0.02)
    path = (slice(rows * 3 // 10, rows * 7 // 10), slice(columns * 9 // 40, columns * 11 // 40))
    aside = (slice(None), slice(columns * 45 // 100, columns * 65 // 100))
    inside = (
        slice(rows * 46 // 100, rows * 54 // 100),
        slice(columns * 73 // 100, columns * 77 // 100),
    )
    for new, old in ((0, 1), (1, 2)):
        assert colors[old][path].mean() < 0.97 * colors[new][path].mean()
        assert roughs[old][path].mean() > roughs[new][path].mean() + 0.03
    # What wears everywhere is left out: only traces differ between place and place.
    loss = [colors[2][where].mean() / colors[0][where].mean() for where in (path, aside, inside)]
    assert loss[0] < 0.9 * loss[1] and loss[2] == pytest.approx(loss[1], rel=0.05)


def test_a_home_keeps_its_geometry_and_is_used_where_people_are() -> None:
    plan = make_plan(generator(11, "plan"), 4, 5)
    style = make_style(generator(11, "style"), "classic")
    kinds = {room.id: str(room.type) for room in plan.rooms}
    finishes = make_finishes(generator(11, "finishes"), style, kinds)
    items = [*build_structure(plan, finishes)[0], *furnish(generator(11, "furniture"), plan, style)]
    used = leave_traces(items, plan, 3)
    before, after = triangles(items), triangles(used)
    cut = 0
    for name, faces in before.items():
        if name.startswith("walls-"):  # in other triangles
            a, b = (each.reshape(-1, 3) for each in (faces, after[name]))
            np.testing.assert_array_equal(
                (a.min(axis=0), a.max(axis=0)), (b.min(axis=0), b.max(axis=0))
            )
            cut += len(a) != len(b)
        else:
            np.testing.assert_array_equal(faces, after[name])
    assert cut
    for old, new in zip(items, used, strict=True):
        np.testing.assert_allclose(areas_by_direction(new), areas_by_direction(old), atol=1e-9)
    again = leave_traces(items, plan, 3)
    assert [part.material for item in used for part in item.parts] == [
        part.material for item in again for part in item.parts
    ]
    marked = {
        item.id: part.material.use
        for item in used
        for part in item.parts
        if isinstance(part.material, Material) and part.material.use is not None
    }
    for room in plan.rooms:
        floor = marked[f"floor-{room.id}"]
        assert "dust" in {trace.kind for trace in floor.traces}
        # Paths end within the floor.
        for trace in floor.traces:
            assert (np.array(trace.start) > np.array(floor.low) - 0.3).all()
            assert (np.array(trace.end) < np.array(floor.high) + 0.3).all()
    leaves = [o.id for o in plan.openings if o.kind in ("door", "entrance")]
    assert leaves and set(leaves) <= set(marked)
