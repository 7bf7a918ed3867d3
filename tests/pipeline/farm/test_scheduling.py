"""Who gets what next: nobody waits while others still have much to do."""

import heapq
from pathlib import Path

import numpy as np
import pytest

from pbrnet.pipeline.costs.forecast import estimator
from pbrnet.pipeline.costs.ledger import Ledger, read_ledger
from pbrnet.pipeline.farm.dispatch import BatchQueue
from pbrnet.pipeline.farm.worker import Item


def _makespan(items: list[Item], seconds: dict[str, float], workers: int, opening: float) -> float:
    """Play the farm: every worker takes its next batch as soon as it is done, one in flight."""
    queue = BatchQueue(items, batch=8, window=1)
    clocks = [(0.0, f"w{index}", "") for index in range(workers)]
    done: list[str] = []
    end = 0.0
    while clocks:
        now, worker, group = heapq.heappop(clocks)
        batch = queue.take(worker, workers)
        if not batch:
            end = max(end, now)
            continue
        done += [item.key for item in batch]
        now += sum(seconds[item.key] for item in batch)
        now += opening * (batch[0].group != group)
        heapq.heappush(clocks, (now, worker, batch[0].group))
    assert sorted(done) == sorted(seconds), "everything, once"
    return end


@pytest.mark.parametrize("seed", range(5))
def test_with_estimates_workers_end_together(seed: int) -> None:
    """Scenes differ in cost by a hundred, views of one scene by three."""
    rng = np.random.default_rng(seed)
    seconds: dict[str, float] = {}
    blind, informed = [], []
    for scene in range(40):
        cost = 10 ** rng.uniform(-1, 1)
        for view in range(5):
            key = f"s{scene:02}-{view}"
            seconds[key] = cost * rng.uniform(0.6, 1.8)
            guess = cost * rng.uniform(0.8, 1.25)
            blind.append(Item(key, f"s{scene:02}", None))
            informed.append(Item(key, f"s{scene:02}", None, guess))
    workers, opening = 8, 0.5
    ideal = (sum(seconds.values()) + 40 * opening) / workers
    by_estimate = _makespan(informed, seconds, workers, opening)
    assert by_estimate < 1.12 * ideal
    assert by_estimate < _makespan(blind, seconds, workers, opening)


def test_the_longest_of_the_largest_scene_comes_first() -> None:
    items = [Item("a0", "a", None, 1.0), Item("a1", "a", None, 1.0), Item("b0", "b", None, 1.0)]
    items += [Item("b1", "b", None, 9.0)]
    queue = BatchQueue(items, batch=1, window=1)
    assert [queue.take("w", 1)[0].key for _ in items] == ["b1", "b0", "a0", "a1"]
    assert not queue


def test_what_follows_in_a_scene_goes_to_the_worker_that_has_it_open() -> None:
    """Phases share no batch; added items come before scenes that nobody has opened."""
    items = [
        Item(f"{scene}{phase}{number}", scene, None, 1.0 + number, phase)
        for scene in "ab"
        for phase in (1, 0)
        for number in range(2)
    ]
    queue = BatchQueue(items, batch=8, window=1)
    taken = [queue.take("w", 1)]
    queue.add([Item("a20", "a", None, 9.0, 2)])
    while queue:
        taken.append(queue.take("w", 1))
    named = [" ".join(item.key for item in batch) for batch in taken]
    assert named == ["a01 a00", "a11 a10", "a20", "b01 b00", "b11 b10"]


def test_estimates_come_from_the_same_thing_or_from_its_scene(tmp_path: Path) -> None:
    ledger = Ledger(tmp_path)
    for scene, factor in (("plain", 1.0), ("rich", 3.0)):
        ledger.add(("inputs", scene, "000"), seconds=0.1 * factor)
        ledger.add(("illumination", scene, "000"), seconds=0.4 * factor)
    ledger.add(("color", "plain", "000"), seconds=8.0)
    ledger.save()
    estimate = estimator(read_ledger(tmp_path))
    assert estimate("inputs", "rich", "000") == pytest.approx(0.3)
    assert estimate("inputs", "rich", "001") == pytest.approx(0.2 * 1.5)
    assert estimate("color", "rich", "000") == pytest.approx(8.0 * 1.5)
    assert estimate("color", "new", "000") == pytest.approx(8.0)
    assert estimate("shading", "rich", "000") == pytest.approx(1.5)
    assert estimator(read_ledger(tmp_path / "nothing"))("color", "a", "000") == 1.0
