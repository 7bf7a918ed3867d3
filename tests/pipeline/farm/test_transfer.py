"""Workers that do not see the data folder: they are sent scenes, and hand their frames back."""

import shutil
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import pytest

from pbrnet.pipeline.params import Params, load_params
from pbrnet.pipeline.stages.cameras import run_cameras
from pbrnet.pipeline.stages.frame_stage import run_frames
from pbrnet.pipeline.stages.scenes import run_scenes
from pbrnet.scenes.errors import MachineError
from tests.fixtures.dask_processes import (
    can_hide,
    dask_scheduler,
    dask_worker,
    kill_tree,
    workers_of,
)
from tests.fixtures.stages import write_room

pytestmark = [pytest.mark.slow, pytest.mark.processes, pytest.mark.timeout(1800)]

PARAMETERS = """
image: {width: 48, height: 36}
scenes: {homes: 1, rooms_min: 1, rooms_max: 1, texture_size: 64}
farm: {batch: 2, retries: 1}
cameras: {views_per_room: 3}
groundtruth: {spp: 16, block_spp: 8, max_depth: 4}
"""
RUN: dict[str, Callable[[Path, Params, str | None], object]] = {
    "scenes": run_scenes,
    "cameras": run_cameras,
    "inputs": partial(run_frames, "inputs"),
    "illumination": partial(run_frames, "illumination"),
    "groundtruth": partial(run_frames, "groundtruth"),
}
STAGES = ("cameras", "inputs", "illumination", "groundtruth")
RESULTS = ("cameras", "inputs", "illumination", "visibility", "shading", "color")


def _command(data: Path, stage: str, *options: str) -> list[str]:
    parameters = data.parent / "params.yaml"
    parameters.write_text(PARAMETERS)
    words = [stage, "--params", str(parameters), "--data", str(data), *options]
    return [sys.executable, "-m", "pbrnet.pipeline.cli", *words]


def _run(data: Path, stage: str, scheduler: str | None = None, **farm: Any) -> None:
    """Run a stage in this process, with parameters of the farm."""
    parameters = data.parent / "params.yaml"
    parameters.write_text(PARAMETERS)
    params = load_params(parameters)
    RUN[stage](data, replace(params, farm=replace(params.farm, **farm)), scheduler)


def _results(data: Path) -> dict[str, bytes]:
    return {
        str(path.relative_to(data)): path.read_bytes()
        for result in RESULTS
        for path in sorted((data / result).rglob("*"))
        if path.is_file()
    }


def _cached_files(cache: Path) -> dict[Path, float]:
    return {path: path.stat().st_ctime for path in cache.glob("files/*/*")}


