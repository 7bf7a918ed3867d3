"""Noisy frames: unbiased, independent of the ground truth, resumable, packed if requested.

Fingerprints of other frames and the other columns of the dataset do not depend on them.
"""

import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest

from pbrnet.pipeline.channels import TRUTHS
from pbrnet.pipeline.costs.ledger import read_ledger
from pbrnet.pipeline.dataset.pack import pack_dataset
from pbrnet.pipeline.dataset.parquet import images_of
from pbrnet.pipeline.farm.settings import FarmParams
from pbrnet.pipeline.frames import Channels, Frame, frame_path, read_frame
from pbrnet.pipeline.passes.denoise import denoiser_version
from pbrnet.pipeline.passes.registry import trace_seed
from pbrnet.pipeline.passes.settings import NoisyParams
from pbrnet.pipeline.passes.truth import noisy_trace, render_samples
from pbrnet.pipeline.render.scene import RenderScene, open_scene, set_variant
from pbrnet.pipeline.splits import SplitParams, split_sampling
from pbrnet.pipeline.stages.cameras import run_cameras
from pbrnet.pipeline.stages.frame_stage import run_frames
from pbrnet.pipeline.views import ImageParams, View
from pbrnet.scenes.contract import load_scene
from pbrnet.scenes.files import digest_folder
from pbrnet.scenes.seeds import derive
from tests.fixtures.dataset import box_frames, make_data, make_view, small_params, write_view
from tests.fixtures.in_process import worker_processes
from tests.fixtures.params import pbrs_cameras, pbrs_params, plain_truth
from tests.fixtures.stages import files_in, views_in, write_room
from tests.fixtures.traces import render

pytestmark = pytest.mark.slow

PARAMS = pbrs_params(
    image=ImageParams(32, 24),
    farm=FarmParams(workers=1, batch=2, retries=1),
    cameras=pbrs_cameras(views_per_room=2),
    groundtruth=plain_truth(spp=4, block_spp=2, max_depth=3),
    noisy=NoisyParams(spp=2),
)
TRACE = noisy_trace(PARAMS.groundtruth, PARAMS.noisy.spp)
WITHOUT = replace(PARAMS, noisy=NoisyParams())
MADE = ("shading", "color", "noisy")
SHADING = ("shading.R", "shading.G", "shading.B")
IMAGES = {
    "noisy_color": ("R", "G", "B"),
    "noisy_half": ("half.R", "half.G", "half.B"),
    "noisy_shading": SHADING,
    "denoised_color": ("denoised.R", "denoised.G", "denoised.B"),
    "denoised_shading": ("denoised.shading.R", "denoised.shading.G", "denoised.shading.B"),
}


