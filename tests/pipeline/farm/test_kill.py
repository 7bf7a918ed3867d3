"""Killed at any time: the outcome is, byte for byte, that of an undisturbed run."""

import contextlib
import os
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from pbrnet.pipeline.dataset.pack import pack_dataset
from pbrnet.pipeline.params import Params, load_params
from pbrnet.pipeline.stages.cameras import run_cameras
from pbrnet.pipeline.stages.frame_stage import run_frames
from tests.fixtures.dask_processes import dask_cluster, dask_scheduler, dask_worker, workers_of
from tests.fixtures.paths import ROOT
from tests.fixtures.stages import files_in, write_room

pytestmark = [pytest.mark.slow, pytest.mark.processes, pytest.mark.timeout(300)]

PARAMETERS = """
image: {width: 64, height: 48}
farm: {batch: 2}
cameras:
  {views_per_room: 4, views_per_scene: 8, eye_height: 1.55, eye_jitter: 0.05, pitch: [], roll: [],
   framing: paper}
groundtruth: {spp: 64, block_spp: 16, max_depth: 5, denoise: none}
"""
STAGES = ("inputs", "illumination", "groundtruth", "dataset")
RUN: dict[str, Callable[[Path, Params], object]] = {
    "cameras": run_cameras,
    "inputs": partial(run_frames, "inputs"),
    "illumination": partial(run_frames, "illumination"),
    "groundtruth": partial(run_frames, "groundtruth"),
    "dataset": pack_dataset,
}
BEFORE_TRUTH = ("inputs", "illumination", "visibility")
FRAMES = ("inputs", "illumination", "visibility", "shading", "color")
ALL = (*FRAMES, "dataset")


def _start(data: Path, stage: str, *options: str) -> subprocess.Popen[bytes]:
    """Start a stage's command in a session of its own, as a terminal would."""
    parameters = data.parent / "params.yaml"
    parameters.write_text(PARAMETERS)
    line = [stage, "--params", str(parameters), "--data", str(data), *options]
    return subprocess.Popen(
        [sys.executable, "-m", "pbrnet.pipeline.cli", *line],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        start_new_session=True,
        # A shell's background jobs ignore Ctrl-C, and so would what they start: these tests, say.
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
    )


def _finish(process: subprocess.Popen[bytes], codes: Sequence[int] = (0,)) -> str:
    words = process.communicate(timeout=400)[1].decode()
    assert process.returncode in codes, words
    return words


def _run(data: Path, *stages: str) -> None:
    """Run stages in this process."""
    parameters = data.parent / "params.yaml"
    parameters.write_text(PARAMETERS)
    params = load_params(parameters)
    for stage in stages:
        RUN[stage](data, params)


@pytest.fixture(scope="module")
def undisturbed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    data = tmp_path_factory.mktemp("undisturbed") / "data"
    for name, depth in (("alpha", 3.0), ("beta", 3.2)):
        write_room(data / "scenes" / name, size=(4.0, depth, 2.6))
    _run(data, "cameras", *STAGES)
    files = files_in(data, *ALL)
    assert len([name for name in files if name.endswith(".exr")]) >= 28
    assert any(name.endswith(".parquet") for name in files)
    return data


@pytest.fixture
def fresh(undisturbed: Path, tmp_path: Path) -> Path:
    """The same scenes and cameras, no frames yet."""
    for folder in ("scenes", "cameras"):
        shutil.copytree(undisturbed / folder, tmp_path / "data" / folder)
    return tmp_path / "data"


@pytest.fixture
def before_truth(fresh: Path, undisturbed: Path) -> Path:
    """The same with inputs and panoramas: only the ground truth is missing."""
    for folder in BEFORE_TRUTH:
        shutil.copytree(undisturbed / folder, fresh / folder)
    return fresh


def _wait_for_frames(
    data: Path,
    process: subprocess.Popen[bytes],
    count: int,
    kinds: Sequence[str] = ("shading", "color"),
) -> None:
    """Until so many frames of ground truth (or other kinds) are there, or the run is over."""
    deadline = time.monotonic() + 60
    while process.poll() is None and time.monotonic() < deadline:
        if sum(len(list((data / kind).rglob("*.exr"))) for kind in kinds) >= count:
            return
        time.sleep(0.01)


@pytest.mark.parametrize("seed", [0, pytest.param(1, marks=pytest.mark.check)])
def test_main_process_killed(fresh: Path, undisturbed: Path, seed: int) -> None:
    rng = np.random.default_rng(seed)
    if not seed:  # the longest stage every time, all of them in make check
        for folder in BEFORE_TRUTH:
            shutil.copytree(undisturbed / folder, fresh / folder)
    for stage in STAGES if seed else ("groundtruth",):
        victim = _start(fresh, stage)
        if seed and stage == "groundtruth":
            _wait_for_frames(fresh, victim, 1)
        time.sleep(rng.uniform(0.0, 2.0))
        left = workers_of(victim)
        victim.kill()
        victim.wait()
        assert victim.stderr
        victim.stderr.close()
        deadline = time.monotonic() + 20
        while any(p.is_running() and p.status() != "zombie" for p in left):
            assert time.monotonic() < deadline, "workers outlive the run they belong to"
            time.sleep(0.05)
        _finish(_start(fresh, stage))
    _run(fresh, "dataset")
    assert files_in(fresh, *ALL) == files_in(undisturbed, *ALL)


