"""Cases made by hand that several families share."""

import json
import zipfile
from pathlib import Path
from typing import Any

from tests.fixtures.changed import changed
from tests.hostile.family import Arguments, Made


def with_file(name: str, data: bytes | str, command: str) -> Made:
    """One file of the base is another."""

    def write(folder: Path) -> Arguments:
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(data if isinstance(data, bytes) else data.encode("utf-8", "surrogatepass"))
        return command.split()

    return write


def with_link(name: str, target: str, command: str) -> Made:
    def write(folder: Path) -> Arguments:
        (folder / name).unlink(missing_ok=True)
        (folder / name).symlink_to(target)
        return command.split()

    return write


def entities(kind: str) -> str:
    bomb = "".join(
        f"<!ENTITY {b} '{f'&{a};' * 12}'>" for a, b in zip("abcdefgh", "bcdefghi", strict=True)
    )
    inside = {
        "bomb": f"<!ENTITY a 'aaaaaaaaaaaa'>{bomb}",
        "file": "<!ENTITY i SYSTEM '/etc/passwd'>",
        "net": "<!ENTITY i SYSTEM 'http://127.0.0.1:1/x'>",
        "zero": "<!ENTITY i SYSTEM '/dev/zero'>",
    }[kind]
    return f"<!DOCTYPE x [{inside}]>"


def with_value(file: str, command: str, path: tuple[str | int, ...], value: Any) -> Made:
    """Change one value of a JSON file."""

    def write(folder: Path) -> Arguments:
        content = json.loads((folder / file).read_text())
        (folder / file).write_text(json.dumps(changed(content, path, value)))
        return command.split()

    return write


def pack(
    members: Path, archive: Path, compression: int = zipfile.ZIP_DEFLATED, largest: int = 2**26
) -> None:
    """Pack the regular files of a folder of up to `largest` bytes; the same bytes at any time."""
    with zipfile.ZipFile(archive, "w") as packed:
        for path in sorted(members.rglob("*")):
            if path.is_file() and path.stat().st_size < largest:
                entry = zipfile.ZipInfo(path.relative_to(members).as_posix())
                packed.writestr(entry, path.read_bytes(), compression)