@pytest.fixture(scope="module")
def local(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A data folder that this machine's own workers filled: two rooms with a file in common."""
    data = tmp_path_factory.mktemp("local") / "data"
    for name, lamp in (("alpha", 10.0), ("beta", 8.0)):
        write_room(data / "scenes" / name, lamp=lamp)
        (data / "scenes" / name / "textures" / "common.bin").write_bytes(bytes(9_000_000))
    for stage in STAGES:
        _run(data, stage)
    assert len(_results(data)) >= 2 + 2 * 4 * 2
    return data


@pytest.fixture
def fresh(local: Path, tmp_path: Path) -> Iterator[Path]:
    """The same scenes, nothing made of them, in a folder that can be hidden."""
    (tmp_path / "try").mkdir()
    if not can_hide(tmp_path / "try"):
        pytest.skip("hiding a folder from a process needs unshare and the right to mount")
    shutil.copytree(local / "scenes", tmp_path / "hidden" / "data" / "scenes")
    yield tmp_path / "hidden" / "data"


def test_workers_elsewhere_make_the_same_bits(fresh: Path, local: Path, tmp_path: Path) -> None:
    place = tmp_path / "elsewhere"
    with (
        dask_scheduler(tmp_path) as (address, _),
        dask_worker(address, place, hidden=fresh, processes=2),
    ):
        _run(fresh, "cameras", address)
        there = _cached_files(place / "cache")
        scenes = [p for p in (fresh / "scenes").rglob("*") if p.is_file()]
        assert len(there) == len({path.read_bytes() for path in scenes}), "each content, once"
        for stage in STAGES[1:]:
            _run(fresh, stage, address)
        after = _cached_files(place / "cache")
        assert after.keys() == there.keys(), "nothing was sent again"
    assert _results(fresh) == _results(local)
    assert not [path for path in fresh.rglob("*") if path.name.startswith((".partial", ".farm"))]
    assert not (place / "data").exists()


def test_a_damaged_copy_is_found_and_sent_again(fresh: Path, local: Path, tmp_path: Path) -> None:
    place = tmp_path / "elsewhere"
    with (
        dask_scheduler(tmp_path) as (address, _),
        dask_worker(address, place, hidden=fresh),
    ):
        _run(fresh, "cameras", address)
        xml = (fresh / "scenes" / "alpha" / "scene.xml").read_bytes()
        (cached,) = [path for path in _cached_files(place / "cache") if path.read_bytes() == xml]
        cached.write_bytes(xml.replace(b"0.5", b"0.7", 1))
    with (  # other processes: the first may have the scene open
        dask_scheduler(tmp_path / "two") as (address, _),
        dask_worker(address, place, hidden=fresh),
    ):
        _run(fresh, "groundtruth", address)
    assert cached.read_bytes() == xml
    whole = _results(local)
    assert all(whole[name] == pixels for name, pixels in _results(fresh).items())


@pytest.mark.check
def test_sharing_and_other_workers_side_by_side(fresh: Path, local: Path, tmp_path: Path) -> None:
    shutil.copytree(local / "cameras", fresh / "cameras")
    with (
        dask_scheduler(tmp_path) as (address, _),
        dask_worker(address, tmp_path / "near"),
        dask_worker(address, tmp_path / "far", hidden=fresh) as far,
    ):
        process = subprocess.Popen(_command(fresh, "groundtruth", "--scheduler", address))
        try:
            deadline = time.monotonic() + 500
            while process.poll() is None and not list((fresh / "color").rglob("*.exr")):
                assert time.monotonic() < deadline
                time.sleep(0.05)
            kill_tree(far)  # with scenes and frames under way
            assert process.wait(timeout=500) == 0
        finally:
            process.kill()
            process.wait()
        assert not workers_of(process)
    assert not (tmp_path / "near" / "cache").exists()
    whole = _results(local)
    made = _results(fresh)
    assert {name for name in whole if name.startswith(("shading", "color"))} <= made.keys()
    assert all(whole[name] == pixels for name, pixels in made.items())


def test_a_folder_that_must_be_shared_is_asked_for(
    fresh: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with (
        dask_scheduler(tmp_path) as (address, _),
        dask_worker(address, tmp_path / "far", hidden=fresh),
    ):
        with pytest.raises(MachineError, match=r"cannot see .* farm\.transfer: auto"):
            _run(fresh, "cameras", address, transfer="shared")
        shutil.rmtree(fresh / "scenes")
        _run(fresh, "scenes", address)
        assert "runs on local workers instead" in capsys.readouterr().err
    assert (fresh / "scenes" / "home-0000" / "scene.json").is_file()


def test_own_workers_can_be_sent_to(
    local: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The same way without a cluster, for those who want to try it."""
    data = tmp_path / "data"
    for folder in ("scenes", "cameras"):
        shutil.copytree(local / folder, data / folder)
    monkeypatch.setenv("PBRNET_CACHE", str(tmp_path / "cache"))
    _run(data, "inputs", transfer="send", workers=2)
    assert _cached_files(tmp_path / "cache")
    whole = _results(local)
    made = {name: pixels for name, pixels in _results(data).items() if name.startswith("inputs")}
    assert made == {name: pixels for name, pixels in whole.items() if name.startswith("inputs")}
