"""Training studies: fair plans, exact resuming, results and their section of the report."""

import json
import shutil
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet as pq
import pytest
import torch

from pbrnet.model.baselines.end_to_end import EndToEnd
from pbrnet.model.data.encoding import Policy
from pbrnet.model.data.reader import Dataset
from pbrnet.model.evaluation.evaluate import LeakError, Score
from pbrnet.model.networks.build import build_network
from pbrnet.model.networks.pbrnet import Architecture
from pbrnet.model.studies.composition import composition_study
from pbrnet.model.studies.decomposition import decomposition_study
from pbrnet.model.studies.files import exclusive
from pbrnet.model.studies.loss import loss_study
from pbrnet.model.studies.table import table_study
from pbrnet.model.studies.trials.learning_curve import extrapolations, power_law
from pbrnet.model.studies.trials.plan import TrialConfig, TrialStudy, plan, subset
from pbrnet.model.studies.trials.results import MetricEstimate, TrialsResult, TrialsRow
from pbrnet.model.studies.trials.runs import Log, run, states
from pbrnet.model.studies.trials.scores import busiest_window, figures
from pbrnet.model.studies.trials.summary import run_and_summarise
from pbrnet.model.training.store import load_model
from pbrnet.model.training.train import Folders, train_network
from pbrnet.pipeline.images import read_picture
from pbrnet.pipeline.params import Params
from pbrnet.scenes.checked import build, plain
from pbrnet.scenes.errors import InputError, ParameterError
from pbrnet.scenes.files import read_json
from tests.fixtures.command import Run
from tests.fixtures.model import box_rows, write_shard
from tests.fixtures.study import report_in, result_in, section_of
from tests.fixtures.training import Killed, stop_at
from tests.fixtures.trial import PARAMS, SIZE, TRAIN, folders_in, trial_workplace

QUICK = TrialConfig(steps=2)


