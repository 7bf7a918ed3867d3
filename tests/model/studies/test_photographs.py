"""Study of photographs: every layout tells the same, measures are exact, trainings are kept."""

import json
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from PIL import Image

from pbrnet.model.report.page import Places, write_report
from pbrnet.model.studies.photographs import study, training
from pbrnet.model.studies.photographs.measures import (
    Prediction,
    affine,
    angle,
    confusion,
    measured,
    scaled,
)
from pbrnet.model.studies.photographs.network import new_network, thirteen
from pbrnet.model.studies.photographs.results import (
    PhotographsResult,
    RowResult,
    figures,
)
from pbrnet.model.studies.photographs.rows import parse_row, read_rows
from pbrnet.model.studies.photographs.samples import (
    CROP,
    FOCAL,
    Pool,
    Sample,
    mirrored,
    plane_normals,
    resampled,
)
from pbrnet.model.studies.photographs.sets.contract import (
    THIRTEEN,
    Intrinsics,
    Key,
    Photograph,
    rays_of,
)
from pbrnet.model.studies.photographs.sets.layouts import open_set
from pbrnet.model.studies.photographs.study import chosen
from pbrnet.model.studies.photographs.summary import Scores, resampled_runs
from pbrnet.model.studies.photographs.training import predict, rate
from pbrnet.model.studies.trials.results import MetricEstimate
from pbrnet.pipeline.params import Params
from pbrnet.scenes.checked import build
from pbrnet.scenes.errors import InputError, ParameterError
from pbrnet.scenes.seeds import generator
from tests.fixtures.command import exit_code, printed, refused
from tests.fixtures.photographs import LAYOUTS, folder_set, hypersim_set, labelled_view, nyu_file

CPU = torch.device("cpu")
COMMAND = ("study", "photographs")


def plane(normal: list[float], away: float, labels: bool = True, size: int = 60) -> Photograph:
    """A plane n . p = -away, seen at a focal length of 100 pixels."""
    camera = Intrinsics(100, 100, size / 2, size / 2)
    rays = np.concatenate([rays_of(camera, size, size), np.ones((size, size, 1))], -1)
    depth = -away / (rays @ (np.array(normal) / np.linalg.norm(normal)))
    image = np.zeros((size, size, 3), np.uint8)
    label = np.ones((size, size), np.uint8) if labels else None
    return Photograph(
        key=Key("plane", "a"),
        image=image,
        depth=depth.astype(np.float32),
        intrinsics=camera,
        label40=label,
    )


def box_sample(seed: int = 3) -> Sample:
    """A box room at the common focal length."""
    view = labelled_view(seed)
    k = view["K"]
    return resampled(
        Photograph(
            key=Key("box", "a"),
            image=view["picture"],
            depth=view["depth"],
            intrinsics=Intrinsics(k[0, 0], k[1, 1], k[0, 2], k[1, 2]),
            normal=view["normal"].astype(np.float32),
            label40=view["label40"],
        )
    )


def perfect(sample: Sample) -> Prediction:
    return Prediction(sample.depth, sample.normal, sample.label40, sample.label13)


@pytest.mark.parametrize("layout", LAYOUTS)
def test_every_layout_tells_depth_normals_and_classes(tmp_path: Path, layout: str) -> None:
    found = open_set(LAYOUTS[layout](tmp_path / "set"), "test")
    (photo,) = found.read([0])
    size = {"width": 64, "height": 48} if layout == "nyu" else {}
    seed = 100 * sum(b"train-room-0") if layout == "packed" else 0
    truth = labelled_view(seed, **size)
    depth, normal, label = truth["depth"], truth["normal"].astype(float), truth["label40"]
    if layout == "nyu":  # blocks of ten pixels, without the frame
        rows, columns = (45 + np.arange(426)) // 10, (41 + np.arange(560)) // 10
        depth, label = depth[np.ix_(rows, columns)], label[np.ix_(rows, columns)]
    np.testing.assert_allclose(photo.depth, depth, rtol=1e-3)
    if photo.normal is not None:
        np.testing.assert_allclose(photo.normal, normal, atol=1e-3)
    if layout != "packed":
        assert photo.label40 is not None and (photo.label40 == label).all()
        assert photo.classes13 is not None and (photo.classes13 == THIRTEEN[label]).all()
    assert photo.display.dtype == np.uint8 and photo.display.std() > 10
    assert len({key.run for key in found.keys}) == (2 if layout in ("folder", "packed") else 1)
    assert (
        found.fingerprint()
        == open_set(tmp_path / "set" if layout != "nyu" else found.path, "test").fingerprint()
    )


