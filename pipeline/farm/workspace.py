"""Files of a worker: read and written in the shared data folder, or transferred through dask.

A worker that sees the data folder reads and writes there, and only paths travel. Any other worker
receives each scene once, keeps it in a store on its own machine, and returns its files to the
command, which writes them. The parameter `farm.transfer` chooses: `shared`, `send`, or `auto`,
which looks for this run's token file in the data folder.
"""

from __future__ import annotations

import contextlib
import os
import shutil
import tempfile
import uuid
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any, Literal

from pbrnet.pipeline.farm.content_store import (
    Chunk,
    ContentStore,
    StoredFile,
    list_files,
    read_chunks,
)
from pbrnet.pipeline.farm.transfer import TransferService, request_bundles
from pbrnet.pipeline.farm.versions import scene_digest
from pbrnet.scenes.checked import plain
from pbrnet.scenes.errors import InputError, MachineError
from pbrnet.scenes.files import atomic_file, digest_bytes, machine_errors

Transfer = Literal["auto", "shared", "send"]
_TOKEN = ".farm-"
_CACHED_LISTS = 64  # scenes whose lists of files the command keeps in memory


@dataclass(frozen=True)
class Workspace:
    """The command's data folder, as it is described to workers."""

    data: Path
    transfer: Transfer
    token: str  # name of a file that exists only in this run's data folder
    topic: str  # on which the command answers requests for files
    cache_mb: int  # of received scenes that a machine keeps

    @property
    def token_path(self) -> Path:
        """Absolute path of the token file."""
        return self.data / self.token


@dataclass(frozen=True)
class SentFile:
    """A finished file on its way to the command: SHA-256 and bytes."""

    digest: str
    content: bytes


@contextlib.contextmanager
def open_workspace(data: Path, transfer: Transfer, cache_mb: int) -> Iterator[Workspace]:
    """Create the workspace of one run over `data`, which this process has locked."""
    for old in data.glob(f"{_TOKEN}*"):
        old.unlink(missing_ok=True)
    data = Path(data).resolve()
    name = uuid.uuid4().hex
    token = data / (_TOKEN + name)
    with machine_errors(token):
        token.touch()
    try:
        yield Workspace(data, transfer, token.name, f"pbrnet-files-{name}", cache_mb)
    finally:
        token.unlink(missing_ok=True)


def scene_service(workspace: Workspace) -> TransferService:
    """Return the service that sends a scene's list of files, and the files, to workers."""
    lists = lru_cache(_CACHED_LISTS)(lambda scene: list_files(workspace.data / "scenes" / scene))

    def answer(request: Mapping[str, Any]) -> Iterator[Any]:
        scene, wanted = request["scene"], request.get("wanted")
        folder = workspace.data / "scenes" / scene
        if folder.parent != workspace.data / "scenes" or not folder.is_dir():
            raise InputError(f"{folder}: no such scene")
        if wanted is None:
            yield [plain(file) for file in lists(scene)]
        else:
            yield from read_chunks(folder, lists(scene), wanted)

    return TransferService(workspace.topic, answer)


_workspace: Workspace | None = None


def use_workspace(workspace: Workspace | None) -> None:
    """Set the workspace of this worker process; None: the paths in the jobs are used as given."""
    global _workspace
    _workspace = workspace


def shares_data() -> bool:
    """Return whether this worker reads and writes in the command's data folder.

    Raises `MachineError` if it must, but does not see the folder.
    """
    if _workspace is None or _workspace.transfer == "send":
        return _workspace is None
    if _workspace.transfer == "shared":
        require_data(_workspace)
    return _workspace.token_path.is_file()


def require_data(workspace: Workspace) -> None:
    """Raise `MachineError` unless this worker sees the command's data folder."""
    if not workspace.token_path.is_file():
        raise MachineError(
            f"a worker cannot see {workspace.data}: every worker needs the project folder under "
            "the same path, or farm.transfer: auto, which sends scenes to those that render"
        )


@contextlib.contextmanager
def scene_folder(folder: Path, digest: str) -> Iterator[Path]:
    """Provide the scene with this digest as a folder that this worker can read.

    `folder` is its path on the command's machine. With `auto`, a worker that does not share the
    data folder uses its own copy at that path if the digest matches; otherwise it receives one.
    """
    if shares_data() or (
        _workspace and _workspace.transfer == "auto" and _has_digest(folder, digest)
    ):
        yield folder
    else:
        assert _workspace is not None
        copy = _received_scene(_workspace, folder.name, digest)
        try:
            yield copy
        finally:
            shutil.rmtree(copy, ignore_errors=True)


def _received_scene(workspace: Workspace, scene: str, digest: str) -> Path:
    """Return a private folder with the scene; requests the files that the store lacks."""
    store = ContentStore(_cache_folder(), workspace.cache_mb << 20)
    (listed,) = request_bundles(workspace.topic, {"scene": scene})
    files = [StoredFile(**file) for file in listed]

    def fetch(wanted: Sequence[int]) -> Iterable[Sequence[Chunk]]:
        return request_bundles(workspace.topic, {"scene": scene, "wanted": list(wanted)})

    copy = store.assemble(digest, files, fetch, lambda copy: _has_digest(copy, digest))
    store.trim()
    return copy


@contextlib.contextmanager
def writing(path: Path, sent: dict[str, SentFile], name: str) -> Iterator[Path]:
    """Provide the path to write to: `path` itself, or a temporary one whose file is sent.

    In the second case `sent[name]` holds the file afterwards.
    """
    if shares_data():
        yield path
        return
    with tempfile.TemporaryDirectory(prefix="pbrnet-sent-") as folder:
        written = Path(folder) / path.name
        yield written
        content = written.read_bytes()
    sent[name] = SentFile(digest_bytes(content), content)


def receive(path: Path, file: SentFile) -> None:
    """Write a file that a worker has sent, by rename, on the command's machine.

    Raises `InputError` if it was damaged on the way.
    """
    if digest_bytes(file.content) != file.digest:
        raise InputError(f"{path}: arrived damaged from a worker; run the same command again")
    with atomic_file(path) as partial:
        partial.write_bytes(file.content)


def _has_digest(folder: Path, digest: str) -> bool:
    try:
        return scene_digest(folder) == digest
    except (InputError, OSError):
        return False


def _cache_folder() -> Path:
    """Return `PBRNET_CACHE`, or a folder of this user's on the machine's temporary disk."""
    named = os.environ.get("PBRNET_CACHE")
    return Path(named) if named else Path(tempfile.gettempdir()) / f"pbrnet-cache-{os.geteuid()}"