@pytest.fixture(scope="module")
def template(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A project that is only copied."""
    place = tmp_path_factory.mktemp("template")
    trial_workplace(place)
    return place


@pytest.fixture()
def workplace(template: Path, tmp_path: Path) -> Callable[[str], Folders]:
    """Function that returns a copy of the project with a name."""

    def make(name: str) -> Folders:
        root = tmp_path / name
        shutil.copytree(template, root)
        return folders_in(root)

    return make


@pytest.fixture()
def folders(workplace: Callable[[str], Folders]) -> Folders:
    return workplace("work")


def silent(_line: str) -> None:
    """Ignore a message."""


def run_all(
    study: TrialStudy, params: Params, folders: Folders, config: TrialConfig, log: Log = silent
) -> None:
    """Plan and run a study."""
    run_and_summarise(study, params.seed, folders, plan(study, params, folders, config), log)


# Training scenes


@pytest.mark.parametrize("seed", range(20))
def test_a_subset_never_splits_a_plan_and_lies_in_the_next(seed: int) -> None:
    counts = {"a-0": 3, "a-1": 2, "b-0": 4, "b-1": 1, "c-0": 2, "d-0": 5, "e": 1}
    previous: set[str] = set()
    for wanted in (1, 4, 9, 13, 18):
        scenes = subset(counts, TRAIN, wanted, seed)
        chosen = {TRAIN.get(scene, scene) for scene in scenes}
        whole = {scene for scene in counts if TRAIN.get(scene, scene) in chosen}
        assert set(scenes) == whole
        views = sum(counts[scene] for scene in scenes)
        largest = 5  # views of the largest plan
        assert wanted <= views < wanted + largest
        assert previous <= set(scenes)
        previous = set(scenes)
    assert previous == set(counts)


def test_seeds_draw_other_subsets() -> None:
    counts = {f"s{index}": 1 for index in range(8)}
    drawn = {subset(counts, {}, 4, seed) for seed in range(30)}
    assert len(drawn) > 15 and subset(counts, {}, 4, 0) == subset(counts, {}, 4, 0)


@pytest.mark.slow
def test_a_dataset_of_some_scenes_holds_those_alone(folders: Folders) -> None:
    whole = Dataset(folders.data / "dataset", "train")
    some = Dataset(folders.data / "dataset", "train", only=["a-1", "d-0"])
    assert len(some) == 4 and some.column("scene_id") == ["a-1", "a-1", "d-0", "d-0"]
    assert some.column("view_id") == ["v000", "v001"] * 2
    names = [example.name for example in some.ordered()]
    assert names == ["a-1/v000", "a-1/v001", "d-0/v000", "d-0/v001"]
    stream = some.shuffled(3)
    for _ in range(3):
        assert sorted(next(stream).name for _ in range(4)) == names
    stream, later = some.shuffled(3), some.shuffled(3, start=5)
    assert [next(stream).name for _ in range(9)][5:] == [next(later).name for _ in range(4)]
    theirs = {example.name: example for example in whole.ordered()}
    for example in some.ordered():
        assert np.array_equal(example["depth"], theirs[example.name]["depth"])
    others = {some.fingerprint(), whole.fingerprint()}
    others.add(Dataset(folders.data / "dataset", "train", only=["a-1", "c-0"]).fingerprint())
    assert len(others) == 3
    assert len(Dataset(folders.data / "dataset", "train", only=[])) == 0


# Plans


def test_trials_differ_in_what_is_compared_and_in_nothing_else(folders: Folders) -> None:
    trials = plan(loss_study(), PARAMS, folders, TrialConfig(seeds=2, steps=30))
    assert [trial.name for trial in trials] == [
        f"{kind}-{repeat}" for repeat in (0, 1) for kind in ("l1", "fifth", "full", "part")
    ]
    for trial in trials:
        kind = trial.name.split("-")[0]
        assert trial.params.train.loss.kind == kind
        same = replace(trial.params.train, loss=PARAMS.train.loss)
        other = replace(trials[0].params.train, loss=PARAMS.train.loss)
        assert same == other and trial.views == 12
        assert trial.steps == {"shading": 30, "composition": 30}
    assert [trial.params.seed for trial in trials[:4]] == [0] * 4
    assert len({trial.params.seed for trial in trials[4:]}) == 1 != trials[4].params.seed


def test_one_network_gets_the_steps_of_both_whatever_the_views(folders: Folders) -> None:
    study = decomposition_study(PARAMS.train.shading)
    trials = plan(study, PARAMS, folders, TrialConfig(views=(2, 12)))
    assert {trial.requested_views for trial in trials} == {2, 12}
    for trial in trials:
        wanted = {"two_stage": {"shading": 12, "composition": 12}}
        wanted |= {name: {name: 24} for name in ("end_to_end", "unet")}
        assert trial.steps == wanted[trial.variant.name]
    for index in (0, 3):  # all variants of a size learn from the same scenes
        assert len({trial.scenes for trial in trials[index : index + 3]}) == 1
    assert trials[0].views < trials[3].views == 12


@pytest.mark.parametrize("exposure", ["shared", "own"])
def test_the_decomposition_compares_the_same_layers(exposure: Policy) -> None:
    wide = replace(PARAMS.train.composition, width=9, levels=2)
    params = replace(PARAMS, train=replace(PARAMS.train, composition=wide))
    changes = decomposition_study(params.train.shading).variants[0].changes
    sizes = {
        name: (changes[f"train.{name}.width"], changes[f"train.{name}.levels"])
        for name in ("composition", "end_to_end", "unet")
    }
    assert sizes == {"composition": (4, 1), "end_to_end": (4, 3), "unet": (4, 3)}
    named = {"end_to_end": sizes["end_to_end"], "shading": (4, 3), "composition": (4, 1)}
    both, *apart = (
        build_network(Architecture(kind, *size, exposure=exposure)) for kind, size in named.items()
    )
    assert isinstance(both, EndToEnd)
    shapes = [[value.shape for value in net.state_dict().values()] for net in apart]
    assert [value.shape for value in both.shading.state_dict().values()] == shapes[0]
    assert [value.shape for value in both.composition.state_dict().values()] == shapes[1]


def test_sizes_that_come_to_the_same_scenes_are_trained_once(folders: Folders) -> None:
    study = decomposition_study(PARAMS.train.shading)
    trials = plan(study, PARAMS, folders, TrialConfig(views=(11, 12)))
    assert {trial.views for trial in trials} == {12} and len(trials) == 3


@pytest.mark.parametrize("views", [0, 13])
def test_more_views_than_there_are_cannot_be_asked_for(folders: Folders, views: int) -> None:
    study = decomposition_study(PARAMS.train.shading)
    with pytest.raises(ParameterError, match=rf"--views: {views} is not allowed; .* 12 views"):
        plan(study, PARAMS, folders, TrialConfig(views=(views,)))


# Training on colour only


def change_shading(data: Path) -> None:
    """Set every true shading of the training split to grey."""
    for path in sorted((data / "dataset").glob("train-*.parquet")):
        scenes = list(dict.fromkeys(pq.read_table(path, columns=["scene_id"])[0].to_pylist()))
        rows = box_rows(scenes, 2, "train", **SIZE)
        for row in rows:
            row["shading"] = np.full_like(row["shading"], 0.3)
        write_shard(path, rows, row_group=3)


def test_the_end_to_end_network_never_hears_of_the_true_shading(
    workplace: Callable[[str], Folders],
) -> None:
    """Other true shading changes the weights with supervision, and no bit without."""
    params = plan_params()
    places = [workplace(name) for name in ("a", "b")]
    change_shading(places[1].data)
    weights: dict[str, list[bytes]] = {}
    for name in ("end_to_end", "shading"):
        for place in places:
            train_network(name, params, place)
            path = place.models / f"{name}.safetensors"
            weights.setdefault(name, []).append(path.read_bytes())
    assert weights["end_to_end"][0] == weights["end_to_end"][1]
    assert weights["shading"][0] != weights["shading"][1]


def plan_params() -> Params:
    stage = replace(PARAMS.train.shading, epochs=1, steps_per_epoch=4)
    return replace(PARAMS, train=replace(PARAMS.train, end_to_end=stage, shading=stage))


@pytest.mark.parametrize("exposure", ["shared", "own"])
def test_the_gradient_of_colour_reaches_both_networks_also_out_of_range(exposure: Policy) -> None:
    torch.manual_seed(0)
    network = EndToEnd(Architecture("end_to_end", 4, 3, exposure=exposure))
    network.shading.unet.out.bias.data += 3  # beyond white everywhere
    given = {
        "depth": torch.rand(1, 2, 16, 16),
        "normal": torch.nn.functional.normalize(torch.rand(1, 3, 16, 16) - 0.5, dim=1),
        "reflectance": torch.rand(1, 3, 16, 16),
        "intensity": torch.rand(1, 1, 16, 32),
        "distance": torch.rand(1, 1, 16, 32),
    }
    seen: list[torch.Tensor] = []
    network.composition.register_forward_pre_hook(
        lambda _module, images: seen.append(images[0]["shading"])
    )
    (network(given) - 0.2).abs().sum().backward()
    assert float(seen[0].min()) >= -1 and float(seen[0].max()) <= 1  # as in two stages, centred
    for part in (network.shading, network.composition):
        assert all(value.grad is not None for value in part.parameters())
        assert sum(float(value.grad.abs().sum()) for value in part.parameters()) > 0


# Resuming


@pytest.mark.slow
def test_finished_trials_are_kept_and_the_stopped_one_goes_on(
    workplace: Callable[[str], Folders], monkeypatch: pytest.MonkeyPatch
) -> None:
    study, config = loss_study(), TrialConfig(steps=3)
    undisturbed, stopped = workplace("a"), workplace("b")
    run_all(study, PARAMS, undisturbed, config)
    with monkeypatch.context() as context:
        # 6 steps a trial: the second is stopped in its composition network's last step
        steps = stop_at(context, 12)
        with pytest.raises(Killed):
            run_all(study, PARAMS, stopped, config)
        assert steps() == 12
    assert not (stopped.metrics / "studies" / "loss.json").exists()
    said: list[str] = []
    with monkeypatch.context() as context:
        steps = stop_at(context, 10**9)
        run_all(study, PARAMS, stopped, config, said.append)
        # only the step after the last checkpoint, then both networks of two more trials
        assert steps() == 1 + 12
    assert [line.split(": ")[-1] for line in said][:1] == ["kept"]
    for name in ("loss.json", "loss.png", "loss/fifth-0/composition.safetensors"):
        ours, theirs = (f.metrics / "studies" / name for f in (stopped, undisturbed))
        assert ours.read_bytes() == theirs.read_bytes(), name


def test_a_trial_of_another_process_is_waited_for_after_all_others(folders: Folders) -> None:
    trials = plan(loss_study(), PARAMS, folders, TrialConfig(steps=1))
    said: list[str] = []
    with ExitStack() as other:
        lock = folders.metrics / "studies" / "loss" / f".{trials[1].name}.lock"
        assert other.enter_context(exclusive(lock, wait=False))

        def log(line: str) -> None:
            said.append(line)
            if trials[-1].name in line:  # the other process is killed
                other.close()

        records = run(loss_study(), trials, folders, log)
    order = [line.split(", ")[1].split(": ") for line in said]
    first, taken, *others = (trial.name for trial in trials)
    assert [name for name, _ in order] == [first, taken, *others, taken]
    assert order[1] == [taken, "taken by another process"]
    assert all(set(record.trained) == {"shading", "composition"} for record in records)


def test_what_another_study_trained_alike_is_copied(
    folders: Folders, monkeypatch: pytest.MonkeyPatch
) -> None:
    loss, table, config = loss_study(), table_study(["can"]), TrialConfig(steps=1)
    run_all(table, PARAMS, folders, config)
    assert states(loss, plan(loss, PARAMS, folders, config), folders) == [*["train"] * 3, "copy"]
    with monkeypatch.context() as context:
        steps = stop_at(context, 10**9)
        said: list[str] = []
        run_all(loss, PARAMS, folders, config, said.append)
        assert steps() == 2 * (len(loss.variants) - 1)  # two networks of all variants but `part`
    studies = folders.metrics / "studies"
    assert [line for line in said if "as in" in line] == [
        f"{network}: as in table/pbrnet-0" for network in ("shading", "composition")
    ]
    for name in ("shading.safetensors", "composition.json", "train_composition.csv"):
        ours, theirs = studies / "loss" / "part-0" / name, studies / "table" / "pbrnet-0" / name
        assert ours.read_bytes() == theirs.read_bytes(), name
    # another seed or size is another training
    with monkeypatch.context() as context:
        steps = stop_at(context, 10**9)
        run_all(composition_study(), replace(PARAMS, seed=PARAMS.seed + 1), folders, config)
        assert steps() == 2 * 2


@pytest.mark.slow
def test_what_is_done_is_not_done_again_until_something_changes(
    folders: Folders, monkeypatch: pytest.MonkeyPatch
) -> None:
    study = composition_study()

    def steps_of(params: Params, config: TrialConfig = QUICK) -> int:
        with monkeypatch.context() as context:
            steps = stop_at(context, 10**9)
            run_all(study, params, folders, config)
            return steps()

    assert steps_of(PARAMS) == 2 * 4
    first = (folders.metrics / "studies" / "composition.json").read_bytes()
    assert steps_of(PARAMS) == 0
    assert (folders.metrics / "studies" / "composition.json").read_bytes() == first
    # what no weight depends on
    other = replace(
        PARAMS, train=replace(PARAMS.train, checkpoint_steps=7, unet=plan_params().train.shading)
    )
    assert steps_of(other) == 0
    # another split is measured, not trained for
    measured = replace(PARAMS, evaluate=replace(PARAMS.evaluate, split="train"))
    assert steps_of(measured) == 0
    result = read_json(folders.metrics / "studies" / "composition.json")
    assert result["split"] == "train" and result["views"] == 12
    assert steps_of(PARAMS, TrialConfig(steps=1)) == 2 * 2
    faster = replace(PARAMS, train=replace(PARAMS.train, learning_rate=2e-3))
    assert steps_of(faster) == 2 * 4
    change_shading(folders.data)
    assert steps_of(faster) == 2 * 4


def test_a_record_that_cannot_be_read_stops_the_study(folders: Folders) -> None:
    place = folders.metrics / "studies" / "composition" / "shared-0"
    place.mkdir(parents=True)
    (place / "trial.json").write_text('{"fingerprint": 3}')
    with pytest.raises(InputError, match=r"trial\.json\.fingerprint.*; delete .*shared-0 to train"):
        run_all(composition_study(), PARAMS, folders, QUICK)


def test_what_was_trained_on_is_not_measured(folders: Folders) -> None:
    table = (folders.data / "dataset" / "scenes.csv").read_text()
    (folders.data / "dataset" / "scenes.csv").write_text(table.replace("t-0,t", "t-0,a"))
    with pytest.raises(LeakError, match="'t-0' has the floor plan 'a'"):
        run_all(composition_study(), PARAMS, folders, QUICK)


# Results


def row(scene: str, view: int, value: float) -> Score:
    values: dict[str, float | None] = dict.fromkeys(("psnr", "flip", "lpips", "detail", "grid"))
    return Score(scene, f"v{view}", "m", {"ssim": value, **values})


def test_figures_are_those_worked_out_by_hand() -> None:
    """With two scenes, resampled means are those of either scene twice, or of both."""
    ours = [[row("a", 0, 0.2), row("a", 1, 0.4), row("b", 0, 0.9)]]
    ours.append([row("a", 0, 0.4), row("a", 1, 0.6), row("b", 0, 0.7)])
    theirs = [[row("a", 0, 0.1), row("a", 1, 0.3), row("b", 0, 1.0)]] * 2
    found = figures(ours, theirs, 0, "loss")
    ssim = found["ssim"]
    # by view 0.3, 0.5 and 0.8; repeats' means 0.5 and 1.7 / 3
    assert ssim.mean == pytest.approx(1.6 / 3)
    assert (ssim.low, ssim.high) == pytest.approx((0.4, 0.8))
    assert ssim.spread == pytest.approx((1.7 / 3 - 0.5) / np.sqrt(2))
    # differences 0.2, 0.2 and -0.2
    assert ssim.gain == pytest.approx(0.2 / 3)
    assert (ssim.gain_low, ssim.gain_high) == pytest.approx((-0.2, 0.2))
    assert found["psnr"] is None
    alone = figures([[row("a", 0, 0.2)]], None, 0, "loss")["ssim"]
    assert (alone.mean, alone.low, alone.spread, alone.gain) == (0.2, None, None, None)


def test_the_sheet_is_cut_where_there_is_most_to_see() -> None:
    picture = np.full((40, 60, 3), 90, np.uint8)
    picture[24:34:2, 38:52] = 200
    rows, columns = busiest_window(picture, 0.5)
    assert (rows.stop - rows.start, columns.stop - columns.start) == (20, 30)
    assert rows.start <= 24 and rows.stop >= 33 and columns.start <= 38 and columns.stop >= 52
    assert busiest_window(picture, 1.0) == (slice(0, 40), slice(0, 60))


def test_loss_from_the_command_to_the_report(run: Run, folders: Folders) -> None:
    code, words, errors = run("loss", "--steps", 2, "--dry-run")
    assert code == 0, errors
    assert "part-0   train    12 views, shading 2, composition 2, time unknown" in words
    assert "4 trials, at least" in words and not folders.metrics.exists()

    code, words, errors = run("loss", "--steps", 2)
    assert code == 0, errors
    assert "study loss: trial 3 of 4, full-0: 12 views, 4 steps" in errors
    assert "4 views of 2 test scenes" in words
    target = folders.metrics / "studies" / "loss.json"
    result = result_in(folders.metrics, "loss", TrialsResult)
    rows = {row.label: row for row in result.rows}
    assert list(rows) == ["l1", "fifth", "full", "part", "truth"]
    assert (result.reference, result.backbone, result.repeats) == ("part", "efficientnet_lite0", 1)
    for label in ("l1", "fifth", "full", "part"):
        metrics = rows[label].metrics
        assert metrics["ssim"] and metrics["flip"] and metrics["detail"] and metrics["grid"]
        assert metrics["lpips"] is None and rows[label].steps == 4 and rows[label].views == 12
        assert (metrics["ssim"].gain is None) == (label == "part")
    truth = rows["truth"].metrics
    assert truth["ssim"] is None and truth["detail"] and truth["detail"].mean == 0
    # the means are those of the views' own scores
    record = read_json(folders.metrics / "studies" / "loss" / "full-0" / "trial.json")
    ssims = [row["values"]["ssim"] for row in record["scores"] if row["method"] == "pbrnet"]
    figure = rows["full"].metrics["ssim"]
    assert figure and len(ssims) == 4 and figure.mean == pytest.approx(np.mean(ssims))
    picture = read_picture(target.with_suffix(".png").read_bytes())
    assert picture.shape[1] == 6 + 5 * (320 + 6)  # truth and four losses, 20 pixels times 16

    code, words, _ = run("loss", "--steps", 2, "--dry-run")
    assert code == 0 and words.count("kept") == 4 and "about 0 s of training left" in words
    page, _ = report_in(folders.data.parent, PARAMS)
    section = section_of(page, "loss")
    assert f"{figure.mean:.3f}" in section and "data:image/png" in section
    assert "Part-perceptual" in section and 'href="#study-loss"' in page


@pytest.mark.slow
def test_decomposition_draws_its_curve(run: Run, folders: Folders) -> None:
    arguments = ("--steps", 1, "--views", 2, "--views", 12, "--seeds", 2, "--method", "can")
    code, _, errors = run("decomposition", *arguments)
    assert code == 0, errors
    result = read_json(folders.metrics / "studies" / "decomposition.json")
    assert [(row["group"], row["label"]) for row in result["rows"]] == [
        (group, label)
        for group in ("at least 2 views", "at least 12 views")
        for label in ("two_stage", "end_to_end", "unet", "can", "truth")
    ]
    assert [note.partition(":")[0] for note in result["notes"]] == [
        "two_stage", "end_to_end", "unet", "can"
    ]  # fmt: skip
    assert all(note.endswith("with 120 views (no measurement)") for note in result["notes"])
    assert result["repeats"] == 2
    spreads = [row["metrics"]["flip"]["spread"] for row in result["rows"] if row["steps"]]
    assert len(spreads) == 8 and min(spreads) > 0
    names = {path.parent.name for path in (folders.metrics / "studies").glob("*/*/trial.json")}
    assert len(names) == 16 and {"unet-2-0", "end_to_end-12-1", "can-12-1"} < names
    _, card = load_model(
        folders.metrics / "studies" / "decomposition" / "end_to_end-2-0" / "end_to_end.safetensors"
    )
    assert card.data.views < 12 and card.training["steps"] == 2
    page, _ = report_in(folders.data.parent, PARAMS)
    section = section_of(page, "decomposition")
    assert "by number of training views" in section and section.count("<svg") == 2


def test_a_power_law_is_found_again_and_promises_its_value() -> None:
    views = (50.0, 100.0, 400.0)
    errors = tuple(0.8 * size**-0.25 for size in views)
    assert power_law(views, errors) == pytest.approx((0.8, 0.25))
    with pytest.raises(ValueError, match="two sizes"):
        power_law((50.0, 50.0), (0.5, 0.4))

    def row(label: str, size: float | None, error: float | None) -> TrialsRow:
        figure = (
            None if error is None else MetricEstimate(error, None, None, None, None, None, None)
        )
        return TrialsRow(label, f"{size}", size, 1, {"flip": figure})

    rows = [row("unet", *point) for point in zip(views, errors, strict=True)]
    (sentence,) = extrapolations([row("truth", None, 0.0), *rows, row("can", 50.0, 0.5)])
    assert "-15.9 % with every doubling" in sentence  # 2 ** -0.25
    assert f"gives {0.8 * 4000**-0.25:.3f} with 4000 views" in sentence


def test_composition_has_products_under_both_policies(run: Run, folders: Folders) -> None:
    code, _, errors = run("composition", "--steps", 1)
    assert code == 0, errors
    rows = read_json(folders.metrics / "studies" / "composition.json")["rows"]
    for policy in ("shared", "own"):
        labels = [row["label"] for row in rows if row["group"] == f"{policy} exposure"]
        assert labels == ["network", "product", "product_linear", "ceiling", "truth"]
        card = read_json(
            folders.metrics / "studies" / "composition" / f"{policy}-0" / "composition.json"
        )
        assert card["exposure"] == policy
        psnr = {
            row["label"]: row["metrics"]["psnr"]["mean"]
            for row in rows
            if row["group"] == f"{policy} exposure" and row["metrics"]["psnr"]
        }
        # box rooms are matte: with the true shading, the product is the truth but for what is white
        others = ("network", "product", "product_linear")
        assert psnr["ceiling"] > max(psnr[label] for label in others)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda r: r.update(rows=r["rows"][:-2]), "lacks 'part'"),
        (lambda r: r["rows"].append(r["rows"][0]), "a label twice"),
        (lambda r: r["rows"][0]["metrics"]["ssim"].update(mean="high"), "expected a number"),
        (lambda r: r.update(repeats=0), "at least 1"),
    ],
)
def test_the_report_notes_a_damaged_result(
    folders: Folders, change: Callable[[Any], Any], words: str
) -> None:
    figure = {"mean": 0.5, "low": None, "high": None}
    figure |= {"spread": None, "gain": None, "gain_low": None, "gain_high": None}
    rows = [
        {"label": label, "group": "", "views": 2, "steps": 4, "metrics": {"ssim": dict(figure)}}
        for label in ("l1", "part", "truth")
    ]
    content = {"study": "loss", "seed": 0, "repeats": 1, "split": "test", "views": 4, "scenes": 2}
    content |= {"backbone": "none", "reference": "part", "rows": rows}
    path = folders.metrics / "studies" / "loss.json"
    path.parent.mkdir(parents=True)
    path.write_text(json.dumps(plain(build(TrialsResult, content))))
    assert 'id="study-loss"' in report_in(folders.data.parent, PARAMS)[0]
    change(content)
    path.write_text(json.dumps(content))
    page, notes = report_in(folders.data.parent, PARAMS)
    assert 'id="study-loss"' not in page
    assert any(words in note and "pbrnet study loss" in note for note in notes), notes


@pytest.mark.parametrize(
    ("arguments", "code", "words"),
    [
        (("loss", "--steps", 0), 2, "--steps"),
        (("loss", "--seeds", 0), 2, "--seeds"),
        (("loss", "--views", 3), 2, "--views"),
        (("decomposition", "--views", 99), 2, "--views: 99 is not allowed"),
        (("composition", "--seed", -1), 2, "--seed"),
        (("loss", "--data", "nowhere"), 3, "no dataset shards here"),
        (("loss", "--models", "nowhere"), 3, "backbone.json: no such file"),
    ],
)
def test_what_cannot_be_done_is_said(
    run: Run, folders: Folders, arguments: tuple[object, ...], code: int, words: str
) -> None:
    ended, _, errors = run(*arguments)
    assert ended == code and words in errors, errors
    assert not folders.metrics.exists()