def test_cameras_and_labels_are_part_of_a_set(tmp_path: Path) -> None:
    path = LAYOUTS["folder"](tmp_path / "set")
    prints = [open_set(path, "test").fingerprint()]
    camera = json.loads((path / "intrinsics.json").read_text())
    (path / "intrinsics.json").write_text(json.dumps({**camera, "fx": 2 * camera["fx"]}))
    prints.append(open_set(path, "test").fingerprint())
    shutil.rmtree(path / "label40")
    prints.append(open_set(path, "test").fingerprint())
    assert len(set(prints)) == 3


def test_packed_radiance_is_in_the_renderer_s_unit(tmp_path: Path) -> None:
    (photo,) = open_set(LAYOUTS["packed"](tmp_path), "train").read([0])
    color = labelled_view(100 * sum(b"train-room-0"))["color"]
    np.testing.assert_allclose(photo.image, color.astype(np.float32), rtol=1e-3)


def test_official_splits_and_the_published_mapping_count(tmp_path: Path) -> None:
    from scipy.io import savemat

    path = nyu_file(tmp_path, ["wall", "floor", "plaster"])
    assert [key.name for key in open_set(path, "train").keys] == ["0001"]
    (photo,) = open_set(path, "test").read([0])
    assert photo.label40 is not None and set(np.unique(photo.label40)) <= {0, 1, 2}
    savemat(tmp_path / "classMapping40.mat", {"mapClass": [[1, 2, 22]]})
    (mapped,) = open_set(path, "test").read([0])
    assert mapped.label40 is not None and (mapped.label40[photo.label40 == 0] == 22).all()


@pytest.mark.parametrize("normal", [[0, 0, -1], [0.3, -0.5, -0.8], [-0.7, 0.1, -0.7]])
def test_planes_have_their_normal(normal: list[float]) -> None:
    found = plane_normals(plane(normal, 2.0))
    known = (found != 0).any(-1)
    assert known[10:-10, 10:-10].all() and not known[0].any()
    assert angle(found[known], np.array(normal)[None]).max() < 0.1


def test_windows_across_labels_holes_and_edges_have_no_normal() -> None:
    flat = plane([0, 0, -1], 2.0)
    assert flat.label40 is not None
    flat.label40[:, 30:] = 2
    flat.depth[15, 10] = 0
    found = (plane_normals(flat) != 0).any(-1)
    assert not found[:, 30].any() and not found[15, 10] and found[45, 10] and found[45, 50]
    bent = plane([0, 0, -1], 2.0, labels=False)
    bent.depth[:, 30:] += 0.1 * np.arange(1, 31)
    found = (plane_normals(bent) != 0).any(-1)
    assert not found[30, 30] and found[30, 15] and found[30, 50]


def test_pictures_come_to_one_focal_length() -> None:
    sample = box_sample()
    assert abs(np.diff(sample.rays[0, :, 0]).mean() - 1 / FOCAL) < 1e-4
    assert sample.image.shape == (*sample.depth.shape, 3) == (*sample.normal.shape[:2], 3)
    whole = labelled_view(3)["depth"]
    assert abs(sample.depth.mean() / whole.mean() - 1) < 0.02, "metres stay metres"
    with pytest.raises(InputError, match="intrinsics"):
        resampled(replace(plane([0, 0, -1], 2.0), intrinsics=Intrinsics(1e5, 1e5, 0, 0)))


def test_a_mirrored_plane_has_the_mirrored_normal() -> None:
    sample = resampled(plane([0.3, -0.5, -0.8], 2.0))
    turned = mirrored(sample)
    flipped = plane([-0.3, -0.5, -0.8], 2.0)
    np.testing.assert_allclose(turned.depth, resampled(flipped).depth, rtol=0.01)
    np.testing.assert_allclose(turned.rays, resampled(flipped).rays, atol=1e-5)
    known = (turned.normal != 0).any(-1)
    assert angle(turned.normal[known], np.array([[-0.3, -0.5, -0.8]])).max() < 0.1


