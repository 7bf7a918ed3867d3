"""Libraries of `pbrnet[export]`, imported when a format needs them."""

from __future__ import annotations

import importlib
from typing import Any

from pbrnet.scenes.errors import MachineError


def library(name: str, purpose: str) -> Any:
    """Import and return a module; `MachineError` says how to install it."""
    try:
        return importlib.import_module(name)
    except ImportError as error:
        raise MachineError(
            f"{purpose} requires the library {name.split('.')[0]} ({error}); install it with: "
            "pip install 'pbrnet[export]'"
        ) from None
