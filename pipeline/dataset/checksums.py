"""Checksums of a dataset: `SHA256SUMS`, in the format of `sha256sum --check`."""

from __future__ import annotations

import re
from pathlib import Path

from pbrnet.scenes.errors import InputError
from pbrnet.scenes.files import digest_file, read_text, write_text

SUMS = "SHA256SUMS"
_LINE = re.compile(r"([0-9a-f]{64})  ([^/\0]+)")


def write_sums(folder: Path) -> None:
    """Write the checksums of all files in `folder`, sorted by name."""
    names = sorted(path.name for path in folder.iterdir() if path.is_file() and path.name != SUMS)
    write_text(folder / SUMS, "".join(f"{digest_file(folder / name)}  {name}\n" for name in names))


def read_sums(path: Path) -> dict[str, str]:
    """Return the checksums that a `SHA256SUMS` file lists, by name; `InputError` for a bad file."""
    try:
        lines = read_text(path).splitlines()
    except InputError as error:
        raise InputError(f"{error}; make the checksums with: pbrnet dataset") from None
    listed = {}
    for line in lines:
        match = _LINE.fullmatch(line)
        if match is None:
            raise InputError(f"{path}: damaged, {line[:80]!r} is not a checksum of a file")
        listed[match[2]] = match[1]
    return listed


def verify_sums(folder: Path) -> int:
    """Compare all files with their checksums; return their number.

    Raises `InputError` that names every file that is missing, damaged or not listed.
    """
    path = Path(folder) / SUMS
    listed = read_sums(path)
    found = {file.name for file in path.parent.iterdir() if file.is_file()} - {SUMS}
    wrong = [f"{name} is missing" for name in sorted(set(listed) - found)]
    wrong += [f"{name} is not on the list" for name in sorted(found - set(listed))]
    for name in sorted(found & set(listed)):
        if digest_file(path.parent / name) != listed[name]:
            wrong.append(f"{name} is damaged")
    if wrong:
        raise InputError(f"{folder}: " + "; ".join(wrong) + "; make it again with: pbrnet dataset")
    return len(listed)
