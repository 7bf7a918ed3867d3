"""Own pieces: turned by their front, scaled to the table, checked, and used in homes."""

from collections import Counter
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest
import trimesh
from PIL import Image
from trimesh.visual import TextureVisuals
from trimesh.visual.material import PBRMaterial

from pbrnet.pipeline.farm.settings import FarmParams
from pbrnet.pipeline.inspection.describe import inspect_path
from pbrnet.pipeline.params import Params
from pbrnet.pipeline.stages.assets import run_assets
from pbrnet.scenes.assets.index import (
    OWN_TABLE,
    Asset,
    AssetIndex,
    IndexEntry,
    LibraryEntry,
    load_asset,
)
from pbrnet.scenes.errors import InputError
from pbrnet.scenes.formats.ply import read_ply
from pbrnet.scenes.layout.furnishing.fitting import fit_piece
from pbrnet.scenes.own_assets.table import read_table
from pbrnet.scenes.params import AssetParams, SceneParams
from pbrnet.scenes.procedural.design import catalogue_sampler, design_home
from pbrnet.scenes.procedural.furnishing.asset_rules import rules_of_own
from pbrnet.scenes.procedural.furnishing.asset_sampler import (
    AssetSampler,
    build_kind_index,
    load_kind_index,
)
from pbrnet.scenes.procedural.furniture import make_style
from pbrnet.scenes.seeds import generator

USD = find_spec("pxr") is not None
HEAD = "file,category,width,depth,height,up,front,licence,author,lumens\n"


def box(low: tuple[float, ...], high: tuple[float, ...]) -> trimesh.Trimesh:
    return trimesh.creation.box(bounds=[low, high])


def sofa() -> trimesh.Scene:
    """A seat of 2 x 0.4 x 0.8 units, and a back of red cloth at -z; y is up, +z the front."""
    seat, back = box((0, 0, 0), (2, 0.4, 0.8)), box((0, 0.4, 0), (2, 0.8, 0.2))
    image = Image.fromarray(np.full((4, 4, 3), (200, 10, 10), np.uint8))
    cloth = PBRMaterial(baseColorTexture=image, roughnessFactor=0.9, metallicFactor=0.0)
    uvs = np.random.default_rng(0).random((len(back.vertices), 2))
    back.visual = TextureVisuals(uv=uvs, material=cloth)
    seat.visual = TextureVisuals(
        material=PBRMaterial(baseColorFactor=[255, 255, 255, 255], roughnessFactor=0.4)
    )
    return trimesh.Scene([seat, back])


