"""The cost model against ledgers whose costs are known."""

import json
from pathlib import Path

import numpy as np
import pytest

from pbrnet.pipeline.costs.forecast import (
    SCENE_STAGES,
    TOGETHER,
    VIEW_STAGES,
    StageCost,
    fit_costs,
    joined,
    typical_costs,
    view_size,
)
from pbrnet.pipeline.costs.ledger import Ledger, read_ledger
from pbrnet.pipeline.params import Params
from pbrnet.pipeline.passes.settings import NoisyParams
from pbrnet.pipeline.views import ImageParams
from pbrnet.scenes.errors import InputError
from tests.fixtures.command import exit_code, printed
from tests.fixtures.params import pbrs_params, plain_truth
from tests.fixtures.stages import write_room

OPEN, FIXED, RATE = 4.0, 0.6, 2e-6  # seconds a scene, a view, a sample


def measured(
    data: Path, scenes: int, sizes: tuple[tuple[int, int, int], ...], spread: float = 0.0
) -> None:
    """A ledger of eight views a scene; scenes differ by a lognormal factor."""
    random = np.random.default_rng(5)
    ledger = Ledger(data)
    for scene in range(scenes):
        name, factor = f"s{scene:03}", float(np.exp(random.normal(0, spread)))
        ledger.add(("scenes", name, ""), seconds=3.0, threads=1)
        for view in range(8):
            width, height, spp = sizes[view % len(sizes)]
            samples = width * height * spp
            seconds = factor * (FIXED + RATE * samples) + OPEN * (view == 0)
            for stage in ("shading", "color"):
                ledger.add(
                    (stage, name, f"{view:03}"),
                    seconds=seconds / 4,
                    first=view == 0,
                    threads=2,
                    width=width,
                    height=height,
                    spp=spp,
                )
    ledger.save()


def truth_of(data: Path) -> StageCost:
    return next(cost for cost in fit_costs(read_ledger(data))[0] if cost.stage == "truth")


def asked(data: Path, *words: str, params: str = "scenes: {homes: 10}\n") -> str:
    """Output of `pbrnet cost`."""
    (data / "params.yaml").write_text(params)
    return printed("cost", "--data", data, "--params", data / "params.yaml", *words)


def test_known_costs_are_found_again_and_scale(tmp_path: Path) -> None:
    measured(tmp_path, 6, ((160, 120, 16), (320, 240, 16), (160, 120, 64)))
    found, errors = fit_costs(read_ledger(tmp_path))
    costs = {cost.stage: cost for cost in found}
    truth = costs["truth"]
    assert truth.measured == 48
    assert all(error.worst < 1e-9 and error.scene < 1e-9 for error in errors.values())
    assert (truth.scene, truth.view, truth.sample) == pytest.approx((OPEN, FIXED, RATE))
    assert costs["scenes"].total(10, 80, 0) == pytest.approx(30)
    params = pbrs_params(image=ImageParams(480, 360), groundtruth=plain_truth(spp=256))
    samples = view_size(params).samples("truth")
    assert truth.total(5, 40, samples) == pytest.approx(
        5 * OPEN + 40 * (FIXED + RATE * 480 * 360 * 256)
    )


def test_a_second_folder_of_another_size_keeps_fixed_costs_apart(tmp_path: Path) -> None:
    """Scenes of the same names in both, as two releases have them."""
    for name, size in (("small", (160, 120, 16)), ("large", (320, 240, 16))):
        (tmp_path / name).mkdir()
        measured(tmp_path / name, 6, (size,))
    words = ["--json", "--scenes", "5", "--views", "40", "--size", "480x360"]
    both = asked(tmp_path / "small", "--also", str(tmp_path / "large"), *words)
    spp = Params().groundtruth.spp
    true = 5 * OPEN + 40 * (FIXED + RATE * 480 * 360 * spp)
    assert 3600 * json.loads(both)["stages"]["truth"] == pytest.approx(true)
    alone = json.loads(asked(tmp_path / "small", *words))
    assert 3600 * alone["stages"]["truth"] > 1.2 * true


def test_one_size_grows_in_proportion(tmp_path: Path) -> None:
    measured(tmp_path, 6, ((160, 120, 16),))
    truth = truth_of(tmp_path)
    assert truth.view == 0
    assert truth.sample * 160 * 120 * 16 == pytest.approx(FIXED + RATE * 160 * 120 * 16)


