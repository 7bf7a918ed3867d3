"""Evaluation on unseen scenes, and prediction from frames and from a scene."""

import csv
import json
import math
import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from pbrnet.model.data.encoding import neutral_background
from pbrnet.model.data.reader import Dataset
from pbrnet.model.evaluation import evaluate as evaluation
from pbrnet.model.evaluation.evaluate import LeakError, evaluate
from pbrnet.model.evaluation.inference import load_networks
from pbrnet.model.evaluation.product import product, product_linear
from pbrnet.model.evaluation.reference import sheet, summary
from pbrnet.model.evaluation.selection import find_views, resized
from pbrnet.model.settings import EvaluateParams, StageTrainParams, TrainParams
from pbrnet.model.training.train import Folders, train_network
from pbrnet.pipeline.costs.ledger import Ledger
from pbrnet.pipeline.dataset.settings import DatasetParams
from pbrnet.pipeline.images import png_facts, read_picture
from pbrnet.pipeline.inspection.renders import view_at
from pbrnet.pipeline.params import Params
from pbrnet.pipeline.splits import SplitParams
from pbrnet.pipeline.tonemap import Exposure, ToneParams, tonemap
from pbrnet.pipeline.views import (
    CameraFile,
    ImageParams,
    View,
    as_matrix,
    intrinsics_of,
    save_cameras,
)
from pbrnet.scenes.color import decode_srgb
from pbrnet.scenes.contract import load_scene
from pbrnet.scenes.errors import InputError
from tests.fixtures.backbone import copy_backbone
from tests.fixtures.changed import changed
from tests.fixtures.command import Run
from tests.fixtures.model import box_dataset, box_rows, write_shard
from tests.fixtures.predict import box_camera, box_frames, box_room
from tests.fixtures.predictor import untrained_models
from tests.fixtures.stages import write_room
from tests.fixtures.trial import folders_in

SIZE = {"width": 24, "height": 18, "panorama": 16}
SMALL = StageTrainParams(epochs=1, width=4, levels=2)
PARAMS = Params(train=TrainParams(shading=SMALL, composition=SMALL, unet=SMALL))


@pytest.fixture(scope="module")
def trained(tmp_path_factory: pytest.TempPathFactory) -> Folders:
    """All three networks, barely trained, beside their dataset."""
    folders = folders_in(tmp_path_factory.mktemp("trained"))
    box_dataset(folders.data, 4, 0, 6, **SIZE)
    copy_backbone(folders.models)
    for name in ("shading", "composition", "unet"):
        train_network(name, PARAMS, folders)
    return folders


@pytest.fixture()
def workplace(trained: Folders, tmp_path: Path) -> Callable[..., Folders]:
    """The trained networks with another dataset: scene names and, if given, their plans."""

    def make(scenes: list[str], plans: str = "") -> Folders:
        data = tmp_path / "data"
        rows = box_rows(scenes, 2, "test", **SIZE)
        write_shard(data / "dataset" / "test-00000-of-00001.parquet", rows)
        if plans:
            (data / "dataset" / "scenes.csv").write_text(f"scene_id,plan\n{plans}")
        return replace(folders_in(tmp_path), data=data, models=trained.models)

    return make


def test_evaluation_measures_every_method_and_view(trained: Folders, tmp_path: Path) -> None:
    folders = replace(folders_in(tmp_path), data=trained.data, models=trained.models)
    result = evaluate(PARAMS, folders)
    assert json.loads((folders.metrics / "evaluation.json").read_text()) == result
    assert (result["split"], result["views"], result["scenes"]) == ("test", 6, 3)
    assert result["kept_back"] is None
    assert set(result["methods"]) == {"pbrnet", "product", "product_linear", "unet", "ceiling"}
    for name, values in result["methods"].items():
        for metric in ("ssim", "psnr", "flip"):
            interval = values[metric]
            assert interval["low"] <= interval["mean"] <= interval["high"], (name, metric)
        assert values["lpips"] is None
        assert (values["seconds"] is None) == (name == "ceiling")
    first = sorted({scene for group in result["examples"].values() for scene, _ in group})[0]
    splits = DatasetParams(splits=SplitParams(test_only=(first,)))
    apart = evaluate(replace(PARAMS, dataset=splits), folders)["kept_back"]
    assert (apart["views"], apart["scenes"]) == (2, 1)
    assert set(apart["methods"]) == set(result["methods"])
    with (folders.metrics / "evaluation.csv").open() as stream:
        rows = list(csv.DictReader(stream))
    assert len(rows) == 6 * 5
    flips = [float(row["flip"]) for row in rows if row["method"] == "pbrnet"]
    assert np.mean(flips) == pytest.approx(result["methods"]["pbrnet"]["flip"]["mean"], rel=1e-4)
    shown = [tuple(view) for group in result["examples"].values() for view in group]
    assert len(set(shown)) == len(shown) == 6
    for scene, view in shown:
        for what in ("prediction", "shading", "error", "unet", "product"):
            with Image.open(folders.metrics / "examples" / f"{scene}--{view}--{what}.png") as image:
                assert image.size == (24, 18)


