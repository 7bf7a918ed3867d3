"""Detection of frozen workers from outside: stopped processes and those that no longer answer.

A worker ends itself when an item takes too long (`pbrnet.pipeline.farm.worker`). A process that is
stopped, or whose machine swaps, cannot. Its heartbeats to the scheduler stop too.
"""

from __future__ import annotations

import contextlib
import time
from collections.abc import Callable, Collection, Mapping
from typing import Any

from distributed import Client

GRACE = 20.0  # seconds of silence beyond an item's time limit
_PATIENCE = 10.0  # seconds for a nanny to kill its worker


class Liveness:
    """Silence of each worker: seconds since its heartbeat last changed, by this process's clock.

    Clocks of other machines do not matter: `last_seen` values are only compared for equality.
    """

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock = clock
        self._seen: dict[str, tuple[float, float]] = {}  # address: last heartbeat, when it changed

    def silent(self, workers: Mapping[str, Mapping[str, Any]], limit: float) -> list[str]:
        """Return the sorted addresses of workers whose silence exceeds `limit` seconds.

        `workers` are those of dask's scheduler information.
        """
        now = self._clock()
        for address, facts in workers.items():
            heartbeat = float(facts["last_seen"])
            if self._seen.get(address, (None, 0.0))[0] != heartbeat:
                self._seen[address] = (heartbeat, now)
        self._seen = {address: self._seen[address] for address in workers}
        return sorted(one for one, (_, since) in self._seen.items() if now - since > limit)


def restart_workers(client: Client, addresses: Collection[str]) -> None:
    """Let the scheduler replace workers: their nannies kill them and start fresh processes.

    A worker without a nanny is removed. Its items, too, run again on other workers.
    """
    with contextlib.suppress(Exception):  # the scheduler may have gone: the dispatch reports that
        client.sync(
            client.scheduler.restart_workers,
            workers=list(addresses),
            timeout=_PATIENCE,
            wait_for_workers=False,
            on_error="return",
            stimulus_id="pbrnet-frozen-worker",
        )
