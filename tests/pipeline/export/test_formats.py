"""Each export is read back by a library of its format, and compared with the room's equations."""

import csv
import json
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import OpenEXR
import pycolmap
import pytest
import webdataset
from PIL import Image
from pycocotools.coco import COCO
from scipy.spatial.transform import Rotation

from pbrnet.pipeline.export.parts import ExportOptions, Job, run_export
from pbrnet.pipeline.export.registry import FORMATS
from pbrnet.pipeline.export.rows import DatasetRows
from pbrnet.scenes.files import digest_folder
from pbrnet.scenes.importing.semantics import category_number
from tests.fixtures.dataset import ROOM
from tests.fixtures.exports import (
    BOX,
    FOCAL,
    HEIGHT,
    PARTS,
    UNIT,
    WIDTH,
    color_at,
    make_dataset,
    truths,
)

TRUTHS = truths()


@pytest.fixture(scope="module")
def dataset(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The packed room."""
    return make_dataset(tmp_path_factory.mktemp("exports") / "dataset")


def exported(name: str, dataset: Path, out: Path, **options: Any) -> Path:
    job = Job(DatasetRows(dataset), dataset.parent / "scenes", ExportOptions(**options), out)
    run_export(FORMATS[name], job)
    return out


def on_a_surface(points: np.ndarray, tolerance: float) -> np.ndarray:
    """True for points (N, 3) on the room's walls or on the box in it."""
    sides = np.concatenate([points, np.array(ROOM) - points], axis=1)
    inside = (sides > -tolerance).all(axis=1)
    on_wall = np.abs(sides).min(axis=1) < tolerance
    edges = np.concatenate([points - BOX[0], BOX[1] - points], axis=1)
    on_box = (edges > -tolerance).all(axis=1) & (np.abs(edges).min(axis=1) < tolerance)
    return inside & (on_wall | on_box)


def test_nerfstudio_reprojects_pixels_by_its_documented_conventions(
    dataset: Path, tmp_path: Path
) -> None:
    scene = exported("nerfstudio", dataset, tmp_path / "out") / "home-a"
    file = json.loads((scene / "transforms.json").read_text())
    assert (file["w"], file["h"], file["fl_x"]) == (WIDTH, HEIGHT, FOCAL["home-a"])
    loaded = {}
    for frame in file["frames"]:
        raw = np.asarray(Image.open(scene / frame["depth_file_path"])).astype(np.float64)
        assert raw.max() > 256  # 16 bits
        picture = np.asarray(Image.open(scene / frame["file_path"])).astype(np.float64)
        loaded[Path(frame["file_path"]).stem] = (
            np.array(frame["transform_matrix"]),
            raw * file["depth_unit_scale_factor"],
            picture,
        )
    assert set(loaded) == {view for scene_id, view in TRUTHS if scene_id == "home-a"}
    columns, rows = np.meshgrid(np.arange(WIDTH) + 0.5, np.arange(HEIGHT) + 0.5)
    x, y = (columns - file["cx"]) / file["fl_x"], (rows - file["cy"]) / file["fl_y"]
    places = {}
    for view, (matrix, depth, _) in loaded.items():
        local = np.stack([x, -y, -np.ones_like(x), 1 / depth], axis=-1) * depth[..., None]
        places[view] = (local @ matrix.T)[..., :3]
        assert np.abs(places[view] - TRUTHS["home-a", view].points).max() < 2e-3
    # A pixel of one view is found in another, where it shows the same colour.
    first, second = "room-0-s0", "walk-0-0002"
    matrix, depth, picture = loaded[second]
    local = np.concatenate([places[first], np.ones((HEIGHT, WIDTH, 1))], -1)
    local = local @ np.linalg.inv(matrix).T
    u = file["fl_x"] * local[..., 0] / -local[..., 2] + file["cx"]
    v = -file["fl_y"] * local[..., 1] / -local[..., 2] + file["cy"]
    inside = (u > 0) & (u < WIDTH) & (v > 0) & (v < HEIGHT) & (local[..., 2] < 0)
    cells = v[inside].astype(int), u[inside].astype(int)
    agree = np.abs(depth[cells] + local[inside][:, 2]) < 0.06
    assert agree.mean() > 0.8
    other = loaded[first][2][inside][agree]
    assert np.abs(picture[cells][agree] - other).mean() < 4  # of 255; half a pixel apart
    header, _, body = (scene / "points.ply").read_bytes().partition(b"end_header\n")
    count = int(header.split(b"element vertex ")[1].split()[0])
    cloud = np.frombuffer(body, np.dtype([("p", "<f4", 3), ("c", "u1", 3)]))
    assert len(cloud) == count > 1000
    assert on_a_surface(cloud["p"].astype(np.float64), 0.01).all()


def test_linear_images_keep_their_radiance(dataset: Path, tmp_path: Path) -> None:
    out = exported("nerfstudio", dataset, tmp_path / "out", images="exr")
    with OpenEXR.File(str(out / "home-b" / "images" / "room-0-s0.exr")) as file:
        found = file.channels()["RGB"].pixels
    expected = color_at(TRUTHS["home-b", "room-0-s0"].points)
    np.testing.assert_allclose(found, expected, rtol=1e-3)


def test_colmap_model_projects_onto_itself(dataset: Path, tmp_path: Path) -> None:
    out = exported("colmap", dataset, tmp_path / "out", points=4000)
    model = pycolmap.Reconstruction(str(out / "home-a" / "sparse" / "0"))
    assert len(model.images) == 5 and len(model.cameras) == 1
    assert 1000 < len(model.points3D) <= 4000
    positions = np.array([point.xyz for point in model.points3D.values()])
    assert on_a_surface(positions, 0.01).all()
    tracks = [point.track.length() for point in model.points3D.values()]
    assert np.mean(tracks) > 2
    errors = []
    for image in model.images.values():
        true = TRUTHS["home-a", Path(image.name).stem]
        assert (out / "home-a" / "images" / image.name).is_file()
        np.testing.assert_allclose(image.projection_center(), true.pose[:3, 3], atol=1e-6)
        camera = model.cameras[image.camera_id]
        np.testing.assert_allclose(camera.calibration_matrix(), true.intrinsics)
        for seen in image.points2D:
            place = image.cam_from_world() * model.points3D[seen.point3D_id].xyz
            errors.append(np.linalg.norm(camera.img_from_cam(place) - seen.xy))
            cell = tuple(int(value) for value in seen.xy[::-1])
            assert abs(place[2] - true.images["depth"][cell]) < 0.02 * place[2]
    assert len(errors) == sum(tracks) and max(errors) < 0.02  # pixels; depth is kept in halves


@pytest.mark.parametrize("classes", ["category", "nyu40"])
def test_coco_instances_are_the_things(dataset: Path, tmp_path: Path, classes: str) -> None:
    out = exported("coco", dataset, tmp_path / "out", classes=classes)
    coco = COCO(str(out / "annotations" / "instances_train.json"))
    assert len(coco.getImgIds()) == 5
    for image in coco.loadImgs(coco.getImgIds()):
        true = TRUTHS[image["scene_id"], image["view_id"]].images["instance"]
        with Image.open(out / "images" / "train" / image["file_name"]) as picture:
            assert picture.size == (image["width"], image["height"]) == (WIDTH, HEIGHT)
        (found,) = coco.loadAnns(coco.getAnnIds(imgIds=image["id"]))  # walls are no things
        mask = true == 4
        np.testing.assert_array_equal(coco.annToMask(found), mask)
        assert coco.loadCats(found["category_id"])[0]["name"] == "table"
        lines, columns = np.nonzero(mask)
        box = [columns.min(), lines.min(), np.ptp(columns) + 1, np.ptp(lines) + 1]
        assert found["bbox"] == box and found["area"] == mask.sum()
    names = {category["name"] for category in coco.dataset["categories"]}
    assert "table" in names and not {"wall", "floor", "ceiling"} & names


def test_coco_panoptic_segments_cover_what_they_say(dataset: Path, tmp_path: Path) -> None:
    """By the rules of the format: ids R + 256 G + 65536 B, a segment for each that occurs."""
    out = exported("coco-panoptic", dataset, tmp_path / "out")
    file = json.loads((out / "annotations" / "panoptic_train.json").read_text())
    categories = {category["id"]: category for category in file["categories"]}
    images = {image["id"]: image for image in file["images"]}
    assert len(file["annotations"]) == 5
    for annotation in file["annotations"]:
        image = images[annotation["image_id"]]
        true = TRUTHS[image["scene_id"], image["view_id"]].images["category"]
        path = out / "annotations" / "panoptic_train" / annotation["file_name"]
        pixels = np.asarray(Image.open(path)).astype(int)
        ids = pixels @ [1, 256, 65536]
        segments = {segment["id"]: segment for segment in annotation["segments_info"]}
        assert set(segments) == set(np.unique(ids)) - {0}
        for number, segment in segments.items():
            mask = ids == number
            assert mask.sum() == segment["area"]
            assert (true[mask] == segment["category_id"]).all()
            assert (true == segment["category_id"]).sum() == segment["area"]
            lines, columns = np.nonzero(mask)
            sides = [np.ptp(columns) + 1, np.ptp(lines) + 1]
            assert segment["bbox"] == [columns.min(), lines.min(), *sides]
        found = {categories[segment["category_id"]]["name"] for segment in segments.values()}
        assert {"wall", "table"} <= found <= set(PARTS)
    thing = {category["name"]: category["isthing"] for category in file["categories"]}
    assert (thing["table"], thing["wall"]) == (1, 0)


def test_webdataset_holds_every_image(dataset: Path, tmp_path: Path) -> None:
    out = exported("webdataset", dataset, tmp_path / "out", tar_views=2)
    tars = sorted(path.name for path in out.glob("*.tar"))
    assert tars == ["test-000000.tar", *(f"train-00000{number}.tar" for number in range(3))]
    samples = list(
        webdataset.WebDataset(
            [str(out / tar) for tar in tars if "train" in tar], shardshuffle=False
        )
    )
    assert len(samples) == 5
    for sample in samples:
        facts = json.loads(sample["json"])
        true = TRUTHS[facts["scene_id"], facts["view_id"]]
        assert sample["__key__"] == f"{true.scene}--{true.view}"
        np.testing.assert_allclose(facts["camera_to_world"], true.pose)
        np.testing.assert_allclose(facts["K"], true.intrinsics)
        pixels = {}
        for name in ("color.exr", "depth.exr", "instance.exr", "normal.exr"):
            file = tmp_path / "image.exr"
            file.write_bytes(sample[name])
            with OpenEXR.File(str(file), separate_channels=True) as image:
                pixels[name] = {key: one.pixels for key, one in image.channels().items()}
        np.testing.assert_array_equal(pixels["depth.exr"]["Z"], true.images["depth"])
        np.testing.assert_array_equal(pixels["instance.exr"]["Y"], true.images["instance"])
        np.testing.assert_array_equal(pixels["normal.exr"]["Y"], true.images["normal"][..., 1])
        green = true.images["color"][..., 1].astype(np.float32) * UNIT
        np.testing.assert_array_equal(pixels["color.exr"]["G"], green)


def hdf5(path: Path) -> np.ndarray:
    with h5py.File(path, "r") as file:
        return np.asarray(file["dataset"])


def test_hypersim_is_read_by_its_documented_conventions(dataset: Path, tmp_path: Path) -> None:
    out = exported("hypersim", dataset, tmp_path / "out")
    with (out / "metadata_camera_parameters.csv").open() as stream:
        cameras = {line["scene_name"]: line for line in csv.DictReader(stream)}
    with (out / "metadata_images_split_scene_v1.csv").open() as stream:
        splits = {
            line["scene_name"]: line["split_partition_name"] for line in csv.DictReader(stream)
        }
    assert splits == {"ai_900_001": "train", "ai_900_002": "test"}
    with (out / "scenes.csv").open() as stream:
        frames = list(csv.DictReader(stream))
    assert [frame["camera_name"] for frame in frames] == ["cam_00"] * 2 + ["cam_01"] * 3 + [
        "cam_00"
    ]
    for frame in frames:
        true = TRUTHS[frame["scene_id"], frame["view_id"]]
        scene, name = out / frame["scene_name"], frame["camera_name"]
        detail, number = scene / "_detail" / name, int(frame["frame_id"])
        geometry = scene / "images" / f"scene_{name}_geometry_hdf5" / f"frame.{number:04d}"
        final = scene / "images" / f"scene_{name}_final_hdf5" / f"frame.{number:04d}"
        # Rays, as the documentation casts them.
        line = cameras[frame["scene_name"]]
        to_ray = [[float(line[f"M_cam_from_uv_{i}{j}"]) for j in range(3)] for i in range(3)]
        u = np.linspace(-1 + 1 / WIDTH, 1 - 1 / WIDTH, WIDTH)
        v = np.linspace(-1 + 1 / HEIGHT, 1 - 1 / HEIGHT, HEIGHT)[::-1]
        uv = np.stack([*np.meshgrid(u, v), np.ones((HEIGHT, WIDTH))], -1)
        turn = hdf5(detail / "camera_keyframe_orientations.hdf5")[number]
        eye = hdf5(detail / "camera_keyframe_positions.hdf5")[number]
        rays = uv @ np.array(to_ray).T @ turn.T
        rays /= np.linalg.norm(rays, axis=-1, keepdims=True)
        away = hdf5(Path(f"{geometry}.depth_meters.hdf5"))
        assert away.dtype == np.float16
        np.testing.assert_allclose(away, true.rays, rtol=1e-3)
        places = eye + rays * away[..., None].astype(np.float64)
        np.testing.assert_allclose(places, true.points, atol=5e-3)
        np.testing.assert_allclose(hdf5(Path(f"{geometry}.position.hdf5")), true.points, atol=5e-3)
        # Points, as the documentation projects them.
        project = np.array([[float(line[f"M_proj_{i}{j}"]) for j in range(4)] for i in range(4)])
        local = (true.points - eye) @ turn
        clip = np.concatenate([local, np.ones((HEIGHT, WIDTH, 1))], -1) @ project.T
        np.testing.assert_allclose(clip[..., :2] / clip[..., 3:], uv[..., :2], atol=1e-6)
        normal = hdf5(Path(f"{geometry}.normal_world.hdf5")).astype(np.float64)
        own = hdf5(Path(f"{geometry}.normal_cam.hdf5")).astype(np.float64)
        np.testing.assert_allclose(own @ turn.T, normal, atol=2e-3)
        assert ((normal * rays).sum(-1) < 0).all()  # facing the camera
        instance = hdf5(Path(f"{geometry}.semantic_instance.hdf5"))
        np.testing.assert_array_equal(instance, true.images["instance"])
        semantic = hdf5(Path(f"{geometry}.semantic.hdf5"))
        np.testing.assert_array_equal(semantic, true.images["nyu40"])
        parts = ("color", "diffuse_reflectance", "diffuse_illumination", "residual")
        images = [hdf5(Path(f"{final}.{part}.hdf5")).astype(np.float64) for part in parts]
        color, reflectance, illumination, residual = images
        np.testing.assert_allclose(reflectance * illumination + residual, color, rtol=1e-3)
        np.testing.assert_allclose(illumination, 0.9 * color / reflectance, rtol=2e-3)
        np.testing.assert_allclose(color * UNIT, color_at(true.points), rtol=1e-3)
    stem = "metadata_semantic_instance_bounding_box_object_aligned_2d"
    mesh = out / "ai_900_001" / "_detail" / "mesh"
    np.testing.assert_allclose(hdf5(mesh / f"{stem}_extents.hdf5")[4], BOX[1] - BOX[0])
    np.testing.assert_allclose(hdf5(mesh / f"{stem}_positions.hdf5")[4], BOX.mean(axis=0))


def test_tum_sequence_has_poses_of_the_optical_frame(dataset: Path, tmp_path: Path) -> None:
    out = exported("tum", dataset, tmp_path / "out", fps=10) / "home-a" / "walk-0"
    poses = np.loadtxt(out / "groundtruth.txt")
    fx, fy, cx, cy = np.loadtxt(out / "calibration.txt")
    lists = {
        name: [line.split() for line in (out / f"{name}.txt").read_text().splitlines()[1:]]
        for name in ("rgb", "depth")
    }
    np.testing.assert_allclose(poses[:, 0], [0, 0.1, 0.2])
    for index, pose in enumerate(poses):
        true = TRUTHS["home-a", f"walk-0-{index:04d}"]
        assert float(lists["depth"][index][0]) == float(lists["rgb"][index][0]) == pose[0]
        assert Image.open(out / lists["rgb"][index][1]).size == (WIDTH, HEIGHT)
        depth = np.asarray(Image.open(out / lists["depth"][index][1])) / 5000.0
        v, u = np.mgrid[:HEIGHT, :WIDTH]  # whole numbers are pixel centres
        local = np.stack([(u - cx) / fx, (v - cy) / fy, np.ones_like(depth)], -1) * depth[..., None]
        world = Rotation.from_quat(pose[4:]).apply(local.reshape(-1, 3)) + pose[1:4]
        np.testing.assert_allclose(world.reshape(HEIGHT, WIDTH, 3), true.points, atol=1e-3)


@pytest.mark.parametrize("name", [name for name in FORMATS if name != "renderformer"])
def test_equal_rows_give_equal_bytes(name: str, dataset: Path, tmp_path: Path) -> None:
    folders = [exported(name, dataset, tmp_path / part) for part in ("one", "other")]
    for folder in folders:
        (folder / ".lock").unlink()
    assert digest_folder(folders[0]) == digest_folder(folders[1])


def test_categories_have_the_dataset_s_numbers(dataset: Path, tmp_path: Path) -> None:
    out = exported("coco-panoptic", dataset, tmp_path / "out")
    file = json.loads((out / "annotations" / "panoptic_test.json").read_text())
    named = {category["name"]: category["id"] for category in file["categories"]}
    assert named["table"] == category_number("table")
    groups = {category["name"]: category["supercategory"] for category in file["categories"]}
    assert groups["armchair"] == "chair"
