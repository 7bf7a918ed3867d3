"""All stages with one command, on a folder of its own."""

import fcntl
from pathlib import Path
from typing import Any

import pytest
from click.testing import CliRunner

from pbrnet.pipeline.cli import cli
from pbrnet.pipeline.commands import stages as commands
from pbrnet.pipeline.costs.forecast import view_size
from pbrnet.pipeline.params import Params
from pbrnet.pipeline.records import data_lock
from pbrnet.pipeline.stages.runner import StageError, StagePlan, begin, finish, stages_together
from pbrnet.scenes.errors import MachineError, PbrnetError


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "p.yaml").write_text("seed: 5\n")
    return tmp_path


def stages(monkeypatch: pytest.MonkeyPatch, **failing: Exception) -> list[tuple[str, Path, int]]:
    """Replace the stages by functions that note their calls; some fail."""
    calls: list[tuple[str, Path, int]] = []

    def stage(name: str) -> Any:
        def made(data: Path, params: Any, scheduler: str | None) -> str:
            calls.append((name, data, params.seed))
            if name in failing:
                raise failing[name]
            return f"{name}: 1 made"

        return made

    def frames(names: list[str], *given: Any) -> list[object]:
        outcomes: list[object] = []
        for name in names:
            try:
                outcomes.append(commands.STAGES[name](*given))
            except StageError as error:
                outcomes.append(error)
        return outcomes

    monkeypatch.setattr(commands, "STAGES", {name: stage(name) for name in commands.STAGES})
    monkeypatch.setattr(commands, "run_frame_stages", frames)
    return calls


def invoke(folder: Path, *more: str) -> Any:
    arguments = ["run", "--params", str(folder / "p.yaml"), "--data", str(folder / "d"), *more]
    return CliRunner().invoke(cli, arguments)


def test_every_stage_runs_once_and_in_order(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    calls = stages(monkeypatch)
    done = invoke(folder)
    assert done.exit_code == 0, done.output
    assert calls == [(name, folder / "d", 5) for name in commands.STAGES]
    assert "[4-6/7] inputs, illumination, groundtruth" in done.output
    assert "[7/7] dataset" in done.output and "groundtruth: 1 made" in done.output
    calls.clear()
    assert invoke(folder, "--until", "cameras", "--seed", "7").exit_code == 0
    assert [(name, seed) for name, _, seed in calls] == [
        ("assets", 7),
        ("scenes", 7),
        ("cameras", 7),
    ]


def test_failed_views_do_not_stop_the_others_but_are_told(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    calls = stages(monkeypatch, inputs=StageError("inputs: 1 failed, 8 made"))
    done = invoke(folder)
    assert isinstance(done.exception, StageError) and done.exception.exit_code == 1
    assert len(calls) == len(commands.STAGES), "the dataset has what there is"
    assert "inputs: 1 failed, 8 made" in done.output


def test_plan_and_trash_are_said_once(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    lying = tmp_path / "trash" / "color" / "one" / "a.exr"
    lying.parent.mkdir(parents=True)
    lying.touch()
    params = Params()
    plan = StagePlan(tmp_path, params.farm, view_size(params), "color", "views", print)
    with stages_together(plan.trash):
        begin(plan)
        assert not finish(plan, {}).notes and capsys.readouterr() == ("", "")
    assert "trash: 1 item, 0.0 MB" in capsys.readouterr().out
    begin(plan)
    assert finish(plan, {}).notes and "color: 0 to make" in capsys.readouterr().err


def test_a_fault_of_the_machine_stops_it(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    calls = stages(monkeypatch, cameras=MachineError("the disk is full"))
    done = invoke(folder)
    assert isinstance(done.exception, MachineError)
    assert [name for name, _, _ in calls] == ["assets", "scenes", "cameras"]


def test_no_other_run_begins_between_its_stages(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    held = []

    def stage(data: Path, *_: object) -> str:
        with (data / ".lock").open() as lock:
            try:
                fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError:
                held.append(lock.read().partition(" (")[0])
        with data_lock(data, "stage"):  # a stage takes what its run holds
            return "made"

    monkeypatch.setattr(commands, "STAGES", dict.fromkeys(commands.STAGES, stage))
    monkeypatch.setattr(
        commands, "run_frame_stages", lambda names, *given: [stage(*given) for _ in names]
    )
    assert invoke(folder).exit_code == 0
    assert held == ["'pbrnet run'"] * len(commands.STAGES)
    with data_lock(folder / "d", "cameras"):
        done = invoke(folder)
    assert isinstance(done.exception, PbrnetError) and "in use by 'pbrnet cam" in str(
        done.exception
    )
    assert len(held) == len(commands.STAGES)
    assert not invoke(folder, "--dry-run").exit_code
