"""Versions of code, scene and processor, and memory: what tells one worker from another."""

from __future__ import annotations

import platform
import resource
import time
from collections.abc import Sequence
from dataclasses import replace
from functools import lru_cache
from pathlib import Path

import numpy as np
import psutil

from pbrnet.pipeline.frames import fingerprint
from pbrnet.scenes.contract import load_scene
from pbrnet.scenes.errors import MachineError
from pbrnet.scenes.files import digest_bytes, digest_file
from pbrnet.scenes.installation import PACKAGE

_LAYERS = ("pipeline", "scenes")
_KINDS = ("*.py", "*.toml", "*.yaml")  # of sources: code, and the tables of modules beside them
PACKED = PACKAGE / "weights"  # pretrained networks: a checkout's, or an installation's
_SURE = 2.0  # seconds after which a changed file has another time
_digests: dict[Path, tuple[int, str]] = {}  # of scene folders, with the state of their files


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


def processor() -> str:
    """Return the processor's name."""
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        lines = []
    names = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return names[0] if names else platform.processor() or platform.machine()


def scene_digest(folder: Path) -> str:
    """Return 64 hex digits over a scene folder, but for the stage's own keys and what may move.

    It is computed again when a file's time, size or place on the disk has changed. Raises
    `InputError` for a scene that cannot be read.
    """
    files = sorted(file for file in folder.rglob("*") if file.is_file())
    facts = [file.stat() for file in files]
    state = hash(
        tuple(
            (str(file), one.st_mtime_ns, one.st_ctime_ns, one.st_size, one.st_ino)
            for file, one in zip(files, facts, strict=True)
        )
    )
    known = _digests.get(folder)
    if known is None or known[0] != state:
        known = state, _scene_digest(folder, files)
        # A change within the resolution of the file system's clock would not be seen.
        if time.time() - max((one.st_ctime for one in facts), default=0.0) > _SURE:
            _digests[folder] = known
    return known[1]


def _scene_digest(folder: Path, files: Sequence[Path]) -> str:
    scene = load_scene(folder)
    bare = replace(scene, source=scene.origin, joints=())
    contents = {
        file.relative_to(folder).as_posix(): digest_file(file)
        for file in files
        if file != folder / "scene.json"
    }
    return fingerprint(scene=bare, files=contents)


def memory_columns() -> dict[str, float]:
    """Return this process's ledger columns: its memory now and its peak so far, in MB."""
    now = psutil.Process().memory_info().rss / (1 << 20)
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    return {"memory_mb": now, "peak_mb": max(now, peak)}
