"""Training: it learns, resumes to the same bits, keeps the first stage fixed, stops at NaN."""

import csv
import json
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet as pq
import pytest
import torch

from pbrnet.model.data.encoding import encode, to_image
from pbrnet.model.data.reader import Dataset
from pbrnet.model.evaluation.metrics import ssim
from pbrnet.model.settings import LossParams, StageTrainParams, TrainParams, learning_rate
from pbrnet.model.training import loop
from pbrnet.model.training.loop import TrainingError, batches_from
from pbrnet.model.training.store import load_model
from pbrnet.model.training.train import Folders, choose_precision, train_network
from pbrnet.pipeline.params import Params
from pbrnet.pipeline.records import data_lock
from pbrnet.pipeline.tonemap import tonemap
from pbrnet.scenes.errors import InputError
from tests.fixtures.backbone import copy_backbone
from tests.fixtures.command import Run
from tests.fixtures.model import box_dataset, box_rows, write_shard
from tests.fixtures.training import Killed, stop_at
from tests.fixtures.trial import folders_in

SIZE = {"width": 24, "height": 18, "panorama": 16}
SMALL = StageTrainParams(epochs=2, width=4, levels=2)
PARAMS = Params(
    train=TrainParams(
        learning_rate=1e-3, checkpoint_steps=3, shading=SMALL, composition=SMALL, unet=SMALL
    )
)
Workplace = Callable[..., Folders]


@pytest.fixture()
def workplace(tmp_path: Path, tmp_path_factory: pytest.TempPathFactory) -> Workplace:
    """A folder with a dataset of box rooms and a backbone; as many as a test asks for."""

    def make(name: str = "work", **rows: int) -> Folders:
        folders = folders_in(tmp_path / name)
        box_dataset(folders.data, **{"train": 8, "validation": 2, "test": 4, **SIZE, **rows})
        copy_backbone(folders.models)
        return folders

    return make


def weights(folders: Folders, name: str) -> bytes:
    return (folders.models / f"{name}.safetensors").read_bytes()


def test_a_training_writes_model_card_metrics_and_curve(workplace: Workplace) -> None:
    folders = workplace()
    train_network("shading", PARAMS, folders)
    network, card = load_model(folders.models / "shading.safetensors")
    assert card.parameters == sum(value.numel() for value in network.parameters())
    assert card.data.views == 8 and len(card.data.scenes) == 4
    assert card.data.licences == ("MIT",)
    assert card.backbone["network"] == "efficientnet_lite0"
    assert card.training["steps"] == 16 and card.exposure == "shared"
    with (folders.plots / "train_shading.csv").open() as stream:
        curve = list(csv.DictReader(stream))
    assert [(row["step"], row["epoch"]) for row in curve] == [("8", "1"), ("16", "2")]
    assert all(float(row["train_loss"]) > 0 and float(row["validation_loss"]) > 0 for row in curve)
    metrics = json.loads((folders.metrics / "train_shading.json").read_text())
    assert metrics["steps"] == 16 and metrics["backbone"] == "efficientnet_lite0"
    assert not (folders.models / "checkpoints" / "shading.pt").exists()


def test_training_twice_gives_the_same_bytes(workplace: Workplace) -> None:
    folders = [workplace(name) for name in ("a", "b")]
    for folder in folders:
        train_network("shading", PARAMS, folder)
    for file in ("models/shading.safetensors", "models/shading.json", "plots/train_shading.csv"):
        assert (folders[0].models.parent / file).read_bytes() == (
            folders[1].models.parent / file
        ).read_bytes()


def test_another_seed_trains_another_network(workplace: Workplace) -> None:
    first, second = workplace("a"), workplace("b")
    train_network("shading", PARAMS, first)
    train_network("shading", replace(PARAMS, seed=1), second)
    assert weights(first, "shading") != weights(second, "shading")


@pytest.mark.slow
@pytest.mark.parametrize("stop", [4, 6, 11])
@pytest.mark.parametrize("precision", ["float32", "bfloat16"])
def test_a_killed_training_ends_as_one_that_was_not(
    workplace: Workplace, monkeypatch: pytest.MonkeyPatch, stop: int, precision: Any
) -> None:
    params = replace(PARAMS, train=replace(PARAMS.train, precision=precision, decay="cosine"))
    undisturbed, killed = workplace("a"), workplace("b")
    train_network("shading", params, undisturbed)

    steps = stop_at(monkeypatch, stop)
    with pytest.raises(Killed):
        train_network("shading", params, killed)
    assert (killed.models / "checkpoints" / "shading.pt").exists()
    assert not (killed.models / "shading.safetensors").exists()
    done = steps()
    train_network("shading", params, killed)
    assert steps() - done == 16 - (stop - 1) // 3 * 3  # it went on from the last checkpoint
    assert weights(undisturbed, "shading") == weights(killed, "shading")
    for file in ("plots/train_shading.csv", "models/shading.json"):
        assert (undisturbed.models.parent / file).read_text() == (
            killed.models.parent / file
        ).read_text()


