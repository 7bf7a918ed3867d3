"""Noise study: only the ground truth and its exposures differ, and frames are rendered once."""

import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from pbrnet.model.data.reader import PAPER, Dataset
from pbrnet.model.studies.frame_store import FrameStore
from pbrnet.model.studies.noise import noisy_truths
from pbrnet.model.studies.trials import derived_splits
from pbrnet.model.studies.trials.derived_splits import TruthImages, write_derived_split
from pbrnet.model.studies.trials.results import TrialsResult
from pbrnet.model.training.train import Folders, train_network
from pbrnet.pipeline.frames import read_frame
from pbrnet.pipeline.passes.denoise import denoise, guides
from pbrnet.pipeline.render.scene import open_scene, set_variant
from pbrnet.pipeline.tonemap import ToneParams, exposure_of
from pbrnet.pipeline.views import load_cameras
from pbrnet.scenes.checked import plain
from pbrnet.scenes.contract import load_scene
from tests.fixtures.backbone import copy_backbone
from tests.fixtures.command import exit_code
from tests.fixtures.light import PARAMS as LIT
from tests.fixtures.light import lit_workplace, room
from tests.fixtures.model import box_rows, write_shard
from tests.fixtures.study import result_in
from tests.fixtures.training import stop_at
from tests.fixtures.trial import PARAMS as TRIALS
from tests.fixtures.trial import SIZE, SMALL, folders_in

pytestmark = pytest.mark.slow

TINY = replace(SMALL, levels=2)
PARAMS = replace(
    LIT,
    train=replace(
        TRIALS.train, loss=replace(TRIALS.train.loss, kind="l1"), shading=TINY, composition=TINY
    ),
)


