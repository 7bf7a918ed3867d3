"""Files by content: what arrives is what was asked for, once, in bounded memory and disk."""

import os
import subprocess
import sys
import time
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
import pytest

from pbrnet.pipeline.farm.content_store import (
    CHUNK_BYTES,
    Chunk,
    ContentStore,
    StoredFile,
    list_files,
    read_chunks,
)
from pbrnet.scenes.errors import InputError, MachineError
from pbrnet.scenes.files import digest_folder

SIZES = {
    "scene.xml": 700,
    "empty": 0,
    "meshes/a.ply": CHUNK_BYTES,
    "meshes/b.ply": 2 * CHUNK_BYTES + 3,
}


class Source:
    """A folder on the command's side, and what was asked of it."""

    def __init__(self, folder: Path, seed: int = 0) -> None:
        rng = np.random.default_rng(seed)
        for name, size in {**SIZES, f"only-{seed}": 5000}.items():
            path = folder / name
            path.parent.mkdir(parents=True, exist_ok=True)
            salt = seed if name.startswith("only") else 0
            path.write_bytes(np.random.default_rng([salt, size]).bytes(size))
        self.folder, self.rng = folder, rng
        self.files = list_files(folder)
        self.fetched: list[int] = []

    def fetch(self, wanted: Sequence[int]) -> Iterator[list[Chunk]]:
        self.fetched += wanted
        return read_chunks(self.folder, self.files, wanted)

    def verify(self, copy: Path) -> bool:
        return digest_folder(copy) == digest_folder(self.folder)

    def into(self, store: ContentStore) -> Path:
        return store.assemble("a scene", self.files, self.fetch, self.verify)


def _bytes(root: Path) -> int:
    return sum(path.stat().st_size for path in root.glob("files/*/*"))


def test_a_folder_arrives_as_it_was_in_bounded_chunks(tmp_path: Path) -> None:
    source = Source(tmp_path / "source")
    bundles = list(read_chunks(source.folder, source.files, range(len(source.files))))
    assert all(0 < sum(len(chunk.content) for chunk in bundle) <= CHUNK_BYTES for bundle in bundles)
    copy = source.into(ContentStore(tmp_path / "store", 1 << 30))
    assert digest_folder(copy) == digest_folder(source.folder)
    assert len(source.fetched) == len(SIZES) + 1


def test_what_is_there_is_not_asked_for_again(tmp_path: Path) -> None:
    store = ContentStore(tmp_path / "store", 1 << 30)
    first, second = Source(tmp_path / "one", 1), Source(tmp_path / "two", 2)
    first.into(store)
    first.into(ContentStore(tmp_path / "store", 1 << 30))  # a second process, or a later run
    assert len(first.fetched) == len(SIZES) + 1
    second.into(store)  # its meshes are the same files
    assert [second.files[index].path for index in second.fetched] == ["only-2"]


def test_equal_files_travel_once(tmp_path: Path) -> None:
    source = Source(tmp_path / "source")
    (source.folder / "again.ply").write_bytes((source.folder / "meshes/b.ply").read_bytes())
    source.files = list_files(source.folder)
    copy = source.into(ContentStore(tmp_path / "store", 1 << 30))
    assert digest_folder(copy) == digest_folder(source.folder)
    assert len(source.fetched) == len(SIZES) + 1


def test_a_damaged_piece_is_found_and_fetched_again(tmp_path: Path) -> None:
    source, store = Source(tmp_path / "source"), ContentStore(tmp_path / "store", 1 << 30)
    source.into(store)
    (mesh,) = [i for i, file in enumerate(source.files) if file.path == "meshes/a.ply"]
    file = store.path(source.files[mesh])
    with file.open("r+b") as stream:  # one bit, the length as it was
        stream.seek(1000)
        byte = stream.read(1)[0]
        stream.seek(1000)
        stream.write(bytes([byte ^ 1]))
    source.fetched.clear()
    copy = source.into(store)
    assert source.fetched == [mesh]
    assert digest_folder(copy) == digest_folder(source.folder)