def test_ctrl_c_keeps_every_step(workplace: Workplace, monkeypatch: pytest.MonkeyPatch) -> None:
    folders = workplace()

    stop_at(monkeypatch, 6, KeyboardInterrupt)
    with pytest.raises(KeyboardInterrupt):
        train_network("shading", PARAMS, folders)
    saved = torch.load(folders.models / "checkpoints" / "shading.pt", weights_only=True)
    assert saved["step"] == 5


def test_ctrl_c_while_validating_loses_no_point_of_the_curve(
    workplace: Workplace, monkeypatch: pytest.MonkeyPatch
) -> None:
    undisturbed, stopped = workplace("a"), workplace("b")
    train_network("shading", PARAMS, undisturbed)

    def stop(*_: Any) -> None:
        raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr(loop.Run, "validate", stop)
        with pytest.raises(KeyboardInterrupt):
            train_network("shading", PARAMS, stopped)
    train_network("shading", PARAMS, stopped)
    for file in ("models/shading.safetensors", "plots/train_shading.csv"):
        found = [(one.models.parent / file).read_bytes() for one in (undisturbed, stopped)]
        assert found[0] == found[1], file


@pytest.mark.parametrize(
    ("words", "change"),
    [("exposure shared", {"exposure": "own"}), ("panorama normal", {"panorama": "position"})],
)
def test_composition_refuses_shading_of_other_parameters(
    workplace: Workplace, words: str, change: dict[str, Any]
) -> None:
    folders = workplace()
    train_network("shading", PARAMS, folders)
    other = replace(PARAMS, train=replace(PARAMS.train, **change))
    with pytest.raises(InputError, match=f"trained with the {words}"):
        train_network("composition", other, folders)


def test_a_fine_tuned_network_knows_all_scenes_that_it_has_seen(workplace: Workplace) -> None:
    folders = workplace()
    train_network("shading", PARAMS, folders, only=["train-room-0", "train-room-1"])
    start = folders.models / "shading.safetensors"
    later = replace(folders, models=folders.models / "later")
    card = train_network("shading", PARAMS, later, start, ["train-room-3"])
    assert card.data.scenes == card.data.plans == ("train-room-0", "train-room-1", "train-room-3")


def test_a_checkpoint_of_other_parameters_is_not_gone_on_from(
    workplace: Workplace, monkeypatch: pytest.MonkeyPatch
) -> None:
    folders, fresh = workplace("a"), workplace("b")
    other = replace(PARAMS, train=replace(PARAMS.train, learning_rate=2e-3))
    with monkeypatch.context() as patch:
        stop_at(patch, 10)
        with pytest.raises(Killed):
            train_network("shading", PARAMS, folders)
    train_network("shading", other, folders)
    train_network("shading", other, fresh)
    assert weights(folders, "shading") == weights(fresh, "shading")


def test_a_damaged_checkpoint_is_named(workplace: Workplace) -> None:
    folders = workplace()
    checkpoint = folders.models / "checkpoints" / "shading.pt"
    checkpoint.parent.mkdir()
    checkpoint.write_bytes(b"half a checkpoint")
    with pytest.raises(InputError, match=r"shading\.pt: damaged checkpoint.*delete it"):
        train_network("shading", PARAMS, folders)


def test_composition_leaves_the_shading_network_as_it_is(workplace: Workplace) -> None:
    folders = workplace()
    train_network("shading", PARAMS, folders)
    before = weights(folders, "shading")
    card = train_network("composition", PARAMS, folders)
    assert weights(folders, "shading") == before
    assert card.needs == {"shading": load_model(folders.models / "shading.safetensors")[1].sha256}


def test_composition_needs_the_shading_network(workplace: Workplace) -> None:
    with pytest.raises(InputError, match="pbrnet train shading"):
        train_network("composition", PARAMS, workplace())


def test_training_needs_the_backbone(workplace: Workplace) -> None:
    folders = workplace()
    shutil.rmtree(folders.models)
    with pytest.raises(InputError, match="pbrnet backbone"):
        train_network("shading", PARAMS, folders)


def test_nan_stops_with_the_view_and_the_step(workplace: Workplace) -> None:
    folders = workplace()
    rows = box_rows(["good", "broken"], 1, "train", **SIZE)
    rows[1]["shading"][0, 0, 0] = np.nan
    write_shard(folders.data / "dataset" / "train-00000-of-00001.parquet", rows)
    with pytest.raises(TrainingError, match=r"nan at step [01] on view broken/v000"):
        train_network("shading", PARAMS, folders)
    assert not (folders.models / "shading.safetensors").exists()


def test_fine_tuning_starts_from_the_given_weights(workplace: Workplace) -> None:
    folders = workplace()
    train_network("shading", PARAMS, folders)
    start = folders.models / "shading.safetensors"
    still = replace(PARAMS, train=replace(PARAMS.train, learning_rate=1e-30))
    elsewhere = replace(folders, models=folders.models / "room")
    card = train_network("shading", still, elsewhere, start)
    assert weights(elsewhere, "shading") == weights(folders, "shading")
    assert card.training["started_from"] == card.sha256


