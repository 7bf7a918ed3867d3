"""Fixtures of all tests, and the order in which processes take the files."""

import os
import subprocess
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.fixtures.command import Run, exit_code
from tests.fixtures.in_process import CHOSEN, worker_processes

# Two test processes share the machine: threads that wait for one another burn its time. Set before
# anything imports numpy or torch; trainings choose for themselves.
os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

pytest_plugins = ["tests.costs"]
# Fixtures that take long: what uses them is slow, or the next test would pay for them.
SLOW_FIXTURES = frozenset({"homes", "converted", "released"})
SHARED_SCENES = Path(__file__).resolve().parents[2] / "shared" / "scenes"


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Mark users of slow fixtures; put slow files first where several processes share the work."""
    for item in items:
        if SLOW_FIXTURES & set(getattr(item, "fixturenames", ())):
            item.add_marker("slow")
    if "PYTEST_XDIST_WORKER" in os.environ:
        slow = {item.path for item in items if item.get_closest_marker("slow")}
        items.sort(key=lambda item: item.path not in slow)


@pytest.fixture(scope="session", autouse=True)
def forked_imports() -> Iterator[None]:
    """Imports fork the test's process, as the command does; a fresh interpreter takes 1.5 s each.

    `tests/pipeline/test_import_limits.py` tests both ways, in processes of its own.
    """
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("pbrnet.pipeline.farm.limits._can_fork", lambda: True)
        yield


@pytest.fixture(scope="session", autouse=True)
def in_process() -> Iterator[None]:
    """Stages work in the test's process."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("pbrnet.pipeline.stages.runner.Farm", CHOSEN)
        yield


@pytest.fixture(scope="module", autouse=True)
def processes(request: pytest.FixtureRequest) -> Iterator[None]:
    """Workers are processes in modules marked so."""
    if request.node.get_closest_marker("processes"):
        with worker_processes():
            yield
    else:
        yield


@pytest.fixture(scope="module")
def few_walks() -> Iterator[None]:
    """Imports look for gaps with few random walks; for tests of what else an import does."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("pbrnet.scenes.reconstruction.enclosure._WALKS", 1024)
        patch.setattr("pbrnet.scenes.reconstruction.gap_sealing._WALKS", 1024)
        patch.setattr("pbrnet.scenes.reconstruction.hidden_openings._WALKS_PER_ROOM", 512)
        yield


@pytest.fixture(scope="session")
def variant() -> str:
    """The renderer's variant on this machine, chosen for this process."""
    from pbrnet.pipeline.render.scene import set_variant

    return set_variant()


@pytest.fixture(scope="session")
def wavefront(variant: str) -> None:
    """Skip what traces many rays at once where only the scalar variant runs."""
    if variant == "scalar_rgb":
        pytest.skip("the scalar variant traces one ray at a time")


@pytest.fixture(scope="session")
def shared_scenes() -> Path:
    """Real scenes by other people, which lie beside the project where they are available."""
    if not SHARED_SCENES.is_dir():
        pytest.skip("the shared example scenes are not on this machine")
    return SHARED_SCENES


@pytest.fixture
def pbrnet_run(capsys: pytest.CaptureFixture[str]) -> Run:
    """Function that runs `pbrnet` with words: exit code, output, errors."""

    def run(*words: object) -> tuple[int, str, str]:
        code = exit_code(*words)
        return (code, *capsys.readouterr())

    return run


@pytest.fixture
def small_disk(tmp_path: Path) -> Iterator[Path]:
    """A file system of its own with 1 MiB, to be filled up."""
    mount = tmp_path / "small"
    mount.mkdir()
    command = ["mount", "-t", "tmpfs", "-o", "size=1m", "tmpfs", str(mount)]
    if os.geteuid() != 0 or subprocess.run(command, capture_output=True).returncode != 0:
        pytest.skip("mounting a small file system needs root")
    yield mount
    subprocess.run(["umount", "-l", str(mount)], check=True)
