"""The installed package: its folder, the folder it is imported from, and optional libraries."""

from __future__ import annotations

import importlib
from pathlib import Path
from typing import Any

import pbrnet
from pbrnet.scenes.errors import MachineError

PACKAGE = Path(pbrnet.__file__).parent  # the folder `pbrnet`; in a checkout it holds links
IMPORT_FOLDER = PACKAGE.parent  # the entry of `sys.path` that makes `import pbrnet` work


def optional(module: str, extra: str = "formats") -> Any:
    """Import a library of an extra, or a module that needs one.

    Raises `MachineError` that says how to install a library that is missing.
    """
    try:
        return importlib.import_module(module)
    except ModuleNotFoundError as error:
        if str(error.name).startswith("pbrnet"):
            raise
        raise MachineError(
            f"the library {error.name} is missing; install pbrnet[{extra}], for example by: "
            f"pip install 'pbrnet[{extra}]'"
        ) from None
