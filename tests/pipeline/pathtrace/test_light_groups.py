"""Light groups: each is a render in which only its lights shine; together they are colour."""

from pathlib import Path
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest

from pbrnet.pipeline.passes.groundtruth import render_both
from pbrnet.pipeline.pathtrace.guiding import plan_guiding
from pbrnet.pipeline.pathtrace.light_parts import GroupTable, LightGroups, LightParts, group_lights
from pbrnet.pipeline.pathtrace.light_plan import plan_lights
from pbrnet.pipeline.pathtrace.light_sampling import PlannedLights
from pbrnet.pipeline.render.scene import RenderScene, open_scene
from pbrnet.scenes.contract import Light
from tests.fixtures.joint import (
    blocks,
    deviations,
    in_parts,
    plain,
    region_means,
    sunsky,
)
from tests.fixtures.params import plain_truth
from tests.fixtures.render import (
    WINDOW,
    ball,
    diffuse,
    glow,
    make_view,
    quad,
    room_walls,
    write_scene,
)
from tests.fixtures.xml import bsdf, emitter

pytestmark = pytest.mark.usefixtures("wavefront")

VIEW = make_view((0, -1.8, 1.5), (0.1, 1, -0.1), size=(24, 18))
COPIES, SPP = 16, 64
LIGHTS = (
    Light("far", "area", ("ball",), "elsewhere"),
    Light("ceiling", "area", ("lamp", "strip"), "r"),
    Light("bulb", "point", (), "r"),
    Light("outdoors", "sky"),
)
REGIONS = blocks(24, 18, 3, 4)


def lit_room(folder: Path, *shining: str) -> RenderScene:
    """A room with a window, two lamps, a bulb and a sky, of which only some shine."""
    walls, _ = room_walls(diffuse("0.7,0.5,0.3"), window=True)

    def light(name: str, radiance: str) -> str:
        return glow(radiance) if name in shining else diffuse(0)

    body = walls + ball("block", (0.5, 0.8, 0.5), 0.5, bsdf("roughconductor", alpha=0.3))
    body += quad("lamp", (0, 0, 2.95), (0, 0, -1), (0.5, 0.4), light("ceiling", "6,5,3"), (0, 1, 0))
    body += quad("strip", (-1.9, 0, 1.5), (1, 0, 0), (0.8, 0.3), light("ceiling", "2,1,1"))
    body += ball("ball", (1.2, 0.5, 2.2), 0.25, light("far", "1,4,8"))
    if "bulb" in shining:
        place = '<point name="position" x="-1.5" y="-1" z="2"/>'
        body += emitter("point", place, id="bulb", intensity=(0.9, 0.5, 0.7))
    if "sky" in shining or "sun" in shining:
        scales = {name: scale * (name in shining) for name, scale in (("sun", 0.2), ("sky", 40))}
        body += sunsky(**scales)
    return open_scene(write_scene(folder, body, portals=[WINDOW], lights=LIGHTS))


def groups_of(scene: RenderScene, most: int) -> LightGroups:
    return group_lights(scene.mitsuba, scene.geometry.shapes, scene.scene.lights, "r", most)


ALL = ("ceiling", "bulb", "far", "sky", "sun")


@pytest.fixture(scope="module")
def room(tmp_path_factory: pytest.TempPathFactory) -> RenderScene:
    return lit_room(tmp_path_factory.mktemp("lit") / "all", *ALL)


def test_lamps_of_the_room_come_first_and_the_rest_is_pooled(room: RenderScene) -> None:
    assert groups_of(room, 4).names == ("sky", "sun", "ceiling", "bulb", "far", "", "")
    assert groups_of(room, 1).names == ("sky", "sun", "ceiling", "others")
    assert groups_of(room, 0).names == ("sky", "sun", "others")
    one = {group for _, group in groups_of(room, 1).members}
    assert one == {2, 3} and len(groups_of(room, 1).members) == 4


class TheOther(GroupTable):
    """Swaps two lamps where a light is met after the first vertex."""

    def group(self, ds: Any) -> Any:
        found = super().group(ds)
        near = ds.dist < 2
        return dr.select(near & (found == 2), mi.UInt32(4), found)


class Mixed(LightParts):
    def __init__(self, lobes: Any, groups: LightGroups | None = None) -> None:
        super().__init__(lobes, groups)
        assert groups is not None
        self.groups = TheOther(groups)


@pytest.mark.slow
def test_each_group_is_a_render_in_which_only_it_shines(room: RenderScene, tmp_path: Path) -> None:
    groups = groups_of(room, 3)
    plan = plan_lights(room.mitsuba, VIEW, (WINDOW,), 1)
    lights = PlannedLights(room.mitsuba, plan, plan_guiding(room.mitsuba, plan, 1))
    found = in_parts(room, VIEW, SPP, COPIES, 4, groups=groups, lights=lights)
    mixed = in_parts(room, VIEW, SPP, COPIES, 4, Mixed, groups)
    total = np.sum([found[f"light{i:02d}"] for i in range(6)], axis=0)
    np.testing.assert_allclose(total, found["colour"], rtol=1e-4, atol=1e-7)
    assert found["light05"].max() == 0
    for number_, name in enumerate(groups.names[:5]):
        alone = plain(lit_room(tmp_path / name, name), VIEW, None, 2, SPP, COPIES, 8)
        wanted = region_means(alone, REGIONS)
        assert wanted.max() > 0
        image = f"light{number_:02d}"
        off = abs(deviations(region_means(found[image], REGIONS), wanted))
        assert off.max() < 4.5, name
        if name == "ceiling":
            off = abs(deviations(region_means(mixed[image], REGIONS), wanted))
            assert off.max() > 6


@pytest.mark.check
def test_groups_change_no_bit_of_colour(room: RenderScene) -> None:
    """With planned lights, and as many channels as need padding."""
    params = plain_truth(spp=8, block_spp=4, max_depth=4)
    bare = render_both(room, VIEW, params, 0.5, 3).color[0]
    full = render_both(room, VIEW, params, 0.5, 3, True, groups_of(room, 13))
    for band in "RGB":
        np.testing.assert_array_equal(full.color[0][band], bare[band])
        total = sum(part[0][band] for name, part in full.parts.items() if "light" in name)
        np.testing.assert_allclose(total, bare[band], rtol=1e-4, atol=1e-7)
