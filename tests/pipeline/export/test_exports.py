"""Exports as a whole: refusals, resume, the command."""

import json
import shutil
import sys
import tarfile
from dataclasses import replace
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from click.testing import CliRunner

from pbrnet.pipeline.cli import cli
from pbrnet.pipeline.export import images, nerfstudio, webdataset
from pbrnet.pipeline.export.parts import CREDITS, RECORD, ExportOptions, Job, run_export
from pbrnet.pipeline.export.registry import FORMATS
from pbrnet.pipeline.export.rows import DatasetRows
from pbrnet.scenes.errors import InputError, MachineError, ParameterError
from pbrnet.scenes.files import digest_folder
from tests.fixtures.command import printed, refused
from tests.fixtures.dataset import make_data, small_params
from tests.fixtures.exports import make_dataset


@pytest.fixture(scope="module")
def dataset(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The packed room."""
    return make_dataset(tmp_path_factory.mktemp("exports") / "data" / "dataset")


@pytest.fixture(scope="module")
def bare(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A dataset of the paper's channels alone, packed by the stage."""
    from pbrnet.pipeline.dataset.pack import pack_dataset

    data = make_data(tmp_path_factory.mktemp("bare"), small_params(), scenes=3, views=1)
    pack_dataset(data, small_params())
    return data / "dataset"


def job(dataset: Path, out: Path, **options: Any) -> Job:
    return Job(DatasetRows(dataset), dataset.parent / "scenes", ExportOptions(**options), out)


@pytest.mark.parametrize(
    ("name", "remedy"),
    [
        ("coco", "add 'labels' to channels"),
        ("coco-panoptic", "add 'labels' to channels"),
        ("hypersim", "add 'light' to channels"),
        ("tum", "set cameras.walks"),
    ],
)
def test_a_format_that_needs_more_names_what_to_add(
    name: str, remedy: str, bare: Path, tmp_path: Path
) -> None:
    with pytest.raises(InputError, match=remedy) as caught:
        run_export(FORMATS[name], job(bare, tmp_path / "out"))
    assert "\n" not in str(caught.value)
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("name", ["nerfstudio", "colmap", "webdataset"])
def test_the_paper_s_channels_are_enough(name: str, bare: Path, tmp_path: Path) -> None:
    assert run_export(FORMATS[name], job(bare, tmp_path / "out")).views == 3


PANORAMIC = ("coco", "coco-panoptic", "webdataset")


@pytest.fixture(scope="module")
def panoramas(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The packed room as equirectangular views, without K."""
    folder = tmp_path_factory.mktemp("panoramas") / "data" / "dataset"
    return make_dataset(folder, lens=("equirectangular", ()))


@pytest.mark.parametrize("name", [name for name in FORMATS if name not in PANORAMIC])
def test_a_format_for_perspective_views_refuses_panoramas(
    name: str, panoramas: Path, tmp_path: Path
) -> None:
    with pytest.raises(InputError, match=r"needs perspective views.*image\.projection") as caught:
        run_export(FORMATS[name], job(panoramas, tmp_path / "out"))
    assert "\n" not in str(caught.value) and not (tmp_path / "out").exists()


@pytest.mark.parametrize("name", PANORAMIC)
def test_panoramas_are_exported_pixel_by_pixel(
    name: str, dataset: Path, panoramas: Path, tmp_path: Path
) -> None:
    """The same files as of perspective views, but for what is said of the camera."""
    for folder in (dataset, panoramas):
        out = tmp_path / folder.parent.parent.name
        run_export(FORMATS[name], job(folder, out))
    flat, round_ = (files_of(tmp_path / one.parent.parent.name) for one in (dataset, panoramas))
    assert flat.keys() == round_.keys() and len(flat) >= 8
    other = {file for file in flat if flat[file] != round_[file]}
    assert other == {file for file in flat if name == "webdataset" and file.endswith(".json")}
    for file in other:
        facts = json.loads(round_[file])
        assert facts["projection"] == "equirectangular" and facts["K"] is None
        assert facts.keys() - json.loads(flat[file]).keys() == {"projection"}


def files_of(folder: Path) -> dict[str, bytes]:
    """Contents by name, those within tars too, without what names the export itself."""
    found: dict[str, bytes] = {}
    for path in sorted(folder.rglob("*")):
        if path.suffix == ".tar":
            with tarfile.open(path) as tar:
                found |= {one.name: tar.extractfile(one).read() for one in tar}  # type: ignore[union-attr]
        elif path.is_file() and path.name not in (RECORD, ".lock"):
            found[str(path.relative_to(folder))] = path.read_bytes()
    return found


@pytest.mark.parametrize("name", FORMATS)
def test_a_row_without_intrinsics_is_refused_in_one_line(
    name: str, dataset: Path, tmp_path: Path
) -> None:
    folder = tmp_path / "data" / "dataset"
    shutil.copytree(dataset, folder)
    path = folder / "test-00000-of-00001.parquet"
    table = pq.read_table(path)
    empty = pa.nulls(len(table), table.schema.field("K").type)
    field = table.schema.field("K").with_nullable(True)
    pq.write_table(table.set_column(table.schema.get_field_index("K"), field, empty), path)
    with pytest.raises(InputError, match="a row without 'K'") as caught:
        run_export(FORMATS[name], job(folder, tmp_path / "out"))
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(("name", "missing"), [("coco", "pycocotools"), ("hypersim", "h5py")])
def test_a_missing_library_is_said_before_anything_is_written(
    name: str, missing: str, dataset: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for module in (missing, f"{missing}.mask"):
        monkeypatch.setitem(sys.modules, module, None)
    with pytest.raises(MachineError, match=r"pbrnet\[export\]"):
        run_export(FORMATS[name], job(dataset, tmp_path / "out"))
    assert not (tmp_path / "out").exists()


def test_hypersim_without_labels_and_light_on_request(bare: Path, tmp_path: Path) -> None:
    run_export(FORMATS["hypersim"], job(bare, tmp_path / "out", partial=True))
    names = {path.name for path in (tmp_path / "out" / "ai_900_001").rglob("*.hdf5")}
    assert "frame.0000.depth_meters.hdf5" in names
    assert not any("semantic" in name or "illumination" in name for name in names)


def test_an_interrupted_export_resumes(
    dataset: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    out, whole = tmp_path / "out", tmp_path / "whole"
    written = 0

    def fail(*arguments: Any) -> None:
        nonlocal written
        written += 1
        if written == 6:
            raise KeyboardInterrupt
        images.write_depth(*arguments)

    with monkeypatch.context() as patch:
        patch.setattr(nerfstudio, "write_depth", fail)
        with pytest.raises(KeyboardInterrupt):
            run_export(FORMATS["nerfstudio"], job(dataset, out))
    before = (out / "home-a" / "transforms.json").stat().st_mtime_ns
    assert not (out / "home-b").exists()
    done = run_export(FORMATS["nerfstudio"], job(dataset, out))
    assert (done.parts, done.kept) == (2, 1)
    assert (out / "home-a" / "transforms.json").stat().st_mtime_ns == before
    run_export(FORMATS["nerfstudio"], job(dataset, whole))
    assert digest_folder(out) != ""
    for folder in (out, whole):
        (folder / ".lock").unlink()
    assert digest_folder(out) == digest_folder(whole)
    # With other options nothing of the first is left.
    done = run_export(FORMATS["nerfstudio"], job(dataset, out, images="exr"))
    assert done.kept == 0 and not list(out.rglob("images/*.png"))


def test_a_folder_with_other_files_is_refused(dataset: Path, tmp_path: Path) -> None:
    (tmp_path / "thesis.tex").write_text("precious")
    with pytest.raises(InputError, match="contains other files"):
        run_export(FORMATS["colmap"], job(dataset, tmp_path))
    assert (tmp_path / "thesis.tex").read_text() == "precious"


def test_another_export_never_removes_files_that_no_export_wrote(
    dataset: Path, tmp_path: Path
) -> None:
    run_export(FORMATS["nerfstudio"], job(dataset, tmp_path))
    (tmp_path / "outputs").mkdir()
    before = digest_folder(tmp_path)
    with pytest.raises(InputError, match=r"outputs is not listed in export\.json"):
        run_export(FORMATS["nerfstudio"], job(dataset, tmp_path, points=10))
    assert digest_folder(tmp_path) == before
    assert run_export(FORMATS["nerfstudio"], job(dataset, tmp_path)).kept == 2
    (tmp_path / "outputs").rmdir()
    assert run_export(FORMATS["hypersim"], job(dataset, tmp_path)).kept == 0
    assert run_export(FORMATS["colmap"], job(dataset, tmp_path)).kept == 0
    assert not list(tmp_path.glob("metadata*"))


@pytest.mark.parametrize("name", FORMATS)
def test_every_export_has_the_credits_of_its_scenes(
    name: str, dataset: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    form = FORMATS[name]
    form = replace(form, parts=lambda job: [], finish=lambda job: None, check=lambda job: None)
    run_export(form, job(dataset, tmp_path))
    rows = (tmp_path / CREDITS).read_text().splitlines()
    assert rows[0] == "scene_id,licence,attribution"
    assert [row.split(",")[0] for row in rows[1:]] == ["home-a", "home-b"]


def test_a_dataset_without_color_has_no_exposure(dataset: Path, tmp_path: Path) -> None:
    folder = tmp_path / "data" / "dataset"
    shutil.copytree(dataset, folder)
    for path in folder.glob("*.parquet"):
        names = ["color", "exposure_color", "white_color"]
        pq.write_table(pq.read_table(path).drop_columns(names), path)
    row = DatasetRows(folder).rows[0]
    with pytest.raises(InputError, match="no color, so no exposure"):
        print(row.exposure)
    run_export(FORMATS["webdataset"], job(folder, tmp_path / "out"))
    facts = next(json.loads(text) for name, text in files_of(tmp_path / "out").items()
                 if name.endswith(".json"))  # fmt: skip
    assert "depth" not in facts and "exposure_color" not in facts
    with pytest.raises(InputError, match="needs 'color'"):
        run_export(FORMATS["colmap"], job(folder, tmp_path / "colmap"))


def test_tars_hold_names_of_more_than_100_bytes(tmp_path: Path) -> None:
    with tarfile.open(tmp_path / "long.tar", "w", format=webdataset.TAR) as tar:
        webdataset._add(tar, f"{'a' * 110}.environment.exr", b"pixels")
        webdataset._add(tar, "short.json", "{}")
    with tarfile.open(tmp_path / "long.tar") as tar:
        assert tar.getnames() == [f"{'a' * 110}.environment.exr", "short.json"]


def test_the_command_exports_a_selection(dataset: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    data = ("--data", dataset.parent)
    said = printed("export-data", "--to", "colmap", "--split", "test", *data, "--out", out)
    assert "1 view as colmap" in said
    assert [path.name for path in out.iterdir() if path.is_dir()] == ["home-b"]
    error = refused("export-data", "--to", "colmap", "--scene", "home-z", *data, "--out", out)
    assert "home-a, home-b" in error
    for name, last in {"tum": "3 views as tum", "coco": "6 views as coco"}.items():
        said = printed("export-data", "--to", name, *data, "--out", tmp_path / name)
        assert said.splitlines()[-1].startswith(last), said
        assert ("3 left out" in said) == (name == "tum")
    words = ["export-data", "--to", "colmap", "--images", "exr", *map(str, data)]
    done = CliRunner().invoke(cli, words)
    assert isinstance(done.exception, ParameterError)
    assert str(done.exception) == "--images: not for colmap"
    usage = printed("export-data", "--help")
    assert all(f"--to {name} " in usage for name in FORMATS)