def test_evaluating_twice_gives_the_same_figures(trained: Folders, tmp_path: Path) -> None:
    results = []
    for name in ("a", "b"):
        folders = replace(folders_in(tmp_path / name), data=trained.data, models=trained.models)
        evaluate(PARAMS, folders)
        results.append((folders.metrics / "evaluation.csv").read_bytes())
    assert results[0] == results[1]


def test_a_scene_that_was_trained_on_is_refused(workplace: Callable[..., Folders]) -> None:
    folders = workplace(["fresh", "train-room-1"])
    with pytest.raises(LeakError, match=r"'train-room-1' is in the test split.*trained on"):
        evaluate(PARAMS, folders)
    assert not folders.metrics.exists()


def test_a_home_of_the_same_number_but_another_plan_is_not_refused(
    workplace: Callable[..., Folders],
) -> None:
    folders = workplace(["train-room-1", "fresh"], plans="train-room-1,a-plan\nfresh,b-plan\n")
    assert evaluate(PARAMS, folders)["views"] == 4


def test_packed_networks_are_measured_without_the_first_stages(tmp_path: Path) -> None:
    """`plus` and `hybrid` alone on a dataset of one's own, with a home of their number."""
    folders = folders_in(tmp_path)
    untrained_models(folders.models, ("plus", "hybrid"), levels=2)
    rows = box_rows(["mine", "home-0000"], 1, "test", noisy=True, **SIZE)
    for row in rows:
        row["transport_color"] = row["color"]  # a perfect method
    write_shard(folders.data / "dataset" / "test-00000-of-00001.parquet", rows)
    plans = "scene_id,plan\nmine,a-plan\nhome-0000,b-plan\n"
    (folders.data / "dataset" / "scenes.csv").write_text(plans)
    result = evaluate(Params(evaluate=EvaluateParams(timing_views=1)), folders)
    assert list(result["methods"]) == ["plus", "hybrid", "radiosity", "denoised", "ceiling"]
    assert result["methods"]["radiosity"]["flip"]["mean"] < 1e-3
    for values in result["methods"].values():
        assert 0 < values["ssim"]["mean"] <= 1
    assert set(result["timing"]) == {"plus", "hybrid"}
    drawn = {path.stem.split("--")[-1] for path in (folders.metrics / "examples").iterdir()}
    assert drawn == {"prediction", "hybrid", "error"}
    assert summary(folders, 0)["networks"].keys() == {"plus", "hybrid"}
    assert sheet("test", ToneParams(), folders, ["plus", "denoised"], 2)[:4] == b"\x89PNG"


def test_networks_whose_inputs_a_dataset_lacks_are_left_out_by_name(tmp_path: Path) -> None:
    folders = folders_in(tmp_path)
    untrained_models(folders.models, ("plus", "hybrid"), levels=2)
    rows = box_rows(["mine", "other"], 1, "test", **SIZE)
    shard = folders.data / "dataset" / "test-00000-of-00001.parquet"
    write_shard(shard, rows)
    params = Params(evaluate=EvaluateParams(timing_views=1))
    with pytest.raises(
        InputError, match=r"no network can be measured.*add 'transport' to channels"
    ):
        evaluate(params, folders)
    write_shard(shard, box_rows(["mine", "other"], 1, "test", transport=True, **SIZE))
    result = evaluate(params, folders)
    assert list(result["methods"]) == ["plus", "radiosity", "ceiling"]
    assert list(result["left_out"]) == ["hybrid"] and "noisy" in result["left_out"]["hybrid"]


def test_a_join_that_a_dataset_lacks_leaves_its_networks_out(tmp_path: Path) -> None:
    folders = folders_in(tmp_path)
    untrained_models(folders.models, ("plus", "unet"), levels=2)
    card = folders.models / "unet.json"
    facts = json.loads(card.read_text())
    card.write_text(json.dumps(changed(facts, ("architecture", "panorama"), "product")))
    shard = folders.data / "dataset" / "test-00000-of-00001.parquet"
    write_shard(shard, box_rows(["mine", "other"], 1, "test", transport=True, **SIZE))
    _, left_out = evaluation._measurable(["plus", "unet"], "test", folders)
    assert list(left_out) == ["unet"] and "illumination.shadow_rays" in left_out["unet"]