@pytest.fixture(scope="module")
def finished(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two rooms with truths and noisy frames, made by two workers."""
    data = tmp_path_factory.mktemp("noisy") / "data"
    write_room(data / "scenes" / "alpha")
    write_room(data / "scenes" / "beta", size=(4.4, 3.2, 2.5))
    run_cameras(data, PARAMS)
    two = replace(PARAMS, farm=replace(PARAMS.farm, workers=2))
    with worker_processes():
        assert run_frames("groundtruth", data, two).made == 12
    return data


@pytest.fixture
def data(finished: Path, tmp_path: Path) -> Path:
    """A copy of the finished folder, to be changed."""
    shutil.copytree(finished, tmp_path / "data")
    return tmp_path / "data"


@pytest.fixture(scope="module")
def room(finished: Path) -> tuple[RenderScene, View]:
    """A room, opened, and a view of it."""
    set_variant()
    return open_scene(load_scene(finished / "scenes" / "alpha")), views_in(finished)[0]


def both(channels: dict[str, np.ndarray]) -> np.ndarray:
    """Colour and shading, float64 (H, W, 6)."""
    return np.stack([channels[name] for name in (*"RGB", *SHADING)], -1).astype(np.float64)


def traced(room: tuple[RenderScene, View], spp: int, seed: int) -> np.ndarray:
    params = replace(PARAMS, noisy=NoisyParams(spp=spp))
    return both(render(["noisy"], *room, params, seed)["noisy"][0])


def halves(channels: Channels) -> tuple[np.ndarray, np.ndarray]:
    """Colour of half of the samples and of all, float64 (H, W, 3)."""
    bands = IMAGES["noisy_half"], IMAGES["noisy_color"]
    half, whole = (np.stack([channels[name] for name in each], -1) for each in bands)
    return half.astype(np.float64), whole.astype(np.float64)


@pytest.mark.slow
def test_half_of_the_samples_tells_the_noise_of_all(room: tuple[RenderScene, View]) -> None:
    """Two halves a and b: whole - half is (b - a) / 2, whose variance is that of the whole."""
    seeds = range(12)
    apart = [halves(render_samples(*room, TRACE, seed)) for seed in seeds]
    wholes = np.stack([whole for _, whole in apart])
    told = np.mean([(whole - half) ** 2 for half, whole in apart])
    assert told == pytest.approx(wholes.var(axis=0, ddof=1).mean(), rel=0.35)


@pytest.mark.slow
def test_samples_for_a_picture_are_those_of_colour_alone(
    room: tuple[RenderScene, View], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Other samples than a frame's, of the same expectation, without a trace of shading."""
    frame = render(["noisy"], *room, PARAMS, 3)["noisy"][0]
    with monkeypatch.context() as patch:
        patch.setattr(
            "pbrnet.pipeline.passes.truth.render_both", lambda *_: pytest.fail("traces shading")
        )
        picture = render_samples(*room, TRACE, 3)
    shading = {*IMAGES["noisy_shading"], *IMAGES["denoised_shading"]}
    assert set(frame) - set(picture) == shading
    assert all(values.shape == frame[name].shape for name, values in picture.items())
    many = replace(PARAMS, noisy=NoisyParams(spp=8))
    means = np.stack(
        [
            [np.mean([channels[band].mean() for band in "RGB"]) for channels in (ours, theirs)]
            for ours, theirs in (
                (
                    render_samples(*room, noisy_trace(many.groundtruth, many.noisy.spp), seed),
                    render(["noisy"], *room, many, 50 + seed)["noisy"][0],
                )
                for seed in range(12)
            )
        ]
    )
    error = np.hypot(*means.std(axis=0, ddof=1)) / np.sqrt(len(means))
    assert error < 0.02 * means.mean()
    assert abs(np.subtract(*means.mean(axis=0))) < 4 * error


def truth_of(room: tuple[RenderScene, View], spp: int, seed: int) -> np.ndarray:
    settings = replace(PARAMS.groundtruth, spp=spp, block_spp=spp)
    found = render(TRUTHS, *room, replace(PARAMS, groundtruth=settings), seed)
    return np.concatenate(
        [Frame(found[kind][0], {}).rgb for kind in ("color", "shading")], axis=-1
    ).astype(np.float64)


@pytest.mark.slow
def test_noisy_frames_are_unbiased_and_have_nothing_of_the_truths_noise(
    room: tuple[RenderScene, View], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(
        "pbrnet.pipeline.passes.truth.denoise", lambda image, *_, **__: image
    )  # not looked at, and slow
    _, view = room
    seeds = {kind: trace_seed(kind, view, 0) for kind in ("noisy", "color", "shading")}
    assert seeds["color"] == seeds["shading"] != seeds["noisy"]
    settled = truth_of(room, 2048, derive(0, "settled"))
    images = np.stack([traced(room, 2, derive(k, "noisy")) for k in range(48)])
    means = images.mean(axis=(1, 2))
    error = means.std(axis=0, ddof=1) / np.sqrt(len(means))
    assert (error < 0.02 * settled.mean(axis=(0, 1))).all(), "a bias could hide"
    assert (abs(means.mean(axis=0) - settled.mean(axis=(0, 1))) < 4.5 * error).all()

    noisy = traced(room, 2, seeds["noisy"]) - settled
    truth = truth_of(room, 2, seeds["color"]) - settled
    own = traced(room, 2, seeds["color"]) - settled  # what the seed of its own is there to avoid
    chance = 4 / np.sqrt(view.width * view.height)
    for channel in range(6):
        alike = [
            np.corrcoef(image[..., channel].ravel(), truth[..., channel].ravel())[0, 1]
            for image in (noisy, own)
        ]
        assert abs(alike[0]) < chance
        assert alike[1] > 0.99, "of the truth's own seed they would be the truth's samples"


def test_colour_and_shading_lie_in_one_frame_that_describes_itself(finished: Path) -> None:
    names = ("stage", "scene_id", "view_id")
    rows = {tuple(row[name] for name in names) for row in read_ledger(finished).to_pylist()}
    for view in views_in(finished):
        frame = read_frame(frame_path(finished, "noisy", view))
        assert (frame.meta["spp"], frame.meta["seed"]) == (2, trace_seed("noisy", view, 0))
        assert frame.meta["denoiser"] == denoiser_version()
        for bands in IMAGES.values():
            assert frame.stack(*bands).mean() > 0
        assert ("noisy", view.scene_id, view.view_id) in rows


def test_the_denoised_are_nearer_to_the_truth(room: tuple[RenderScene, View]) -> None:
    settled = truth_of(room, 1024, derive(0, "settled"))
    channels, _ = render(["noisy"], *room, PARAMS, 3)["noisy"]
    images = {name: np.stack([channels[b] for b in bands], -1) for name, bands in IMAGES.items()}
    for name, truth in (("color", settled[..., :3]), ("shading", settled[..., 3:])):
        errors = [abs(images[f"{state}_{name}"] - truth).mean() for state in ("noisy", "denoised")]
        assert errors[1] < 0.5 * errors[0]


@pytest.mark.slow
def test_one_worker_and_a_resumed_run_give_the_same_bytes(data: Path, tmp_path: Path) -> None:
    before = files_in(data, *MADE)
    alone = tmp_path / "alone"
    shutil.copytree(data / "scenes", alone / "scenes")
    shutil.copytree(data / "cameras", alone / "cameras")
    run_frames("groundtruth", alone, replace(PARAMS, farm=FarmParams(workers=1, batch=1)))
    assert files_in(alone, *MADE) == before
    paths = sorted((data / "noisy").rglob("*.exr"))
    paths[0].unlink()
    paths[1].write_bytes(paths[1].read_bytes()[:-9])
    summary = run_frames("groundtruth", data, PARAMS)
    assert (summary.made, summary.kept) == (2, 10)
    assert files_in(data, *MADE) == before


@pytest.mark.slow
def test_asking_for_them_or_not_leaves_the_truth_alone(data: Path) -> None:
    before = files_in(data, "shading", "color")
    summary = run_frames("groundtruth", data, WITHOUT)
    assert (summary.made, summary.kept, summary.removed) == (0, 8, 4)
    assert files_in(data, *MADE) == before
    assert list((data / "noisy").iterdir()) == []
    summary = run_frames("groundtruth", data, PARAMS)
    assert (summary.made, summary.kept) == (0, 12), "they come back from the trash"
    assert files_in(data, "shading", "color") == before


def test_each_alone_where_the_variant_traces_them_apart(room: tuple[RenderScene, View]) -> None:
    apart = replace(PARAMS, groundtruth=replace(PARAMS.groundtruth, joint=False))
    one, stats = render(["noisy"], *room, apart, 5)["noisy"]
    assert stats["spp"] == 2
    means = [image.mean(axis=(0, 1)) for image in (both(one), traced(room, 64, 6))]
    np.testing.assert_allclose(*means, rtol=0.2)


@pytest.mark.slow
def test_training_views_have_samples_of_their_own(data: Path) -> None:
    """Two rooms: one is tested. Its frames stay; those of the other are rendered anew."""
    noisy, truth = NoisyParams(spp=2, train=(1, 8)), replace(PARAMS.groundtruth, train_spp=6)
    params = replace(PARAMS, noisy=noisy, groundtruth=truth)
    before = files_in(data, *MADE)
    views = views_in(data)
    scenes = [load_scene(folder) for folder in sorted((data / "scenes").iterdir())]
    sampling = split_sampling(scenes, truth, noisy, params.dataset.splits, params.seed)
    changed = [view for view in views if sampling[view.scene_id][0].spp == 6]
    assert {view.scene_id for view in changed} in ({"alpha"}, {"beta"})
    run_frames("groundtruth", data, params)
    after = files_in(data, *MADE)
    assert {name.split("/")[1] for name in after if after[name] != before[name]} == {
        changed[0].scene_id
    }
    for view in views:
        own_truth, own_noisy = sampling[view.scene_id]
        assert read_frame(frame_path(data, "noisy", view)).meta["spp"] == own_noisy.spp
        assert read_frame(frame_path(data, "color", view)).meta["spp"] == own_truth.spp
    many = [replace(scenes[0], scene_id=f"s{number}", plan="") for number in range(400)]
    drawn = split_sampling(many, truth, noisy, SplitParams(validation=0, test=0), params.seed)
    numbers = [own.spp for _, own in drawn.values()]
    counts = np.bincount(numbers, minlength=9)
    expected = 400 * np.diff(np.log(np.arange(1, 10))) / np.log(9)
    assert counts[0] == 0 and len(counts) == 9
    assert (np.abs(counts[1:] - expected) < 4 * np.sqrt(expected)).all()
    assert run_frames("groundtruth", data, params).made == 0


def box_data(folder: Path, noisy: bool) -> Path:
    data = make_data(folder, small_params(), scenes=3, views=2)
    if noisy:
        for index in range(3):
            for number in range(2):
                add_noisy(data, make_view(small_params(), f"home-{index:04d}", number))
    return data


def add_noisy(data: Path, view: View, **meta: object) -> Path:
    frames = box_frames(view, small_params())
    rng = np.random.default_rng(number_of(view))
    grain = rng.exponential(1, (view.height, view.width))
    channels = {band: frames["color"][band] * grain for band in "RGB"}
    channels |= {name: frames["shading"][name[-1]] * grain for name in SHADING}
    channels |= {name: frames["color"][name[-1]] for name in IMAGES["noisy_half"]}
    channels |= {name: frames["color"][name[-1]] for name in IMAGES["denoised_color"]}
    channels |= {name: frames["shading"][name[-1]] for name in IMAGES["denoised_shading"]}
    return write_view(data, "noisy", channels, view, **{"spp": 2, "noise": 0.99, **meta})


def number_of(view: View) -> int:
    return sum(map(ord, view.scene_id + view.view_id))


def test_the_dataset_has_them_only_where_asked_and_is_else_the_same(tmp_path: Path) -> None:
    params = small_params()
    plain, noisy = box_data(tmp_path / "a", noisy=False), box_data(tmp_path / "b", noisy=True)
    pack_dataset(plain, params)
    pack_dataset(noisy, params)
    assert digest_folder(plain / "dataset") == digest_folder(noisy / "dataset")
    pack_dataset(noisy, replace(params, noisy=NoisyParams(spp=2)))
    for shard in sorted((plain / "dataset").glob("*.parquet")):
        old, new = pq.read_table(shard), pq.read_table(noisy / "dataset" / shard.name)
        extra = ["preview_noisy", *IMAGES, "noisy_spp"]
        assert sorted(new.column_names) == sorted([*old.column_names, *extra])
        assert new.drop_columns(extra).equals(old)
        images = {name: images_of(shard, new, name) for name in IMAGES}
        for number, row in enumerate(new.to_pylist()):
            view = make_view(params, row["scene_id"], int(row["view_id"]))
            frame = read_frame(frame_path(noisy, "noisy", view))
            for name, bands in IMAGES.items():
                image = np.stack([frame.channels[band] for band in bands], -1)
                expected = (image / row["radiance_scale"]).astype(np.float16)
                assert images[name][number].tobytes() == expected.tobytes()
            assert row["noisy_spp"] == 2
    assert "noisy_color" in (noisy / "dataset" / "README.md").read_text()


@pytest.mark.parametrize(
    ("spoil", "reason", "words"),
    [
        ("remove", "missing", "no noisy frame"),
        ("lost", "not_finite", "noisy: 3 pixels without any finite sample"),
        ("other view", "stale", "noisy: its view_id"),
    ],
)
def test_a_view_whose_noisy_frame_is_no_use_is_rejected(
    tmp_path: Path, spoil: str, reason: str, words: str
) -> None:
    params = replace(small_params(), noisy=NoisyParams(spp=2))
    data = box_data(tmp_path, noisy=True)
    view = make_view(params, "home-0001", 1)
    path = frame_path(data, "noisy", view)
    if spoil == "remove":
        path.unlink()
    elif spoil == "lost":
        add_noisy(data, view, lost_pixels=3)
    else:
        shutil.copy(frame_path(data, "noisy", make_view(params, "home-0001", 0)), path)
    pack_dataset(data, params)
    lines = (data / "dataset" / "rejected.csv").read_text().splitlines()[1:]
    assert len(lines) == 1 and lines[0].startswith(f"home-0001,001,{reason},")
    assert words in lines[0]
