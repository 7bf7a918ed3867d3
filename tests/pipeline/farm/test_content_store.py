"""Files by content: what arrives is what was asked for, once, in bounded memory and disk."""

from __future__ import annotations

import os
import subprocess
import sys
import time
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
import pytest

from pipeline.farm.content_store import PART, Part, Piece, Store, list_pieces, read_parts
from scenes.errors import InputError, MachineError
from scenes.files import digest_folder

SIZES = {"scene.xml": 700, "empty": 0, "meshes/a.ply": PART, "meshes/b.ply": 2 * PART + 3}


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
        self.pieces = list_pieces(folder)
        self.asked: list[int] = []

    def fetch(self, wanted: Sequence[int]) -> Iterator[list[Part]]:
        self.asked += wanted
        return read_parts(self.folder, self.pieces, wanted)

    def sure(self, copy: Path) -> bool:
        return digest_folder(copy) == digest_folder(self.folder)

    def into(self, store: Store) -> Path:
        return store.folder_of("a scene", self.pieces, self.fetch, self.sure)


def _bytes(root: Path) -> int:
    return sum(path.stat().st_size for path in root.glob("pieces/*/*"))


def test_a_folder_arrives_as_it_was_in_bounded_parts(tmp_path: Path) -> None:
    source = Source(tmp_path / "source")
    bundles = list(read_parts(source.folder, source.pieces, range(len(source.pieces))))
    assert all(0 < sum(len(part.content) for part in bundle) <= PART for bundle in bundles)
    copy = source.into(Store(tmp_path / "store", 1 << 30))
    assert digest_folder(copy) == digest_folder(source.folder)
    assert len(source.asked) == len(SIZES) + 1


def test_what_is_there_is_not_asked_for_again(tmp_path: Path) -> None:
    store = Store(tmp_path / "store", 1 << 30)
    first, second = Source(tmp_path / "one", 1), Source(tmp_path / "two", 2)
    first.into(store)
    first.into(Store(tmp_path / "store", 1 << 30))  # a second process, or a later run
    assert len(first.asked) == len(SIZES) + 1
    second.into(store)  # its meshes are the same files
    assert [second.pieces[index].path for index in second.asked] == ["only-2"]


def test_equal_files_travel_once(tmp_path: Path) -> None:
    source = Source(tmp_path / "source")
    (source.folder / "again.ply").write_bytes((source.folder / "meshes/b.ply").read_bytes())
    source.pieces = list_pieces(source.folder)
    copy = source.into(Store(tmp_path / "store", 1 << 30))
    assert digest_folder(copy) == digest_folder(source.folder)
    assert len(source.asked) == len(SIZES) + 1


def test_a_damaged_piece_is_found_and_fetched_again(tmp_path: Path) -> None:
    source, store = Source(tmp_path / "source"), Store(tmp_path / "store", 1 << 30)
    source.into(store)
    (mesh,) = [i for i, piece in enumerate(source.pieces) if piece.path == "meshes/a.ply"]
    piece = store._path(source.pieces[mesh])
    with piece.open("r+b") as stream:  # one bit, the length as it was
        stream.seek(1000)
        byte = stream.read(1)[0]
        stream.seek(1000)
        stream.write(bytes([byte ^ 1]))
    source.asked.clear()
    copy = source.into(store)
    assert source.asked == [mesh]
    assert digest_folder(copy) == digest_folder(source.folder)


@pytest.mark.parametrize("keep", [0, 1])
def test_bytes_that_are_not_the_piece_never_enter(tmp_path: Path, keep: int) -> None:
    """Damaged on the way for ever, or once."""
    source, store = Source(tmp_path / "source"), Store(tmp_path / "store", 1 << 30)
    sound, calls = source.fetch, []

    def damaged(wanted: Sequence[int]) -> Iterator[list[Part]]:
        calls.append(wanted)
        for bundle in sound(wanted):
            wrong = [Part(part.index, part.content[:-1] + b"x", part.last) for part in bundle]
            yield bundle if keep and len(calls) > 1 else wrong

    if keep:
        copy = store.folder_of("a scene", source.pieces, damaged, source.sure)
        assert digest_folder(copy) == digest_folder(source.folder)
        return
    with pytest.raises(InputError, match="do not arrive as they should be"):
        store.folder_of("a scene", source.pieces, damaged, source.sure)
    assert not list((tmp_path / "store").glob("pieces/*/*"))


def test_an_interrupted_fetch_leaves_only_whole_pieces(tmp_path: Path) -> None:
    source, store = Source(tmp_path / "source"), Store(tmp_path / "store", 1 << 30)

    def breaks(wanted: Sequence[int]) -> Iterator[list[Part]]:
        bundles = source.fetch(wanted)
        yield next(bundles)
        yield next(bundles)
        raise OSError("the line is dead")

    with pytest.raises(OSError, match="line is dead"):
        store.folder_of("a scene", source.pieces, breaks, source.sure)
    digests = {piece.digest: piece.size for piece in source.pieces}
    for path in (tmp_path / "store").glob("pieces/*/*"):
        assert path.stat().st_size == digests[path.name]
    assert not list((tmp_path / "store").rglob("partial"))
    assert digest_folder(source.into(store)) == digest_folder(source.folder)


def test_the_store_stays_within_its_limit_and_open_folders_stay_whole(tmp_path: Path) -> None:
    sources = [Source(tmp_path / f"source{seed}", seed) for seed in (1, 2)]
    whole = sum(piece.size for piece in sources[0].pieces)
    store = Store(tmp_path / "store", whole - 1)
    copy = sources[0].into(store)
    store.trim()
    assert 0 < _bytes(store.root) < whole
    assert digest_folder(copy) == digest_folder(sources[0].folder)
    sources[1].into(store)
    store.trim()
    assert _bytes(store.root) < whole
    newest = next(piece for piece in sources[1].pieces if piece.path == "only-2")
    assert store._path(newest).is_file(), "the oldest go first"


def test_what_a_killed_process_left_is_removed(tmp_path: Path) -> None:
    code = (
        "import os, sys, time; from pathlib import Path; "
        "from pipeline.farm.content_store import Store;"
        "print(Store(Path(sys.argv[1]), 1).private(), flush=True); time.sleep(60)"
    )
    command = [sys.executable, "-c", code, str(tmp_path / "store")]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as other:
        assert other.stdout
        theirs = Path(other.stdout.readline().strip())
        store = Store(tmp_path / "store", 1)
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
        Store(tmp_path / "store", 1)


def test_a_path_that_leads_outside_is_refused(tmp_path: Path) -> None:
    source, store = Source(tmp_path / "source"), Store(tmp_path / "store", 1 << 30)
    bad = [Piece("../" + piece.path, piece.digest, piece.size) for piece in source.pieces]
    with pytest.raises(InputError, match="outside"):
        store.folder_of("a scene", bad, source.fetch, source.sure)
    assert not (tmp_path / "store" / "rooms" / "scene.xml").exists()