def test_workers_killed(before_truth: Path, undisturbed: Path) -> None:
    rng, fresh = np.random.default_rng(2), before_truth
    process = _start(fresh, "groundtruth")
    killed = 0
    for _ in range(2):
        _wait_for_frames(fresh, process, 1)
        time.sleep(rng.uniform(0.0, 1.0))
        # Their server is a child of the process, and they are the children of that server.
        workers = [p for p in workers_of(process) if p.ppid() != process.pid]
        if workers:
            workers[int(rng.integers(len(workers)))].kill()
            killed += 1
    _finish(process)
    assert killed
    assert files_in(fresh, *FRAMES) == files_in(undisturbed, *FRAMES)
    assert not (fresh / "failures" / "groundtruth.json").exists()


def test_scheduler_killed(before_truth: Path, undisturbed: Path, tmp_path: Path) -> None:
    fresh = before_truth
    with dask_cluster(tmp_path / "dask") as cluster:
        process = _start(fresh, "groundtruth", "--scheduler", cluster.address)
        _wait_for_frames(fresh, process, 1)
        cluster.scheduler.kill()
        if process.wait(timeout=120):
            assert "scheduler has gone" in _finish(process, (4,))
    _run(fresh, "groundtruth")
    assert files_in(fresh, *FRAMES) == files_in(undisturbed, *FRAMES)


def test_workers_in_other_folders_come_and_go(
    before_truth: Path, undisturbed: Path, tmp_path: Path
) -> None:
    fresh = before_truth
    with dask_cluster(tmp_path / "early") as cluster:
        process = _start(fresh, "groundtruth", "--scheduler", cluster.address)
        _wait_for_frames(fresh, process, 1)
        with dask_worker(cluster.address, tmp_path / "late"):
            _wait_for_frames(fresh, process, 3)
            cluster.worker.terminate()
            _finish(process)
    assert files_in(fresh, *FRAMES) == files_in(undisturbed, *FRAMES)


def test_a_worker_with_other_code_is_refused(fresh: Path, tmp_path: Path) -> None:
    shutil.copytree(ROOT / "pbrnet", tmp_path / "other" / "pbrnet")  # what its links lead to
    with (tmp_path / "other" / "pbrnet" / "pipeline" / "noise.py").open("a") as stream:
        stream.write("# one line more\n")
    with (
        dask_scheduler(tmp_path) as (address, _),
        dask_worker(address, tmp_path / "theirs", tmp_path / "other"),
    ):
        words = _finish(_start(fresh, "inputs", "--scheduler", address), (4,))
    assert "a worker runs pbrnet" in words and "install the same version" in words
    assert not list(fresh.rglob("*.exr"))


@pytest.mark.check
@pytest.mark.timeout(3600)
def test_twenty_kills(fresh: Path, undisturbed: Path, tmp_path: Path) -> None:
    """Twenty times SIGKILL, to a worker, the main process or the scheduler in turn, at random
    moments of a stage at work; only kills that hit count."""
    rng = np.random.default_rng(3)
    hits: list[str] = []
    for attempt in range(100):
        if len(hits) == 20:
            break
        stage = STAGES[int(rng.integers(3))]
        frames = ("shading", "color") if stage == "groundtruth" else (stage,)
        for kind in frames:
            shutil.rmtree(fresh / kind, ignore_errors=True)
        kind = ("worker", "main", "scheduler")[len(hits) % 3]
        with contextlib.ExitStack() as stack:
            cluster = None
            if kind == "scheduler" or rng.random() < 0.3:
                cluster = stack.enter_context(dask_cluster(tmp_path / f"dask{attempt}"))
            theirs = ["--scheduler", cluster.address] if cluster else []
            process = _start(fresh, stage, *theirs)
            if rng.random() < 0.7:  # else while everything starts
                _wait_for_frames(fresh, process, int(rng.integers(1, 4)), frames)
            elif cluster and kind == "worker":  # dask's command ends if its worker never started
                _wait_for_frames(fresh, process, 1, frames)
            time.sleep(rng.uniform(0.0, 2.0))
            workers = [
                worker
                for worker in workers_of(cluster.worker if cluster else process)
                if "spawn_main" in " ".join(worker.cmdline())
            ]
            there = process.poll() is None and (kind != "worker" or workers)
            if there and kind == "worker":
                workers[int(rng.integers(len(workers)))].kill()
            elif there:
                (process if kind == "main" or not cluster else cluster.scheduler).kill()
            # A run may be over before the signal arrives: it ends as if nothing had been killed.
            codes = {"worker": (0,), "main": (-signal.SIGKILL, 0), "scheduler": (4, 0)}[kind]
            words = _finish(process, codes if there else (0,))
            hits += [kind] if there and (kind == "worker" or process.returncode) else []
        assert "Traceback" not in words
    assert len(hits) == 20
    _run(fresh, *STAGES)
    assert files_in(fresh, *ALL) == files_in(undisturbed, *ALL)


def test_interrupt_leaves_whole_files_and_says_how_to_go_on(fresh: Path, undisturbed: Path) -> None:
    process = _start(fresh, "groundtruth", "--workers", "1")  # so that much is left to do
    _wait_for_frames(fresh, process, 1)
    os.killpg(process.pid, signal.SIGINT)
    started = time.monotonic()
    words = _finish(process, (130,))
    assert time.monotonic() - started < 15
    assert "same command again to resume" in words and "Traceback" not in words
    assert not list(fresh.rglob(".partial-*"))
    whole = files_in(undisturbed, *ALL)
    assert all(whole[name] == pixels for name, pixels in files_in(fresh, *ALL).items())
