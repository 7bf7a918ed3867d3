"""IFC: unit, rooms from spaces, windows as portals, objects by class, and what is refused."""

import re
from pathlib import Path

import numpy as np
import pytest

from pbrnet.scenes import child_process
from pbrnet.scenes.color import decode_srgb_value
from pbrnet.scenes.contract import Scene
from pbrnet.scenes.errors import InputError, MachineError
from pbrnet.scenes.registry import import_scene
from tests.fixtures.ifc import attic, house, with_upper_storey
from tests.fixtures.imported import values

INSTALLED = pytest.mark.skipif(
    child_process.find_spec("ifcopenshell") is None, reason="the extra pbrnet[ifc] is not installed"
)


def imported(folder: Path, text: str, **options: object) -> Scene:
    path = folder / "in" / "house.ifc"
    path.parent.mkdir(exist_ok=True)
    path.write_text(text)
    return import_scene(path, folder / "out", **options)


@INSTALLED
def test_a_house_with_spaces(tmp_path: Path) -> None:
    scene = imported(tmp_path, house().text)
    living, bath = scene.rooms
    assert (living.name, living.type) == ("Wohnzimmer", "living")
    assert (bath.name, bath.type) == ("Bad", "bathroom")
    assert (living.floor_z, living.ceiling_z) == (0, 2.6)
    assert np.ptp(living.floor, axis=0) == pytest.approx([5, 4])
    assert np.min(bath.floor, axis=0) == pytest.approx([5.1, 0])
    # The pane is the portal; the closed door between the rooms is none.
    (portal,) = scene.portals
    assert (portal.kind, portal.clear, portal.room) == ("window", True, living.id)
    corners = np.array(portal.polygon)
    assert corners.min(axis=0) == pytest.approx([1.05, -0.1, 0.95], abs=0.06)
    assert corners.max(axis=0) == pytest.approx([2.45, -0.1, 2.05], abs=0.06)
    assert living.has_light
    found = {each.name: (each.category, each.is_structure, each.room) for each in scene.objects}
    assert found["Fauteuil 7"] == ("armchair", False, living.id)
    assert found["Typ 12"] == ("toilet", False, bath.id)
    assert found["south"][:2] == ("wall", True) and found["Inner door"][:2] == ("door", True)
    assert found["Fenster 1"][:2] == ("window", True)
    assert found["floor"][:2] == ("floor", True)
    expected = [decode_srgb_value(each) for each in (0.4, 0.2, 0.1)]
    assert any(each == pytest.approx(expected, rel=1e-5)
               for each in values(scene, "diffuse", "reflectance"))  # fmt: skip
    assert scene.source["storeys"] == ["Ground floor"] and scene.source["version"] == "IFC4"
    assert scene.credits[0].author == "A. Maker"
    kinds = {each.kind: each.room for each in scene.lights}
    assert kinds == {"sun": None, "sky": None, "area": bath.id}  # which has a door alone


@INSTALLED
def test_metres_far_away_without_spaces_or_glass(tmp_path: Path) -> None:
    text = house(glass=False, spaces=False, at=(4_000_000.0, 5_000_000.0, 0.0)).text
    scene = imported(tmp_path, text, storey=["Ground floor"])
    assert any("no spaces: rooms were derived" in each for each in scene.changes)
    assert any("near the origin" in each for each in scene.changes)
    assert any("without a transparent style became glass: Fenster 1" in e for e in scene.changes)
    heights = [room.ceiling_z - room.floor_z for room in scene.rooms]
    assert heights == [pytest.approx(2.6, abs=0.01)] * 2
    assert np.abs([room.floor[0] for room in scene.rooms]).max() < 50
    assert [(each.kind, each.clear) for each in scene.portals] == [("window", True)]


@INSTALLED
def test_spaces_that_reach_through_their_ceiling_end_at_it(tmp_path: Path) -> None:
    """As Revit writes rooms with a default height; a plenum below the roof is no room."""
    made = house(spaces=False)
    made.space("Wohnzimmer", (0, 0, 0), (5000, 4000, 4000))
    made.space("Bad", (5100, 0, 0), (8100, 4000, 2600))
    made.space("Roof area", (0, 0, 2300), (8100, 4000, 6000))
    scene = imported(tmp_path, made.text)
    assert [room.name for room in scene.rooms] == ["Wohnzimmer", "Bad"]
    assert [room.ceiling_z for room in scene.rooms] == pytest.approx([2.6, 2.6])
    assert [portal.kind for portal in scene.portals] == ["window"]
    assert any("end at it: Wohnzimmer" in each for each in scene.changes)
    assert any("too low to be rooms were left out: Roof area" in each for each in scene.changes)


