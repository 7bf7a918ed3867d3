"""Cases made by hand that several families share."""

import json
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

from tests.fixtures.changed import changed
from tests.hostile.family import Arguments, Made


def case(write: Callable[..., str | Arguments]) -> Callable[..., Made]:
    """Cases of a function that writes files into a folder and returns the command line."""

    def made(*options: Any, **more: Any) -> Made:
        def whole(folder: Path) -> Arguments:
            line = write(folder, *options, **more)
            return line.split() if isinstance(line, str) else line

        return whole

    return made


@case
def with_file(folder: Path, name: str, data: bytes | str, command: str) -> str:
    """One file of the base is another."""
    path = folder / name
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(data if isinstance(data, bytes) else data.encode("utf-8", "surrogatepass"))
    return command


@case
def with_text(folder: Path, name: str, old: str, new: str, command: str) -> str:
    """One file of the base with some text exchanged."""
    (folder / name).write_text((folder / name).read_text().replace(old, new))
    return command


@case
def with_link(folder: Path, name: str, target: str, command: str) -> str:
    (folder / name).unlink(missing_ok=True)
    (folder / name).symlink_to(target)
    return command


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


@case
def with_value(
    folder: Path, file: str, command: str, path: tuple[str | int, ...], value: Any
) -> str:
    """Change one value of a JSON file."""
    content = json.loads((folder / file).read_text())
    (folder / file).write_text(json.dumps(changed(content, path, value)))
    return command


def pack(
    members: Path, archive: Path, compression: int = zipfile.ZIP_DEFLATED, largest: int = 2**26
) -> None:
    """Pack the regular files of a folder of up to `largest` bytes; the same bytes at any time."""
    with zipfile.ZipFile(archive, "w") as packed:
        for path in sorted(members.rglob("*")):
            if path.is_file() and path.stat().st_size < largest:
                entry = zipfile.ZipInfo(path.relative_to(members).as_posix())
                packed.writestr(entry, path.read_bytes(), compression)