def test_perfect_predictions_have_no_error() -> None:
    sample = box_sample()
    found = measured(sample, perfect(sample))
    assert found["absrel"] == found["absrel_scaled"] == 0 and found["absrel_affine"] < 1e-6
    assert found["delta1"] == found["normal_11"] == 1 and found["normal_mean"] < 0.1
    assert found["normal_known"] == 1


def test_errors_are_what_was_done_to_the_prediction() -> None:
    sample = box_sample()
    farther = replace(perfect(sample), depth=(1.3 * sample.depth).astype(np.float32))
    found = measured(sample, farther)
    assert found["absrel"] == pytest.approx(0.3, abs=1e-6) and found["delta1"] == 0
    assert found["absrel_scaled"] < 1e-6 and found["delta1_scaled"] == 1
    truth = np.linspace(1, 4, 50)
    shifted = 1 / (0.4 / truth + 0.2)
    assert np.abs(scaled(truth, shifted) / truth - 1).max() > 0.1
    np.testing.assert_allclose(affine(truth, shifted), truth, rtol=1e-6)
    angles = np.radians(20)
    turn = np.array(
        [[1, 0, 0], [0, np.cos(angles), -np.sin(angles)], [0, np.sin(angles), np.cos(angles)]]
    )
    found = measured(
        sample, replace(perfect(sample), normal=(sample.normal @ turn).astype(np.float32))
    )
    assert found["normal_11"] < 1 and found["normal_22"] == 1 and found["normal_mean"] <= 20.01


def test_intersection_over_union_of_classes() -> None:
    truth = np.array([[1, 1, 1, 2, 0]], np.uint8)
    found = np.array([[1, 1, 2, 2, 5]], np.uint8)
    table = confusion(truth, found, 13)
    assert table.sum() == 4 and table[0, 1] == 1
    scores = Scores({}, {13: table[None], 40: np.zeros((1, 40, 40), np.int32)})
    every = np.ones((1, 1))
    assert scores.measure("pixels13", every) == pytest.approx(0.75)
    assert scores.measure("miou13", every) == pytest.approx((2 / 3 + 1 / 2) / 2)
    assert np.isnan(scores.measure("pixels40", every)).all()


def test_whole_runs_are_resampled() -> None:
    weights = resampled_runs(["a", "b", "a", "c"], 0)
    assert (weights[:, 0] == weights[:, 2]).all() and (weights[:, [0, 1, 3]].sum(1) == 3).all()
    values = {"absrel": np.array([1.0, 4.0, np.nan, 1.0])}
    means = Scores(values, {}).measure("absrel", np.ones((1, 4)))
    assert means == pytest.approx(2.0)


def test_scores_are_read_back_for_the_same_training_alone() -> None:
    from pbrnet.model.studies.photographs.measures import LABELS, MEASURES

    values = {name: np.arange(3.0) for name in MEASURES if name not in LABELS}
    tables = {count: np.ones((3, count, count), np.int32) for count in (13, 40)}
    content = Scores(values, tables).to_bytes("one")
    read = Scores.read(content, "one")
    assert read is not None and read.values["absrel"].tolist() == [0, 1, 2]
    assert Scores.read(content, "other") is None and Scores.read(content[:50], "one") is None
    assert read.examples(1) == [0, 1, 2]


def test_classes_of_thirteen_sum_those_of_forty() -> None:
    logits = torch.randn(1, 40, 2, 3, generator=torch.Generator().manual_seed(0))
    classes = torch.log_softmax(logits, 1)
    grouped = thirteen(classes).exp()
    assert grouped.sum(1).allclose(torch.ones(1, 2, 3))
    bed = classes[:, 3].exp()  # NYU40 class 4, NYU13 class 1
    assert grouped[:, 0].allclose(bed)


def test_network_predicts_pictures_of_any_size() -> None:
    network = new_network(1).train()
    assert not network.encoder._bn0.training and network.norm.training
    sample = box_sample()
    odd = replace(
        sample, **{n: getattr(sample, n)[:97, :131] for n in sample.__dict__ if n != "key"}
    )
    found = predict(network.eval(), odd, CPU)
    assert found.depth.shape == (97, 131) and (found.depth > 0).all()
    assert np.abs(np.linalg.norm(found.normal, axis=-1) - 1).max() < 1e-3
    assert found.label13.min() >= 1 and found.label13.max() <= 13


