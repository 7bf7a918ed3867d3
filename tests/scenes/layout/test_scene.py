"""Layouts as scenes: a whole import, and generated homes that are described and read back."""

import json
from collections import Counter
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from pbrnet.pipeline.cli import cli
from pbrnet.scenes.contract import Scene
from pbrnet.scenes.errors import InputError
from pbrnet.scenes.files import digest_folder
from pbrnet.scenes.importing.changes import Changes
from pbrnet.scenes.layout.building.plan import plan_of
from pbrnet.scenes.layout.building.swings import with_swings
from pbrnet.scenes.layout.describe import described, layout_text
from pbrnet.scenes.layout.furnishing.furnish import furnish_layout
from pbrnet.scenes.params import SceneParams
from pbrnet.scenes.procedural.design import Design, design_home
from pbrnet.scenes.procedural.home import make_home
from pbrnet.scenes.procedural.plan import Plan
from pbrnet.scenes.registry import import_scene
from pbrnet.scenes.seeds import generator
from tests.fixtures.command import refused
from tests.fixtures.layouts import FLAT, changed, checked, write_layout


@pytest.fixture(scope="module")
def flat(tmp_path_factory: pytest.TempPathFactory) -> Scene:
    folder = tmp_path_factory.mktemp("flat")
    path = write_layout(folder / "flat.json", FLAT)
    return import_scene(path, folder / "flat", lighting="evening")


def test_an_import_is_a_whole_scene(flat: Scene) -> None:
    living, bath = flat.rooms
    assert (living.type, bath.type, bath.name) == ("living", "bathroom", "bathroom")
    assert (living.ceiling_z, bath.ceiling_z) == (2.6, 2.3)
    assert living.has_light and bath.has_light
    furniture = Counter(item.category for item in flat.objects if not item.is_structure)
    assert furniture["table"] == furniture["toilet"] == 1 and furniture["lamp"] == 2
    assert {"facade", "slabs", "floor-living", "door-0", "entrance-1"} <= {
        item.id for item in flat.objects
    }
    assert Counter(portal.kind for portal in flat.portals) == {"window": 2, "door": 1}
    assert flat.lighting == "evening" and flat.source["style"] == "minimal"
    assert flat.source["furnishing"]["median_iou"] > 0.9
    made = {id_ for id_, _ in flat.source["furnishing"]["stated"].values()}
    assert made <= {one.id for one in flat.objects}
    assert ("A. Maker", "CC0-1.0") in {(one.author, one.licence) for one in flat.credits}


def test_portals_of_slanted_walls_lie_in_them_and_look_out(flat: Scene) -> None:
    slanted = next(one for one in flat.portals if one.room == "living" and one.clear)
    corners = np.array(slanted.polygon)
    normal = np.array(slanted.normal)
    assert normal == pytest.approx([0.8, -0.6, 0], abs=1e-4)
    assert np.ptp(corners @ normal) < 1e-4
    # 60 % of the wall's 0.3 m outside of the inner face, the line through (4, 0) and (5.5, 2)
    assert corners[0] @ normal == pytest.approx(3.2 + 0.18, abs=1e-4)


def test_equal_files_give_equal_bytes_and_seeds_others(flat: Scene, tmp_path: Path) -> None:
    path = write_layout(tmp_path / "flat.json", FLAT)
    again = import_scene(path, tmp_path / "flat", lighting="evening")
    assert digest_folder(again.folder) == digest_folder(flat.folder)
    assert again.plan == flat.plan


def test_things_are_added_only_where_they_are_asked_for(flat: Scene, tmp_path: Path) -> None:
    path = write_layout(tmp_path / "flat.json", FLAT)
    more = import_scene(path, tmp_path / "more", lighting="evening", outdoors="none", things=True)
    stated = {item.id for item in flat.objects if item.room is not None}
    added = [item for item in more.objects if item.room is not None and item.id not in stated]
    assert stated <= {item.id for item in more.objects}
    assert {"switch"} <= {item.category for item in added} and len(added) > 5


def test_no_lamp_is_added_where_only_those_of_the_file_are_asked_for(tmp_path: Path) -> None:
    path = write_layout(tmp_path / "flat.json", changed(objects=[]))
    scene = import_scene(path, tmp_path / "flat", outdoors="none", lamps="home")
    assert not [item for item in scene.objects if not item.is_structure]


def test_a_folder_without_catalogues_is_refused(tmp_path: Path) -> None:
    path = write_layout(tmp_path / "flat.json", FLAT)
    with pytest.raises(InputError, match="holds no catalogue; convert one"):
        import_scene(path, tmp_path / "flat", catalogue=tmp_path)


