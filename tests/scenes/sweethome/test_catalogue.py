"""Furniture catalogues: reading, conversion, refusal, and homes furnished from them."""

import json
import os
import shutil
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from PIL import Image

from pbrnet.pipeline.commands import stages
from pbrnet.pipeline.farm.settings import FarmParams
from pbrnet.pipeline.inspection.describe import inspect_path
from pbrnet.pipeline.params import Params
from pbrnet.pipeline.stages.assets import run_assets
from pbrnet.pipeline.stages.scenes import run_scenes
from pbrnet.scenes.assets.free_space import covering_boxes, subdivide_triangles, support_surfaces
from pbrnet.scenes.assets.index import Asset, Provenance, load_asset, load_index
from pbrnet.scenes.assets.piece import CataloguePiece
from pbrnet.scenes.contract import Room, Scene, SceneObject, load_scene, scene_folders
from pbrnet.scenes.errors import InputError, MachineError
from pbrnet.scenes.files import digest_folder
from pbrnet.scenes.formats.ply import read_ply, write_ply
from pbrnet.scenes.geometry.mesh import Mesh
from pbrnet.scenes.params import AssetParams, SceneParams
from pbrnet.scenes.photometry import blackbody, color_temperature
from pbrnet.scenes.procedural.furnishing.asset_sampler import load_kind_index
from pbrnet.scenes.procedural.home import make_home
from pbrnet.scenes.sweethome.catalogue import packages
from pbrnet.scenes.sweethome.catalogue.convert import PieceJob, convert
from pbrnet.scenes.sweethome.catalogue.library import UnusablePiece, read_library
from pbrnet.scenes.sweethome.catalogue.packages import INSTALLED
from pbrnet.scenes.sweethome.catalogue.properties import parse_properties
from pbrnet.scenes.sweethome.furnishing.lamps import USUAL
from tests.fixtures import catalogue as draw
from tests.fixtures.encoded import zipped
from tests.fixtures.geometry import Solids, crossings, floating

NOWHERE = Provenance("test.sh3f", "0" * 64, "Test library", "2.1", "example.org", "")


