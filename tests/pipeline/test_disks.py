"""Full and read-only disks: one line, exit code 4, nothing lost, and the same command goes on."""

import shutil
import subprocess
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
import torch

from pbrnet.model.training.checkpoint import Checkpoint, State
from pbrnet.pipeline.dataset.pack import pack_dataset
from pbrnet.pipeline.export.hypersim import write_hdf5
from pbrnet.scenes.errors import MachineError
from tests.fixtures.command import Run
from tests.fixtures.dataset import make_data, small_params
from tests.fixtures.stages import files_in, write_room
from tests.fixtures.sweethome import BOX

PARAMS = "image: {width: 32, height: 24}\nillumination: {width: 32}\n"
# What writes; {} is the disk.
COMMANDS = {
    "init": "init {}/new",
    "layouts": "scenes --describe {}/layouts --params {}/homes.yaml --data {}/data",
    "import": "import {}/a.obj --out {}/data/scenes/a --scale 1",
    "assets": "assets --data {}/other --params {}/params.yaml",
    "picture": "inspect {}/data/dataset --out {}/a.png",
    "glb": "export-scene {}/room --to glb --out {}/room.glb",
    "archive": "export-scene {}/room --to mitsuba --out {}/room.zip",
    "hypersim": "export-data --to hypersim --partial --data {}/data",
    "webdataset": "export-data --to webdataset --data {}/data",
    "colmap": "export-data --to colmap --data {}/data",
    "views": "score --pin {}/pin.json --count 1 --dataset {}/data/dataset",
    "dataset": "dataset --data {}/data --params {}/params.yaml",
}


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A data folder with a packed dataset, a scene, a model and parameter files."""
    folder = tmp_path_factory.mktemp("made")
    params = small_params()
    pack_dataset(make_data(folder / "data", params, 3, 1), params)
    (folder / "params.yaml").write_text(PARAMS)
    (folder / "homes.yaml").write_text("scenes: {homes: 1, rooms_max: 1}\n")
    (folder / "a.obj").write_text(BOX)
    write_room(folder / "room")
    return folder


@pytest.fixture
def disk(made: Path, small_disk: Path) -> Path:
    """The same on a file system of its own."""
    subprocess.run(["mount", "-o", "remount,size=4m", small_disk], check=True)
    shutil.copytree(made, small_disk, dirs_exist_ok=True)
    return small_disk


@pytest.mark.parametrize("state", ["full", "nearly full", "read-only"])
@pytest.mark.parametrize("name", COMMANDS)
def test_a_disk_that_cannot_be_written_is_said_and_the_same_command_goes_on(
    name: str, state: str, disk: Path, pbrnet_run: Run
) -> None:
    words = COMMANDS[name].replace("{}", str(disk)).split()
    if name == "dataset":  # otherwise it is kept
        (disk / "data" / "packed.json").unlink()
    before = files_in(disk, ".")
    if state == "read-only":
        subprocess.run(["mount", "-o", "remount,ro", disk], check=True)
    else:
        free = shutil.disk_usage(disk).free - (0 if state == "full" else 24_000)
        with (disk / "ballast").open("wb", buffering=0) as ballast:
            ballast.write(bytes(free))
    code, _, said = pbrnet_run(*words)
    if state != "nearly full" or code:
        (line,) = [line for line in said.splitlines() if line.startswith("Error: ")]
        assert code == 4
        assert ("Read-only file system" if state == "read-only" else "disk is full") in line
        after = files_in(disk, ".")
        assert {name: after.get(name) for name in before} == before
    assert not list(disk.rglob(".partial-*"))
    if state == "read-only":
        subprocess.run(["mount", "-o", "remount,rw", disk], check=True)
    else:
        (disk / "ballast").unlink()
    if name != "init" or code:
        assert pbrnet_run(*words)[0] == 0


def test_hdf5_that_does_not_fit_ends_in_an_error_and_not_in_a_crash(small_disk: Path) -> None:
    pytest.importorskip("h5py")
    noise = np.random.default_rng(0).random((512, 512))
    with pytest.raises(OSError, match="No space left"):
        write_hdf5(small_disk / "a.hdf5", noise)


def test_a_checkpoint_that_does_not_fit_keeps_the_one_before(small_disk: Path) -> None:
    checkpoint = Checkpoint(small_disk / "a.pt", "run")
    small, large = (
        SimpleNamespace(modules={"network": torch.nn.Linear(width, width)}, state_dict=dict)
        for width in (8, 600)
    )
    checkpoint.save(cast(Any, small), {}, State(step=3))
    before = checkpoint.path.read_bytes()
    with pytest.raises(MachineError, match="disk is full"):
        checkpoint.save(cast(Any, large), {}, State(step=6))
    assert files_in(small_disk, ".") == {"a.pt": before}
