"""A run on a scheduler without workers says so, and what to start."""

from types import SimpleNamespace
from typing import Any

import pytest

from pbrnet.pipeline.farm import dispatch as module
from pbrnet.pipeline.farm.dispatch import FIRST_PATIENCE, WORKER_PATIENCE, Dispatch
from pbrnet.pipeline.farm.settings import FarmParams
from pbrnet.scenes.errors import MachineError


def without_workers(external: bool) -> Dispatch:
    """A dispatch on a client whose scheduler has no worker."""
    client: Any = SimpleNamespace(
        status="running", scheduler=SimpleNamespace(address="tcp://10.0.0.1:8786")
    )
    return Dispatch(client, FarmParams(), int, 0, str, [], refill=lambda: None, external=external)


def test_workers_that_are_gone_with_their_scheduler(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    now = 1000.0
    monkeypatch.setattr(module.time, "monotonic", lambda: now)
    farm = without_workers(external=True)
    farm.check_for_workers()
    assert capsys.readouterr().err == ""
    now += 6
    farm.check_for_workers()
    farm.check_for_workers()
    assert capsys.readouterr().err.count("dask worker tcp://10.0.0.1:8786") == 1
    now += FIRST_PATIENCE
    with pytest.raises(MachineError, match=r"no worker .* start one with: dask worker tcp://10"):
        farm.check_for_workers()


def test_workers_that_were_there_are_waited_for(monkeypatch: pytest.MonkeyPatch) -> None:
    now = 1000.0
    monkeypatch.setattr(module.time, "monotonic", lambda: now)
    for external in (True, False):
        farm = without_workers(external)
        farm.had_worker = True
        now += WORKER_PATIENCE - 1
        farm.check_for_workers()
        now += 2
        with pytest.raises(MachineError, match="no dask worker for 300 s"):
            farm.check_for_workers()
