"""Versions of the code, whole or of the modules that determine an output, and of the processor.

Workers that run other code than the command must not do its work. Outputs whose fingerprint
contains a `source_revision` are made again when a module that they depend on changes.
"""

from __future__ import annotations

import platform
from functools import lru_cache
from pathlib import Path

import numpy as np

from pbrnet.pipeline.imports import ROOT, import_closure
from pbrnet.scenes.errors import MachineError
from pbrnet.scenes.files import digest_bytes, digest_file
from pbrnet.scenes.installation import PACKAGE

_LAYERS = ("pipeline", "scenes")
PACKED = PACKAGE / "weights"  # pretrained networks: a checkout's, or an installation's


@lru_cache(maxsize=1)
def code_version() -> str:
    """Return a short digest of the sources of `pipeline` and `scenes`, by name and content."""
    sources = (path for folder in _LAYERS for path in (PACKAGE / folder).rglob("*.py"))
    return _digest(PACKAGE, sorted(sources))[:12]


def require_code(wanted: str) -> None:
    """Raise `MachineError` unless this process runs the code version `wanted`."""
    if code_version() != wanted:
        raise MachineError(
            f"a worker runs pbrnet {code_version()}, this command is {wanted}: install the same "
            "version on all workers and restart them"
        )


@lru_cache
def source_revision(*modules: str, root: Path = ROOT) -> str:
    """Return a digest of the sources of these modules and of all that they import.

    `modules` are dotted names; imports are followed within the project below `root`, also those
    inside functions. Raises `FileNotFoundError` if a module does not exist.
    """
    paths = [root / Path(*module.split(".")).with_suffix(".py") for module in modules]
    return _digest(root, import_closure(paths, root))


@lru_cache(maxsize=1)
def instruction_set() -> str:
    """Return the widest vector instructions of this processor: "AVX-512", "AVX2", or its name.

    Light frames depend on it in their last bits.
    """
    found = set(np.show_config(mode="dicts")["SIMD Extensions"]["found"])
    if found & {"X86_V4", "AVX512_SKX"}:
        return "AVX-512"
    return "AVX2" if found & {"X86_V3", "AVX2"} else platform.machine()


def _digest(root: Path, sources: list[Path]) -> str:
    parts = []
    for path in sources:
        parts += [path.relative_to(root).as_posix().encode(), digest_file(path).encode()]
    return digest_bytes(*parts)