def test_fine_tuning_refuses_another_architecture(workplace: Workplace) -> None:
    folders = workplace()
    train_network("shading", PARAMS, folders)
    wider = replace(PARAMS, train=replace(PARAMS.train, shading=replace(SMALL, width=8)))
    with pytest.raises(InputError, match=r"train\.shading"):
        train_network("shading", wider, folders, folders.models / "shading.safetensors")


def test_views_of_different_sizes_do_not_share_a_batch(workplace: Workplace) -> None:
    folders = workplace(train=2)
    dataset = folders.data / "dataset"
    (dataset / "train-00000-of-00001.parquet").rename(dataset / "train-00000-of-00002.parquet")
    other = box_rows(["large"], 2, "train", width=32, height=24, panorama=16)
    write_shard(dataset / "train-00001-of-00002.parquet", other)
    train_network("shading", PARAMS, folders)
    batches = replace(PARAMS, train=replace(PARAMS.train, batch=4))
    with pytest.raises(InputError, match="views of one batch differ in size"):
        train_network("shading", batches, folders)


def test_without_validation_views_there_is_no_validation_loss(workplace: Workplace) -> None:
    folders = workplace(validation=0)
    assert train_network("shading", PARAMS, folders).metrics["validation_loss"] is None
    assert (folders.plots / "train_shading.csv").read_text().splitlines()[1].endswith(",")


def test_mirrored_views_are_seen_only_where_flips_are_on(workplace: Workplace) -> None:
    folders = workplace()
    dataset = Dataset(folders.data / "dataset", "train")
    originals = {example.name: example for example in dataset.ordered()}
    seen = {True: 0, False: 0}
    for flips in (True, False):
        params = replace(PARAMS, train=replace(PARAMS.train, flips=flips))
        batches = batches_from(dataset, params.train, params.seed, 0)
        for _ in range(40):
            example = next(batches)[0]
            seen[flips] += not np.array_equal(example["depth"], originals[example.name]["depth"])
    assert 8 < seen[True] < 32 and seen[False] == 0


@pytest.mark.slow
def test_one_view_is_learned_by_heart(workplace: Workplace) -> None:
    folders = workplace(train=2, validation=0, width=48, height=36)
    shard = folders.data / "dataset" / "train-00000-of-00001.parquet"
    table = pq.read_table(shard).slice(0, 1)
    pq.write_table(table, shard)
    stage = StageTrainParams(epochs=300, width=12, levels=4)
    params = replace(
        PARAMS,
        train=replace(
            PARAMS.train,
            learning_rate=3e-3,
            decay="cosine",
            flips=False,
            loss=LossParams(kind="part"),
            shading=stage,
        ),
    )
    train_network("shading", params, folders)
    network, _ = load_model(folders.models / "shading.safetensors")
    example = next(Dataset(folders.data / "dataset", "train").ordered())
    with torch.no_grad():
        predicted = to_image(network(encode([example])))
    assert ssim(tonemap(example["shading"], example.exposure_shading), predicted) > 0.97


def test_the_learning_rate_is_constant_or_half_a_cosine() -> None:
    constant, cosine = (
        TrainParams(learning_rate=1e-3, decay=decay) for decay in ("constant", "cosine")
    )
    assert [learning_rate(constant, step, 100) for step in (0, 50, 99)] == [1e-3] * 3
    assert learning_rate(cosine, 0, 100) == 1e-3
    assert learning_rate(cosine, 50, 100) == pytest.approx(5e-4)
    assert learning_rate(cosine, 99, 100) < 1e-6


def test_precision_follows_the_processor(monkeypatch: pytest.MonkeyPatch) -> None:
    cpu = torch.device("cpu")
    for flags, expected in (({"avx512_bf16": True}, "bfloat16"), ({"avx2": True}, "float32")):
        monkeypatch.setattr(torch.cpu, "get_capabilities", lambda flags=flags: flags)
        assert choose_precision(TrainParams(), cpu) == expected
    assert choose_precision(TrainParams(precision="float32"), cpu) == "float32"


@pytest.mark.slow
@pytest.mark.parametrize("part", ["weights", "card", "foreign"])
def test_damaged_models_are_refused(workplace: Workplace, part: str) -> None:
    folders = workplace()
    train_network("shading", PARAMS, folders)
    path = folders.models / "shading.safetensors"
    if part == "weights":
        path.write_bytes(path.read_bytes()[:-100])
    elif part == "card":
        path.with_suffix(".json").write_text("{")
    else:
        path.with_suffix(".json").write_text('{"name": "something else"}')
    with pytest.raises(InputError, match=r"shading\."):
        load_model(path)


def test_a_second_training_of_the_same_network_is_refused(tmp_path: Path, pbrnet_run: Run) -> None:
    words = ("train", "shading", "--models", tmp_path / "m", "--data", tmp_path)
    with data_lock(tmp_path / "m" / "checkpoints", "train shading", ".shading.lock"):
        code, _, said = pbrnet_run(*words)
    assert code == 1 and "in use by 'pbrnet train shading'" in said and "--models" in said
    assert "in use" not in pbrnet_run("train", "unet", *words[2:])[2]
