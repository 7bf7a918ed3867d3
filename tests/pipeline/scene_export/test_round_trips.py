"""Every scene comes back from each format: many homes, and imports of many sources."""

import json
import struct
from pathlib import Path

import pytest

from pbrnet.pipeline.scene_export.export import export_scene
from pbrnet.scenes.contract import load_scene
from tests.fixtures.many_scenes import HOMES, IMPORTS, is_missing
from tests.fixtures.round_trips import (
    FORMATS,
    LIMIT,
    equal,
    found_anew,
    measured,
    round_trip,
    without_extras,
)

# Made by the fixtures; each takes a second or two.
_SMALL = ("mitsuba-made", "obj-room")


@pytest.mark.parametrize("name", _SMALL)
def test_small_rooms_come_back(name: str, few_walks: None, tmp_path: Path) -> None:
    pytest.importorskip("pxr")
    scene = IMPORTS[name](tmp_path / "scene")
    for format_ in FORMATS:
        assert all(equal(scene, round_trip(scene, format_, tmp_path)).values())


def test_rooms_and_objects_are_found_anew(few_walks: None, tmp_path: Path) -> None:
    scene = IMPORTS["obj-two-rooms"](tmp_path / "scene")  # with sun, sky and ground of ours
    export_scene(scene.folder, "glb", tmp_path / "scene.glb")
    found = found_anew(scene, tmp_path / "scene.glb", tmp_path)
    assert found.rooms == (2, 2)
    assert found.objects == found.categories == (4, 4)


def test_files_without_extras_hold_the_same_geometry(few_walks: None, tmp_path: Path) -> None:
    scene = IMPORTS["obj-room"](tmp_path / "scene")
    export_scene(scene.folder, "glb", tmp_path / "scene.glb")
    whole = (tmp_path / "scene.glb").read_bytes()
    bare = without_extras(whole)
    assert struct.unpack_from("<I", bare, 8)[0] == len(bare)
    documents = [json.loads(one[20 : 20 + struct.unpack_from("<I", one, 12)[0]])
                 for one in (whole, bare)]  # fmt: skip
    assert "extras" in json.dumps(documents[0]) and "extras" not in json.dumps(documents[1])
    assert documents[0]["accessors"] == documents[1]["accessors"]


@pytest.mark.check
@pytest.mark.timeout(1800)
@pytest.mark.parametrize("name", [*HOMES, *IMPORTS])
def test_scenes_come_back_and_look_the_same(name: str, tmp_path: Path) -> None:
    pytest.importorskip("pxr")
    if is_missing(name):
        pytest.skip("the file, or the library that reads it, is not on this machine")
    scene = (HOMES | IMPORTS)[name](tmp_path / "scene")
    line = measured(scene, tmp_path)
    assert all(all(line[format_]["equal"].values()) for format_ in FORMATS)
    for found in (line["glb"], line["usdz"]):
        assert found.get("alike", found["flip"]) <= LIMIT
        assert found["radiance"] == pytest.approx(1, abs=0.02)
    assert load_scene(tmp_path / "scene-glb").plan == scene.plan