def shelf() -> str:
    """A box of 80 x 30 x 190 cm as a USD file, z up."""
    shape = box((0, 0, 0), (80, 30, 190))
    corners = [tuple(one) for one in shape.vertices.tolist()]
    return f"""#usda 1.0
(
    metersPerUnit = 0.01
    upAxis = "Z"
)
def Mesh "shelf"
{{
    int[] faceVertexCounts = {[3] * len(shape.faces)}
    int[] faceVertexIndices = {shape.faces.ravel().tolist()}
    point3f[] points = {corners}
    uniform token subdivisionScheme = "none"
}}
"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    place = tmp_path_factory.mktemp("mine") / "my-things"
    place.mkdir()
    sofa().export(place / "sofa.glb")
    # Centimetres, z up, its front towards +x; a splinter floats above it
    stool = box((0, 0, 0), (40, 30, 45)) + box((10, 10, 70), (12, 12, 72))
    stool.export(place / "stool.obj")
    bulb = box((0, 0, 0), (0.3, 1.6, 0.3))
    bulb.visual = TextureVisuals(material=PBRMaterial(emissiveFactor=[1.0, 1.0, 1.0]))
    trimesh.Scene([bulb]).export(place / "lamp.glb")
    table = place / "pieces.csv"
    table.write_text(
        HEAD
        + "sofa.glb,sofa,1.8,0.9,0.8,,,CC0-1.0,A. Maker,\n"
        + "stool.obj,stool,0.3,0.4,,z,x,CC-BY-4.0,B. Maker,\n"
        + "lamp.glb,lamp,0.3,0.3,1.6,,,CC0-1.0,,700\n"
        + "sofa.glb,bed,0.1,0.05,0.04,,,CC0-1.0,,\n"
        + "sofa.glb,table,0.8,1.8,0.8,,,CC0-1.0,,\n"
        + "missing.glb,table,1,1,1,,,,,\n"
        + "sofa.glb,settee,1,1,1,,,,,\n"
        + "billy.usda,shelf,0.8,0.3,1.9,,,CC0-1.0,C. Maker,\n"
    )
    (place / "billy.usda").write_text(shelf())
    return place


@pytest.fixture(scope="module")
def data(folder: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    place = tmp_path_factory.mktemp("data")
    wanted = AssetParams(enabled=True, folder=str(folder), debian=())
    summary = run_assets(place, Params(assets=wanted, farm=FarmParams(workers=1)))
    reasons = {one.key.partition("/")[2]: one.reason for one in summary.index.refused}
    assert summary.made == 3 + USD, reasons
    assert "unit of the table" in reasons["sofa-row4"]
    assert "is the front another axis" in reasons["sofa-row5"]
    assert "no file in the table's folder" in reasons["missing"]
    assert "is 'sofa' meant?" in reasons["sofa-row7"]
    return place


def asset(data: Path, name: str) -> tuple[Asset, np.ndarray]:
    """A converted piece, and its corners (F, 3, 3) part by part, joined."""
    place = data / "assets/my-things" / name
    found = load_asset(place)
    return found, np.concatenate([read_ply(place / part.mesh).corners for part in found.parts])


def test_a_piece_has_the_tables_size_and_its_back_behind(data: Path) -> None:
    found, corners = asset(data, "sofa")
    low, high = corners.min(axis=(0, 1)), corners.max(axis=(0, 1))
    assert low == pytest.approx([-0.9, -0.45, 0], abs=1e-6)
    assert high == pytest.approx([0.9, 0.45, 0.8], abs=1e-6)
    assert found.piece.size == (1.8, 0.9, 0.8)
    tall = corners[corners[:, :, 2].max(axis=1) > 0.5]
    assert tall[:, :, 1].min() > 0  # the back, at -z of the file, is at +y
    assert {part.texture is None for part in found.parts} == {True, False}
    assert any("stretched by 1.25" in note for note in found.checks.notes)


def test_height_follows_the_plan_and_the_front_is_turned(data: Path) -> None:
    found, corners = asset(data, "stool")
    size = corners.max(axis=(0, 1)) - corners.min(axis=(0, 1))
    assert size[:2] == pytest.approx([0.3, 0.4], abs=1e-5)
    assert (size[2], found.piece.size[2]) == pytest.approx((0.72, 0.72), abs=1e-4)
    assert any("parts float" in note for note in found.checks.notes)


def test_a_lamp_shines_with_the_tables_flux(data: Path) -> None:
    found, _ = asset(data, "lamp")
    assert found.lumens == pytest.approx(700, rel=0.01)


def test_homes_may_take_own_pieces_for_their_kinds(data: Path) -> None:
    kinds = load_kind_index(data / "assets").kinds
    assert [piece.creator for piece in kinds["sofa"]] == ["A. Maker"]
    assert [piece.licence for piece in kinds["stool"]] == ["CC-BY-4.0"]
    assert len(kinds["floor_lamp"]) == 1


def test_inspect_shows_own_pieces(data: Path) -> None:
    told = inspect_path(data / "assets")
    assert f"{3 + USD} of 8 pieces usable, from 1 catalogue" in told.title
    assert "stretched by 1.25" in told.text and "parts float" in told.text
    assert told.draw is not None
    assert np.asarray(told.draw()).std() > 5


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("file,category,width\na.glb,sofa,1\n", "no column 'depth'"),
        ("file,category,width,depth,colour\na.glb,sofa,1,1,red\n", "unknown column 'colour'"),
        ("file,category,width,depth\na.glb,sofa,1\n", "row 1 has too many or too few cells"),
        ("", "no column 'file'"),
    ],
)
def test_tables_of_other_columns_are_refused(tmp_path: Path, text: str, told: str) -> None:
    table = tmp_path / "pieces.csv"
    table.write_text(text)
    with pytest.raises(InputError, match=told):
        read_table(table)


@pytest.mark.parametrize(
    ("row", "told"),
    [
        ("../a.glb,sofa,2,1,1,,,,,", "no file in the table's folder"),
        ("a.exe,sofa,2,1,1,,,,,", "is none of"),
        ("a.glb,sofa,nan,1,1,,,,,", "not a positive number"),
        ("a.glb,sofa,1e400,1,1,,,,,", "not a positive number"),
        ("a.glb,sofa,two,1,1,,,,,", "not a number"),
        ("a.glb,sofa,2000,1,1,,,,,", "not from 0.005 to 20 m"),
        ("a.glb,sofa,2,1,1,,w,,,", "is not one of x, -x"),
    ],
)
def test_rows_that_make_no_sense_are_listed(tmp_path: Path, row: str, told: str) -> None:
    (tmp_path / "a.glb").write_bytes(b"")
    table = tmp_path / "pieces.csv"
    table.write_text(HEAD + row + "\n")
    library = read_table(table)
    assert not library.pieces
    assert told in library.refused[0][2]


def own(name: str, category: str, size: tuple[float, float, float]) -> IndexEntry:
    """An own piece of the index."""
    words = f"{name} {category}"
    return IndexEntry(f"mine/{name}", name, category, "Own", words, size, 0.0, 12, 0.0, False,
                      True, 0, "", "", "")  # fmt: skip


@pytest.mark.parametrize(
    ("piece", "kinds"),
    [
        (own("billy", "shelf", (0.8, 0.3, 1.9)), {"bookshelf"}),
        (own("park store", "cabinet", (1.4, 0.45, 0.75)), {"chest_of_drawers", "sideboard"}),
        (own("low", "table", (1.1, 0.6, 0.42)), {"coffee_table"}),
        (own("oak table", "table", (1.6, 0.9, 0.75)), {"dining_table"}),
        (own("office chair", "chair", (0.6, 0.6, 1.0)), {"office_chair"}),
        (own("sven", "chair", (0.5, 0.5, 0.9)), {"dining_chair"}),
        (own("grand", "piano", (1.5, 2.0, 1.0)), set()),
        (own("huge", "sofa", (4.0, 1.0, 0.8)), set()),
    ],
)
def test_the_stated_category_and_the_size_tell_the_kinds(piece: IndexEntry, kinds: set) -> None:
    assert {rule.kind for rule in rules_of_own(piece)} == kinds


def test_procedural_homes_take_own_pieces(data: Path) -> None:
    wanted = SceneParams(catalogue_share=1.0, rooms_min=2, rooms_max=5)
    furniture = design_home(wanted.home(3, "day"), data / "assets").furniture
    taken = Counter(one.placed.piece.credit.author for one in furniture if one.placed.piece.credit)
    assert taken["A. Maker"] >= 1
    assert taken["C. Maker"] >= USD


def sampler(data: Path) -> AssetSampler:
    made = catalogue_sampler(SceneParams(catalogue_share=1.0).home(0, "day"), data / "assets")
    assert made is not None
    return made


@pytest.mark.parametrize(
    ("category", "size", "author"),
    [
        ("sofa", (2.1, 0.9, 0.85), "A. Maker"),
        ("sofa", (3.4, 0.9, 0.85), None),
        pytest.param("bookshelf", (0.9, 0.3, 2.0), "C. Maker",
                     marks=pytest.mark.skipif(not USD, reason="needs OpenUSD")),
    ],
)  # fmt: skip
def test_boxes_of_layouts_take_own_pieces_that_fill_them(
    data: Path, category: str, size: tuple[float, float, float], author: str | None
) -> None:
    style = make_style(generator(1, "style"), "minimal")
    fit = fit_piece(generator(0), style, category, size, sampler=sampler(data))
    assert fit is not None
    assert (fit.piece.credit.author if fit.piece.credit else None) == author


def test_a_category_without_kinds_takes_its_own_pieces() -> None:
    pieces = own("upright", "piano", (0.8, 0.5, 1.1)), own("glass", "mirror", (0.6, 0.04, 1.0))
    library = LibraryEntry("mine", OWN_TABLE, "", "", "", "", "", "", 2, 2)
    index = build_kind_index(AssetIndex((library,), pieces))
    drawn = AssetSampler(generator(0), index, SceneParams(catalogue_share=1.0).home(0, "day"))
    assert drawn.own_pieces("piano", ()) == [(pieces[0], "piano")]
    assert drawn.own_pieces("mirror", ("wall_mirror",)) == [(pieces[1], "mirror")]
    assert drawn.own_pieces("lamp", ("floor_lamp",)) == []
