"""Catalogue files of a folder or of Debian packages, which are fetched if they are missing."""

from __future__ import annotations

import shutil
import subprocess
import tempfile
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

from pbrnet.scenes.errors import InputError, MachineError
from pbrnet.scenes.files import (
    atomic_directory,
    digest_file,
    digest_folder,
    read_json,
    write_json,
)
from pbrnet.scenes.sweethome.catalogue.library import Library, read_library

INSTALLED = Path("/usr/share/sweethome3d/furniture")  # catalogues of Debian's packages
SUFFIX = ".sh3f"
DOWNLOADS = "packages"  # below data/assets: fetched packages
_PATIENCE = 900.0  # seconds for apt-get


@dataclass(frozen=True)
class Catalogue:
    """A catalogue file, its content, and the package and version it was fetched in, or ""."""

    path: Path
    package: str
    sha256: str
    library: Library


def find_catalogues(
    folder: str, packages: Sequence[str], root: Path, table: str
) -> list[tuple[Path, str]]:
    """Return the catalogue files and their packages, sorted; fetch missing packages.

    They are those in `folder`, with its `table` of own pieces, or, if it is empty, those of the
    Debian `packages`, which are fetched into a folder below `root`. Raises `MachineError` if there
    are none, or none can be fetched.
    """
    if folder:
        place = Path(folder).expanduser()
        if not place.is_dir():
            raise MachineError(
                f"assets.folder: {place} is not a folder; name one that holds {SUFFIX} files, or a "
                f"{table} and models"
            )
        files = [(path, "") for path in (*_catalogues(place), place / table) if path.is_file()]
        if not files:
            raise MachineError(f"assets.folder: no {SUFFIX} file and no {table} in {place}")
        return files
    found: dict[str, tuple[Path, str]] = {}
    for package in packages:
        version = _installed_version(package)
        if version and _catalogues(INSTALLED):
            place = INSTALLED
        else:
            place = root / DOWNLOADS / package
            if not (place / "package.json").is_file():
                _fetch(package, place)
            version = read_json(place / "package.json").get("version", "")
        label = f"{package} {version}".strip()
        found |= {path.name: (path, label) for path in _catalogues(place)}
    return list(found.values())


def _catalogues(folder: Path) -> list[Path]:
    if not folder.is_dir():
        return []
    return sorted(p for p in folder.iterdir() if p.suffix.lower() == SUFFIX and p.is_file())


def _installed_version(package: str) -> str:
    query = ["dpkg-query", "--show", "--showformat=${db:Status-Status} ${Version}", "--", package]
    try:
        done = subprocess.run(query, capture_output=True, text=True, timeout=60, check=False)
    except (OSError, subprocess.TimeoutExpired):
        return ""
    status, _, version = done.stdout.strip().partition(" ")
    return version if done.returncode == 0 and status == "installed" else ""


def _fetch(package: str, out: Path) -> None:
    """Download a Debian package and unpack its catalogues into the folder `out`."""
    advice = (
        f"; set assets.folder to a folder with {SUFFIX} files, install the package, "
        "or set assets.enabled to false"
    )
    with tempfile.TemporaryDirectory(prefix="pbrnet-assets-") as name:
        folder = Path(name)
        _command(["apt-get", "download", "--", package], folder, f"cannot fetch {package}", advice)
        debs = sorted(folder.glob("*.deb"))
        if not debs:
            raise MachineError(f"assets: apt-get downloaded no package for {package}{advice}")
        unpack = ["dpkg-deb", "--extract", str(debs[0]), str(folder / "tree")]
        _command(unpack, folder, f"cannot unpack {debs[0].name}", advice)
        found = [path for path in sorted((folder / "tree").rglob(f"*{SUFFIX}")) if path.is_file()]
        if not found:
            raise MachineError(f"assets: {package} holds no {SUFFIX} file{advice}")
        with atomic_directory(out) as partial:
            for path in found:
                shutil.copyfile(path, partial / path.name)
            parts = debs[0].stem.split("_")
            facts = {
                "package": package,
                "version": parts[1] if len(parts) > 1 else "",
                "file": debs[0].name,
                "sha256": digest_file(debs[0]),
            }
            write_json(partial / "package.json", facts)


def _command(command: Sequence[str], folder: Path, what: str, advice: str) -> None:
    try:
        done = subprocess.run(
            command, cwd=folder, capture_output=True, text=True, timeout=_PATIENCE, check=False
        )
    except FileNotFoundError:
        raise MachineError(f"assets: {what}: {command[0]} is not installed{advice}") from None
    except subprocess.TimeoutExpired:
        raise MachineError(
            f"assets: {what}: not finished after {_PATIENCE:.0f} s{advice}"
        ) from None
    if done.returncode:
        message = (done.stderr.strip() or done.stdout.strip() or "no message").splitlines()[-1]
        raise MachineError(f"assets: {what}: {message}{advice}")


def read_catalogues(
    files: Iterable[tuple[Path, str]], read_table: Callable[[Path], Library]
) -> list[Catalogue]:
    """Read catalogue files; `InputError` for a damaged one, or two that would share a folder.

    `read_table` reads tables of own pieces, whose digest is that of all files of the folder.
    """
    found: list[Catalogue] = []
    for path, package in files:
        is_own = path.suffix.lower() != SUFFIX
        library = read_table(path) if is_own else read_library(path)
        if library.key.lower() in (DOWNLOADS, *(other.library.key.lower() for other in found)):
            raise InputError(f"{path}: another catalogue has this name; rename the file")
        digest = digest_folder(path.parent) if is_own else digest_file(path)
        found.append(Catalogue(path, package, digest, library))
    return found
