"""The farm: everything asked for is done once, and what cannot be done is named."""

import os
import re
import signal
import tempfile
import time
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import psutil
import pytest
from dask.system import cpu_count
from distributed import Future

from pbrnet.pipeline.farm import cluster
from pbrnet.pipeline.farm.cluster import Farm
from pbrnet.pipeline.farm.dispatch import BatchQueue, Dispatch, Liveness
from pbrnet.pipeline.farm.settings import FarmParams
from pbrnet.pipeline.farm.worker import Item, Outcome, WorkerHistory
from pbrnet.scenes.errors import MachineError, ParameterError
from tests.fixtures.dask_processes import dask_cluster, workers_of
from tests.fixtures.farm import no_setup, work

pytestmark = [pytest.mark.slow, pytest.mark.processes]


def _items(count: int, **special: dict[str, Any]) -> list[Item]:
    names = [f"k{index}" for index in range(count)]
    return [
        Item(name, f"g{index // 5}", {"name": name, **special.get(name, {})})
        for index, name in enumerate(names)
    ]


def _run(items: list[Item], params: FarmParams | None = None) -> dict[str, Outcome]:
    params = params or FarmParams(workers=2, batch=4)
    with Farm(params, None, no_setup, len(items)) as farm:
        outcomes = list(farm.run(work, items))
    assert Counter(outcome.key for outcome in outcomes) == Counter(item.key for item in items)
    return {outcome.key: outcome for outcome in outcomes}


def test_every_item_is_done_once_and_the_broken_one_is_named(tmp_path: Path) -> None:
    log: dict[str, Any] = {"log": str(tmp_path)}
    special = {
        "k3": {"do": "raise", **log},
        "k8": {"do": "bug", **log},
        "k11": {"do": "raise", "well_after": 1, **log},
    }
    outcomes = _run(_items(23, **special))
    assert outcomes["k3"].error == "k3: broken on purpose"
    assert re.fullmatch(r"KeyError: 'k8' \(in work, line \d+\)", outcomes["k8"].error)
    assert outcomes["k3"].attempt == outcomes["k8"].attempt == 3
    assert len(list(tmp_path.glob("k3-*"))) == 3
    assert (outcomes["k11"].value, outcomes["k11"].attempt) == ("k11", 2)
    others = [o for key, o in outcomes.items() if key not in special]
    assert all((o.value, o.error, o.attempt) == (o.key, "", 1) for o in others)
    assert all(o.worker for o in others)


def test_an_item_that_kills_its_workers_is_found_among_innocent_ones(tmp_path: Path) -> None:
    killer = {"do": "die", "log": str(tmp_path)}
    outcomes = _run(_items(20, k7=killer), FarmParams(workers=2, batch=8, retries=1))
    assert "died" in outcomes["k7"].error
    assert all(not outcome.error for key, outcome in outcomes.items() if key != "k7")


