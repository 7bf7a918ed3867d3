"""Ways to stop a training in its middle."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest

from model.training import loop


class Killed(BaseException):
    """What no handler expects: the process is gone."""


def stop_at(
    monkeypatch: pytest.MonkeyPatch, call: int, error: type[BaseException] = Killed
) -> Callable[[], int]:
    """Raise the error when a loss is looked at for the `call`-th time; tells the calls so far."""
    calls = 0
    check = loop._stop_if_diverged

    def stop(*arguments: Any) -> None:
        nonlocal calls
        calls += 1
        if calls == call:
            raise error
        check(*arguments)

    monkeypatch.setattr(loop, "_stop_if_diverged", stop)
    return lambda: calls