def test_scenes_that_differ_are_predicted_within_a_fifth(tmp_path: Path) -> None:
    """Scenes whose rates differ by a third: the total of unseen ones, and what is said of it."""
    measured(tmp_path, 60, ((160, 120, 16), (160, 120, 64)), spread=0.33)
    error = fit_costs(read_ledger(tmp_path))[1]["truth"]
    assert 0.01 < error.usual < 0.1 < error.worst < 0.2
    assert 0.15 < error.scene < 0.35, "the median of |exp(0.33 z) - 1| is 0.22"
    half = read_ledger(tmp_path).filter(
        np.array([int(row["scene_id"][1:]) % 2 == 0 for row in read_ledger(tmp_path).to_pylist()])
    )
    fit = next(cost for cost in fit_costs(half)[0] if cost.stage == "truth")
    rest = [row for row in read_ledger(tmp_path).to_pylist() if int(row["scene_id"][1:]) % 2]
    actual = sum(2 * row["seconds"] for row in rest if row["stage"] != "scenes")
    sizes = (160 * 120 * 16, 160 * 120 * 64)
    predicted = sum(fit.total(0, 120, size) for size in sizes) + 30 * fit.scene
    assert predicted == pytest.approx(actual, rel=0.2)


def test_the_command_says_core_hours(tmp_path: Path) -> None:
    measured(tmp_path / "data", 6, ((160, 120, 16), (320, 240, 16)))
    (tmp_path / "params.yaml").write_text(
        "image: {width: 160, height: 120}\n"
        "scenes: {homes: 10}\ncameras: {views_per_scene: 5}\n"
        "groundtruth: {spp: 64}\n"
    )
    words = ["cost", "--data", str(tmp_path / "data"), "--params", str(tmp_path / "params.yaml")]
    facts = json.loads(printed(*words, "--json"))
    assert (facts["scenes"], facts["views"]) == (10, 50)
    truth = 10 * OPEN + 50 * (FIXED + RATE * 160 * 120 * 64)
    assert facts["core_hours"] * 3600 == pytest.approx(truth + 10 * 3.0)
    assert facts["relative_error"] < 1e-6
    said = printed(*words, "--views", "500000", "--cores", "1000")
    assert "500,000 views of 100,000 scenes, 160x120" in said
    assert "on 1,000 cores: " in said
    linked = "{walks: 2, walk_frames: 30, stereo_baseline: 0.1, overlap_views: 3}"
    (tmp_path / "params.yaml").write_text(f"scenes: {{homes: 10}}\ncameras: {linked}\n")
    assert json.loads(printed(*words, "--json"))["views"] == 10 * 2 * (5 * 3 + 2 * 30)
    (tmp_path / "params.yaml").write_text("scenes: {homes: 0}\n")
    assert exit_code(*words) == 2, "there are no scenes"
    write_room(tmp_path / "data" / "scenes" / "alpha")
    write_room(tmp_path / "data" / "scenes" / "beta", source={"views": [{}, {}]})
    assert "12 views of 2 scenes, 160x120" in printed(*words), "two are stored in one of them"


def test_without_measured_views_there_is_no_estimate(tmp_path: Path) -> None:
    empty = joined([read_ledger(tmp_path), read_ledger(tmp_path)])
    with pytest.raises(InputError, match="no ground truth yet"):
        fit_costs(empty)
    measured(tmp_path, 2, ((160, 120, 16),))
    assert all(np.isnan(error.worst) for error in fit_costs(read_ledger(tmp_path))[1].values())
    assert "too few scenes" in asked(tmp_path, "--check")
    assert json.loads(asked(tmp_path, "--check", "--json"))["truth"]["worst"] is None


def test_without_a_ledger_costs_are_typical(tmp_path: Path) -> None:
    said = asked(tmp_path, params="scenes: {homes: 10}\nchannels: [all]\n")
    assert "about, on a typical core" in said and "not included" not in said
    found = {cost.stage for cost in typical_costs()}
    assert found == {*SCENE_STAGES, *VIEW_STAGES}
    some, more = (
        json.loads(
            asked(tmp_path, "--json", params=f"scenes: {{homes: 10}}\ngroundtruth: {{spp: {n}}}")
        )
        for n in (16, 64)
    )
    assert 0 < some["core_hours"] < more["core_hours"] < 4 * some["core_hours"]
    depth = json.loads(asked(tmp_path, "--json", params="scenes: {homes: 10}\nchannels: [depth]"))
    assert depth["stages"].keys() == {"scenes", "cameras", "inputs"}