def test_nan_in_the_truth_names_the_view(
    trained: Folders, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folders = replace(folders_in(tmp_path), data=trained.data, models=trained.models)
    nan = dict.fromkeys(("ssim", "psnr", "flip"), math.nan)
    monkeypatch.setattr(evaluation, "measure", lambda *_: nan)
    with pytest.raises(InputError, match=r"/v\d+: ssim of \w+ is not a number"):
        evaluate(PARAMS, folders)
    assert not (folders.metrics / "evaluation.csv").exists()


def test_a_folder_without_networks_is_refused_with_what_to_do(
    trained: Folders, tmp_path: Path
) -> None:
    folders = replace(folders_in(tmp_path), data=trained.data)
    with pytest.raises(
        InputError, match=r"no trained networks in this folder.*pbrnet train shading"
    ):
        evaluate(PARAMS, folders)


def test_another_scene_of_a_plan_that_was_trained_on_is_refused(
    workplace: Callable[..., Folders],
) -> None:
    folders = workplace(["by-night"], plans="by-night,train-room-0\n")
    with pytest.raises(LeakError, match="'by-night' has the floor plan 'train-room-0'"):
        evaluate(PARAMS, folders)


def test_the_training_split_may_be_measured_when_asked_for(
    trained: Folders, tmp_path: Path
) -> None:
    folders = replace(folders_in(tmp_path), data=trained.data, models=trained.models)
    result = evaluate(replace(PARAMS, evaluate=EvaluateParams(split="train")), folders)
    assert result["split"] == "train" and result["views"] == 4


def test_one_scene_gives_means_without_interval(workplace: Callable[..., Folders]) -> None:
    result = evaluate(PARAMS, workplace(["fresh"]))
    assert result["methods"]["pbrnet"]["ssim"]["low"] is None


def test_the_renderers_time_is_read_from_the_ledger(workplace: Callable[..., Folders]) -> None:
    folders = workplace(["fresh"])
    ledger = Ledger(folders.data)
    for scene, view, seconds in (("fresh", "v000", 1), ("fresh", "v001", 3), ("other", "v0", 9)):
        ledger.add(("color", scene, view), seconds=seconds)
    ledger.save()
    assert evaluate(PARAMS, folders)["timing"]["renderer_color"] == pytest.approx(2.0)
    ledger.path.write_text("who,what\nme,this\n")
    with pytest.raises(InputError, match=r"ledger\.parquet: not a ledger"):
        evaluate(PARAMS, folders)


def test_a_composition_network_of_another_shading_network_is_refused(
    trained: Folders, tmp_path: Path
) -> None:
    folders = replace(folders_in(tmp_path), data=trained.data, backbone=trained.models)
    train_network("shading", replace(PARAMS, seed=5), folders)
    for suffix in (".safetensors", ".json"):
        name = f"composition{suffix}"
        (folders.models / name).write_bytes((trained.models / name).read_bytes())
    with pytest.raises(InputError, match="trained on another shading network"):
        load_networks(folders.models)


def test_another_tone_mapping_than_in_training_is_refused(trained: Folders, tmp_path: Path) -> None:
    folders = replace(folders_in(tmp_path), data=trained.data, models=trained.models)
    with pytest.raises(InputError, match="tone mapping"):
        evaluate(replace(PARAMS, tone=ToneParams(key=0.5)), folders)


def test_networks_of_different_exposure_policies_are_not_compared(
    trained: Folders, tmp_path: Path
) -> None:
    for source in sorted(trained.models.glob("[scu]*.*")):
        (tmp_path / source.name).write_bytes(source.read_bytes())
    card = tmp_path / "unet.json"
    card.write_text(card.read_text().replace('"exposure": "shared"', '"exposure": "own"'))
    with pytest.raises(InputError, match="differ in exposure"):
        load_networks(tmp_path, ["pbrnet", "unet"])


def test_the_product_of_true_shading_is_the_truth_where_light_bounces_not(
    trained: Folders,
) -> None:
    """In the box world colour is exactly reflectance x shading / albedo."""
    networks = load_networks(trained.models)
    compared = 0
    for example in Dataset(trained.data / "dataset", "test").ordered():
        shading = tonemap(example["shading"], example.exposure_shading)
        image = product(example["reflectance"], shading, example.exposure_shading, networks.card)
        truth = tonemap(example["color"], example.exposure_shading)
        unclipped = shading.max(axis=-1) < 0.999
        assert np.abs(image - truth)[unclipped].max(initial=0) < 2e-3
        compared += int(unclipped.sum())
    assert compared > 500


def test_the_product_shows_the_sky_as_bright_as_shading_does(trained: Folders) -> None:
    networks = load_networks(trained.models)
    example = next(Dataset(trained.data / "dataset", "test").ordered())
    sky = np.zeros_like(example["valid"])
    sky[:, :5] = True
    outside = example.having(
        valid=example["valid"] & ~sky,
        reflectance=np.where(sky[..., None], np.float32(0), example["reflectance"]),
    )
    shading = tonemap(example["shading"], example.exposure_shading)
    image = product(
        neutral_background(outside, 0.5), shading, example.exposure_shading, networks.card
    )
    assert np.abs(image - shading)[sky].max() < 2e-3
    inside = product(example["reflectance"], shading, example.exposure_shading, networks.card)
    assert np.array_equal(image[~sky], inside[~sky])


@pytest.mark.parametrize("project", [product, product_linear])
def test_the_product_does_not_depend_on_the_unit_of_radiance(
    trained: Folders, project: Callable[..., np.ndarray]
) -> None:
    networks = load_networks(trained.models)
    example = next(Dataset(trained.data / "dataset", "test").ordered())
    shading = tonemap(example["shading"], example.exposure_shading)
    images = [
        project(example["reflectance"], shading, Exposure(scale, 0.9), networks.card)
        for scale in (1.0, 1e-4)
    ]
    assert np.allclose(*images, atol=1e-4)


def test_the_linear_projection_by_hand(trained: Folders) -> None:
    """White point 2: radiance 0.5 of scale 1, reflectance half the grey, shows as 0.125."""
    networks = load_networks(trained.models)
    exposure = Exposure(1.0, 2.0)
    shading = tonemap(np.full((8, 8, 3), 0.5, np.float32), exposure)
    reflectance = np.full((8, 8, 3), networks.card.albedo / 2, np.float32)
    image = product_linear(reflectance, shading, exposure, networks.card)
    assert np.allclose(decode_srgb(image), 0.125, atol=1e-4)
    bright = product_linear(
        reflectance * 2, tonemap(shading + 9, exposure), exposure, networks.card
    )
    assert bright.max() <= 1


def test_a_baseline_that_is_named_must_be_there(trained: Folders, tmp_path: Path) -> None:
    folders = replace(folders_in(tmp_path), data=trained.data, models=trained.models)
    params = replace(PARAMS, train=replace(PARAMS.train, baselines=("unet", "can")))
    with pytest.raises(InputError, match=r"can\.safetensors: no such model.*pbrnet train can"):
        evaluate(params, folders)


def test_the_worst_view_is_the_one_with_the_largest_error(
    trained: Folders, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(evaluation, "EXAMPLES", 1)
    folders = replace(folders_in(tmp_path), data=trained.data, models=trained.models)
    result = evaluate(PARAMS, folders)
    with (folders.metrics / "evaluation.csv").open() as stream:
        rows = [row for row in csv.DictReader(stream) if row["method"] == "pbrnet"]
    rows.sort(key=lambda row: float(row["flip"]))
    assert result["examples"]["best"] == [[rows[0]["scene_id"], rows[0]["view_id"]]]
    assert result["examples"]["worst"] == [[rows[-1]["scene_id"], rows[-1]["view_id"]]]


FRAMES = ("--inputs", "data/inputs/box/v0.exr", "--illumination", "data/illumination/box/v0.exr")


@pytest.fixture()
def predict(
    trained: Folders, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, pbrnet_run: Run
) -> Run:
    """`pbrnet predict` in `tmp_path`: exit code, output, errors."""
    monkeypatch.chdir(tmp_path)
    Path("params.yaml").write_text("groundtruth: {spp: 4, block_spp: 4}\n")
    return partial(pbrnet_run, "predict", "--models", trained.models)


@pytest.mark.slow
def test_predicting_from_frames_in_a_process_of_its_own(trained: Folders, tmp_path: Path) -> None:
    box_frames(tmp_path / "data", width=37, height=23, panorama=20)
    (tmp_path / "params.yaml").write_text("seed: 0\n")
    command = [sys.executable, "-m", "pbrnet.pipeline.cli", "predict", *FRAMES]
    command += ["--models", str(trained.models), "--out", "p.png"]
    done = subprocess.run(command, capture_output=True, text=True, cwd=tmp_path, timeout=300)
    assert done.returncode == 0, done.stderr
    assert "box/v0, 37x23" in done.stdout
    with Image.open(tmp_path / "p.png") as image:
        assert image.size == (37, 23)


def test_comparing_with_the_truth_in_the_data_folder(predict: Run, tmp_path: Path) -> None:
    box_frames(tmp_path / "data", width=37, height=23, panorama=20)
    code, words, _ = predict(*FRAMES, "--compare", "--out", "c.png")
    assert code == 0 and "SSIM" in words and "FLIP" in words
    with Image.open(tmp_path / "c.png") as image:
        assert image.size[0] > 3 * 37 and image.size[1] > 2 * 23
    (tmp_path / "data" / "color" / "box" / "v0.exr").unlink()
    code, _, errors = predict(*FRAMES, "--compare")
    assert code == 3 and "no shading and colour frames of box/v0" in errors


def test_frames_of_two_views_are_refused(predict: Run, tmp_path: Path) -> None:
    for name in ("v0", "v1"):
        box_frames(tmp_path / "data", name, width=24, height=18, panorama=16)
    code, _, errors = predict(*FRAMES[:3], FRAMES[3].replace("v0", "v1"))
    assert code == 3 and "different views" in errors


@pytest.fixture()
def room(tmp_path: Path) -> Path:
    """A scene folder: a grey box with a lamp below its ceiling, and a camera file."""
    return box_room(tmp_path / "data", box_camera("v0", (24, 18), (0.5, 0.5, 1.5), (1, 1, -0.2)))


def test_predicting_from_a_scene_at_any_size_beside_the_truth(
    predict: Run, tmp_path: Path, room: Path
) -> None:
    code, words, errors = predict(room, "--view", "v0", "--size", "33x20", "--compare")
    assert code == 0, errors
    assert "33x20" in words and "SSIM" in words
    content = (tmp_path / "predictions" / f"{room.name}--v0.png").read_bytes()
    assert read_picture(content).shape[1] > 3 * 33
    facts = png_facts(content)
    assert facts and facts["words"] in words and facts["prediction"] == f"{room.name}/v0"
    for credit, words in zip(load_scene(room).credits, facts["credits"], strict=True):
        assert credit.author in words and credit.licence in words


def test_another_size_keeps_the_horizontal_view_and_square_pixels() -> None:
    view = View(
        "s", "v", 40, 30, as_matrix(intrinsics_of(ImageParams(40, 30))), as_matrix(np.eye(4))
    )
    wide = resized(view, (80, 30))
    half_x = [view.width / 2 / v.intrinsics[0, 0] * v.width / view.width for v in (view, wide)]
    assert half_x[0] == pytest.approx(half_x[1])
    assert wide.intrinsics[0, 0] == wide.intrinsics[1, 1]
    assert tuple(wide.intrinsics[:2, 2]) == (40, 15)


def test_all_views_are_named_for_one_that_is_not_there(tmp_path: Path) -> None:
    frames = [
        replace(view_at((0, 0, 1), (1, 0, 1), name=f"walk-00-{n:04d}"), trajectory="walk-00")
        for n in range(3)
    ]
    write_room(tmp_path / "a")
    with pytest.raises(InputError, match=r"no cameras of a yet; sample them with: pbrnet cameras"):
        find_views(tmp_path / "a", tmp_path / "a.json", ["x"], None)
    rest = [view_at((0, 0, 1), (1, 0, 1), name=f"room-s{n}") for n in range(9)]
    save_cameras(tmp_path / "a.json", CameraFile("a", (*rest, *frames)))
    with pytest.raises(InputError, match=r"room-s8, walk-00-0000 to walk-00-0002\)$"):
        find_views(tmp_path / "a", tmp_path / "a.json", ["x"], None)


@pytest.mark.parametrize(
    ("arguments", "code", "words"),
    [
        (("data/scenes/box",), 2, "give --view"),
        (("data/scenes/box", "--view", "v9"), 3, "no view 'v9' (there are: v0)"),
        (("data/scenes/box", "--view", "v0", "--size", "huge"), 2, "640x480"),
        (("data/scenes/none", "--view", "v0"), 3, "none"),
        ((), 2, "--inputs and --illumination"),
        (("--inputs", "a.exr", "--illumination", "b.exr"), 3, "a.exr: no such frame"),
    ],
)
def test_what_cannot_be_predicted_is_said(
    predict: Run, tmp_path: Path, room: Path, arguments: tuple[str, ...], code: int, words: str
) -> None:
    ended, _, errors = predict(*arguments)
    assert ended == code and words in errors
    assert not (tmp_path / "predictions").exists()
