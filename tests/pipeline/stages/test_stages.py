"""Stages: what holds is kept, what changed is rendered again, what failed is named."""

import json
import os
import shutil
import subprocess
import weakref
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import pytest
from click.testing import CliRunner

from pbrnet.pipeline.channels import Kind
from pbrnet.pipeline.commands import stages
from pbrnet.pipeline.commands.options import Request
from pbrnet.pipeline.commands.start import plan_stages
from pbrnet.pipeline.costs.ledger import read_ledger
from pbrnet.pipeline.dataset.checks import Rejection, surfaces_of
from pbrnet.pipeline.farm.settings import FarmParams
from pbrnet.pipeline.frames import frame_path, read_frame, read_meta
from pbrnet.pipeline.params import Params, load_params
from pbrnet.pipeline.passes.settings import IlluminationParams
from pbrnet.pipeline.records import data_lock
from pbrnet.pipeline.render.scene import RenderScene, open_scene
from pbrnet.pipeline.stages import frame_stage, render_jobs
from pbrnet.pipeline.stages.cameras import run_cameras
from pbrnet.pipeline.stages.frame_stage import run_frame_stages, run_frames
from pbrnet.pipeline.stages.runner import StageError, Summary, plan_line
from pbrnet.pipeline.stages.scenes import run_scenes
from pbrnet.pipeline.views import ImageParams, View, load_cameras, save_cameras
from pbrnet.scenes.contract import Scene, load_scene
from pbrnet.scenes.errors import InputError, MachineError, ParameterError, PbrnetError
from pbrnet.scenes.params import SceneParams
from tests.fixtures.in_process import worker_processes
from tests.fixtures.params import pbrs_cameras, pbrs_params, plain_truth
from tests.fixtures.stages import files_in, views_in, write_room

pytestmark = pytest.mark.slow

PARAMS = pbrs_params(
    image=ImageParams(48, 36),
    farm=FarmParams(workers=1, batch=2, retries=1),
    scenes=SceneParams(homes=0, imports=("nothing",)),
    cameras=pbrs_cameras(views_per_room=2),
    illumination=IlluminationParams(width=32),
    groundtruth=plain_truth(spp=4, block_spp=2, max_depth=3),
)
KINDS: tuple[Kind, ...] = ("inputs", "illumination", "visibility", "shading", "color")
STAGES: dict[str, Callable[..., Any]] = {
    "cameras": run_cameras,
    "inputs": partial(run_frames, "inputs"),
    "illumination": partial(run_frames, "illumination"),
    "groundtruth": partial(run_frames, "groundtruth"),
}