def test_the_check_finds_a_law_that_unseen_scenes_do_not_follow(tmp_path: Path) -> None:
    """Half of the scenes cost twice as much, and nothing known beforehand tells which."""
    ledger = Ledger(tmp_path)
    for scene in range(40):
        for view in range(4):
            seconds = (2.0 if scene % 2 else 1.0) * (1 + (view == 0))
            for stage in ("shading", "color"):
                ledger.add(
                    (stage, f"s{scene:02}", f"{view}"),
                    seconds=seconds / 2, first=view == 0, threads=1,
                    width=160, height=120, spp=64,
                )  # fmt: skip
    ledger.save()
    error = fit_costs(read_ledger(tmp_path))[1]["truth"]
    # Of 40 such scenes, halves differ in their means by 2 / sqrt(40) of the 1/3 that scenes do.
    assert error.usual == pytest.approx(0.67 * 2 / 40**0.5 / 3, rel=0.5)
    # All cost 1.5: a third more than one kind costs, a quarter less than the other.
    assert 0.2 < error.scene < 0.55
    lines = asked(tmp_path, "--check").splitlines()
    assert [line.split()[0] for line in lines[2:]] == ["truth", TOGETHER]
    assert lines[2].split()[1:] == [
        f"{value:.1%}" for value in (error.usual, error.worst, error.scene)
    ]


def test_noisy_frames_count_where_they_are_asked_for(tmp_path: Path) -> None:
    measured(tmp_path, 6, ((160, 120, 16),))
    with_noisy = "scenes: {homes: 10}\nimage: {width: 160, height: 120}\nnoisy: {spp: 4}\n"
    assert "the ledger has no such frames yet" in asked(tmp_path, params=with_noisy)
    ledger = Ledger(tmp_path)
    for scene in range(6):
        ledger.add(
            ("noisy", f"s{scene:03}", "000"),
            seconds=2.0, first=False, threads=1, width=160, height=120, spp=4,
        )  # fmt: skip
    ledger.save()
    hours = json.loads(asked(tmp_path, "--json", "--views", "3600", params=with_noisy))["stages"]
    assert hours["noisy"] == pytest.approx(2.0)
    without = json.loads(asked(tmp_path, "--json", "--views", "3600"))["stages"]
    assert "noisy" not in without and without["truth"] > 0


def test_samples_of_a_plan_are_the_mean_over_its_splits() -> None:
    """A fifth is tested with 64 and 4 samples; training views have 16, and 1 or 2 drawn."""
    params = pbrs_params(
        image=ImageParams(20, 20),
        groundtruth=plain_truth(spp=64, train_spp=16),
        noisy=NoisyParams(spp=4, train=(1, 2)),
    )
    assert view_size(params).samples("truth") == pytest.approx(400 * (0.2 * 64 + 0.8 * 16))
    drawn = (np.log(2) + 2 * np.log(1.5)) / np.log(3)
    assert view_size(params).samples("noisy") == pytest.approx(400 * (0.2 * 4 + 0.8 * drawn))
    assert view_size(pbrs_params(image=params.image)).samples("truth") == 400 * plain_truth().spp


def test_a_view_whose_other_half_is_not_done_yet_does_not_count(tmp_path: Path) -> None:
    measured(tmp_path, 6, ((160, 120, 16),))
    before = truth_of(tmp_path)
    ledger = Ledger(tmp_path)
    ledger.add(
        ("shading", "s000", "extra"),
        seconds=0.001, first=False, threads=2, width=160, height=120, spp=16,
    )  # fmt: skip
    ledger.save()
    assert truth_of(tmp_path) == before


def test_a_plan_of_many_large_views_says_hours_and_bytes(tmp_path: Path) -> None:
    """Hypersim's number and size of views, from a ledger of small ones."""
    measured(tmp_path, 6, ((160, 120, 16), (320, 240, 16)))
    ledger = Ledger(tmp_path)
    for width, height in ((160, 120), (320, 240)):
        key = ("inputs", "s000", f"{width}")
        ledger.add(key, seconds=0.1, width=width, height=height, bytes=5 * width * height)
    ledger.save()
    words = ("--views", "75000", "--size", "1024x768")
    params = "groundtruth: {spp: 64}\ncameras: {views_per_scene: 5}\n"
    facts = json.loads(asked(tmp_path, *words, "--json", params=params))
    assert (facts["scenes"], facts["views"]) == (15_000, 75_000)
    truth = 15_000 * (OPEN + 3.0) + 75_000 * (FIXED + RATE * 1024 * 768 * 64)
    inputs = facts["stages"]["inputs"] * 3600
    assert facts["core_hours"] * 3600 == pytest.approx(truth + inputs)
    assert facts["frame_bytes"] == 75_000 * 5 * 1024 * 768
    shown = asked(tmp_path, *words, "--cores", "64", params=params)
    assert "75,000 views of 15,000 scenes, 1024x768" in shown
    assert "frames: at least 294.9 GB" in shown
    assert "color: not included" in shown and "color" in facts["not_included"]
    assert f"on 64 cores: {facts['core_hours'] / 64:.1f} hours" in shown
