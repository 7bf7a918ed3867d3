"""Files and folders are complete or absent; seeds and digests depend on content alone."""

import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from pbrnet.scenes import seeds
from pbrnet.scenes.errors import InputError, MachineError
from pbrnet.scenes.files import (
    atomic_directory,
    atomic_file,
    digest_file,
    digest_folder,
    read_bytes,
    read_csv,
    read_json,
    read_text,
    remove_partials,
    sweep,
    write_json,
    write_text,
)


def names(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.iterdir())


def test_a_failed_write_leaves_the_old_file(tmp_path: Path) -> None:
    path = tmp_path / "a.txt"
    write_text(path, "old")
    with pytest.raises(RuntimeError), atomic_file(path) as partial:
        partial.write_text("half")
        raise RuntimeError
    assert path.read_text() == "old"
    assert names(tmp_path) == ["a.txt"]


def test_a_failed_folder_leaves_the_old_folder(tmp_path: Path) -> None:
    folder = tmp_path / "scene"
    with atomic_directory(folder) as partial:
        (partial / "a").write_text("1")
    with pytest.raises(RuntimeError), atomic_directory(folder) as partial:
        (partial / "b").write_text("2")
        raise RuntimeError
    assert [path.name for path in folder.iterdir()] == ["a"]
    with atomic_directory(folder) as partial:
        (partial / "c").write_text("3")
    assert [path.name for path in folder.iterdir()] == ["c"]
    assert names(tmp_path) == ["scene"]


@pytest.mark.parametrize("kind", ["atomic_file", "atomic_directory"])
def test_what_a_killed_writer_left_is_swept_and_what_a_living_one_writes_is_not(
    tmp_path: Path, kind: str
) -> None:
    script = (
        f"from pathlib import Path; from scenes.files import {kind}\n"
        f"with {kind}(Path({str(tmp_path / 'deep' / 'a')!r})):\n"
        "    print('half', flush=True); input()\n"
    )
    left = 0
    for clean in (sweep, lambda folder: remove_partials(folder / "deep")):
        with subprocess.Popen(
            [sys.executable, "-c", script], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
        ) as writer:
            assert writer.stdout is not None and writer.stdout.readline() == "half\n"
            assert sweep(tmp_path) == 0
            (partial,) = (tmp_path / "deep").iterdir()
            writer.kill()
        assert partial.exists()
        left += clean(tmp_path)
        assert names(tmp_path / "deep") == []
    assert left == 2
    assert sweep(tmp_path / "nowhere") == remove_partials(tmp_path / "nowhere") == 0


def test_a_full_disk_is_a_clear_error_and_keeps_the_old_file(small_disk: Path) -> None:
    path = small_disk / "a.txt"
    write_text(path, "old")
    with pytest.raises(MachineError, match="disk is full"):
        write_text(path, "x" * (4 << 20))
    assert path.read_text() == "old"
    assert names(small_disk) == ["a.txt"]


def put_fifo(path: Path) -> None:
    os.mkfifo(path)


def put_link_to_fifo(path: Path) -> None:
    os.mkfifo(path.with_name("pipe"))
    path.symlink_to("pipe")


def put_stream(path: Path) -> None:
    path.symlink_to("/proc/self/fd/0")  # as /dev/stdin


@pytest.mark.parametrize("put", [put_fifo, put_link_to_fifo, put_stream])
@pytest.mark.parametrize("write", [atomic_file, atomic_directory])
def test_a_rename_never_replaces_what_is_no_file_or_folder(
    tmp_path: Path, put: Callable[[Path], None], write: Callable[[Path], Any]
) -> None:
    put(tmp_path / "a")
    before = [(path.name, path.lstat()[:2]) for path in sorted(tmp_path.iterdir())]
    with pytest.raises(MachineError, match="not replaced"), write(tmp_path / "a"):
        pass
    assert [(path.name, path.lstat()[:2]) for path in sorted(tmp_path.iterdir())] == before


