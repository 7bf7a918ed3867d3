"""Presets and where they and recipes are found: in the project's folder, then in the package.

A preset, `params/NAME.yaml`, holds what differs from the quick start, whose values are the defaults
of all keys. `pbrnet preset` writes it out whole.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import takewhile
from pathlib import Path
from typing import Any

from pbrnet.pipeline.params import Params, load_params, read_yaml
from pbrnet.pipeline.release.parameter_text import QUICK, parameter_text
from pbrnet.scenes.errors import ParameterError
from pbrnet.scenes.files import regular_file
from pbrnet.scenes.installation import PACKAGE


@dataclass(frozen=True)
class Preset:
    """A preset: its title and its file, which the quick start does without."""

    title: str
    file: Path | None = None

    def params(self) -> Params:
        """Read and check the parameters; raises `ParameterError`."""
        return load_params(self.file) if self.file else Params()

    def content(self) -> Any:
        """Return what differs from the quick start, as it is written."""
        return (read_yaml(self.file) or {}) if self.file else {}

    def text(self) -> str:
        """Return the whole parameter file."""
        return parameter_text(self.params(), self.title)


def presets() -> dict[str, Preset]:
    """Return the presets by name, the quick start first."""
    files = files_of("params")
    return {"quick": Preset(QUICK)} | {
        name: Preset(_title(file), file) for name, file in files.items() if name != "quick"
    }


def find_preset(name: str) -> Preset:
    """Return a preset; raises `ParameterError` that names the others."""
    found = presets()
    if name not in found:
        raise ParameterError(f"{name}: no such preset; available: {', '.join(found)}")
    return found[name]


def files_of(folder: str, suffix: str = ".yaml") -> dict[str, Path]:
    """Return the files of a folder of the package and of the project by name.

    A file of the project goes before one of the package.
    """
    places = (PACKAGE / folder, Path(folder))
    files = [file for place in places for file in sorted(place.glob(f"*{suffix}"))]
    return dict(sorted((file.stem, file) for file in files))


def _title(file: Path) -> str:
    """The comment at a preset's beginning."""
    text = regular_file(file).read_text(encoding="utf-8", errors="replace")
    lines = takewhile(lambda line: line.startswith("#"), text.splitlines())
    return " ".join(line.lstrip("# ") for line in lines)