@pytest.fixture(scope="session")
def library(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return draw.write_catalogue(tmp_path_factory.mktemp("catalogue") / "test.sh3f")


@pytest.fixture(scope="session")
def converted(library: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The hand-drawn catalogue as the stage converts it."""
    data = tmp_path_factory.mktemp("data")
    summary = run_assets(data, _params(library.parent))
    assert summary.made == 8 and not summary.index.refused, str(summary)
    return data


def _params(folder: Path, share: float = 0.0, **assets: object) -> Params:
    return Params(
        assets=replace(AssetParams(enabled=True, folder=str(folder)), **assets),  # type: ignore[arg-type]
        farm=FarmParams(workers=1),
        scenes=SceneParams(homes=1, rooms_max=2, texture_size=64, catalogue_share=share),
    )


def _asset(data: Path, name: str) -> Asset:
    return load_asset(data / "assets" / "test" / name)


def _meshes(data: Path, name: str) -> list[Mesh]:
    folder = data / "assets" / "test" / name
    return [read_ply(folder / part.mesh) for part in load_asset(folder).parts]


def _corners(spans: list[draw.Span]) -> np.ndarray:
    """Triangles of boxes, metres, Z up."""
    lines = draw.boxes(spans).splitlines()
    points = np.array([[float(v) for v in line.split()[1:]] for line in lines if line[0] == "v"])
    quads = np.array([[int(v) for v in line.split()[1:]] for line in lines if line[0] == "f"]) - 1
    return points[np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]])]


# -- reading --------------------------------------------------------------------------------


def test_properties_are_read_as_java_does() -> None:
    text = (
        b"# comment\n! another\nname#1=Caf\\u00e9\nlong = one \\\n   two\n"
        b"key\\:with=a\\=b\\tc\r\nlatin=\xe9t\xe9\nempty=\nname#1=Last\\\\"
    )
    assert parse_properties(text) == {
        "name#1": "Last\\",
        "long": "one two",
        "key:with": "a=b\tc",
        "latin": "été",
        "empty": "",
    }


def test_a_catalogue_says_what_its_pieces_are(library: Path) -> None:
    read = read_library(library)
    assert (read.key, read.name, read.version) == ("test", "Test library", "2.1")
    assert read.licence == "CC-BY-3.0-US" and not read.refused
    pieces = {piece.name: piece for piece in read.pieces}
    table = pieces["Table"]
    assert table.key == "test/Table" and table.creator == "Jörg Test"
    assert table.size == pytest.approx((1.2, 0.8, 0.75)) and table.category == "table"
    assert table.drop == pytest.approx(0.75)  # not said: its top
    assert pieces["Bookcase"].drop == pytest.approx(0.5)
    assert pieces["Chair"].drop is None  # -1: nothing stands on it
    (light,) = pieces["Lamp"].lights
    assert (light.x, light.y, light.z) == pytest.approx((0.5, 0.5, 0.75))
    assert light.color == 0xAA9770 and light.diameter == pytest.approx(0.2)
    door = pieces["Door"].opening
    assert door is not None and door.wall_thickness == 0.5 and door.wall_distance == 0.25
    assert door.sashes[0] == pytest.approx((0.1, 0.5, 0.8, 0.0, -90.0))


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        ({"width": "nan"}, "not a sensible number"),
        ({"height": "0"}, "size"),
        ({"depth": "wide"}, "not a number"),
        ({"width": "1e5"}, "size"),
        ({"model": ""}, "no model"),
        ({"modelRotation": "1 0 0"}, "nine"),
        ({"lightSourceX": "1 2", "lightSourceColor": "#ffffff"}, "alike"),
        ({"lightSourceX": "1", "lightSourceY": "1", "lightSourceZ": "1",
          "lightSourceColor": "red"}, "colour"),
    ],
)  # fmt: skip
def test_a_piece_that_makes_no_sense_is_refused_with_the_reason(
    change: dict[str, str], reason: str, tmp_path: Path
) -> None:
    row = draw.piece(9, "Bad", "table.obj", (120, 80, 75), **change)
    read = read_library(draw.write_catalogue(tmp_path / "bad.sh3f", row))
    assert len(read.pieces) == 8
    ((key, name, why),) = read.refused
    assert (key, name) == ("bad/Bad", "Bad") and reason in why


def test_files_that_are_no_catalogues_are_refused(tmp_path: Path, library: Path) -> None:
    whole = library.read_bytes()
    cases: dict[str, bytes] = {"truncated": whole[: len(whole) // 2], "text": b"hello"}
    for name, data in cases.items():
        path = tmp_path / f"{name}.sh3f"
        path.write_bytes(data)
        with pytest.raises(InputError, match=name):
            read_library(path)
    climbing = tmp_path / "climbing.sh3f"
    climbing.write_bytes(zipped({"../../evil.obj": "v 0 0 0"}))
    with pytest.raises(InputError, match="leads out"):
        read_library(climbing)
    other = draw.pack(tmp_path / "other.sh3f", "id=nothing\n", {})
    with pytest.raises(InputError, match="no piece"):
        read_library(other)


# -- converting -----------------------------------------------------------------------------


def test_pieces_have_the_size_that_their_catalogue_gives(converted: Path) -> None:
    for piece in load_index(converted / "assets").pieces:
        bounds = np.array([m.bounds for m in _meshes(converted, piece.key.split("/")[1])])
        low, high = bounds[:, 0].min(axis=0), bounds[:, 1].max(axis=0)
        assert high - low == pytest.approx(piece.size, abs=1e-5), piece.key
        assert low[2] == pytest.approx(0, abs=1e-6)  # its foot is on the floor
        assert 0.5 * (low + high)[:2] == pytest.approx([0, 0], abs=1e-6)


def test_fronts_face_forwards_and_rotations_turn_them(converted: Path) -> None:
    """A knob in the middle of the model's front, its +z, sticks out towards -Y here."""
    points = np.concatenate([mesh.vertices for mesh in _meshes(converted, "Chair")])
    knob = points[points[:, 1] < -0.246]
    assert len(knob) and np.abs(knob[:, 0]).max() == pytest.approx(0.025, abs=1e-5)
    # The matrix takes z to x: the knob is on the right.
    points = np.concatenate([mesh.vertices for mesh in _meshes(converted, "Turnedchair")])
    knob = points[points[:, 0] > 0.246]
    assert len(knob) and np.abs(knob[:, 1]).max() == pytest.approx(0.025, abs=1e-5)


def test_normals_are_unit_and_faces_outward(converted: Path) -> None:
    for mesh in _meshes(converted, "Table"):
        assert mesh.normals is not None
        assert np.linalg.norm(mesh.normals, axis=1) == pytest.approx(1.0, abs=1e-6)
    corners = np.concatenate([mesh.corners for mesh in _meshes(converted, "Table")])
    volume = np.einsum("fi,fi->f", corners[:, 0], np.cross(corners[:, 1], corners[:, 2])).sum() / 6
    assert volume == pytest.approx(1.2 * 0.8 * 0.04 + 4 * 0.06**2 * 0.71, rel=1e-4)


def test_images_are_found_bounded_and_parted_from_their_alpha(
    library: Path, tmp_path: Path
) -> None:
    """The material file names an absolute path in another case, beside a black colour."""
    piece = next(piece for piece in read_library(library).pieces if piece.name == "Panel")
    asset = convert(PieceJob(library, piece, tmp_path / "out", NOWHERE, "mark", 1000, 64))
    (part,) = [part for part in asset.parts if part.texture]
    assert part.texture and part.alpha and min(part.color) > 0.5
    with Image.open(tmp_path / "out" / part.texture) as image:
        assert image.size == (64, 32) and image.getpixel((3, 3)) == (200, 30, 30)
    with Image.open(tmp_path / "out" / part.alpha) as image:
        assert (image.getpixel((3, 3)), image.getpixel((60, 3))) == (255, 0)
    mesh = read_ply(tmp_path / "out" / part.mesh)
    assert mesh.uvs is not None
    top = mesh.uvs[mesh.vertices[:, 2] > 0.9]
    assert top[:, 1] == pytest.approx(0.0, abs=1e-6)  # v = 0 is the image's top row


def test_a_lamp_shines_with_the_flux_of_its_bulb(converted: Path) -> None:
    lamp = _asset(converted, "Lamp")
    assert lamp.lumens == pytest.approx(USUAL, rel=0.02)
    assert load_index(converted / "assets").pieces
    glowing = [part for part in lamp.parts if part.lumens > 0]
    assert glowing and all(3000 < part.kelvin < 5500 for part in glowing)


def test_a_lamp_keeps_its_clear_shade_as_opal_glass(library: Path, tmp_path: Path) -> None:
    """Clear glass would stop the light's shadow rays, and its absence change the lamp's size."""
    clear = f"mtllib lamp.mtl\n{draw.LAMP}"
    materials = "newmtl wood\nKd 0.4 0.3 0.2\nnewmtl shade\nKd 1 1 1\nd 0.2\n"
    source = draw.write_catalogue(
        tmp_path / "clear.sh3f", **{"models/lamp.obj": clear, "models/lamp.mtl": materials}
    )
    piece = next(piece for piece in read_library(source).pieces if piece.lights)
    asset = convert(PieceJob(source, piece, tmp_path / "lamp", NOWHERE, "", 1000, 64))
    assert asset.checks.size_error < 1e-4 and any("opal" in note for note in asset.checks.notes)
    assert all(part.kind not in ("glass", "sheer") for part in asset.parts)
    assert asset.lumens == pytest.approx(USUAL, rel=0.02)


def test_colour_temperatures_of_black_bodies_are_their_own() -> None:
    for kelvin in (2400, 3000, 4000, 6500):
        assert color_temperature(blackbody(kelvin)) == pytest.approx(kelvin, rel=0.04)


def test_models_that_cannot_be_used_are_refused(library: Path, tmp_path: Path) -> None:
    table = read_library(library).pieces[0]
    cases: dict[str, tuple[str | bytes, str]] = {
        "missing": ("", "no faces"),
        "nan": (draw.TABLE.replace("v 0 0 0", "v nan 0 0", 1), "not a finite number"),
        "absurd": (draw.TABLE.replace("v 120", "v 1e300", 1), "not a finite number"),
        "index": ("v 0 0 0\nf 1 2 3\n", "does not exist"),
        "binary": (b"\0\1\2\3" * 100, "binary"),
        "bomb": (b"v 0 0 0\n" * 2_000_000, "zip bombs"),
    }
    for name, (data, reason) in cases.items():
        source = draw.write_catalogue(tmp_path / f"{name}.sh3f", **{"models/table.obj": data})
        with pytest.raises(UnusablePiece, match=reason):
            convert(PieceJob(source, table, tmp_path / name, NOWHERE, "", 1000, 64))
        assert not (tmp_path / name).exists()
    with pytest.raises(UnusablePiece, match="max_triangles"):
        convert(PieceJob(library, table, tmp_path / "many", NOWHERE, "", 10, 64))
    gone = replace(table, model="models/none.obj")
    with pytest.raises(UnusablePiece, match=r"none\.obj"):
        convert(PieceJob(library, gone, tmp_path / "gone", NOWHERE, "", 1000, 64))


# -- what a piece leaves free -------------------------------------------------------------------


def test_things_stand_on_boards_at_the_boards_heights(converted: Path) -> None:
    levels = _asset(converted, "Bookcase").levels
    assert levels[0].z == pytest.approx(0.5, abs=1e-4)  # what the catalogue says comes first
    assert sorted(level.z for level in levels) == pytest.approx([0.02, 0.5, 1.0, 1.6], abs=1e-4)
    by_height = {round(level.z, 1): level for level in levels}
    # 2 cm boards: from 0.5 m there is air up to 0.98.
    assert by_height[0.5].headroom == pytest.approx(0.48, abs=0.012)
    # Between sides 2 cm thick; a cell of the grid may be lost at each end.
    assert 0.68 < 2 * by_height[0.5].half_x < 0.761
    assert 0.22 < 2 * by_height[1.6].half_y < 0.301
    assert _asset(converted, "Chair").levels == ()


def test_boxes_hold_the_piece_and_leave_the_room_below_a_table(converted: Path) -> None:
    asset = _asset(converted, "Table")
    corners = np.concatenate([mesh.corners for mesh in _meshes(converted, "Table")])
    small, _ = subdivide_triangles(corners, 0.01)
    boxes = np.array(asset.boxes)
    inside = (
        (small.reshape(-1, 1, 3) > boxes[:, 0] - 1e-4)
        & (small.reshape(-1, 1, 3) < boxes[:, 1] + 1e-4)
    ).all(axis=2)
    assert inside.any(axis=1).all()
    # Nothing below the top between the legs: room for knees.
    low, high = np.array([-0.5, -0.3, 0.0]), np.array([0.5, 0.3, 0.65])
    overlap = np.minimum(boxes[:, 1], high) - np.maximum(boxes[:, 0], low)
    assert not (overlap > 1e-6).all(axis=1).any()


def test_dicing_keeps_the_surface_and_bounds_the_size() -> None:
    corners = _corners([((0, 0, 0), (2.0, 0.01, 0.3))])
    small, owner = subdivide_triangles(corners, 0.05)
    assert np.ptp(small, axis=1).max() <= 0.05
    area = 0.5 * np.linalg.norm(
        np.cross(small[:, 1] - small[:, 0], small[:, 2] - small[:, 0]), axis=1
    )
    whole = np.bincount(owner, area)
    expected = 0.5 * np.linalg.norm(
        np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1
    )
    assert whole == pytest.approx(expected)


def test_levels_need_width_and_headroom() -> None:
    narrow = _corners([((0, 0, 0), (1.0, 0.05, 0.5))])
    assert support_surfaces(narrow, 0.5) == ()
    low_roof = _corners([((0, 0, 0), (1.0, 0.5, 0.5)), ((0, 0, 0.56), (1.0, 0.5, 0.6))])
    assert [level.z for level in support_surfaces(low_roof, 0.6)] == pytest.approx([0.6], abs=1e-6)
    assert support_surfaces(low_roof, None) == ()
    # What is inside a closed box carries nothing that one would see.
    shut = _corners([((0, 0, 0), (1.0, 0.5, 0.8)), ((0.02, 0.02, 0.38), (0.98, 0.48, 0.4))])
    assert [level.z for level in support_surfaces(shut, 0.8)] == pytest.approx([0.8], abs=1e-6)
    assert len(covering_boxes(low_roof)) >= 1


# -- the stage --------------------------------------------------------------------------------


def test_off_means_an_empty_catalogue(tmp_path: Path, converted: Path, library: Path) -> None:
    summary = run_assets(tmp_path, Params())
    assert (
        "assets.enabled is false" in str(summary) and load_index(tmp_path / "assets").pieces == ()
    )
    shutil.copytree(converted / "assets", tmp_path / "assets", dirs_exist_ok=True)
    on = run_assets(tmp_path, _params(library.parent))
    assert (on.made, on.kept) == (0, 8)
    off = run_assets(tmp_path, Params())
    assert off.removed == 8 and not list((tmp_path / "assets").glob("*/*"))


def test_a_second_run_keeps_what_holds(converted: Path, library: Path, tmp_path: Path) -> None:
    params = _params(library.parent)
    shutil.copytree(converted / "assets", tmp_path / "assets")
    before = digest_folder(tmp_path / "assets")
    again = run_assets(tmp_path, params)
    assert (again.made, again.kept) == (0, 8) and digest_folder(tmp_path / "assets") == before
    # What a killed run leaves, and a piece that lost a file, are mended.
    (tmp_path / "assets" / "test" / ".partial-x").mkdir()
    next((tmp_path / "assets" / "test" / "Lamp" / "meshes").iterdir()).unlink()
    mended = run_assets(tmp_path, params)
    assert (mended.made, mended.kept) == (1, 7) and digest_folder(tmp_path / "assets") == before
    changed = run_assets(tmp_path, _params(library.parent, texture_size=32))
    assert changed.made == 8


@pytest.mark.slow
def test_refused_pieces_are_listed_and_the_rest_is_made(tmp_path: Path) -> None:
    folder = tmp_path / "catalogues"
    folder.mkdir()
    rows = draw.piece(9, "Gone", "none.obj", (10, 10, 10))
    rows += draw.piece(10, "Odd", "table.obj", (10, 10, 0))
    draw.write_catalogue(folder / "odd.sh3f", rows)
    summary = run_assets(tmp_path / "data", _params(folder))
    assert summary.made == 8
    content = json.loads((tmp_path / "data" / "assets" / "catalogue.json").read_text())
    assert [entry["key"] for entry in content["refused"]] == ["odd/Gone", "odd/Odd"]
    assert all(entry["reason"] for entry in content["refused"])
    assert content["libraries"][0]["usable"] == 8 and content["libraries"][0]["pieces"] == 10
    assert {entry["licence"] for entry in content["pieces"]} == {"CC-BY-3.0-US"}
    assert {entry["creator"] for entry in content["pieces"]} == {"Jörg Test"}


def test_catalogues_that_cannot_be_had_are_the_machines_fault(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with pytest.raises(MachineError, match=r"assets\.folder") as caught:
        run_assets(tmp_path, _params(tmp_path / "nowhere"))
    assert caught.value.exit_code == 4
    (tmp_path / "empty").mkdir()
    with pytest.raises(MachineError, match=r"no \.sh3f file"):
        run_assets(tmp_path, _params(tmp_path / "empty"))
    monkeypatch.setenv("PATH", str(tmp_path))
    monkeypatch.setattr(packages, "INSTALLED", tmp_path)
    online = Params(assets=AssetParams(enabled=True))
    with pytest.raises(MachineError, match="apt-get"):
        run_assets(tmp_path / "data", online)


@pytest.mark.slow
def test_a_fetched_package_is_fetched_once(
    tmp_path: Path, library: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A false apt-get and dpkg-deb stand in for the network."""
    tools = tmp_path / "tools"
    tools.mkdir()
    scripts = {
        "apt-get": "echo called >> $COUNTER; echo deb > some-furniture_1.2-3_all.deb",
        "dpkg-deb": f'mkdir -p "$3/usr/share"; cp {library} "$3/usr/share/"',
        "dpkg-query": "exit 1",
    }
    for name, text in scripts.items():
        (tools / name).write_text(f"#!/bin/sh\n{text}\n")
        (tools / name).chmod(0o755)
    counter = tmp_path / "count"
    monkeypatch.setenv("PATH", f"{tools}:/usr/bin:/bin")
    monkeypatch.setenv("COUNTER", str(counter))
    params = Params(
        assets=AssetParams(enabled=True, debian=("some-furniture",)), farm=FarmParams(workers=1)
    )
    for _ in range(2):
        index = run_assets(tmp_path / "data", params).index
        assert index.libraries[0].package == "some-furniture 1.2-3"
    assert counter.read_text().count("called") == 1
    told = _asset(tmp_path / "data", "Chair").provenance
    assert told.package == "some-furniture 1.2-3" and len(told.sha256) == 64


def test_inspect_draws_a_sheet(converted: Path) -> None:
    found = inspect_path(converted / "assets")
    assert "8 of 8 pieces usable" in found.text and "CC-BY-3.0-US" in found.text
    sheet = found.draw()
    assert sheet.ndim == 3 and sheet.std() > 10
    one = inspect_path(converted / "assets" / "test" / "Lamp")
    assert "Jörg Test" in one.text and one.draw().shape[0] > 200


# -- homes ------------------------------------------------------------------------------------


def _home(folder: Path, seed: int, share: float, assets: Path) -> Scene:
    params = SceneParams(texture_size=64, catalogue_share=share)
    make_home(folder, folder.name, params.home(seed, "mixed"), assets)
    return load_scene(folder)


def test_without_a_share_homes_stay_as_they_are(converted: Path, tmp_path: Path) -> None:
    home = SceneParams(rooms_max=2, texture_size=64).home(11, "day")
    make_home(tmp_path / "a" / "home", "home", home)
    make_home(tmp_path / "b" / "home", "home", home, converted / "assets")
    assert digest_folder(tmp_path / "a") == digest_folder(tmp_path / "b")


def test_homes_use_and_credit_the_catalogue(converted: Path, tmp_path: Path) -> None:
    assets = converted / "assets"
    kinds = load_kind_index(assets).kinds
    assert {piece.name for piece in kinds["dining_chair"]} == {
        "Chair",
        "Turned chair",
        "Zipped chair",
    }
    seen: set[str] = set()
    for seed in range(2):
        scene = _home(tmp_path / str(seed) / "home", seed, 1.0, assets)
        if seed == 0:
            again = _home(tmp_path / "again" / "home", seed, 1.0, assets)
            assert digest_folder(scene.folder) == digest_folder(again.folder)
        for credit in scene.credits[1:]:
            assert (credit.author, credit.licence) == ("Jörg Test", "CC-BY-3.0-US")
            assert "test.sh3f 2.1" in credit.source
            seen.update(credit.part.split(", "))
        solids = Solids(scene)
        assert crossings(solids) == []
        assert [item for room in scene.rooms for item in floating(solids, room)] == []
    assert {"bookcase", "lamp"} <= seen and seen & {"chair", "turned chair", "zipped chair"}


@pytest.mark.check
@pytest.mark.timeout(3600)
@pytest.mark.parametrize("first", range(0, 1000, 50))
def test_a_thousand_homes_with_real_catalogues(first: int, tmp_path: Path) -> None:
    """None fails, nothing crosses or floats; prints the processor's seconds a home took."""
    assets = Path(os.environ.get("PBRNET_ASSETS", "data/assets"))
    if not load_index(assets).pieces:
        pytest.skip(f"no catalogues in {assets}; run pbrnet assets with assets.enabled: true")
    seconds, wrong = [], {}
    for seed in range(first, first + 50):
        started = time.process_time()
        scene = _home(tmp_path / f"home-{seed}", seed, 0.6, assets.resolve())
        seconds.append(time.process_time() - started)
        solids = Solids(scene)
        crossed = crossings(solids)
        hung = [item for room in scene.rooms for item in floating(solids, room)]
        if crossed or hung:
            wrong[seed] = (crossed, hung)
        shutil.rmtree(scene.folder)
    print(
        f"homes {first} to {first + 49}: mean {np.mean(seconds):.2f} s, {max(seconds):.2f} s most"
    )
    assert not wrong


def test_the_geometry_check_finds_what_is_wrong(tmp_path: Path) -> None:
    """Boxes of 40 cm: sunk 2 cm into each other, touching, standing on one another, hanging.

    And one of 10 cm inside.
    """

    def scene(lows: dict[str, tuple[float, float, float]]) -> Solids:
        (tmp_path / "meshes").mkdir(exist_ok=True)
        items = []
        for name, low in lows.items():
            high = tuple(value + (0.1 if name == "small" else 0.4) for value in low)
            corners = _corners([(low, high)])  # type: ignore[list-item]
            faces = np.arange(3 * len(corners)).reshape(-1, 3)
            write_ply(tmp_path / "meshes" / f"{name}.ply", Mesh(corners.reshape(-1, 3), faces))
            items.append(SceneObject(name, name, "box", (name,), low, high, False, "room"))  # type: ignore[arg-type]
        floor = ((0.0, 0.0), (5.0, 0.0), (5.0, 5.0), (0.0, 5.0))
        room = Room("room", "room", "living", floor, 0.0, 2.5, True)
        made = Scene("s", {}, (room,), tuple(items), (), (), ())
        object.__setattr__(made, "folder", tmp_path)
        return Solids(made)

    sunk = scene({"a": (1, 1, 0), "b": (1.38, 1.1, 0.05)})
    assert crossings(sunk) == [("a", "b")]
    assert floating(sunk, sunk.scene.rooms[0]) == ["b"]
    stacked = scene({"a": (1, 1, 0), "b": (1.1, 1.1, 0.4), "c": (1.4, 1.0, 0)})
    assert crossings(stacked) == [] and floating(stacked, stacked.scene.rooms[0]) == []
    assert crossings(scene({"a": (1, 1, 0), "small": (1.1, 1.2, 0.15)})) == [("a", "small")]
    hanging = scene({"a": (1, 1, 0), "b": (1.1, 1.1, 0.43), "c": (0.0, 2.0, 1.0)})
    assert floating(hanging, hanging.scene.rooms[0]) == ["b"]  # c is on the wall


def test_a_lamp_of_the_catalogue_lights_the_home(converted: Path, tmp_path: Path) -> None:
    for seed in range(12):
        scene = _home(tmp_path / str(seed), seed, 1.0, converted / "assets")
        names = {item.id: item.name for item in scene.objects}
        lit = [light for light in scene.lights if names.get(light.id) == "lamp"]
        if lit:
            # 350 to 600 lm by its size; dimmed to a fifth at least.
            assert all(70 <= (light.lumens or 0) <= 600 for light in lit)
            return
    pytest.fail("no home has the catalogue's lamp burning")


def test_the_scenes_stage_asks_for_a_catalogue_it_needs(
    converted: Path, library: Path, tmp_path: Path
) -> None:
    params = _params(library.parent, share=0.5)
    with pytest.raises(InputError, match="pbrnet assets"):
        run_scenes(tmp_path, params)
    assert run_scenes(converted, params).made == 1
    assert run_scenes(converted, params).kept == 1
    more = replace(params, scenes=replace(params.scenes, catalogue_share=0.6))
    assert run_scenes(converted, more).made == 1


def test_furnished_homes_alone_take_from_the_catalogue(
    converted: Path, library: Path, tmp_path: Path
) -> None:
    params = _params(library.parent, share=0.0)
    params = replace(params, scenes=replace(params.scenes, furnished_homes=2, furnished_share=1.0))
    with pytest.raises(InputError, match=r"furnished_homes: 2.*pbrnet assets"):
        run_scenes(tmp_path, params)
    shutil.copytree(converted / "assets", tmp_path / "assets")
    assert run_scenes(tmp_path, params).made == 3
    credited = {
        folder.name: any("CC-BY" in credit.licence for credit in load_scene(folder).credits)
        for folder in scene_folders(tmp_path / "scenes")
    }
    assert sorted(credited) == ["furnished-0000", "furnished-0001", "home-0000"]
    assert not credited["home-0000"] and any(credited.values())


def test_the_command_says_what_is_usable(converted: Path, library: Path, tmp_path: Path) -> None:
    shutil.copytree(converted / "assets", tmp_path / "data" / "assets")
    params = tmp_path / "params.yaml"
    params.write_text(
        f"assets: {{enabled: true, folder: {library.parent}}}\nfarm: {{workers: 1}}\n"
    )
    run = CliRunner().invoke(
        stages.assets, ["--params", str(params), "--data", str(tmp_path / "data")]
    )
    assert run.exit_code == 0 and "8 of 8 pieces usable" in run.output


# -- the real thing -----------------------------------------------------------------------------


@pytest.mark.slow
def test_pieces_of_the_real_package(tmp_path: Path) -> None:
    """Every twentieth piece of Debian's package, where it is installed."""
    found = sorted(INSTALLED.glob("*.sh3f")) if INSTALLED.is_dir() else []
    if not found:
        pytest.skip("Debian's sweethome3d-furniture is not installed here")
    refused: list[str] = []
    chosen: list[tuple[Path, CataloguePiece]] = []
    for path in found:
        library = read_library(path)
        assert not library.refused
        chosen += [(path, piece) for piece in library.pieces[::20]]
    for path, piece in chosen:
        try:
            asset = convert(PieceJob(path, piece, tmp_path / piece.key, NOWHERE, "", 200_000, 256))
        except UnusablePiece as reason:
            refused.append(f"{piece.key}: {reason}")
            continue
        assert asset.piece.licence.startswith("CC") and asset.checks.size_error < 0.002
    assert len(refused) <= 0.05 * len(chosen), refused
