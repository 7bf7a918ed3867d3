"""An import that takes too long or too much memory is stopped, with one line and exit code 4."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import psutil
import pytest

from pbrnet.pipeline.farm.settings import FarmParams
from pbrnet.pipeline.params import Params
from pbrnet.pipeline.stages.runner import StageError
from pbrnet.pipeline.stages.scenes import run_scenes
from pbrnet.scenes.params import SceneParams
from pbrnet.scenes.registry import ImportEntry
from tests.fixtures.in_process import worker_processes
from tests.fixtures.rooms import shell, write_obj

IMPORT = (sys.executable, "-m", "pbrnet.pipeline.cli", "import")

# Each case runs in a fresh process, as a process with threads is not forked. That of the command
# has NumPy, whose OpenBLAS has threads where there are several processors.
WORK = """
import os, tempfile, time
from pbrnet.scenes.errors import InputError

def spin():
    while True: pass

def grow():
    kept = []
    while True: kept.append(bytearray(10**7)); time.sleep(0.001)

def refuse():
    raise InputError("x.obj: no")

def crash():
    os.abort()

def leave():
    tempfile.mkdtemp()
    spin()

def finish():
    print("working")
"""
CASES = """
import os, sys, threading, time
import numpy
import work
from pbrnet.pipeline.farm.limits import Limits, run_limited

if sys.argv[1] == "with threads":
    threading.Thread(target=threading.Event().wait, daemon=True).start()
for each in (work.spin, work.grow, work.refuse, work.crash, work.leave, work.finish):
    started = time.monotonic()
    try:
        run_limited(each, Limits(20, 0.4) if each is work.grow else Limits(0.7, 0.4), "x.obj")
        print(each.__name__, "fine", flush=True)
    except Exception as error:
        print(each.__name__, type(error).__name__, error.exit_code, error, flush=True)
    assert time.monotonic() - started < 15
print(len(os.listdir(os.environ["TMPDIR"])), "left")
"""


@pytest.mark.parametrize("kind", ["without threads", "with threads"])
def test_a_child_is_stopped_at_each_limit_and_its_errors_pass(tmp_path: Path, kind: str) -> None:
    module, temporary = tmp_path / "module", tmp_path / "temporary"
    module.mkdir()
    temporary.mkdir()
    (module / "work.py").write_text(WORK)
    path = os.pathsep.join([_environment()["PYTHONPATH"], str(module)])
    done = subprocess.run(
        [sys.executable, "-c", CASES, kind],
        env={**os.environ, "PYTHONPATH": path, "TMPDIR": str(temporary)},
        capture_output=True, text=True, timeout=100, check=True,
    )  # fmt: skip
    said = done.stdout.splitlines()
    assert said[0].startswith("spin StoppedError 4 x.obj: the import took more than 0.7 s")
    assert said[1].startswith("grow StoppedError 4 x.obj: the import needed more than 0.4 GiB")
    assert said[2] == "refuse InputError 3 x.obj: no"
    assert said[3].startswith("crash StoppedError 4 x.obj: the import ended without a word")
    assert said[4].startswith("leave StoppedError 4")
    assert said[5:] == ["working", "finish fine", "0 left"]


def test_the_command_ends_at_its_limit_and_leaves_nothing(tmp_path: Path) -> None:
    room = write_obj(tmp_path / "in" / "room.obj", shell())
    out = tmp_path / "out" / "room"
    done = subprocess.run(
        [*IMPORT, str(room), "--out", str(out),
         "--max-seconds", "0.3"],
        env=_environment(), capture_output=True, text=True, timeout=100, check=False,
    )  # fmt: skip
    assert done.returncode == 4, done.stderr
    assert "took more than 0.3 s" in done.stderr
    assert "--max-seconds" in done.stderr
    assert len(done.stderr.splitlines()) == 1
    assert not out.exists()
    assert not out.parent.exists() or list(out.parent.iterdir()) == []


def test_the_command_ends_at_its_limit_of_memory(tmp_path: Path) -> None:
    small, large = _small_and_large(tmp_path / "in")
    for path, code in ((small, 0), (large, 4)):
        out = tmp_path / "out" / path.stem
        done = subprocess.run(
            [*IMPORT, str(path), "--out", str(out), "--scale", "1", "--max-memory", "0.5"],
            env=_environment(), capture_output=True, text=True, timeout=100, check=False,
        )  # fmt: skip
        assert done.returncode == code, done.stderr
    assert "needed more than 0.5 GiB of memory" in done.stderr and "--max-memory" in done.stderr
    assert sorted(each.name for each in out.parent.iterdir()) == ["room"]


def test_the_stage_stops_an_import_and_goes_on(tmp_path: Path) -> None:
    small, large = _small_and_large(tmp_path / "in")
    imports = tuple(ImportEntry(file=str(path), scale=1.0) for path in (large, small))
    wanted = SceneParams(homes=0, imports=imports, import_memory=0.5)
    params = Params(scenes=wanted, farm=FarmParams(workers=1))
    started = time.monotonic()
    with (
        worker_processes(),
        pytest.raises(StageError, match="scenes: 1 failed, 1 made") as raised,
    ):
        run_scenes(tmp_path / "data", params)
    (failure,) = [line for line in str(raised.value).splitlines() if "large" in line]
    assert f"{large}: the import needed more than 0.5 GiB of memory and was stopped" in failure
    assert failure.endswith("or allow more with scenes.import_memory")
    assert [each.name for each in (tmp_path / "data" / "scenes").iterdir()] == ["room"]
    assert time.monotonic() - started < 60  # it is not tried again


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGKILL])
def test_a_killed_import_leaves_nothing_or_the_next_one_sweeps(
    tmp_path: Path, number: signal.Signals
) -> None:
    room = write_obj(tmp_path / "in" / "room.obj", shell())
    out, temporary = tmp_path / "out" / "room", tmp_path / "temporary"
    temporary.mkdir()
    environment = {**_environment(), "TMPDIR": str(temporary)}
    command = [*IMPORT, str(room), "--out", str(out)]
    with subprocess.Popen(
        command, env=environment, stderr=subprocess.PIPE, start_new_session=True
    ) as running:
        while running.poll() is None and not list(out.parent.glob(".partial-*")):
            time.sleep(0.005)
        children = psutil.Process(running.pid).children(recursive=True)
        running.send_signal(number)
        running.wait(60)
    assert not out.exists()
    assert not psutil.wait_procs(children, 30)[1]
    if number == signal.SIGTERM:
        assert running.returncode == 130
        assert not list(out.parent.glob(".partial-*"))
    subprocess.run(command, env=environment, check=True, timeout=100)
    assert sorted(path.name for path in out.parent.iterdir()) == ["room"]
    assert list(temporary.iterdir()) == []


def _small_and_large(folder: Path) -> tuple[Path, Path]:
    """A room, and a model whose import needs more than 0.5 GiB."""
    small, large = write_obj(folder / "room.obj", shell()), folder / "large.obj"
    corners = "".join(f"v {n % 1000} {n // 1000} {n % 7}\n" for n in range(600_000))
    faces = "".join(f"f {n} {n + 1} {n + 1000}\n" for n in range(1, 599_000))
    large.write_text(corners + faces)
    return small, large


def _environment() -> dict[str, str]:
    return {**os.environ, "PYTHONPATH": str(Path(__file__).parents[2])}