def test_crops_keep_picture_and_truth_together() -> None:
    sample = box_sample()
    marked = np.repeat((sample.label40 * 10)[..., None], 3, -1)
    pool = Pool([replace(sample, image=marked)], varied=False, seed=0)
    rng = generator(0, "crops")
    for _ in range(6):
        crop = pool.draw(rng)
        assert crop.depth.shape == CROP and (crop.image[..., 0] == 10 * crop.label40).all()
    small = replace(sample, depth=sample.depth[:50])
    with pytest.raises(InputError, match="too narrow"):
        Pool([small], varied=True, seed=0)


def test_views_grow_by_whole_runs(tmp_path: Path) -> None:
    found = open_set(folder_set(tmp_path / "set", 8), "test")
    few, many = chosen(found, 3, 0), chosen(found, 6, 0)
    assert len(few) == 3 and len(many) == 6 and set(few) < set(many)
    assert len({found.keys[n].run for n in few}) == 1
    with pytest.raises(InputError, match="8 pictures"):
        chosen(found, 9, 0)


def test_learning_rate_rises_and_falls() -> None:
    rates = [rate(step, 100) for step in range(100)]
    assert np.argmax(rates) in (4, 5) and rates[-1] < 0.01 * max(rates) and min(rates) > 0


def test_rows_name_sets_stages_and_numbers(tmp_path: Path) -> None:
    row = parse_row("ours, then real=data@50,more:photos")
    sources = [[(str(s.path), s.views) for s in stage] for stage in row.stages]
    assert sources == [[("data", 50), ("more", None)], [("photos", None)]]
    shown = {"a/plain/data/dataset": "plain/data/dataset", "a/photos": "photos", "data": "data"}
    assert {parse_row(f"x={path}").stages[0][0].name for path in shown} == set(shown.values())
    file = tmp_path / "rows.yaml"
    file.write_text("- {name: a, train: [[x@5]], varied: false}\n")
    (read,) = read_rows(file)
    assert str(read.stages[0][0].path) == str(tmp_path / "x") and not read.varied
    for wrong in ("no sets", "a=", "=x", "a=x,", "a=x:"):
        with pytest.raises(ParameterError):
            parse_row(wrong)


