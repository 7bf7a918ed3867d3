"""Files and folders are complete or absent; seeds and digests depend on content alone."""

import subprocess
import sys
from pathlib import Path

import pytest

from pbrnet.scenes import seeds
from pbrnet.scenes.errors import InputError, MachineError
from pbrnet.scenes.files import (
    atomic_directory,
    atomic_file,
    digest_folder,
    read_json,
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


def test_json_errors_name_the_file(tmp_path: Path) -> None:
    path = tmp_path / "a.json"
    path.write_text('{"a": ')
    with pytest.raises(InputError, match=r"a\.json: not valid JSON"):
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
