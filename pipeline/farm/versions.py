"""Versions of code and processor: workers with other code than the command must not do its work."""

from __future__ import annotations

import platform
from functools import lru_cache

import numpy as np

from pbrnet.scenes.errors import MachineError
from pbrnet.scenes.files import digest_bytes, digest_file
from pbrnet.scenes.installation import PACKAGE

_LAYERS = ("pipeline", "scenes")
_KINDS = ("*.py", "*.yaml")  # of sources: code, and the tables of modules beside them
PACKED = PACKAGE / "weights"  # pretrained networks: a checkout's, or an installation's


@lru_cache(maxsize=1)
def code_version() -> str:
    """Return a short digest of the sources of `pipeline` and `scenes`, by name and content."""
    parts = []
    folders = [PACKAGE / layer for layer in _LAYERS]
    for path in sorted(one for folder in folders for kind in _KINDS for one in folder.rglob(kind)):
        parts += [path.relative_to(PACKAGE).as_posix().encode(), digest_file(path).encode()]
    return digest_bytes(*parts)[:12]


def require_code(wanted: str) -> None:
    """Raise `MachineError` unless this process runs the code version `wanted`."""
    if code_version() != wanted:
        raise MachineError(
            f"a worker runs pbrnet {code_version()}, this command is {wanted}: install the same "
            "version on all workers and restart them"
        )


@lru_cache(maxsize=1)
def instruction_set() -> str:
    """Return the widest vector instructions of this processor: "AVX-512", "AVX2", or its name.

    Light frames depend on it in their last bits.
    """
    found = set(np.show_config(mode="dicts")["SIMD Extensions"]["found"])
    if found & {"X86_V4", "AVX512_SKX"}:
        return "AVX-512"
    return "AVX2" if found & {"X86_V3", "AVX2"} else platform.machine()