@pytest.mark.parametrize("keep", [0, 1])
def test_bytes_that_are_not_the_piece_never_enter(tmp_path: Path, keep: int) -> None:
    """Damaged on the way for ever, or once."""
    source, store = Source(tmp_path / "source"), ContentStore(tmp_path / "store", 1 << 30)
    sound, calls = source.fetch, []

    def damaged(wanted: Sequence[int]) -> Iterator[list[Chunk]]:
        calls.append(wanted)
        for bundle in sound(wanted):
            wrong = [Chunk(chunk.index, chunk.content[:-1] + b"x", chunk.last) for chunk in bundle]
            yield bundle if keep and len(calls) > 1 else wrong

    if keep:
        copy = store.assemble("a scene", source.files, damaged, source.verify)
        assert digest_folder(copy) == digest_folder(source.folder)
        return
    with pytest.raises(InputError, match="arrive with other content than listed"):
        store.assemble("a scene", source.files, damaged, source.verify)
    assert not list((tmp_path / "store").glob("files/*/*"))


def test_an_interrupted_fetch_leaves_only_whole_files(tmp_path: Path) -> None:
    source, store = Source(tmp_path / "source"), ContentStore(tmp_path / "store", 1 << 30)

    def breaks(wanted: Sequence[int]) -> Iterator[list[Chunk]]:
        bundles = source.fetch(wanted)
        yield next(bundles)
        yield next(bundles)
        raise OSError("the line is dead")

    with pytest.raises(OSError, match="line is dead"):
        store.assemble("a scene", source.files, breaks, source.verify)
    digests = {file.digest: file.size for file in source.files}
    for path in (tmp_path / "store").glob("files/*/*"):
        assert path.stat().st_size == digests[path.name]
    assert not list((tmp_path / "store").rglob("partial"))
    assert digest_folder(source.into(store)) == digest_folder(source.folder)


def test_the_store_stays_within_its_limit_and_open_folders_stay_whole(tmp_path: Path) -> None:
    sources = [Source(tmp_path / f"source{seed}", seed) for seed in (1, 2)]
    whole = sum(file.size for file in sources[0].files)
    store = ContentStore(tmp_path / "store", whole - 1)
    copy = sources[0].into(store)
    store.trim()
    assert 0 < _bytes(store.root) < whole
    assert digest_folder(copy) == digest_folder(sources[0].folder)
    sources[1].into(store)
    store.trim()
    assert _bytes(store.root) < whole
    newest = next(file for file in sources[1].files if file.path == "only-2")
    assert store.path(newest).is_file(), "the oldest go first"


def test_what_a_killed_process_left_is_removed(tmp_path: Path) -> None:
    code = (
        "import os, sys, time; from pathlib import Path; "
        "from pipeline.farm.content_store import ContentStore;"
        "print(ContentStore(Path(sys.argv[1]), 1).private_folder(), flush=True); time.sleep(60)"
    )
    command = [sys.executable, "-c", code, str(tmp_path / "store")]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as other:
        assert other.stdout
        theirs = Path(other.stdout.readline().strip())
        store = ContentStore(tmp_path / "store", 1)
        long_ago = time.time() - 3600
        os.utime(theirs.parent, (long_ago, long_ago))
        store.trim()
        assert theirs.is_dir(), "it is at work"
        other.kill()
        other.wait()
        store.trim()
        assert not theirs.parent.exists()


def test_a_folder_of_somebody_else_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "store").mkdir()
    monkeypatch.setattr(os, "geteuid", lambda: 12345)
    with pytest.raises(MachineError, match="PBRNET_CACHE"):
        ContentStore(tmp_path / "store", 1)


def test_a_path_that_leads_outside_is_refused(tmp_path: Path) -> None:
    source, store = Source(tmp_path / "source"), ContentStore(tmp_path / "store", 1 << 30)
    bad = [StoredFile("../" + file.path, file.digest, file.size) for file in source.files]
    with pytest.raises(InputError, match="outside"):
        store.assemble("a scene", bad, source.fetch, source.verify)
    assert not (tmp_path / "store" / "processes" / "scene.xml").exists()
