"""Method table: equal budgets, several trainings, scores that can be recomputed."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from pbrnet.model.data.encoding import color_exposure
from pbrnet.model.data.reader import Dataset
from pbrnet.model.evaluation.metrics import psnr
from pbrnet.model.studies.table import table_study
from pbrnet.model.studies.trials.plan import TrialConfig, plan
from pbrnet.model.studies.trials.results import TrialsResult
from pbrnet.model.training.train import Folders
from pbrnet.pipeline.tonemap import tonemap
from tests.fixtures.command import Run
from tests.fixtures.study import report_in, result_in, section_of
from tests.fixtures.training import stop_at
from tests.fixtures.trial import PARAMS, SMALL, folders_in, trial_workplace

TINY = replace(SMALL, levels=2)
METHODS = ("unet", "plus", "hybrid")
TABLE = replace(
    PARAMS,
    train=replace(
        PARAMS.train,
        loss=replace(PARAMS.train.loss, kind="l1"),
        baselines=METHODS,
        shading=TINY,
        plus=TINY,
        hybrid=TINY,
        unet=TINY,
    ),
)


@pytest.fixture()
def folders(tmp_path: Path) -> Folders:
    """Twelve training and four test views, with noisy samples."""
    trial_workplace(tmp_path, TABLE, noisy=True)
    return folders_in(tmp_path)


@pytest.mark.slow
def test_every_method_has_the_same_views_and_steps(folders: Folders) -> None:
    trials = plan(table_study(METHODS), TABLE, folders, TrialConfig(seeds=3, steps=7, views=(4,)))
    assert len(trials) == 3 * 4
    for repeat in range(3):
        own = [trial for trial in trials if trial.repeat == repeat]
        assert [trial.variant.name for trial in own] == ["pbrnet", *METHODS]
        assert {sum(trial.steps.values()) for trial in own} == {14}
        assert len({trial.scenes for trial in own}) == 1
        assert 4 <= own[0].views < 12
        assert len({trial.params.seed for trial in own}) == 1
    assert len({trial.params.seed for trial in trials}) == 3
    labels = [label for v in table_study(METHODS).variants for label in v.methods.values()]
    assert labels == ["pbrnet", "product", "unet", "plus", "hybrid", "denoised"]


@pytest.mark.slow
def test_the_table_from_the_command_to_the_report(
    run: Run, folders: Folders, monkeypatch: pytest.MonkeyPatch
) -> None:
    code, words, errors = run("table", "--dry-run", "--steps", 1)
    assert code == 0, errors
    assert words.count("train   ") == 3 * 4, "three seeds unless told otherwise"
    code, words, errors = run(
        "table", "--steps", 1, "--seeds", 2, "--method", "unet", "--method", "hybrid"
    )
    assert code == 0, errors
    result = result_in(folders.metrics, "table", TrialsResult)
    assert (result.reference, result.repeats, result.views) == ("pbrnet", 2, 4)
    rows = {row.label: row for row in result.rows}
    assert list(rows) == ["pbrnet", "product", "unet", "hybrid", "denoised", "truth"]
    for label in ("pbrnet", "unet", "hybrid"):
        ssim = rows[label].metrics["ssim"]
        assert ssim and ssim.low is not None and ssim.spread, "other weights, other figures"
        assert f"±{ssim.spread:.3f}" in words
        assert rows[label].steps == 2 and rows[label].views == 12
    assert "standard deviation over 2 trainings" in words

    # scores without a network do not depend on the seed
    views = list(Dataset(folders.data / "dataset", "test", ("denoised_color",)).ordered())
    values = []
    for view in views:
        assert view["denoised_color"] is not None
        exposure = color_exposure(view, TABLE.train.exposure)
        values.append(
            psnr(tonemap(view["color"], exposure), tonemap(view["denoised_color"], exposure))
        )
    denoised = rows["denoised"].metrics["psnr"]
    assert denoised and denoised.mean == pytest.approx(np.mean(values)) and denoised.spread == 0
    assert rows["denoised"].views is None and rows["denoised"].steps is None

    section = section_of(report_in(folders.data.parent, TABLE)[0], "table")
    assert "One direct U-Net" in section and "standard deviation over the trainings" in section

    with monkeypatch.context() as context:
        steps = stop_at(context, 10**9)
        code, _, errors = run("table", "--steps", 1, "--seeds", 2, "--method", "unet")
        assert code == 0 and steps() == 0 and errors.count("kept") == 4


def test_a_method_that_lacks_its_samples_is_named(run: Run, folders: Folders) -> None:
    trial_workplace(folders.data.parent, TABLE, noisy=False)
    code, _, errors = run("table", "--steps", 1, "--seeds", 1, "--method", "hybrid")
    assert code == 3 and "noisy_color," in errors and "noisy.spp" in errors
    code, _, errors = run("table", "--method", "nothing")
    assert code == 2 and "nothing" in errors