@pytest.fixture(scope="module")
def template(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """One test room, two training rooms, and the finished study."""
    root = tmp_path_factory.mktemp("noise")
    lit_workplace(root, scenes=1, train=2)
    copy_backbone(root / "models")
    (root / "params.yaml").write_text(yaml.safe_dump(plain(PARAMS)))
    code, _ = run(folders_in(root))
    assert code == 0
    return root


@pytest.fixture()
def folders(template: Path, tmp_path: Path) -> Folders:
    """A copy of the finished study."""
    shutil.copytree(template, tmp_path / "work")
    return folders_in(tmp_path / "work")


def run(folders: Folders, *more: object) -> tuple[int, Path]:
    """`pbrnet study noise` with one step and 1 and 4 samples: exit code, result."""
    root = folders.data.parent
    words = ["study", "noise", "--params", root / "params.yaml", "--data", folders.data]
    words += ["--models", folders.models, "--spp", 1, "--spp", 4, "--steps", 1, *more]
    return exit_code(*words), folders.models / "metrics" / "studies"


def packed(folders: Folders, name: str) -> Dataset:
    """Return the training split of the trials of that name."""
    return Dataset(folders.data / "studies" / "noise" / "packs" / name / "dataset", "train")


def test_rows_are_judged_against_the_clean_truth(folders: Folders) -> None:
    result = result_in(folders.models / "metrics", "noise", TrialsResult)
    labels = ["1 spp", "4 spp", "1 spp, denoised", "4 spp, denoised", "clean", "truth"]
    assert [row.label for row in result.rows] == labels and result.reference == "clean"
    assert (result.views, result.split) == (2, "test")
    for row in result.rows[:-1]:
        assert (row.views, row.steps) == (4, 2) and row.metrics["flip"]
    assert (folders.models / "metrics" / "studies" / "noise.png").is_file()


def test_only_the_truth_differs(folders: Folders) -> None:
    clean = list(Dataset(folders.data / "dataset", "train").ordered())
    for truth in noisy_truths((1, 4)):
        for ours, theirs in zip(packed(folders, truth.name).ordered(), clean, strict=True):
            assert ours.name == theirs.name
            for name in set(PAPER) - {"shading", "color"}:
                assert np.array_equal(ours[name], theirs[name]), name
            for kind in ("shading", "color"):
                path = folders.data / "studies" / "noise" / truth.name / kind / ours.scene_id
                frame = read_frame(path / f"{ours.view_id}.exr")
                # The row's unit need not be that of this frame: small values are rounded again.
                least = 2**-24 * float(frame.rgb.max())
                np.testing.assert_allclose(ours[kind], frame.rgb, 2**-11, least)
                assert frame.meta["spp"] == truth.spp
                # from the noisy image, not from the clean one
                own = exposure_of(ours[kind], ToneParams())
                assert getattr(ours, f"exposure_{kind}") == own
                assert own != getattr(theirs, f"exposure_{kind}")


def test_what_is_denoised_are_the_same_samples(folders: Folders) -> None:
    set_variant()
    kept = folders.data / "studies" / "noise"
    scene = open_scene(load_scene(folders.data / "scenes" / "room-1"))
    view = load_cameras(folders.data / "cameras" / "room-1.json").views[0]
    raw, smooth = (
        read_frame(kept / f"{name}-4" / "color" / "room-1" / f"{view.view_id}.exr")
        for name in ("raw", "denoised")
    )
    again = denoise(raw.channels, *guides(scene, view))
    for band in "RGB":
        assert np.allclose(again[band], smooth.channels[band], rtol=0.02, atol=1e-3)
    assert not np.allclose(raw.rgb, smooth.rgb, rtol=0.02, atol=1e-3)


def test_fewer_samples_are_further_from_the_clean_truth(folders: Folders) -> None:
    clean = np.stack([e["color"] for e in Dataset(folders.data / "dataset", "train").ordered()])

    def error(name: str) -> float:
        views = np.stack([example["color"] for example in packed(folders, name).ordered()])
        return float(np.sqrt(np.mean((np.log(views + 0.01) - np.log(clean + 0.01)) ** 2)))

    assert error("raw-1") > error("raw-4") and error("raw-1") > error("denoised-1")
    assert error("clean") == 0


def test_clean_is_trained_as_on_the_dataset_itself(folders: Folders, tmp_path: Path) -> None:
    trial = folders.models / "metrics" / "studies" / "noise" / "clean-0"
    stage = replace(TINY, epochs=1, steps_per_epoch=1)
    params = replace(PARAMS, train=replace(PARAMS.train, shading=stage))
    train_network("shading", params, replace(folders, models=tmp_path))
    ours, theirs = (place / "shading.safetensors" for place in (trial, tmp_path))
    assert ours.read_bytes() == theirs.read_bytes()
    noisy = trial.parent / "raw-1-0" / "shading.safetensors"
    assert noisy.read_bytes() != theirs.read_bytes()


def test_packs_of_the_same_rows_are_read_in_the_same_order(tmp_path: Path) -> None:
    data = tmp_path / "dataset"
    rows = box_rows(["a-0", "a-1", "b-0", "c-0"], 3, "train", **SIZE)
    write_shard(data / "train-00000-of-00001.parquet", rows, row_group=2)
    (data / "scenes.csv").write_text("scene_id,plan\na-0,a\na-1,a\nb-0,b\nc-0,c\n")
    some = Dataset(data, "train", only=["a-0", "c-0"])

    def darker(scene: str, view: str) -> TruthImages:
        (row,) = (r for r in rows if (r["scene_id"], r["view_id"]) == (scene, view))
        return {kind: row[kind].astype(np.float32) / 4 for kind in ("shading", "color")}

    assert {"tint", "visibility"} <= {*derived_splits._KEPT}, "joins of the panorama need them"
    write_derived_split(tmp_path / "same", "1", lambda: [some], "test")
    write_derived_split(tmp_path / "other", "2", lambda: [some], "test", ToneParams(), darker)
    same, other = (Dataset(tmp_path / name / "dataset", "test") for name in ("same", "other"))
    orders = []
    for split in (same, other):
        stream = split.shuffled(5)
        orders.append([next(stream).name for _ in range(12)])
    assert orders[0] == orders[1] and len(set(orders[0])) == 6
    assert same.plans() == {"a-0": "a", "c-0": "c"}
    for ours, theirs in zip(other.ordered(), same.ordered(), strict=True):
        np.testing.assert_allclose(ours["color"], theirs["color"] / 4, rtol=2e-3, atol=1e-6)
        ratio = ours.exposure_shading.scale / theirs.exposure_shading.scale
        assert ratio == pytest.approx(4, rel=1e-2)


def test_a_pack_is_made_anew_only_for_another_mark(tmp_path: Path) -> None:
    path = tmp_path / "dataset" / "train-00000-of-00001.parquet"
    write_shard(path, box_rows(["a", "b"], 1, "train", **SIZE))

    def scenes(name: str, fingerprint: str) -> set[str]:
        parts = [Dataset(tmp_path / "dataset", "train", only=[name])]
        write_derived_split(tmp_path / "made", fingerprint, lambda: parts, "train")
        return set(Dataset(tmp_path / "made" / "dataset", "train").column("scene_id"))

    assert [scenes("a", "1"), scenes("b", "1"), scenes("b", "2")] == [{"a"}, {"a"}, {"b"}]


def test_what_is_done_is_not_done_again(
    folders: Folders, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    before = (folders.models / "metrics" / "studies" / "noise.json").read_bytes()

    def refuse(*_: Any, **__: Any) -> None:
        raise AssertionError("rendered again")

    monkeypatch.setattr(FrameStore, "made", refuse)
    shutil.rmtree(folders.data / "studies")  # frames may be deleted
    steps = stop_at(monkeypatch, 10**9)
    code, studies = run(folders)
    assert code == 0 and steps() == 0
    assert (studies / "noise.json").read_bytes() == before
    assert run(folders, "--dry-run")[0] == 0
    said = capsys.readouterr().out
    assert "4 views to render with 4 samples" in said and said.count("kept") == 5


def test_a_stopped_study_renders_only_what_is_missing(
    folders: Folders, monkeypatch: pytest.MonkeyPatch
) -> None:
    renders = folders.data / "studies" / "noise"
    shutil.rmtree(renders / "packs")
    shutil.rmtree(folders.models / "metrics")
    lost = renders / "denoised-4" / "color" / "room-2" / "v1.exr"
    before = {path: path.read_bytes() for path in sorted(renders.rglob("*.exr"))}
    lost.unlink()
    traced: list[str] = []
    real = FrameStore.made

    def counted(store: FrameStore, kinds: Any, scene: Any, view: Any) -> Any:
        traced.append(f"{view.scene_id}/{view.view_id} {store.settings[kinds[0]].trace.spp}")
        return real(store, kinds, scene, view)

    monkeypatch.setattr(FrameStore, "made", counted)
    assert run(folders)[0] == 0
    assert traced == ["room-2/v1 4"]
    pixels = [read_frame(lost), None]
    lost.write_bytes(before[lost])
    pixels[1] = read_frame(lost)
    assert pixels[0] and pixels[1] and np.array_equal(pixels[0].rgb, pixels[1].rgb)


def test_other_scenes_than_the_datasets_are_refused(
    folders: Folders, capsys: pytest.CaptureFixture[str]
) -> None:
    room(folders.data / "scenes" / "room-2", lamp=40.0)
    assert run(folders)[0] == 3
    assert "not the scene that the dataset was made from" in capsys.readouterr().err
    shutil.rmtree(folders.data / "scenes" / "room-2")
    assert run(folders)[0] == 3
    assert "pbrnet scenes" in capsys.readouterr().err
    assert run(folders, "--views", 5)[0] == 2
    assert "--views: 5 is not allowed" in capsys.readouterr().err
