"""Which code this is, and what comes with it.

Workers that run other code than the command must not do its work.
"""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path

from scenes.errors import MachineError
from scenes.files import digest_bytes, digest_file

_ROOT = Path(__file__).resolve().parent.parent
_PACKAGES = ("pipeline", "scenes")
PACKED = _ROOT / "weights"  # pretrained networks: a checkout's, or an installation's


@lru_cache(maxsize=1)
def code_version() -> str:
    """A short digest of the sources of `pipeline` and `scenes`, by name and content."""
    sources = (path for package in _PACKAGES for path in (_ROOT / package).rglob("*.py"))
    parts = []
    for path in sorted(sources):
        parts += [path.relative_to(_ROOT).as_posix().encode(), digest_file(path).encode()]
    return digest_bytes(*parts)[:12]


def require_code(wanted: str) -> None:
    """Raise `MachineError` unless this process runs the code `wanted`."""
    if code_version() != wanted:
        raise MachineError(
            f"a worker runs pbrnet {code_version()}, this command is {wanted}: bring the same "
            "version to all workers and start them again"
        )