@pytest.fixture(scope="module")
def home() -> Design:
    return design_home(SceneParams(rooms_min=3, rooms_max=3).home(8, "day"), None)


def test_a_described_home_is_read_back(home: Design) -> None:
    layout = checked(json.loads(layout_text(described(home, "home", 8))))
    changes = Changes()
    plan, stated = plan_of(layout, home.plan.ground, changes)
    made = furnish_layout(generator(0), layout, plan, home.style, None, changes)
    solid = [one.footprint for one in made.standing if one.on_floor]
    plan = with_swings(generator(0), plan, stated, solid)
    for room, own in zip(plan.rooms, home.plan.rooms, strict=True):
        assert (room.id, room.type) == (own.id, own.type)
        assert room.shape.hausdorff_distance(own.shape) < 1e-3
    for one, own in zip(plan.openings, home.plan.openings, strict=True):
        assert (one.kind, one.rooms) == (own.kind, own.rooms)
        places = [(*each.start, *each.end, each.thickness, each.z0, each.z1) for each in (one, own)]
        assert places[0] == pytest.approx(places[1], abs=1e-3)
        if own.kind == "door":
            assert (one.swing, one.hinge_at_start) == (own.swing, own.hinge_at_start)
            assert one.angle == pytest.approx(own.angle, abs=1e-3)
    kinds = Counter(each.placed.kind for each in made.placed)
    assert kinds == Counter(one.kind for one in layout.objects)
    assert made.record["median_iou"] >= 0.97 and not made.record["plain_boxes"]


def test_a_scene_folder_is_described_like_its_home(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)  # where no params.yaml is
    params = SceneParams(rooms_min=3, rooms_max=3, texture_size=64, outdoors="none")
    settings = params.home(8, "day")
    home = design_home(settings, None)
    make_home(tmp_path / "home", "home", settings)
    done = CliRunner().invoke(
        cli, ["scenes", "--describe", str(tmp_path / "out"), str(tmp_path / "home")]
    )
    assert done.exit_code == 0, done.output
    layout = checked(json.loads((tmp_path / "out" / "home.layout.json").read_text()))
    plan, _ = plan_of(layout, home.plan.ground, Changes())
    for room, own in zip(plan.rooms, home.plan.rooms, strict=True):
        assert (room.id, room.type) == (own.id, own.type)
        assert room.shape.hausdorff_distance(own.shape) < 1e-3

    def places(each: Plan) -> list[tuple]:
        return sorted((one.kind.replace("patio", "window"),
                       *np.round(one.edge.at(one.width / 2), 2),
                       round(one.width, 2), round(one.z0, 2), round(one.z1, 2))
                      for one in each.openings if one.kind not in ("open", "archway"))  # fmt: skip

    ours, theirs = places(plan), places(home.plan)
    assert [one[0] for one in ours] == [one[0] for one in theirs]
    for one, own in zip(ours, theirs, strict=True):
        assert one[1:] == pytest.approx(own[1:], abs=0.35)  # on either face of the wall
        assert one[3:] == pytest.approx(own[3:], abs=0.011)
    kinds = Counter(each.placed.kind for each in home.furniture)
    told = Counter(one.kind for one in layout.objects)
    assert told == Counter({kind: n for kind, n in kinds.items() if kind in told})
    assert sum(told.values()) > 0.9 * sum(kinds.values())
    twice = ("scenes", "--describe", tmp_path / "out", tmp_path / "home", tmp_path / "home")
    assert "a second scene with the id 'home'" in refused(*twice)


def test_the_command_describes_the_homes_of_the_parameters(tmp_path: Path) -> None:
    (tmp_path / "params.yaml").write_text("scenes: {homes: 1, rooms_min: 1, rooms_max: 1}\n")
    options = ["--params", str(tmp_path / "params.yaml"), "--data", str(tmp_path / "data")]
    done = CliRunner().invoke(cli, ["scenes", "--describe", str(tmp_path / "out"), *options])
    assert done.exit_code == 0, done.output
    content = json.loads((tmp_path / "out" / "home-0000.layout.json").read_text())
    assert content["pbrnet"] == "layout" and len(checked(content).rooms) == 1
    assert not (tmp_path / "data" / "scenes").exists()


def test_a_bad_layout_is_one_line_and_exit_code_3(tmp_path: Path) -> None:
    path = write_layout(tmp_path / "flat.json", changed(wall=-1))
    done = CliRunner().invoke(cli, ["import", str(path), "--out", str(tmp_path / "out")])
    assert isinstance(done.exception, InputError) and done.exception.exit_code == 3
    assert "\n" not in str(done.exception) and "wall: -1 is not" in str(done.exception)
    assert not (tmp_path / "out").exists()
