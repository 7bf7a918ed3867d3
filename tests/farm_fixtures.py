"""Work for the farm's tests: what workers import by name."""

from __future__ import annotations

import ctypes
import os
import signal
import time
from pathlib import Path
from typing import Any

from scenes.errors import InputError, MachineError


def no_setup(threads: int) -> None:
    """Nothing to prepare."""


def work(payload: dict[str, Any]) -> Any:
    """Do what the payload says: wait, raise, die, fill a disk; log each attempt as a file."""
    log = payload.get("log")
    if log:
        attempts = len(list(Path(log).glob(f"{payload['name']}-*")))
        (Path(log) / f"{payload['name']}-{attempts}-{os.getpid()}").touch()
        if attempts >= payload.get("well_after", 1 << 30):
            return payload["name"]
    time.sleep(payload.get("sleep", 0.0))
    match payload.get("do"):
        case "raise":
            raise InputError(f"{payload['name']}: broken on purpose")
        case "bug":
            raise KeyError(payload["name"])
        case "die":
            os.kill(os.getpid(), signal.SIGKILL)
        case "hang":
            ctypes.PyDLL(None).sleep(600)  # native code that keeps the interpreter's lock
        case "full":
            raise MachineError("the disk is full")
    return payload["name"]
