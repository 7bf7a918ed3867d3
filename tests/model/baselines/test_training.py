"""The baselines through the one loop: they learn, go on after a kill, and are evaluated."""

import json
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import pyarrow.parquet as pq
import pytest
import torch

from pbrnet.model.baselines import cyclegan
from pbrnet.model.data.encoding import encode, to_image
from pbrnet.model.data.reader import Dataset
from pbrnet.model.evaluation.evaluate import evaluate
from pbrnet.model.evaluation.metrics import ssim
from pbrnet.model.methods import BASELINES, METHODS, Adam
from pbrnet.model.networks.objective import Batch, Objective
from pbrnet.model.settings import StageTrainParams, TrainParams
from pbrnet.model.training import train as training
from pbrnet.model.training.loop import TrainingError
from pbrnet.model.training.store import load_model
from pbrnet.model.training.train import Folders, train_network
from pbrnet.pipeline.params import Params
from pbrnet.pipeline.tonemap import tonemap
from tests.fixtures.backbone import copy_backbone
from tests.fixtures.model import box_dataset
from tests.fixtures.training import Killed, stop_at
from tests.fixtures.trial import folders_in

SIZE = {"width": 24, "height": 18, "panorama": 16}
SMALL = StageTrainParams(epochs=2, width=4, levels=3)
PARAMS = Params(
    train=TrainParams(
        learning_rate=1e-3,
        checkpoint_steps=3,
        precision="float32",
        baselines=BASELINES,  # type: ignore[arg-type]
        **dict.fromkeys(METHODS, SMALL),  # type: ignore[arg-type]
    )
)
GAMES = ("pix2pix_own", "cyclegan_own")


def workplace(root: Path, train: int = 8, noisy: bool = False, **size: int) -> Folders:
    """A folder with a dataset of box rooms and a backbone."""
    folders = folders_in(root)
    box_dataset(folders.data, train, 2, 4, noisy, **{**SIZE, **size})
    copy_backbone(folders.models)
    return folders


# Calls 13 and 14 are the two updates of step 6, the first after a checkpoint; 16: the second of 7.
@pytest.mark.slow
@pytest.mark.parametrize("name", GAMES)
@pytest.mark.parametrize(("call", "error"), [(16, Killed), (15, KeyboardInterrupt)])
def test_a_game_that_was_stopped_ends_as_one_that_was_not(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    name: str,
    call: int,
    error: type[BaseException],
) -> None:
    monkeypatch.setattr(cyclegan, "BUFFER_SIZE", 3)  # so that stored images are returned
    undisturbed, stopped = workplace(tmp_path / "a"), workplace(tmp_path / "b")
    train_network(name, PARAMS, undisturbed)
    with monkeypatch.context() as patch:
        stop_at(patch, call, error)
        with pytest.raises(error):
            train_network(name, PARAMS, stopped)
    saved = stopped.models / "checkpoints" / f"{name}.pt"
    step = torch.load(saved, weights_only=True)["step"]
    assert step == (6 if error is Killed else 7)
    train_network(name, PARAMS, stopped)
    for file in (f"models/{name}.safetensors", f"plots/train_{name}.csv"):
        assert (tmp_path / "a" / file).read_bytes() == (tmp_path / "b" / file).read_bytes()


@pytest.mark.slow
@pytest.mark.parametrize("name", GAMES)
def test_ctrl_c_between_two_players_keeps_the_last_whole_step(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str
) -> None:
    folders = workplace(tmp_path)
    stop_at(monkeypatch, 10, KeyboardInterrupt)  # step 4: one has moved, the other has not
    with pytest.raises(KeyboardInterrupt):
        train_network(name, PARAMS, folders)
    saved = torch.load(folders.models / "checkpoints" / f"{name}.pt", weights_only=True)
    assert saved["step"] == 3


@pytest.mark.parametrize("name", GAMES)
def test_a_checkpoint_holds_all_players_and_the_history(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str
) -> None:
    folders = workplace(tmp_path)
    stop_at(monkeypatch, 13, KeyboardInterrupt)
    with pytest.raises(KeyboardInterrupt):
        train_network(name, PARAMS, folders)
    saved = torch.load(folders.models / "checkpoints" / f"{name}.pt", weights_only=True)
    assert len(saved["players"]) == len(saved["optimisers"]) == 2
    for optimiser in saved["optimisers"].values():
        assert len(optimiser["state"]) == len(optimiser["param_groups"][0]["params"]) > 0
        assert optimiser["param_groups"][0]["betas"] == (0.5, 0.999)
        assert optimiser["param_groups"][0]["lr"] == pytest.approx(2e-4)
    if name == "cyclegan_own":
        assert {len(images) for images in saved["memory"]["histories"].values()} == {6}
        assert saved["memory"]["last"].shape == (1, 3, 18, 24)