@INSTALLED
def test_proxies_that_bound_rooms_are_parts_of_the_building(tmp_path: Path) -> None:
    """As modellers write a house that knows no walls; a thing in a room stays one."""
    text = house(spaces=False).text.replace("IFCWALL(", "IFCBUILDINGELEMENTPROXY(")
    text = text.replace("SOLIDWALL", "ELEMENT").replace("IFCFURNITURE(", "IFCBUILDINGELEMENTPROXY(")
    scene = imported(tmp_path, text.replace("Fauteuil 7", "Element 7"))
    found = {each.name: (each.category, each.is_structure) for each in scene.objects}
    assert {found[name] for name in ("south", "north", "west", "east")} == {("wall", True)}
    assert found["Element 7"] == ("other", False)


@INSTALLED
def test_spaces_without_slabs_get_floors_and_ceilings(tmp_path: Path) -> None:
    scene = imported(tmp_path, house(slabs=False).text)
    assert [room.ceiling_z for room in scene.rooms] == [2.6, 2.6]
    assert [portal.kind for portal in scene.portals] == ["window"]
    assert {"floor", "ceiling"} <= {each.category for each in scene.objects}
    assert any("spaces without a ceiling got one at their height: 2" in e for e in scene.changes)
    whole = imported(tmp_path, house().text)
    assert not any("got one at their height" in each for each in whole.changes)


@INSTALLED
def test_a_storey_without_spaces_gets_its_closed_rooms(tmp_path: Path) -> None:
    scene = imported(tmp_path, with_upper_storey(house()).text)
    assert [(room.name, room.floor_z) for room in scene.rooms[:2]] == [
        ("Wohnzimmer", 0), ("Bad", 0)
    ]  # fmt: skip
    (upper,) = scene.rooms[2:]
    assert (upper.floor_z, upper.ceiling_z) == pytest.approx((2.8, 5.3))
    assert np.ptp(upper.floor, axis=0) == pytest.approx([8.1, 4])
    assert {portal.room for portal in scene.portals} == {scene.rooms[0].id, upper.id}
    assert any("got rooms from their surfaces: Upper floor" in each for each in scene.changes)


@INSTALLED
@pytest.mark.parametrize("roof_window", [False, True])
def test_an_attic_is_its_own_solid(tmp_path: Path, roof_window: bool) -> None:
    scene = imported(tmp_path, attic(roof_window).text)
    (room,) = scene.rooms
    assert (room.ceiling_z, room.has_light) == (3.0, True)
    assert len(scene.portals) == roof_window
    assert ("lamp" in {each.category for each in scene.objects}) != roof_window
    for portal in scene.portals:  # in the slope, which rises 2 m over 2.5 m towards the ridge
        assert portal.normal == pytest.approx((0, -2 / 10.25**0.5, 2.5 / 10.25**0.5), abs=0.01)


@INSTALLED
def test_openings_without_a_context_are_cut(tmp_path: Path) -> None:
    text = re.sub(r"IFCSHAPEREPRESENTATION\(#\d+", "IFCSHAPEREPRESENTATION($", house().text)
    scene = imported(tmp_path, text)
    assert [portal.kind for portal in scene.portals] == ["window"]


@INSTALLED
def test_files_are_refused_with_a_reason(tmp_path: Path) -> None:
    text = house().text
    with pytest.raises(InputError, match=r"no storey 'Attic'; there are Ground floor"):
        imported(tmp_path, text, storey=["Attic"])
    for damaged in (text[: len(text) // 2], "x" + text[100:], text.replace("IFCPROJECT", "IFCX")):
        with pytest.raises(InputError, match=r"house\.ifc: damaged IFC file"):
            imported(tmp_path, damaged)
    assert not (tmp_path / "out").exists()


def test_without_the_library_the_error_says_what_to_install(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(child_process, "find_spec", lambda _: None)
    with pytest.raises(MachineError, match=r"house\.ifc: .* install pbrnet\[ifc\]"):
        imported(tmp_path, "")
