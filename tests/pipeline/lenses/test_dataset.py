"""Rows and exports of views through lenses."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pycolmap
import pytest

from pbrnet import reader
from pbrnet.model.data.reader import Dataset
from pbrnet.pipeline.dataset.pack import pack_dataset
from pbrnet.pipeline.dataset.parquet import check_row
from pbrnet.pipeline.export.parts import ExportOptions, Job, run_export
from pbrnet.pipeline.export.registry import FORMATS
from pbrnet.pipeline.export.rows import DatasetRows
from pbrnet.pipeline.lenses.calibration import read_calibration
from pbrnet.pipeline.lenses.model import Lens, Projection
from pbrnet.pipeline.lenses.settings import LensParams, lens_of
from pbrnet.scenes.errors import InputError
from tests.fixtures.dataset import make_data, small_params
from tests.fixtures.exports import make_dataset

BARREL = (-0.1, 0.02, 0.001, -0.002, 0.003)
BRANDT = (0.03, -0.01, 0.004, -0.001)
LENSES: dict[str, tuple[Projection, tuple[float, ...]]] = {
    "distorted": ("perspective", BARREL),
    "fisheye": ("fisheye", BRANDT),
    "orthographic": ("orthographic", ()),
}


@pytest.mark.parametrize("name", LENSES)
def test_the_dataset_says_what_its_rows_are(tmp_path: Path, name: str) -> None:
    projection, distortion = LENSES[name]
    params = small_params()
    lens = LensParams(distortion=distortion)
    params = replace(params, image=replace(params.image, projection=projection, lens=lens))
    data = make_data(tmp_path, params, scenes=3, views=2)
    assert pack_dataset(data, params).total == 6
    table = pq.read_table(next((data / "dataset").glob("train-*.parquet")))
    assert set(table["projection"].to_pylist()) == {projection}
    assert table["K"].null_count == 0
    row = next(iter(reader.read(data / "dataset", columns=["K", "projection"])))
    np.testing.assert_array_equal(row["K"], lens_of(params.image).K)
    if distortion:
        assert table["distortion"][0].as_py() == list(distortion)
        shape = json.loads(table.schema.field("distortion").metadata[b"shape"])
        assert shape == [len(distortion)]
    else:
        assert "distortion" not in table.column_names
    along_ray = b"not z-depth" in table.schema.field("depth").metadata[b"description"]
    assert along_ray == (projection == "fisheye")
    with pytest.raises(InputError, match="the networks take perspective ones"):
        Dataset(data / "dataset", "train")


@pytest.mark.parametrize(
    ("row", "message"),
    [
        ({"projection": "omni"}, "projection: 'omni' is not one of"),
        ({"projection": "fisheye", "K": None}, "K: null"),
        ({"projection": "fisheye", "distortion": [1.0]}, "1 coefficients"),
        ({"projection": "fisheye", "distortion": [1e9, 0, 0, 0]}, "beyond"),
    ],
)
def test_rows_with_impossible_lenses_are_refused(row: dict, message: str) -> None:
    with pytest.raises(InputError, match=message):
        check_row(Path("a.parquet"), {"scene_id": "a", "view_id": "b", **row})


@pytest.fixture(scope="module", params=["distorted", "fisheye"])
def folder(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A dataset of the room whose pixels are those of a pinhole, under another lens."""
    folder = tmp_path_factory.mktemp(request.param) / "dataset"
    return make_dataset(folder, lens=LENSES[request.param])


def exported(name: str, folder: Path, out: Path) -> Path:
    options = ExportOptions(points=2000)
    run_export(FORMATS[name], Job(DatasetRows(folder), folder.parent / "scenes", options, out))
    return out


def test_colmap_sees_the_points_where_the_lens_does(folder: Path, tmp_path: Path) -> None:
    """By COLMAP's own projection, OPENCV_FISHEYE and FULL_OPENCV, within 0.01 pixels."""
    out = exported("colmap", folder, tmp_path / "out") / "home-a"
    model = pycolmap.Reconstruction(str(out / "sparse" / "0"))
    camera = model.cameras[1]
    fisheye = "fisheye" in str(folder)
    assert camera.model.name == ("OPENCV_FISHEYE" if fisheye else "FULL_OPENCV")
    errors = [
        np.linalg.norm(
            camera.img_from_cam(image.cam_from_world() * model.points3D[seen.point3D_id].xyz)
            - seen.xy
        )
        for image in model.images.values()
        for seen in image.points2D
    ]
    assert len(errors) > 500 and max(errors) < 0.01
    found = read_calibration(out / "opencv-1.yaml")
    row = DatasetRows(folder).rows[0]
    assert found.distortion[:4] == tuple(row.values["distortion"][:4])
    assert found.focal == (row.intrinsics[0, 0], row.intrinsics[1, 1])


def test_nerfstudio_gets_the_coefficients(folder: Path, tmp_path: Path) -> None:
    out = exported("nerfstudio", folder, tmp_path / "out") / "home-a"
    file = json.loads((out / "transforms.json").read_text())
    fisheye = "fisheye" in str(folder)
    names = ("k1", "k2", "k3", "k4") if fisheye else ("k1", "k2", "p1", "p2", "k3")
    assert file["camera_model"] == ("OPENCV_FISHEYE" if fisheye else "OPENCV")
    assert file.get("is_fisheye", False) == fisheye  # as instant-ngp tells the lens
    assert [file[name] for name in names] == list(BRANDT if fisheye else BARREL)
    found = read_calibration(out / "transforms.json")
    assert found.distortion[:4] == (BRANDT if fisheye else BARREL)[:4]


@pytest.mark.parametrize("name", ["hypersim", "tum", "renderformer"])
def test_formats_of_pinholes_refuse_lenses(folder: Path, tmp_path: Path, name: str) -> None:
    with pytest.raises(InputError, match="needs perspective views, undistorted") as caught:
        exported(name, folder, tmp_path / "out")
    assert "\n" not in str(caught.value)


def test_a_rational_lens_is_none_of_nerfstudio(tmp_path: Path) -> None:
    eight = (0.1, 0.02, 0.0, 0.0, 0.01, 0.1, 0.02, 0.01)
    dataset = make_dataset(tmp_path / "dataset", lens=("perspective", eight))
    with pytest.raises(InputError, match="rational model"):
        exported("nerfstudio", dataset, tmp_path / "out")
    assert Lens("perspective", 1, 1, (), eight).plane.denominator == eight[5:]