@pytest.mark.slow
def test_all_are_trained_and_measured(tmp_path: Path) -> None:
    """Every method of the registry, a card that says how, and a place in the table."""
    folders = workplace(tmp_path, train=2, noisy=True)
    for name in METHODS:
        card = train_network(name, PARAMS, folders)
        settings = card.training
        assert card.architecture.kind == METHODS[name].kind
        assert isinstance(settings["loss"], str) == bool(METHODS[name].own_loss), name
        assert settings["learning_rate"] == (
            METHODS[name].adam.rate if METHODS[name].adam else 1e-3  # type: ignore[union-attr]
        )
    result = evaluate(PARAMS, folders)
    assert list(result["methods"]) == [
        *("pbrnet", "product", "product_linear"),
        *BASELINES,
        "radiosity",
        "denoised",
        "ceiling",
    ]
    unknown = {name for name, values in result["methods"].items() if values["seconds"] is None}
    unsure = {"ceiling", "plus", "hybrid", "radiosity", "denoised"}
    assert unknown == unsure, "no ledger says what transport and samples took"
    assert json.loads((folders.metrics / "evaluation.json").read_text()) == result
    drawn = {path.stem.split("--")[-1] for path in (folders.metrics / "examples").iterdir()}
    assert set(BASELINES) < drawn


def test_nan_in_one_of_the_losses_stops_training(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folders = workplace(tmp_path)
    monkeypatch.setattr(
        cyclegan,
        "least_squares",
        lambda output, label: output.mean() * (1 / label if label else torch.nan),
    )
    with pytest.raises(TrainingError, match="nan at step 0 on view"):
        train_network("cyclegan_own", PARAMS, folders)


@pytest.fixture()
def one_view(tmp_path: Path) -> Folders:
    """A dataset of a single view."""
    folders = workplace(tmp_path, train=2, width=32, height=24)
    shard = folders.data / "dataset" / "train-00000-of-00001.parquet"
    pq.write_table(pq.read_table(shard).slice(0, 1), shard)
    return folders


def by_heart(name: str, steps: int, width: int, levels: int) -> Params:
    """Parameters to learn one view."""
    stage = StageTrainParams(epochs=steps, width=width, levels=levels)
    train = TrainParams(
        learning_rate=4e-3,
        decay="cosine",
        flips=False,
        precision="float32",
        **{name: stage},  # type: ignore[arg-type]
    )
    return Params(train=train)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "steps", "width", "levels"),
    [
        pytest.param("can", 600, 16, 6, marks=pytest.mark.check),
        pytest.param("can_own", 800, 16, 6, marks=pytest.mark.check),
        pytest.param("pix2pix", 900, 24, 3, marks=pytest.mark.check),
        pytest.param("pix2pix_own", 600, 24, 3, marks=pytest.mark.check),
        pytest.param("cyclegan", 500, 16, 2, marks=pytest.mark.check),
    ],
)
def test_one_view_is_learned_by_heart(
    one_view: Folders,
    monkeypatch: pytest.MonkeyPatch,
    name: str,
    steps: int,
    width: int,
    levels: int,
) -> None:
    own = METHODS[name].adam
    if own is not None:  # a higher rate than the paper's, for a run that is a thousandth as long
        faster = replace(METHODS[name], adam=replace(own, rate=4e-3))
        monkeypatch.setitem(METHODS, name, faster)
    train_network(name, by_heart(name, steps, width, levels), one_view)
    network, _ = load_model(one_view.models / f"{name}.safetensors")
    example = next(Dataset(one_view.data / "dataset", "train").ordered())
    with torch.no_grad():
        predicted = to_image(network(encode([example])))
    assert ssim(tonemap(example["color"], example.exposure_shading), predicted) >= 0.98


class Watched:
    """Looks over an objective's shoulder: the last one made, and a batch it was given."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.objective: Any = None
        self.batch: Batch | None = None
        make = training._objective

        def watch(*arguments: Any) -> Objective:
            self.objective = make(*arguments)
            inner = self.objective.losses

            def losses(batch: Batch) -> Iterator[tuple[str, torch.Tensor]]:
                self.batch = batch
                return inner(batch)

            self.objective.losses = losses
            return self.objective

        monkeypatch.setattr(training, "_objective", watch)


@pytest.mark.check
def test_cyclegan_learns_the_way_there_and_back(
    one_view: Folders, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It promises no likeness to the truth, but that each cycle ends where it began."""
    watched = Watched(monkeypatch)
    faster = replace(METHODS["cyclegan_own"], adam=Adam(1e-3, (0.5, 0.999), "halfway"))
    monkeypatch.setitem(METHODS, "cyclegan_own", faster)
    train_network("cyclegan_own", by_heart("cyclegan_own", 300, 12, 2), one_view)
    cycles, batch = watched.objective, watched.batch
    assert batch is not None
    color = 2 * batch.truth - 1
    with torch.no_grad():
        returned = cycles._to_color(cycles._to_stack(color))
    assert (returned - color).abs().mean() < 0.3 * (color - color.mean()).abs().mean()
    assert ssim(to_image(batch.truth), to_image((returned + 1) / 2)) > 0.8
