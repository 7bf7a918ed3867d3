"""Generalisation study: division by plan, fine-tuning from trained networks, specular masks."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from pbrnet.model.data.reader import Dataset, Example
from pbrnet.model.studies.generalisation import divide
from pbrnet.model.studies.trials.results import TrialsResult
from pbrnet.model.studies.trials.specular import measure_apart, specular_mask
from pbrnet.model.training.train import Folders
from pbrnet.scenes.errors import InputError
from pbrnet.scenes.files import digest_file, read_json
from tests.fixtures.command import Run
from tests.fixtures.model import box_rows, made_example, write_shard
from tests.fixtures.study import report_in, result_in, section_of
from tests.fixtures.training import stop_at
from tests.fixtures.trial import PARAMS, SIZE, SMALL, folders_in, trial_workplace

TINY = replace(SMALL, levels=2)
QUICK = replace(
    PARAMS,
    train=replace(
        PARAMS.train, loss=replace(PARAMS.train.loss, kind="l1"), shading=TINY, composition=TINY
    ),
)
PLANS = {"v-0": "v", "v-1": "v", "w-0": "w", "x-0": "x", "y-0": "y"}
GLOSS = slice(8, 20), slice(10, 26)  # rows and columns of a specular reflection


@pytest.fixture()
def folders(tmp_path: Path) -> Folders:
    """The workplace of the trials, and beside it `other`, a dataset of glossy rooms."""
    trial_workplace(tmp_path / "home", QUICK)
    for split, names in (("train", ["v-0", "v-1", "w-0"]), ("test", ["x-0", "y-0"])):
        rows = box_rows(names, 2, split, **SIZE)
        for row in rows:
            row["color"][GLOSS] = 4 * float(row["shading"].astype(np.float32).mean())
        path = tmp_path / "other" / "dataset" / f"{split}-00000-of-00001.parquet"
        write_shard(path, rows, row_group=3)
    lines = ["scene_id,plan", *(f"{scene},{plan}" for scene, plan in PLANS.items())]
    (tmp_path / "other" / "dataset" / "scenes.csv").write_text("\n".join(lines))
    return folders_in(tmp_path / "home")


# Division


@pytest.mark.parametrize("seed", range(10))
@pytest.mark.parametrize("wanted", [1, 3, 99])
def test_plans_are_never_split_and_half_of_them_are_tested_on(seed: int, wanted: int) -> None:
    views = {"v-0": 2, "v-1": 3, "w-0": 1, "x-0": 2, "y-0": 4, "z": 2}
    found = divide(views, PLANS, wanted, seed, "there")
    assert set(found.tuning) | set(found.testing) == set(views)
    plans = [{PLANS.get(scene, scene) for scene in part} for part in (found.tuning, found.testing)]
    assert not plans[0] & plans[1]
    assert 1 <= len(plans[0]) <= 2 and len(plans[0]) + len(plans[1]) == 5
    assert found.tuning_views == sum(views[scene] for scene in found.tuning)
    assert found.tuning_views + found.testing_views == sum(views.values())
    if wanted == 1:
        assert len(plans[0]) == 1
    if wanted == 99:
        assert len(plans[0]) == 2, "no more than there are to test on"


def test_one_plan_cannot_be_divided() -> None:
    with pytest.raises(InputError, match="there: only one floor plan, 'v'"):
        divide({"v-0": 2, "v-1": 3}, PLANS, 1, 0, "there")


# Specular masks


def matte_view() -> Example:
    """Return a view of an analytic box room; its colour is exactly the product."""
    row = box_rows(["a"], 1, "train", width=80, height=60, panorama=16)[0]
    images = {
        name: row[name].astype(np.float32) for name in ("depth", "normal", "reflectance", "shading")
    }
    dark = np.zeros((16, 32), np.float32)
    color = 2 * images["reflectance"] * images["shading"]
    valid = np.ones(row["depth"].shape, bool)
    return made_example(row["K"].reshape(3, 3), valid=valid, color=color, intensity=dark, **images)


def test_a_mirror_is_found_and_nothing_else() -> None:
    view = matte_view()
    assert not specular_mask(view, 0.5).any()
    mirror = np.zeros(view["valid"].shape, bool)
    mirror[20:34, 10:30] = True
    level = float(view["shading"].mean())
    mirrored = np.where(mirror[..., None], np.float32(8 * level), view["color"])
    assert np.array_equal(specular_mask(view.having(color=mirrored), 0.5), mirror)
    dark = np.where(mirror[..., None], view["color"] / 4, view["color"])
    assert np.array_equal(specular_mask(view.having(color=dark), 0.5), mirror)
    # another grey of the shading, the same room
    other = view.having(color=mirrored, shading=1.5 * view["shading"])
    assert np.array_equal(specular_mask(other, 0.75), mirror)


def test_what_is_no_gloss_is_left_out() -> None:
    view = matte_view()
    height, width = view["valid"].shape
    # indirect light: twice as bright at one end of the view as at the other
    slope = np.linspace(0.8, 1.6, width, dtype=np.float32)[None, :, None]
    assert specular_mask(view.having(color=slope * view["color"]), 0.5).mean() < 0.02
    # silhouettes: one pixel of another colour
    edges = view["color"].copy()
    edges[:, 40], edges[30, :] = 5 * edges[:, 40], edges[30, :] / 5
    assert not specular_mask(view.having(color=edges), 0.5).any()
    # a lamp in front, which the panorama has; otherwise it would count as specular
    lamp = np.zeros((height, width), bool)
    lamp[25:35, 34:46] = True
    lit = view.having(color=np.where(lamp[..., None], np.float32(30.0), view["color"]))
    assert np.array_equal(specular_mask(lit, 0.5), lamp)
    light = np.zeros((80, 160), np.float32)
    light[35:45, 75:85] = 30.0
    assert not specular_mask(lit.having(intensity=light), 0.5).any()
    elsewhere = lit.having(intensity=np.roll(light, 80, axis=1))
    assert np.array_equal(specular_mask(elsewhere, 0.5), lamp)
    # the sky outside a window, where there is no surface
    assert not specular_mask(lit.having(valid=~lamp), 0.5).any()


def test_regions_are_measured_by_themselves() -> None:
    truth = np.full((20, 30, 3), 0.5, np.float32)
    mask = np.zeros((20, 30), bool)
    mask[4:10, 5:15] = True
    image = np.where(mask[..., None], truth + np.float32(0.1), truth)
    found = measure_apart(truth, image, mask)
    assert found["specular_psnr"] == pytest.approx(20, abs=1e-3) and found["matte_psnr"] == 100
    assert found["specular_flip"] > found["matte_flip"] >= 0  # type: ignore[operator]
    mask[:] = False
    found = measure_apart(truth, image, mask)
    assert found["specular_psnr"] is None and found["specular_flip"] is None
    assert found["matte_psnr"] == pytest.approx(20 + 10 * np.log10(10), abs=1e-3)


# From the command to the report


@pytest.mark.slow
def test_another_folder_from_the_command_to_the_report(
    run: Run, folders: Folders, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked = ("--other", "../other", "--views", 3, "--steps", 4, "--tuning-steps", 2)
    code, words, errors = run("generalisation", *asked, "--dry-run")
    assert code == 0, errors
    assert words.count("train   ") == 3 and not folders.metrics.exists()
    code, words, errors = run("generalisation", *asked)
    assert code == 0, errors
    result = result_in(folders.metrics, "generalisation", TrialsResult)
    rows = {row.label: row for row in result.rows}
    assert list(rows) == [
        *("before", "before, product", "ceiling", "tuned", "tuned, product"),
        *("alone", "alone, product", "truth"),
    ]
    studies = folders.metrics / "studies" / "generalisation"
    cards = {
        name: read_json(studies / f"{name}-0" / "composition.json")
        for name in ("before", "tuned", "alone")
    }
    assert {name: card["training"]["steps"] for name, card in cards.items()} == {
        "before": 4,
        "tuned": 2,
        "alone": 6,
    }
    for name in ("shading", "composition"):
        tuned = read_json(studies / "tuned-0" / f"{name}.json")
        first = digest_file(studies / "before-0" / f"{name}.safetensors")
        assert tuned["training"]["started_from"] == first
    assert cards["alone"]["training"]["started_from"] is None
    assert cards["before"]["data"]["views"] == 12
    # training scenes are not tested
    scores = read_json(studies / "tuned-0" / "trial.json")["scores"]
    measured = {row["scene_id"] for row in scores}
    tuned_on = set(cards["tuned"]["data"]["scenes"])
    assert measured | tuned_on == set(PLANS) and not measured & tuned_on
    assert cards["tuned"]["data"]["views"] >= 3
    assert f"tuned on {cards['tuned']['data']['views']} views" in result.notes[0]
    assert result.notes[0] in words
    # no product can represent a specular reflection, not even that of the true shading
    ceiling = rows["ceiling"].metrics
    assert ceiling["specular_flip"] and ceiling["matte_flip"]
    assert ceiling["specular_flip"].mean > 2 * ceiling["matte_flip"].mean
    assert rows["tuned"].metrics["flip"].gain is not None  # type: ignore[union-attr]
    assert rows["ceiling"].steps is None and rows["tuned, product"].steps == 2

    section = section_of(report_in(folders.data.parent, QUICK)[0], "generalisation")
    assert "Fine-tuned on the source" in section and result.notes[0] in section
    assert "specular" in section

    steps = stop_at(monkeypatch, 10**9)
    assert run("generalisation", *asked)[0] == 0 and steps() == 0
    # another first training: its fine-tuning is repeated, other trainings are kept
    again = ("--other", "../other", "--views", 3, "--steps", 3, "--tuning-steps", 2)
    assert run("generalisation", *again)[0] == 0
    assert steps() == 2 * 3 + 2 * 2 + 2 * 5
    before = studies / "before-0" / "shading.safetensors"
    before.unlink()
    (studies / "tuned-0" / "trial.json").unlink()
    code, _, errors = run("generalisation", *again)
    assert code == 3 and "no such model, but tuned-0 fine-tunes it" in errors


def test_a_source_within_the_dataset_is_not_trained_on(run: Run, folders: Folders) -> None:
    """`a` and `b` are training plans, `t` a test plan; a scene stands for its whole plan."""
    asked = ("--source", "[abt]*0", "--views", 1, "--steps", 1, "--tuning-steps", 1)
    code, _, errors = run("generalisation", *asked)
    assert code == 0, errors
    studies = folders.metrics / "studies" / "generalisation"
    before, tuned = (
        read_json(studies / f"{name}-0" / "shading.json")["data"] for name in ("before", "tuned")
    )
    assert before["scenes"] == ["c-0", "d-0"]
    measured = {row["scene_id"] for row in read_json(studies / "before-0" / "trial.json")["scores"]}
    assert measured | set(tuned["scenes"]) == {"a-0", "a-1", "b-0", "b-1", "t-0"}
    assert len(tuned["plans"]) == 1 and not measured & set(tuned["scenes"])
    result = result_in(folders.metrics, "generalisation", TrialsResult)
    assert result.scenes == len(measured)
    gloss = next(row for row in result.rows if row.label == "ceiling").metrics
    assert gloss.get("specular_flip") is None, "box rooms are matte"
    test = Dataset(next((folders.data / "studies").rglob("test-*.parquet")).parent, "test")
    assert set(test.column("scene_id")) == measured


@pytest.mark.slow
@pytest.mark.parametrize(
    ("arguments", "code", "words"),
    [
        ((), 2, "--other FOLDER, --source PATTERN"),
        (("--source", "nothing-*"), 3, "no floor plan or scene is called 'nothing-*'"),
        (("--source", "a"), 3, "only one floor plan, 'a'"),
        (("--source", "[abcd]"), 3, "every training scene belongs to the source"),
        (("--other", "data"), 2, "--other data is DATA itself"),
        (("--other", "nowhere"), 3, "no dataset shards here"),
        (("--other", "../twin"), 3, "has the name of a training scene"),
    ],
)
def test_what_cannot_be_done_is_said(
    run: Run, folders: Folders, arguments: tuple[object, ...], code: int, words: str
) -> None:
    trial_workplace(folders.data.parent.parent / "twin-work", QUICK)
    (folders.data.parent.parent / "twin-work" / "data").rename(folders.data.parent.parent / "twin")
    ended, _, errors = run("generalisation", *arguments, "--steps", 1)
    assert ended == code and words in errors, errors
    assert not folders.metrics.exists()