def test_a_worker_that_was_given_up_is_started_anew(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """On a busy machine a worker may come back too late for dask, which then forgets it."""
    monkeypatch.setattr("pbrnet.pipeline.farm.cluster._LOST", "1ms")
    once = {"do": "die", "well_after": 1, "log": str(tmp_path)}
    outcomes = _run(_items(6, k2=once), FarmParams(workers=1, batch=2))
    assert all(not outcome.error for outcome in outcomes.values())


def test_an_endless_item_is_ended_and_named() -> None:
    params = FarmParams(workers=2, batch=4, retries=1, time_limit=3)
    outcomes = _run(_items(8, k2={"do": "hang"}), params)
    assert "longer than farm.time_limit allows (3 s)" in outcomes["k2"].error
    assert all(not outcome.error for key, outcome in outcomes.items() if key != "k2")


def test_a_frozen_worker_is_replaced_from_outside(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("pbrnet.pipeline.farm.dispatch.GRACE", 3.0)
    once = {"do": "stop", "well_after": 1, "log": str(tmp_path)}
    before = time.monotonic()
    outcomes = _run(_items(6, k2=once), FarmParams(workers=1, batch=2, time_limit=2))
    assert time.monotonic() - before < 90
    assert all(not outcome.error for outcome in outcomes.values())
    (first, second) = sorted(tmp_path.glob("k2-*"))
    assert first.name.split("-")[-1] != second.name.split("-")[-1]  # another process
    assert not psutil.pid_exists(int(first.name.split("-")[-1]))


def test_silence_is_measured_by_changes_of_the_heartbeat() -> None:
    now = [0.0]
    liveness = Liveness(lambda: now[0])
    assert liveness.silent({"a": {"last_seen": 1e9}, "b": {"last_seen": 5}}, 10) == []
    now[0] = 8.0
    assert liveness.silent({"a": {"last_seen": 1e9 + 1}, "b": {"last_seen": 5}}, 10) == []
    now[0] = 11.0
    assert liveness.silent({"a": {"last_seen": 1e9 + 1}, "b": {"last_seen": 5}}, 10) == ["b"]
    assert liveness.silent({"a": {"last_seen": 1e9 + 1}}, 2) == ["a"]


def test_outcomes_that_die_with_their_worker_are_made_again(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """A worker is killed when its batch is finished and its outcomes are not yet fetched."""
    collect, killed = Dispatch.collect, []

    def kill_first(run: Dispatch, future: Future) -> Iterator[Outcome]:
        if not killed and future.status == "finished":
            (holder,) = run.client.who_has([future])[future.key]
            killed.append(run.client.run(os.getpid, workers=[holder])[holder])
            os.kill(killed[0], signal.SIGKILL)
            deadline = time.monotonic() + 60
            while future.status == "finished":
                assert time.monotonic() < deadline, "the loss of the outcomes was not seen"
                time.sleep(0.01)
        yield from collect(run, future)

    monkeypatch.setattr(Dispatch, "collect", kill_first)
    slow = {f"k{index}": {"sleep": 0.5} for index in range(6)}  # made again too soon, it is missed
    outcomes = _run(_items(6, **slow), FarmParams(workers=2, batch=2))
    assert killed
    assert all((o.value, o.error) == (key, "") for key, o in outcomes.items())


@pytest.mark.parametrize("workers", [1, pytest.param(2, marks=pytest.mark.check)])
def test_workers_are_replaced_after_so_many_scenes(workers: int, tmp_path: Path) -> None:
    """Nothing is done twice for it, not even where there is nobody else meanwhile."""
    log = {f"k{index}": {"log": str(tmp_path)} for index in range(30)}  # six scenes
    outcomes = _run(_items(30, **log), FarmParams(workers=workers, batch=2, recycle=2))
    assert all((o.value, o.error, o.attempt) == (key, "", 1) for key, o in outcomes.items())
    assert len(list(tmp_path.iterdir())) == 30
    scenes: dict[str, set[str]] = {}
    for key, outcome in outcomes.items():
        scenes.setdefault(outcome.worker, set()).add(f"g{int(key[1:]) // 5}")
    assert len(scenes) >= 3
    assert max(len(groups) for groups in scenes.values()) <= 2


def test_a_process_that_grew_is_replaced_but_not_for_little_or_too_early() -> None:
    mb, history = 1 << 20, WorkerHistory()
    for number, held in enumerate((100, 900, 950, 400, 500)):
        assert not history.reason(f"g{number}", held * mb, 100), "settled at 400 MB"
        history.begin(f"g{number}", held * mb)
    assert not history.reason("g5", 655 * mb, 100)
    assert history.reason("g5", 700 * mb, 100) == "700.00 MiB of memory, 400.00 MiB at first"
    assert not history.reason("g4", 5000 * mb, 100), "it has this scene open"
    assert not history.reason("g5", 5000 * mb, 0)
    assert "5 scenes" in history.reason("g5", 400 * mb, 5)


def test_a_machine_that_lacks_something_stops_the_run() -> None:
    with pytest.raises(MachineError, match="the disk is full"):
        _run(_items(12, k2={"do": "full"}))


def test_workers_that_die_while_they_start_are_started_again(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    start, failures = cluster.LocalCluster, [2, 3]

    def dying(**options: Any) -> Any:
        if failures[0]:
            failures[0] -= 1
            raise RuntimeError("Nanny failed to start.")
        return start(**options)

    monkeypatch.setattr(cluster, "LocalCluster", dying)
    params = FarmParams(workers=1, retries=2)
    assert _run(_items(1), params)["k0"].value == "k0"
    assert capsys.readouterr().err.count("trying again") == 2
    failures.pop(0)
    with pytest.raises(MachineError, match="could not be started"):
        _run(_items(1), params)


def test_workers_and_folder_are_gone_afterwards() -> None:
    before = {process.pid for process in psutil.Process().children(recursive=True)}
    farm = Farm(FarmParams(workers=2), None, no_setup, 8)
    with pytest.raises(KeyboardInterrupt), farm:
        for _ in farm.run(work, _items(8, k7={"sleep": 60.0})):
            started = time.monotonic()
            raise KeyboardInterrupt
    assert time.monotonic() - started < 10
    left = [p for p in psutil.Process().children(recursive=True) if p.pid not in before]
    assert not [p for p in left if "spawn_main" in " ".join(p.cmdline())]


@pytest.mark.parametrize(("workers", "count"), [(0, 2), (3, 3)])
def test_every_card_has_a_worker_which_sees_no_other(workers: int, count: int) -> None:
    params = FarmParams(workers=workers, batch=1, window=1)
    names = {f"k{index}": {"do": "card", "sleep": 0.5} for index in range(8)}
    with Farm(params, None, no_setup, 8, cards=("2", "GPU-b")) as farm:
        assert farm.wanted == count and farm.threads == max(1, cpu_count() // count)
        outcomes = list(farm.run(work, _items(8, **names)))
    cards = {outcome.worker: outcome.value for outcome in outcomes}
    assert len(cards) == count and set(cards.values()) == {"2", "GPU-b"}
    assert all(cards[outcome.worker] == outcome.value for outcome in outcomes)


def test_two_items_of_one_name_are_refused() -> None:
    farm = Farm(FarmParams(workers=1), None, no_setup, 2)
    with pytest.raises(ValueError, match="same key"), farm:
        list(farm.run(work, [*_items(1), *_items(1)]))


def test_no_scheduler_at_the_address(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("pbrnet.pipeline.farm.cluster.CONNECT_PATIENCE", 1.0)
    farm = Farm(FarmParams(), "tcp://127.0.0.1:9", no_setup, 1)
    with pytest.raises(MachineError, match=r"no dask scheduler answers at 'tcp://127\.0\.0\.1:9'"):
        farm.__enter__()


def test_a_temporary_folder_too_deep_for_sockets_is_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    deep = tmp_path / ("x" * 60) / ("y" * 60)
    deep.mkdir(parents=True)
    monkeypatch.setattr(tempfile, "tempdir", str(deep))
    with pytest.raises(MachineError, match="set TMPDIR"), Farm(FarmParams(), None, no_setup, 1):
        pass


def test_an_address_without_a_port_is_refused() -> None:
    with pytest.raises(ParameterError, match="tcp://head:8786"):
        Farm(FarmParams(), "nonsense", no_setup, 1).__enter__()


def test_the_environment_names_the_scheduler_and_losing_it_is_said(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with dask_cluster(tmp_path) as theirs:
        monkeypatch.setenv("DASK_SCHEDULER_ADDRESS", theirs.address)
        with Farm(FarmParams(batch=2), None, no_setup, 9) as farm:
            outcomes = list(farm.run(work, _items(9)))
            assert sorted(outcome.value for outcome in outcomes) == [f"k{i}" for i in range(9)]
            pids = {process.pid for process in workers_of(theirs.worker)}
            assert {int(outcome.worker.split(":")[1]) for outcome in outcomes} <= pids
            lost = farm.run(work, _items(9, k8={"sleep": 60.0}))
            next(lost)
            theirs.scheduler.kill()
            with pytest.raises(MachineError, match="scheduler has gone"):
                list(lost)


def test_waiting_items_keep_a_worker_on_its_scene_and_shrink_at_the_end() -> None:
    sizes = {"small": 3, "big": 20, "middle": 9}
    items = [Item(f"{g}{i}", g, None) for g, size in sizes.items() for i in range(size)]
    queue = BatchQueue(items, batch=4, window=1)
    taken: dict[str, list[tuple[str, int]]] = {"a": [], "b": []}
    seen: list[str] = []
    while queue:
        for worker, log in taken.items():
            batch = queue.take(worker, 2)
            if batch:
                assert len({item.group for item in batch}) == 1
                log.append((batch[0].group, len(batch)))
                seen += [item.key for item in batch]
    assert sorted(seen) == sorted(item.key for item in items)
    assert taken["a"][0][0] == "big" and taken["b"][0][0] == "middle"
    for log in taken.values():  # no worker comes back to a scene it left
        changes = [group for i, (group, _) in enumerate(log) if not i or log[i - 1][0] != group]
        assert len(set(changes)) == len(changes)
    last = [log[-1][1] for log in taken.values()]
    assert max(last) <= 2
    assert queue.take("a", 2) == ()
