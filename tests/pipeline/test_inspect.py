"""`pbrnet inspect` understands all our files, and says what is wrong with others."""

import json
import shutil
import struct
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import OpenEXR
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from PIL import Image
from safetensors.numpy import save_file

from pbrnet.pipeline.dataset.pack import pack_dataset
from pbrnet.pipeline.images import (
    NOTHING,
    contact_sheet,
    depth_picture,
    intensity_picture,
    normal_picture,
    png_bytes,
)
from pbrnet.pipeline.inspection.describe import inspect_path
from pbrnet.pipeline.inspection.renders import draw_dollhouse, quick_renders
from pbrnet.pipeline.inspection.sections import Inspection
from pbrnet.pipeline.inspection.sizes import scene_sizes, triangles_of
from pbrnet.scenes.contract import load_scene
from pbrnet.scenes.errors import InputError
from pbrnet.scenes.registry import import_scene
from tests.fixtures import sweethome as draw
from tests.fixtures.command import printed
from tests.fixtures.dataset import make_data, small_params
from tests.fixtures.paths import ROOT


@pytest.fixture(scope="module")
def data(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A data folder with a dataset and a model beside it."""
    params = small_params()
    folder = make_data(tmp_path_factory.mktemp("inspect"), params, scenes=3)
    pack_dataset(folder, params)
    weights = {
        "encoder.0.weight": np.ones((8, 3, 3, 3), np.float32),
        "encoder.0.bias": np.zeros(8, np.float32),
    }
    save_file(weights, folder / "shading.safetensors", {"network": "shading"})
    card = {"backbone": {"network": "vgg19"}, "epochs": 3}
    (folder / "shading.json").write_text(json.dumps(card))
    return folder


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "kind", "words"),
    [
        ("scenes/home-0000", "scene", ["2 rooms", "sofa", "20.0", "CC0-1.0", "total lumens"]),
        pytest.param("scenes/home-0000/scene.json", "scene", ["2 rooms"], marks=pytest.mark.check),
        ("scenes/home-0000/scene.xml", "scene", ["2 rooms"]),
        ("cameras/home-0000.json", "cameras", ["3 views", "too few objects  20", "sofa, lamp"]),
        ("color/home-0000/000.exr", "frame", ["kind color", "noise", "0.125", "float32", "63.4"]),
        ("inputs/home-0000/000.exr", "frame", ["albedo.G", "float32", "valid"]),
        ("illumination/home-0000/000.exr", "frame", ["1.2e+05", "2.25", "tint.R"]),
        ("visibility/home-0000/000.exr", "frame", ["visibility.Y", "0.125"]),
        ("dataset", "dataset", ["9 views in 3 files", "metre", "float16", "plain, lz4"]),
        ("dataset/train-00000-of-00001.parquet", "shard", ["3 views in 1 file", "24 x 32 x 3"]),
        ("shading.safetensors", "model", ["224 parameters", "backbone.network  vgg19", "8 x 3"]),
        ("shading.json", "model", ["224 parameters"]),
    ],
)
def test_it_says_what_a_file_holds_and_draws_it(
    data: Path, name: str, kind: str, words: list[str]
) -> None:
    inspection = inspect_path(data / name, renders=False)
    assert inspection.kind == kind
    for word in words:
        assert word in inspection.text
    assert json.loads(inspection.json)["kind"] == kind
    picture = inspection.draw()
    assert picture.dtype == np.uint8 and picture.shape[2] == 3
    assert len(np.unique(picture.reshape(-1, 3), axis=0)) > 8, "the drawing is empty"


def cut(path: Path) -> None:
    """Half of the file."""
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])


def noise(path: Path) -> None:
    """Random bytes."""
    path.write_bytes(np.random.default_rng(0).bytes(500))


def empty(path: Path) -> None:
    """Nothing at all."""
    path.write_bytes(b"")


def foreign_exr(path: Path) -> None:
    """An EXR of another program."""
    with OpenEXR.File({}, {"RGB": np.zeros((4, 4, 3), np.float32)}) as file:
        file.write(str(path))


def foreign_parquet(path: Path) -> None:
    """A Parquet file of another project."""
    pq.write_table(pa.table({"a": [1, 2]}), path)


def huge_header(path: Path) -> None:
    """A safetensors file that claims a header of 2^60 bytes."""
    path.write_bytes(struct.pack("<Q", 1 << 60) + b"{}")


@pytest.mark.parametrize(
    ("name", "change", "words"),
    [
        ("color/home-0000/000.exr", cut, "damaged|readable"),
        ("color/home-0000/000.exr", noise, "not a readable EXR"),
        ("color/home-0000/000.exr", empty, "not a readable EXR"),
        ("color/home-0000/000.exr", foreign_exr, "not a pbrnet frame"),
        ("dataset/train-00000-of-00001.parquet", cut, "damaged, truncated or not Parquet"),
        ("dataset/train-00000-of-00001.parquet", empty, "damaged, truncated or not Parquet"),
        (
            "dataset/train-00000-of-00001.parquet",
            foreign_parquet,
            "not a shard of pbrnet: no column preview",
        ),
        ("cameras/home-0000.json", cut, "not valid JSON"),
        ("scenes/home-0000/scene.json", cut, "not valid JSON"),
        ("shading.safetensors", cut, "not a readable safetensors"),
        ("shading.safetensors", huge_header, "not a readable safetensors"),
    ],
)
def test_damaged_and_foreign_files_are_named(
    tmp_path: Path, data: Path, name: str, change: Callable[[Path], None], words: str
) -> None:
    target = tmp_path / Path(name).name
    target.write_bytes((data / name).read_bytes())
    change(target)
    with pytest.raises(InputError, match=words) as caught:
        inspect_path(target)
    assert str(target) in str(caught.value)


def test_values_are_short_words() -> None:
    source = {
        "kind": "model",
        "placed": {"up": "z", "reasons": ["a", "b"]},
        "views": [{"a": 1}] * 3,
    }
    credit = {"title": "x" * 370, "author": "me"}
    text = Inspection("scene", "a", {"General": source, "Credits": [credit]}, np.zeros).text
    assert "placed  up: z, reasons: a, b\n" in text and "views   3 items\n" in text
    assert max(map(len, text.splitlines())) < 80 and "x…  me" in text


@pytest.mark.parametrize(
    "name", ["absent.exr", "notes.txt", "folder", "other.json", "metrics.json"]
)
def test_what_it_does_not_know_it_says(tmp_path: Path, name: str) -> None:
    (tmp_path / "notes.txt").write_text("hello")
    (tmp_path / "folder").mkdir()
    (tmp_path / "other.json").write_text("[1, 2]")
    (tmp_path / "metrics.json").write_text('{"views": 24}')
    with pytest.raises(InputError, match=r"no such file or folder|can inspect a scene folder"):
        inspect_path(tmp_path / name)


def test_the_command_prints_and_draws(
    data: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    assert "Frame 000.exr" in printed("inspect", data / "color" / "home-0000" / "000.exr")
    assert Image.open(tmp_path / "inspect-000.png").size[0] > 300
    told = printed("inspect", data / "dataset", "--json", "--text-only")
    assert json.loads(told)["kind"] == "dataset"
    assert sorted(path.name for path in tmp_path.iterdir()) == ["inspect-000.png"]


def test_pictures_show_what_is_there_and_what_is_not() -> None:
    depth = np.array([[1.0, 4.0, 0.0]])
    picture = depth_picture(depth)
    assert (picture[0, 2] == NOTHING).all()
    assert picture[0, 0].sum() > picture[0, 1].sum(), "near is brighter than far"
    facing = normal_picture(np.array([[[0, 0, -1.0], [1, 0, 0], [0, -1, 0]]]))
    assert facing[0, 0].argmax() == 2 and facing[0, 1].argmax() == 0 and facing[0, 2].argmax() == 1
    light = intensity_picture(np.array([[0.0, 1.0, 1000.0]]))
    assert (light[0, 0] == NOTHING).all() and light[0, 2].sum() > light[0, 1].sum() > 60
    assert (intensity_picture(np.zeros((2, 2))) == NOTHING).all()


def test_a_contact_sheet_keeps_every_pixel() -> None:
    random = np.random.default_rng(0)
    pictures = [random.integers(0, 255, (10, 12, 3), dtype=np.uint8) for _ in range(5)]
    sheet = contact_sheet(pictures, 3, gap=4)
    assert sheet.shape == (4 + 2 * 14, 4 + 3 * 16, 3)
    assert np.array_equal(sheet[4:14, 4:16], pictures[0])
    assert np.array_equal(sheet[18:28, 20:32], pictures[4])
    assert png_bytes(sheet) == png_bytes(sheet.copy())


@pytest.fixture(scope="module")
def flat(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A red bed and a blue cube in a closed room with a white ceiling."""
    folder = tmp_path_factory.mktemp("flat")
    xml = draw.home(
        draw.box_walls(0, 0, 420, 320)
        + draw.room(10, 10, 400, 300, floorColor="FF00FF00", ceilingColor="FFFFFFFF")
        + draw.window(x=200, y=0)
        + draw.piece(name="Bed", model="box", x=300, y=200, width=200, depth=150, height=50,
                     color="FFFF0000")
        + draw.piece(name="Cube", model="box", x=80, y=60, color="FF0000FF")
    )  # fmt: skip
    file = draw.pack(folder / "flat.sh3d", xml, {"box": draw.BOX})
    return import_scene(file, folder / "scenes" / "flat").folder


@pytest.mark.slow
def test_the_dollhouse_shows_what_stands_below_the_ceiling(flat: Path) -> None:
    picture = draw_dollhouse(load_scene(flat)).astype(int)
    red, green, blue = (picture[..., band] for band in range(3))
    for band, others in ((red, (green, blue)), (green, (red, blue)), (blue, (red, green))):
        share = np.mean((band > 60) & (band > 2 * others[0]) & (band > 2 * others[1]))
        assert share > 0.01, "bed, cube and floor must be seen through the ceiling"
    assert (picture[0, 0] > 230).all()  # paper around it
    # The bed stands in the east, the eye in the south-east: it is right of the cube.
    columns = np.arange(picture.shape[1])[None, :]
    bed = (red > 60) & (red > 2 * green) & (red > 2 * blue)
    cube = (blue > 60) & (blue > 2 * green) & (blue > 2 * red)
    assert (bed * columns).sum() / bed.sum() > (cube * columns).sum() / cube.sum()


def test_quick_renders_come_without_sampled_views(flat: Path) -> None:
    scene = load_scene(flat)
    pictures = quick_renders(scene, [], count=1)
    assert len(pictures) <= 1
    for _, picture in pictures:
        assert picture.shape == (240, 320, 3) and picture.std() > 1


def test_sizes_are_counted(flat: Path) -> None:
    rows = {row["what"]: row for row in scene_sizes(load_scene(flat))}
    assert rows["bed"]["triangles"] == 12 and rows["bed"]["shapes"] == 1
    assert rows["textures"]["pixels"] == 0
    total = sum(triangles_of(path) for path in (flat / "meshes").glob("*.ply"))
    assert rows["all"]["triangles"] == total
    Image.new("RGB", (40, 30)).save(flat / "textures" / "extra.png")
    textures = {row["what"]: row for row in scene_sizes(load_scene(flat))}["textures"]
    assert textures["pixels"] == 1200
    assert textures["MB in memory"] == pytest.approx(1200 * 3 * 4 / 1e6, abs=0.005)
    (flat / "textures" / "extra.png").unlink()


@pytest.mark.slow
def test_a_picture_of_a_scene_holds_plan_dollhouse_and_renders(flat: Path, tmp_path: Path) -> None:
    whole, plan = tmp_path / "whole.png", tmp_path / "plan.png"
    told = printed("inspect", flat, "--out", plan, "--plan-only")
    assert "triangles" in told and "MB in memory" in told
    printed("inspect", flat, "--out", whole)
    with Image.open(whole) as picture, Image.open(plan) as smaller:
        assert picture.height > min(smaller.height, 400) + 300


@pytest.mark.slow
@pytest.mark.skipif(shutil.which("taskset") is None, reason="needs taskset")
def test_the_dollhouse_works_on_one_cpu(flat: Path, tmp_path: Path) -> None:
    code = (
        "from pathlib import Path; from pipeline.inspection.renders import draw_dollhouse; "
        "from scenes.contract import load_scene; "
        f"print(draw_dollhouse(load_scene(Path({str(flat)!r}))).shape)"
    )
    ran = subprocess.run(
        ["taskset", "-c", "0", sys.executable, "-c", code],
        capture_output=True, text=True, timeout=240, cwd=ROOT, check=False,
    )  # fmt: skip
    assert ran.returncode == 0, ran.stderr
    assert "640" in ran.stdout
