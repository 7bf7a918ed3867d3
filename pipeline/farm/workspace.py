"""Where a worker finds scenes and leaves what it made: in the command's data folder, or by dask.

A worker that sees the data folder reads and writes there, and only paths travel. Any other worker
is sent each scene once, keeps it in a store of its own machine, and hands its files back to the
command, which writes them. `farm.transfer` says which: `shared`, `send`, or `auto`, which looks for
a file of this run's in the data folder.
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

from pipeline.farm.content_store import Part, Piece, Store, list_pieces, read_parts
from pipeline.farm.scene_digest import scene_digest
from pipeline.farm.transfer import Supply, ask
from scenes.checked import plain
from scenes.errors import InputError, MachineError
from scenes.files import atomic_file, digest_bytes, machine_errors

Transfer = Literal["auto", "shared", "send"]
_TOKEN = ".farm-"
_KNOWN = 64  # scenes whose lists of files the command remembers


@dataclass(frozen=True)
class Site:
    """What a worker must know of the command's data folder."""

    data: Path
    transfer: Transfer
    token: str  # a file in the data folder that only this run's folder has
    line: str  # by which the command answers
    cache_mb: int  # of scenes that a machine keeps

    @property
    def mark(self) -> Path:
        """The token's whole path."""
        return self.data / self.token


@dataclass(frozen=True)
class SentFile:
    """A finished file on its way to the command: SHA-256 and bytes."""

    digest: str
    content: bytes


@contextlib.contextmanager
def open_site(data: Path, transfer: Transfer, cache_mb: int) -> Iterator[Site]:
    """A site for one run over `data`, which this process has locked."""
    for old in data.glob(f"{_TOKEN}*"):
        old.unlink(missing_ok=True)
    data = Path(data).resolve()
    name = uuid.uuid4().hex
    token = data / (_TOKEN + name)
    with machine_errors(token):
        token.touch()
    try:
        yield Site(data, transfer, token.name, f"pbrnet-files-{name}", cache_mb)
    finally:
        token.unlink(missing_ok=True)


def supply(site: Site) -> Supply:
    """What the command answers its workers: a scene's list of files, and the files themselves."""
    lists = lru_cache(_KNOWN)(lambda scene: list_pieces(site.data / "scenes" / scene))

    def answer(request: Mapping[str, Any]) -> Iterator[Any]:
        scene, wanted = request["scene"], request.get("wanted")
        folder = site.data / "scenes" / scene
        if folder.parent != site.data / "scenes" or not folder.is_dir():
            raise InputError(f"{folder}: no such scene")
        if wanted is None:
            yield [plain(piece) for piece in lists(scene)]
        else:
            yield from read_parts(folder, lists(scene), wanted)

    return Supply(site.line, answer)


_site: Site | None = None


def use_site(site: Site | None) -> None:
    """Set where this worker process works; None: where the jobs say."""
    global _site
    _site = site


def shares_data() -> bool:
    """Whether this worker works in the command's data folder.

    Raises `MachineError` if it must, but does not see it.
    """
    if _site is None or _site.transfer == "send":
        return _site is None
    if _site.transfer == "shared":
        require_data(_site)
    return _site.mark.is_file()


def require_data(site: Site) -> None:
    """Raise `MachineError` unless this worker sees the command's data folder."""
    if not site.mark.is_file():
        raise MachineError(
            f"a worker does not see {site.data}: all workers need the project folder under the "
            "same path; with farm.transfer: auto, those that render are sent what they need"
        )


@contextlib.contextmanager
def scene_folder(folder: Path, digest: str) -> Iterator[Path]:
    """The scene with this digest, as a folder that this worker can read.

    `folder` is where the command has it. With `auto`, a worker that does not share the data folder
    takes its own copy at that place if it is the same scene; else it is sent it.
    """
    if shares_data() or (_site and _site.transfer == "auto" and _is_scene(folder, digest)):
        yield folder
    else:
        assert _site is not None
        copy = _sent_scene(_site, folder.name, digest)
        try:
            yield copy
        finally:
            shutil.rmtree(copy, ignore_errors=True)


def _sent_scene(site: Site, scene: str, digest: str) -> Path:
    """A private folder with the scene; whatever the store lacks comes from the command."""
    store = Store(_cache_folder(), site.cache_mb << 20)
    (listed,) = ask(site.line, {"scene": scene})
    pieces = [Piece(**piece) for piece in listed]

    def fetch(wanted: Sequence[int]) -> Iterable[Sequence[Part]]:
        return ask(site.line, {"scene": scene, "wanted": list(wanted)})

    copy = store.folder_of(digest, pieces, fetch, lambda copy: _is_scene(copy, digest))
    store.trim()
    return copy


@contextlib.contextmanager
def writing(path: Path, sent: dict[str, SentFile], name: str) -> Iterator[Path]:
    """Where to write what belongs at `path`: there, or at a place from which it is sent.

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
    """On the command's machine: write a file that a worker has sent, by rename.

    Raises `InputError` if it was damaged on the way.
    """
    if digest_bytes(file.content) != file.digest:
        raise InputError(f"{path}: arrived damaged from a worker; run the same command again")
    with atomic_file(path) as partial:
        partial.write_bytes(file.content)


def _is_scene(folder: Path, digest: str) -> bool:
    try:
        return scene_digest(folder) == digest
    except (InputError, OSError):
        return False


def _cache_folder() -> Path:
    """`PBRNET_CACHE`, or a folder of this user's on the machine's temporary disk."""
    named = os.environ.get("PBRNET_CACHE")
    return Path(named) if named else Path(tempfile.gettempdir()) / f"pbrnet-cache-{os.geteuid()}"