@pytest.fixture(scope="module")
def finished(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A data folder with two rooms and all frames, made by two workers."""
    data = tmp_path_factory.mktemp("finished") / "data"
    write_room(data / "scenes" / "alpha")
    write_room(data / "scenes" / "beta", size=(4.4, 3.2, 2.5))
    with worker_processes():
        for stage in STAGES.values():
            stage(data, replace(PARAMS, farm=replace(PARAMS.farm, workers=2)))
    return data


@pytest.fixture
def data(finished: Path, tmp_path: Path) -> Path:
    """A copy of the finished folder to meddle with."""
    shutil.copytree(finished, tmp_path / "data")
    return tmp_path / "data"


def test_all_frames_are_there_and_describe_themselves(finished: Path) -> None:
    views = views_in(finished)
    assert len(views) == 4
    for view in views:
        for kind in KINDS:
            frame = read_frame(frame_path(finished, kind, view))
            assert frame.meta["view"]["view_id"] == view.view_id
            assert "mitsuba" in frame.meta["renderer"]
            assert ("seed" in frame.meta) == (kind in ("shading", "color"))
    assert sum(1 for _ in finished.rglob("*.exr")) == 20
    rows = read_ledger(finished).to_pylist()
    made = {(row["stage"], row["scene_id"], row["view_id"]): row for row in rows}
    assert len(rows) == len(made) == 2 + 20
    for view in views:
        for kind in KINDS:
            row = made[kind, view.scene_id, view.view_id]
            path = frame_path(finished, kind, view)
            assert row["bytes"] == path.stat().st_size and row["seconds"] > row["opening"] >= 0
            assert row["peak_mb"] > 50 and row["threads"] >= 1 and "mitsuba" in row["renderer"]
            frame = read_frame(path)
            height, width = next(iter(frame.channels.values())).shape
            assert (row["width"], row["height"], row["times"]) == (width, height, 1)
            assert (row["spp"], row["noise"]) == (frame.meta.get("spp"), frame.meta.get("noise"))
    assert not (finished / "failures" / "groundtruth.json").exists()


def test_one_process_makes_the_same_bytes_as_two_workers(finished: Path, tmp_path: Path) -> None:
    shutil.copytree(finished / "scenes", tmp_path / "scenes")
    alone = replace(PARAMS, farm=FarmParams(workers=1, batch=1))
    for stage in STAGES.values():
        stage(tmp_path, alone)
    assert files_in(tmp_path, "cameras", *KINDS) == files_in(finished, "cameras", *KINDS)


def test_stages_together_make_what_they_make_one_by_one(
    finished: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Each scene is opened once, alone; light that the checks reject is not rendered."""
    data, opened = tmp_path / "data", list[tuple[str, weakref.ref[RenderScene]]]()
    for name in ("scenes", "cameras"):
        shutil.copytree(finished / name, data / name)

    def noted(scene: Scene) -> RenderScene:
        assert not any(other() for _, other in opened)
        found = open_scene(scene)
        opened.append((scene.scene_id, weakref.ref(found)))
        return found

    monkeypatch.setattr(render_jobs, "open_scene", noted)
    names = ["inputs", "illumination", "groundtruth"]
    summaries = run_frame_stages(names, data, PARAMS)
    made = [summary.made for summary in summaries if isinstance(summary, Summary)]
    assert made == [4, 8, 8] and sorted(name for name, _ in opened) == ["alpha", "beta"]
    assert files_in(data, *KINDS) == files_in(finished, *KINDS)

    def judged(data: Path, view: View, *rest: Any) -> Any:
        found = surfaces_of(data, view, *rest)
        wrong = view == views_in(data)[0] and not isinstance(found, Rejection)
        return Rejection("few_surfaces", "none") if wrong else found

    monkeypatch.setattr(frame_stage, "surfaces_of", judged)
    for kind in KINDS:
        shutil.rmtree(data / kind)
    light = run_frame_stages(names, data, PARAMS)[2]
    assert isinstance(light, Summary) and light.made == 6 and "left out" in light.notes[0]
    for kind in ("shading", "color"):
        shutil.rmtree(data / kind)
    alone = run_frames("groundtruth", data, PARAMS)
    assert (alone.made, alone.notes) == (light.made, light.notes)


def test_a_second_run_keeps_everything_and_starts_nobody(
    data: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("pbrnet.pipeline.stages.runner.Farm", None)
    before = files_in(data, "cameras", *KINDS)
    for stage, count in (("cameras", 2), ("inputs", 4), ("groundtruth", 8)):
        summary = STAGES[stage](data, PARAMS)
        assert (summary.made, summary.kept, summary.removed) == (0, count, 0)
    assert files_in(data, "cameras", *KINDS) == before


def test_missing_truncated_and_foreign_frames_are_rendered_again(data: Path) -> None:
    before = files_in(data, "cameras", *KINDS)
    paths = sorted((data / "color").rglob("*.exr"))
    paths[0].unlink()
    paths[1].write_bytes(paths[1].read_bytes()[:-7])
    paths[2].write_text("not an EXR at all")
    summary = run_frames("color", data, PARAMS)
    assert (summary.made, summary.kept) == (3, 1)
    assert files_in(data, "cameras", *KINDS) == before


def test_a_frame_that_rots_on_the_disk_is_found_and_made_again(data: Path) -> None:
    path = frame_path(data, "color", views_in(data)[1])
    whole = path.read_bytes()
    rotten = bytearray(whole)
    rotten[-len(whole) // 4] ^= 0x10
    path.write_bytes(rotten)
    trusting = replace(PARAMS, farm=replace(PARAMS.farm, checksums=False))
    assert run_frames("groundtruth", data, trusting).made == 0
    assert run_frames("groundtruth", data, PARAMS).made == 1
    assert path.read_bytes() == whole


def test_halves_are_the_whole(data: Path) -> None:
    """Frames are the same whether made together or alone."""
    before = files_in(data, "cameras", *KINDS)
    for kind in ("shading", "color"):
        shutil.rmtree(data / kind)
        assert run_frames(kind, data, PARAMS).made == 4
    assert files_in(data, "cameras", *KINDS) == before


def test_without_twin_there_is_colour_but_no_shading(data: Path) -> None:
    scene = data / "scenes" / "alpha" / "scene.xml"
    hair = '<shape type="sphere" id="hairy"><float name="radius" value="0.1"/><bsdf type="hair"/>'
    scene.write_text(scene.read_text().replace("</scene>", hair + "</shape></scene>"))
    with pytest.raises(StageError, match=r"2 failed, 2 made, 4 kept(.|\n)*'hair'"):
        run_frames("groundtruth", data, PARAMS)
    before = files_in(data, "color")
    assert len(list((data / "color" / "alpha").glob("*.exr"))) == 2
    assert not list((data / "shading" / "alpha").glob("*.exr"))
    shutil.rmtree(data / "color" / "alpha")
    assert run_frames("color", data, PARAMS).made == 2
    assert files_in(data, "color") == before


def test_two_renders_differ_from_one_trace_by_noise_only(data: Path) -> None:
    view = views_in(data)[0]
    one = [read_frame(frame_path(data, kind, view)).rgb for kind in ("shading", "color")]
    apart = replace(PARAMS, groundtruth=replace(PARAMS.groundtruth, joint=False))
    assert run_frames("groundtruth", data, apart).made == 8
    two = [read_frame(frame_path(data, kind, view)).rgb for kind in ("shading", "color")]
    for first, second in zip(one, two, strict=True):
        assert first.mean() == pytest.approx(second.mean(), rel=0.1)


def test_strangers_are_removed_and_files_of_others_are_not(
    data: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    before = files_in(data, "cameras", *KINDS)
    some = next((data / "inputs" / "alpha").glob("*.exr"))
    shutil.copy(some, data / "inputs" / "alpha" / "old-s1.exr")
    shutil.copytree(data / "inputs" / "beta", data / "inputs" / "gone")
    (data / "inputs" / "alpha" / ".partial-x.exr").write_text("half")
    notes = data / "inputs" / "alpha" / "my notes.txt"
    notes.write_text("keep me")
    summary = run_frames("inputs", data, PARAMS)
    assert (summary.made, summary.kept, summary.removed) == (0, 4, 4)
    assert notes.read_text() == "keep me"
    assert "my notes.txt" in capsys.readouterr().err
    notes.unlink()
    assert files_in(data, "cameras", *KINDS) == before


def test_orphans_come_back_from_the_trash_without_rendering(
    data: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    before = files_in(data, "color", "shading")
    fewer = _alter("cameras", views_per_room=1)
    everything = files_in(data, ".")
    plans = [plan_line(plan) for plan in plan_stages(STAGES, Request(fewer, data))]
    assert files_in(data, ".") == everything, "a plan changes nothing"
    assert plans[0].startswith("cameras: 2 to make (2 of them out of date, 0.0 MB; the old ones to")
    assert "at most 32 more" in plans[3] and "8 to be kept, remade or moved" in plans[3]
    run_cameras(data, fewer)
    gone = run_frames("groundtruth", data, fewer)
    assert (gone.made, gone.kept, gone.removed) == (0, 4, 4)
    assert "4 no longer required" in capsys.readouterr().err
    assert any(note.startswith("trash: 6 items") for note in gone.notes), "with camera files"
    run_cameras(data, PARAMS)
    monkeypatch.setattr("pbrnet.pipeline.stages.runner.Farm", None)
    again = run_frames("groundtruth", data, PARAMS)
    assert (again.made, again.kept, again.removed) == (0, 8, 0)
    assert "4 back from the trash" in capsys.readouterr().err
    assert files_in(data, "color", "shading") == before
    assert set(files_in(data, "trash")) == set(files_in(data, "trash/cameras"))


def test_replaced_frames_come_back_with_their_parameters(
    data: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    before = files_in(data, "color", "shading")
    other = _alter("groundtruth", max_depth=2)
    assert run_frames("groundtruth", data, other).made == len(before)
    after = files_in(data, "color", "shading")
    assert not set(after.items()) & set(before.items())
    monkeypatch.setattr("pbrnet.pipeline.stages.runner.Farm", None)
    for params, files in ((PARAMS, before), (other, after), (PARAMS, before)):
        again = run_frames("groundtruth", data, params)
        assert (again.made, again.kept) == (0, len(before)), "nothing is rendered"
        assert f"{len(before)} back from the trash" in capsys.readouterr().err
        assert files_in(data, "color", "shading") == files


def test_changed_samples_render_ground_truth_only(data: Path) -> None:
    more = replace(PARAMS, groundtruth=replace(PARAMS.groundtruth, spp=8))
    assert run_cameras(data, more).made == 0
    assert run_frames("inputs", data, more).made == 0
    assert run_frames("illumination", data, more).made == 0
    assert run_frames("groundtruth", data, more).made == 8
    path = next((data / "color").rglob("*.exr"))
    assert read_meta(path)["spp"] == 8


def _alter(section: str, **values: Any) -> Params:
    return replace(PARAMS, **{section: replace(getattr(PARAMS, section), **values)})


def test_a_changed_scene_renews_its_own_cameras_and_frames_only(data: Path) -> None:
    before = files_in(data, "cameras", *KINDS)
    write_room(data / "scenes" / "beta", size=(4.4, 3.2, 2.5), lamp=20.0)
    assert run_cameras(data, PARAMS).made == 1
    assert run_frames("groundtruth", data, PARAMS).kept == 4
    after = files_in(data, "cameras", *KINDS)
    assert all(after[name] == before[name] for name in before if "/alpha" in name)
    assert all(after[name] != before[name] for name in after if name.startswith("color/beta"))


def test_a_failing_scene_is_named_and_stops_nobody(data: Path) -> None:
    scene = data / "scenes" / "alpha" / "scene.xml"
    whole = scene.read_text()
    scene.write_text(whole.replace('type="cube"', 'type="no-such-shape"', 1))
    write_room(data / "scenes" / "beta", size=(4.4, 3.2, 2.5), lamp=20.0)
    with pytest.raises(StageError, match=r"4 failed, 4 made, 0 kept") as failed:
        run_frames("groundtruth", data, PARAMS)
    assert failed.value.exit_code == 1
    assert "alpha/living" in str(failed.value) and "no-such-shape" in str(failed.value)
    listed = json.loads((data / "failures" / "groundtruth.json").read_text())
    assert {(f["scene_id"], f["stage"]) for f in listed} == {
        ("alpha", "color"),
        ("alpha", "shading"),
    }
    assert all(f["view_id"].startswith("living-s") and f["error"] for f in listed)
    # What is out of date and could not be renewed is not left lying about.
    assert not list((data / "color" / "alpha").glob("*.exr"))
    scene.write_text(whole)
    again = run_frames("groundtruth", data, PARAMS)
    assert (again.made, again.kept) == (0, 8), "the trash has the frames of the whole scene"
    assert not (data / "failures" / "groundtruth.json").exists()


def test_a_scene_that_cannot_be_read_fails_alone_and_keeps_its_frames(data: Path) -> None:
    (data / "scenes" / "alpha" / "scene.json").write_text("{")
    with pytest.raises(StageError, match=r"1 failed, 0 made, 2 kept(.|\n)*not valid JSON"):
        run_frames("inputs", data, PARAMS)
    assert len(list((data / "inputs" / "alpha").glob("*.exr"))) == 2


@pytest.mark.parametrize(
    ("view_id", "scene_id"), [("../../escape", "alpha"), ("fine", "beta"), (".hidden", "alpha")]
)
def test_a_camera_file_cannot_lead_outside(data: Path, view_id: str, scene_id: str) -> None:
    path = data / "cameras" / "alpha.json"
    file = load_cameras(path)
    evil = replace(file.views[0], view_id=view_id, scene_id=scene_id)
    save_cameras(path, replace(file, views=(evil,)))
    with pytest.raises(StageError, match="cannot be a view"):
        run_frames("inputs", data, PARAMS)
    assert not list(data.parent.glob("*.exr"))


def test_order_of_the_commands_is_explained(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="run first: pbrnet scenes"):
        run_cameras(tmp_path / "none", PARAMS)
    write_room(tmp_path / "data" / "scenes" / "alpha")
    with pytest.raises(StageError, match="run first: pbrnet cameras"):
        run_frames("inputs", tmp_path / "data", PARAMS)


def test_a_scene_without_views_is_an_outcome(tmp_path: Path) -> None:
    write_room(tmp_path / "scenes" / "dark", has_light=False)
    write_room(tmp_path / "scenes" / "lit")
    summary = run_cameras(tmp_path, PARAMS)
    assert summary.made == 2
    (why,) = [note for note in summary.notes if note.startswith("no view in dark: ")]
    assert "no lamp, window or door" in why
    assert run_frames("inputs", tmp_path, PARAMS).made == 2


def test_a_second_run_on_the_same_folder_is_refused(data: Path) -> None:
    with data_lock(data, "groundtruth"), pytest.raises(PbrnetError, match="in use by 'pbrnet gr"):
        run_frames("inputs", data, PARAMS)
    assert run_frames("inputs", data, PARAMS).kept == 4


def test_scenes_are_made_kept_renewed_and_removed(tmp_path: Path) -> None:
    elsewhere = tmp_path / "elsewhere"
    for name in ("one", "two"):
        write_room(elsewhere / name)
    data = tmp_path / "data"
    write_room(data / "scenes" / "mine")

    def params(*names: str) -> Params:
        imports = tuple(str(elsewhere / name) for name in names)
        return _alter("scenes", imports=imports)

    summary = run_scenes(data, params("one", "two"))
    assert (summary.made, summary.kept, summary.removed) == (2, 0, 0)
    run_cameras(data, PARAMS)
    write_room(elsewhere / "two", lamp=3.0)
    summary = run_scenes(data, params("one", "two"))
    assert (summary.made, summary.kept) == (1, 1)
    assert run_cameras(data, PARAMS).made == 1
    summary = run_scenes(data, params("one"))
    assert (summary.kept, summary.removed) == (1, 1)
    assert sorted(path.name for path in (data / "scenes").iterdir()) == ["mine", "one"]
    with pytest.raises(StageError, match=r"three: .*no such file"):
        run_scenes(data, params("one", "three"))
    with pytest.raises(StageError, match="a scene of another tool"):
        write_room(elsewhere / "mine")
        run_scenes(data, params("mine"))


def test_a_clock_that_jumps_makes_nothing_again(data: Path) -> None:
    """Fingerprints decide, not the modification times of files."""
    for path in sorted(data.rglob("*.exr"))[::2]:
        os.utime(path, (4e9, 4e9))
    for path in sorted(data.rglob("scene.xml")):
        os.utime(path, (1, 1))
    for stage, count in (("cameras", 2), ("inputs", 4), ("groundtruth", 8)):
        assert (STAGES[stage](data, PARAMS).made, STAGES[stage](data, PARAMS).kept) == (0, count)


@pytest.mark.skipif(os.geteuid() != 0, reason="mounting a small tmpfs needs root")
def test_a_folder_that_is_read_only_is_said_and_keeps_all(data: Path, tmp_path: Path) -> None:
    disk = tmp_path / "disk"
    disk.mkdir()
    mounted = subprocess.run(["mount", "-t", "tmpfs", "none", disk], check=False)
    if mounted.returncode:
        pytest.skip("a tmpfs cannot be mounted here")
    try:
        shutil.copytree(data, disk, dirs_exist_ok=True)
        next((disk / "color").rglob("*.exr")).unlink()
        before = files_in(disk, "cameras", *KINDS)
        subprocess.run(["mount", "-o", "remount,ro", disk], check=True)
        with pytest.raises(MachineError, match="Read-only file system"):
            run_frames("groundtruth", disk, PARAMS)
        assert files_in(disk, "cameras", *KINDS) == before
    finally:
        subprocess.run(["umount", disk], check=True)


def test_a_full_disk_is_said_and_the_run_goes_on_later(data: Path, small_disk: Path) -> None:
    for folder in ("scenes", "cameras"):
        shutil.copytree(data / folder, small_disk / folder)
    ballast = small_disk / "ballast"
    with ballast.open("wb", buffering=0) as stream:
        stream.write(bytes(shutil.disk_usage(small_disk).free - 40_000))
    with pytest.raises(MachineError, match="disk is full"):
        run_frames("groundtruth", small_disk, PARAMS)
    assert not list(small_disk.rglob(".partial-*"))
    ballast.unlink()
    run_frames("groundtruth", small_disk, PARAMS)
    assert files_in(small_disk, "shading", "color") == files_in(data, "shading", "color")


def test_commands_have_examples_and_say_what_they_did(data: Path, tmp_path: Path) -> None:
    for name in ("assets", "scenes", "cameras", *STAGES, "shading", "color"):
        help_text = CliRunner().invoke(getattr(stages, name), ["--help"]).output
        assert f"pbrnet {name}" in help_text, name
        assert "--seed" in help_text
    yaml = tmp_path / "params.yaml"
    yaml.write_text(
        "image: {width: 48, height: 36}\n"
        "cameras: {views_per_scene: 8, eye_height: 1.55, eye_jitter: 0.05, pitch: [], roll: [],\n"
        "  framing: paper}\n"
        "groundtruth: {spp: 4, block_spp: 2, max_depth: 3, denoise: none}\n"
        "scenes: {homes: 0, imports: [nothing]}\n"
        "illumination: {width: 32}\n"
    )
    assert load_params(yaml).groundtruth == PARAMS.groundtruth
    assert load_params(yaml).cameras == PARAMS.cameras
    options = ["--params", str(yaml), "--data", str(data), "--workers", "1"]
    for command, line in (
        (stages.cameras, "cameras: 0 made, 2 kept"),
        (stages.shading, "shading: 0 made, 4 kept"),
        (stages.groundtruth, "groundtruth: 0 made, 8 kept"),
    ):
        result = CliRunner().invoke(command, options, catch_exceptions=False)
        assert result.exit_code == 0 and line in result.output
    result = CliRunner().invoke(stages.assets, options[:4], catch_exceptions=False)
    assert json.loads((data / "assets" / "catalogue.json").read_text())["pieces"] == []
    assert "assets.enabled is false" in result.output


def test_variants_of_a_home_stand_beside_it_and_share_its_plan(tmp_path: Path) -> None:
    data = tmp_path / "data"

    def made(**changes: Any) -> list[str]:
        wanted = SceneParams(homes=1, rooms_max=1, texture_size=64, **changes)
        run_scenes(data, replace(PARAMS, scenes=wanted))
        return sorted(path.name for path in (data / "scenes").iterdir())

    names = made(variants=3)
    assert names == ["home-0000", "home-0000-v1", "home-0000-v2"]
    scenes = [load_scene(data / "scenes" / name) for name in names]
    assert [scene.lighting for scene in scenes] == ["day", "evening", "night"]
    assert len({scene.plan for scene in scenes}) == 1
    home = (data / "scenes" / "home-0000" / "scene.json").stat().st_mtime_ns
    assert made(variants=2) == ["home-0000", "home-0000-v1"]
    assert (data / "scenes" / "home-0000" / "scene.json").stat().st_mtime_ns == home
    made(variants=2, vary=("light",))
    assert load_scene(data / "scenes" / "home-0000-v1").source["varied"] == ["light"]


def test_no_homes_are_fine_where_there_are_scenes(tmp_path: Path) -> None:
    none = replace(PARAMS, scenes=SceneParams(homes=0))
    with pytest.raises(ParameterError, match="homes: 0 homes, no imports, and no scene"):
        run_scenes(tmp_path, none)
    write_room(tmp_path / "scenes" / "room")
    assert run_scenes(tmp_path, none).made == 0