@pytest.fixture(scope="module")
def place(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a set of photographs and a packed data set."""
    root = tmp_path_factory.mktemp("photographs")
    folder_set(root / "photos")
    LAYOUTS["packed"](root / "data")
    return root


def words(place: Path, *more: str) -> list[str]:
    places = {"--work": "work", "--metrics": "metrics"}
    given = [str(word) for name, path in places.items() for word in (name, place / path)]
    return [*COMMAND, str(place / "photos"), *given, "--steps", "2", "--seeds", "1", *more]


def test_study_from_end_to_end_and_again(place: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(training, "BATCH", 2)
    data, photos = place / "data", place / "photos"
    rows = ("--row", f"ours={data}", "--row", f"ours, then real={data}@2:{photos}")
    survey = printed(*words(place, *rows, "--dry-run"))
    assert "4 pictures of 2 runs" in survey and "ours, seed 0: train" in survey
    shown = printed(*words(place, *rows))
    assert "ours, then real" in shown
    path = place / "metrics" / "photographs.json"
    content = path.read_text()
    result = build(PhotographsResult, json.loads(content))
    row = result.rows["ours, then real"]
    assert (result.pictures, result.runs, row.views) == (4, 2, 3)
    assert row.absrel is not None and row.absrel.gain is not None and row.absrel.low is not None
    assert row.miou13 is not None and result.rows["ours"].absrel is not None
    assert {f.name for f in (place / "metrics").iterdir()} == {
        "photographs.json",
        "photographs.png",
    }
    sheets = list((place / "work").glob("*/0/pictures.png"))
    assert len(sheets) == 2 and Image.open(sheets[0]).width > 7 * 150

    monkeypatch.setattr(study, "train", None)  # a training would fail now
    assert "ours, seed 0: kept" in printed(*words(place, *rows))
    assert path.read_text() == content
    assert "ours, seed 0: train" in printed(*words(place, *rows, "--dry-run", "--steps", "3"))
    with monkeypatch.context() as raised:
        raised.setattr(study, "table", lambda: {"studies.photographs": 99})
        assert "ours, seed 0: train" in printed(*words(place, *rows, "--dry-run"))
    write_report(
        Places(place / "none", place / "none", place / "metrics"), Params(), place / "r.html"
    )
    page = (place / "r.html").read_text()
    assert 'id="study-photographs"' in page and "ours, then real" in page


def test_rows_of_one_set_draw_a_line_over_views() -> None:
    row = RowResult((("ours",),), 4, 1, True, 0.1, absrel_scaled=MetricEstimate(0.2))
    result = PhotographsResult(
        "photos", 2, 1, 0.5, 7, 8, FOCAL, 0, "ours", ("ours", "fewer"),
        {"ours": row, "fewer": replace(row, views=2, absrel_scaled=MetricEstimate(0.3))},
    )  # fmt: skip
    alone = replace(result, order=("ours",), rows={"ours": row})
    assert len(figures(alone)) == 1
    (_, curve) = figures(result)
    labels = [label.get_text() for label in curve.axes[0].get_xticklabels()]
    assert labels == ["2", "4"]


@pytest.mark.parametrize(
    ("damage", "said"),
    [
        (lambda p: (p / "depth" / "0.png").unlink(), "no such file"),
        (lambda p: (p / "depth" / "0.png").write_bytes(b"\x89PNG"), "0.png"),
        (lambda p: Image.new("L", (40, 30)).save(p / "depth" / "0.png"), "16 bits"),
        (lambda p: Image.new("RGB", (40, 30)).save(p / "label40" / "0.png"), "8 bits"),
        (lambda p: Image.new("RGB", (20, 30)).save(p / "rgb" / "0.png"), "same size"),
        (
            lambda p: (p / "intrinsics.json").write_text('{"fx": 0, "fy": 1, "cx": 0, "cy": 0}'),
            "above 0",
        ),
        (lambda p: (p / "test.csv").write_text("name,run\n../x,1\n"), "name of a picture"),
        (lambda p: (p / "test.csv").write_text("name,run\nx,1\n"), "no such picture"),
        (lambda p: (p / "test.csv").write_text("name,run\n"), "no pictures"),
        (lambda p: (p / "test.csv").write_text("id\n0\n"), "no column"),
    ],
)
def test_damaged_folders_are_refused_in_a_line(tmp_path: Path, damage: object, said: str) -> None:
    folder = folder_set(tmp_path / "set", 1)
    assert callable(damage)
    damage(folder)
    message = refused(*COMMAND, folder, "--row", f"a={folder}", "--dry-run")
    assert said in message and "\n" not in message


def test_damaged_hdf5_files_are_refused_in_a_line(tmp_path: Path) -> None:
    path = nyu_file(tmp_path / "nyu")
    whole = path.read_bytes()
    for content in (b"", b"no HDF5", whole[: len(whole) // 2]):
        path.write_bytes(content)
        assert "not HDF5" in refused(*COMMAND, path, "--row", f"a={path}", "--dry-run")
    path.write_bytes(whole)
    (path.parent / "splits.mat").write_bytes(b"MATLAB")
    assert "splits.mat" in refused(*COMMAND, path, "--row", f"a={path}", "--dry-run")
    folder = hypersim_set(tmp_path / "hypersim")
    (folder / "metadata_camera_parameters.csv").write_text("scene_name\nai_001_001\n")
    assert "M_cam_from_uv" in refused(*COMMAND, folder, "--row", f"a={folder}", "--dry-run")
    shutil.rmtree(folder / "ai_001_001")
    assert exit_code(*COMMAND, folder, "--row", f"a={folder}", "--dry-run") == 3


def test_training_on_pictures_of_the_test_is_refused(tmp_path: Path) -> None:
    folder = folder_set(tmp_path / "set", 2)
    (folder / "train.txt").unlink()
    rows = ("--row", f"a={folder / '..' / 'set'}")
    assert "2 pictures" in refused(*COMMAND, folder, *rows, "--dry-run")


def test_wrong_rows_and_sets_are_refused(place: Path, tmp_path: Path) -> None:
    photos = place / "photos"
    assert "no set of pictures" in refused(*COMMAND, photos, "--row", f"a={tmp_path}", "--dry-run")
    assert "no such file" in refused(*COMMAND, tmp_path / "x", "--row", "a=b", "--dry-run")
    assert exit_code(*COMMAND, photos, "--dry-run") == 2
    twice = ("--row", f"a={photos}", "--row", f"a={photos}")
    assert exit_code(*COMMAND, photos, *twice, "--dry-run") == 2
    assert exit_code(*COMMAND, photos, *twice[:2], "--reference", "b", "--dry-run") == 2