def test_files_and_folders_do_not_replace_each_other(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("1")
    (tmp_path / "folder").mkdir()
    with pytest.raises(MachineError, match="it is a file"), atomic_directory(tmp_path / "file"):
        pass
    with pytest.raises(MachineError, match="it is a folder"):
        write_text(tmp_path / "folder", "2")
    assert (tmp_path / "file").read_text() == "1"


def test_a_target_that_becomes_a_pipe_while_it_is_written_stays_one(tmp_path: Path) -> None:
    with pytest.raises(MachineError, match="a pipe"), atomic_file(tmp_path / "a"):
        os.mkfifo(tmp_path / "a")
    assert (tmp_path / "a").is_fifo() and names(tmp_path) == ["a"]


def test_links_to_files_are_replaced_and_their_files_kept(tmp_path: Path) -> None:
    (tmp_path / "cached").write_text("1")
    (tmp_path / "a").symlink_to("cached")
    (tmp_path / "b").symlink_to("nowhere")
    for name in "ab":
        write_text(tmp_path / name, "2")
        assert not (tmp_path / name).is_symlink()
    assert (tmp_path / "cached").read_text() == "1"


@pytest.mark.parametrize("put", [put_fifo, put_link_to_fifo, Path.mkdir])
@pytest.mark.parametrize("read", [read_json, read_text, read_bytes, read_csv, digest_file])
def test_pipes_and_folders_are_refused_and_never_waited_for(
    tmp_path: Path, put: Callable[[Path], None], read: Callable[[Path], Any]
) -> None:
    put(tmp_path / "a")
    with pytest.raises(InputError, match=r"a: (not a regular file|a folder)"):
        read(tmp_path / "a")


@pytest.mark.parametrize("text", ["a,b\n1\n", "a\n1,2\n", "a\n" + "x" * 200_000])
def test_damaged_tables_are_refused(tmp_path: Path, text: str) -> None:
    (tmp_path / "a.csv").write_text("a,b\n1,2\n")
    assert read_csv(tmp_path / "a.csv") == [{"a": "1", "b": "2"}]
    (tmp_path / "a.csv").write_text(text)
    with pytest.raises(InputError, match=r"a\.csv"):
        read_csv(tmp_path / "a.csv")


def test_a_partial_file_that_is_a_pipe_or_a_link_does_not_stop_the_sweep(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / ".partial-pipe")
    (tmp_path / ".partial-link").symlink_to("/dev/null")
    assert sweep(tmp_path) == 1
    assert names(tmp_path) == [".partial-link"]


def test_json_errors_name_the_file(tmp_path: Path) -> None:
    path = tmp_path / "a.json"
    path.write_text('{"a": ')
    with pytest.raises(InputError, match=r"a\.json: not valid JSON"):
        read_json(path)
    path.write_text('{"a": 1e400}')
    with pytest.raises(InputError, match="beyond double precision"):
        read_json(path)
    with pytest.raises(InputError, match="no such file"):
        read_json(tmp_path / "b.json")
    with pytest.raises(ValueError, match="JSON"):
        write_json(path, float("nan"))


def test_a_folders_digest_sees_names_and_contents(tmp_path: Path) -> None:
    first, second = tmp_path / "1", tmp_path / "2"
    for folder, names in ((first, "ab"), (second, "ba")):
        folder.mkdir()
        for name in names:
            (folder / name).write_text(name)
    assert digest_folder(first) == digest_folder(second)
    (second / "a").rename(second / "c")
    assert digest_folder(first) != digest_folder(second)


def test_seeds_descend_by_name() -> None:
    assert seeds.derive(0, "home", 1) == seeds.derive(0, "home", 1)
    different = {
        seeds.derive(root, *names)
        for root in (0, 1)
        for names in (("home", 1), ("home", 11), ("home1",), ("hom", "e1"), ("home", "1", ""))
    }
    assert len(different) == 10
    assert 0 <= seeds.derive32(0, "x") < 2**32
    draws = [seeds.generator(0, "x").integers(1 << 40) for _ in range(2)]
    assert draws[0] == draws[1]


def test_seeds_are_the_same_on_every_machine() -> None:
    """A change here would silently change every dataset ever made."""
    assert seeds.derive(0, "home", 0) == 14671120086821944859


def test_a_folder_that_a_link_names_is_replaced_where_it_lies(tmp_path: Path) -> None:
    (tmp_path / "disk" / "dataset").mkdir(parents=True)
    (tmp_path / "dataset").symlink_to(tmp_path / "disk" / "dataset")
    with atomic_directory(tmp_path / "dataset") as folder:
        assert folder.parent == tmp_path / "disk"
        (folder / "new").write_text("new")
    assert (tmp_path / "dataset").is_symlink()
    assert [path.name for path in (tmp_path / "disk" / "dataset").iterdir()] == ["new"]


def test_a_byte_order_mark_is_no_part_of_a_text(tmp_path: Path) -> None:
    (tmp_path / "layout.json").write_bytes(b"\xef\xbb\xbf{}")
    assert read_text(tmp_path / "layout.json") == "{}"
    assert read_json(tmp_path / "layout.json") == {}
