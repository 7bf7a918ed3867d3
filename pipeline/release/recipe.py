"""Recipes of datasets and their records.

`recipes/NAME.yaml` says what a release is: version, title, and the `parameters` that differ from
the quick start or from a `preset`. `recipes/NAME.json`, written by `pbrnet release NAME --record`,
says what came out: checksums, costs, machine.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pyarrow as pa

from pbrnet.pipeline.dataset.shards import write_sums
from pbrnet.pipeline.params import Params, build_params, read_yaml
from pbrnet.pipeline.release.presets import files_of, find_preset
from pbrnet.pipeline.templating import plain_markdown
from pbrnet.scenes.checked import build, check_name, plain
from pbrnet.scenes.errors import InputError, ParameterError
from pbrnet.scenes.files import read_json, read_text, write_json, write_text


@dataclass(frozen=True)
class RecipeHead:
    """Title and version of a release."""

    title: str
    version: str  # of the dataset: a change of the parameters or of the code's pixels raises it

    def verify(self, where: str) -> None:
        """Raise ValueError for an empty title or version."""
        if not self.title.strip() or not self.version.strip():
            raise ValueError(f"{where}: a recipe needs a title and a version")


@dataclass(frozen=True)
class Recipe(RecipeHead):
    """Definition of a release."""

    parameters: Params


@dataclass(frozen=True)
class Record:
    """Outcome of making a release: cost, machine, checksums."""

    version: str
    core_seconds: dict[str, float]  # by stage
    rows: int
    bytes: int  # of the dataset's files
    machine: str  # processor
    instruction_set: str
    sums: dict[str, str]  # SHA-256 by file

    @property
    def core_hours(self) -> float:
        """Cost of all stages together."""
        return sum(self.core_seconds.values()) / 3600


@dataclass(frozen=True)
class Difference:
    """Files of a release that are not those of the record."""

    changed: tuple[str, ...] = ()
    missing: tuple[str, ...] = ()
    added: tuple[str, ...] = ()

    def __bool__(self) -> bool:
        return bool(self.changed or self.missing or self.added)

    def __str__(self) -> str:
        parts = {"other bytes": self.changed, "missing": self.missing, "new": self.added}
        return "; ".join(f"{what}: {', '.join(names)}" for what, names in parts.items() if names)


def recipe_names(folder: Path | None = None) -> dict[str, str]:
    """Return the title of each recipe by name: of a folder, or of project and package."""
    names = list(_files(folder))
    if not names:
        raise ParameterError(f"{folder}: no recipes found")
    return {name: load_recipe(name, folder).title for name in names}


def load_recipe(name: str, folder: Path | None = None) -> Recipe:
    """Read and check a recipe of a folder, or of project or package.

    `ParameterError` names the fault.
    """
    check_name(name, "a recipe's name")
    files = _files(folder)
    if name not in files:
        known = ", ".join(files) or "none"
        raise ParameterError(f"{name}: no such recipe; available: {known}")
    try:
        content = read_yaml(files[name])
        if not isinstance(content, dict):
            raise ParameterError("expected title, version and parameters")
        changes = content.pop("parameters", None) or {}
        if "preset" in content:
            changes = _merged(find_preset(str(content.pop("preset"))).content(), changes)
        head = build(RecipeHead, content)
        return Recipe(head.title, head.version, build_params(changes))
    except ParameterError as error:
        raise ParameterError(f"{files[name]}: {error}") from None


def _files(folder: Path | None, suffix: str = ".yaml") -> dict[str, Path]:
    if folder is None:
        return files_of("recipes", suffix)
    return {file.stem: file for file in sorted(folder.glob(f"*{suffix}"))}


def _merged(base: Any, changes: Any) -> Any:
    """Return mappings merged key by key; other values of `changes` replace those of `base`."""
    if not isinstance(base, dict) or not isinstance(changes, dict):
        return changes
    return base | {key: _merged(base.get(key), value) for key, value in changes.items()}


def load_record(name: str, folder: Path | None = None) -> Record | None:
    """Return the record of a recipe, or None if it was never recorded."""
    file = _files(folder, ".json").get(name)
    return build(Record, read_json(file), str(file), InputError) if file else None


def save_record(name: str, record: Record, folder: Path | None = None) -> Path:
    """Write the record of a recipe by rename, into its folder or the project's; return the file."""
    file = (folder or Path("recipes")) / f"{name}.json"
    write_json(file, plain(record))
    return file


def core_seconds(ledger: pa.Table) -> dict[str, float]:
    """Return the core-seconds of each stage in a ledger."""
    spent: dict[str, float] = {}
    for row in ledger.select(["stage", "seconds", "threads"]).to_pylist():
        seconds = float(row["seconds"] or 0) * (row["threads"] or 1)
        spent[row["stage"]] = spent.get(row["stage"], 0.0) + seconds
    return {stage: round(seconds, 2) for stage, seconds in spent.items()}


def add_to_card(dataset: Path, name: str, recipe: Recipe, record: Record | None) -> None:
    """Add to a dataset's card how it is made again and what that costs; renew its checksums.

    The cost is the record's, never that of this making: the card has equal bytes each time.
    """
    title, version = plain_markdown(recipe.title), plain_markdown(recipe.version)
    lines = [
        "",
        "## Make it again",
        "",
        f"Release `{name}`, version {version}: {title}. From the project's folder:",
        "",
        "```sh",
        f"pbrnet release {name}",
        "```",
        "",
        "The command compares the files with the recorded checksums.",
    ]
    if record is not None:
        stages = sorted(record.core_seconds.items(), key=lambda item: -item[1])
        parts = ", ".join(f"{plain_markdown(stage)} {_span(seconds)}" for stage, seconds in stages)
        lines += [
            f"It took {_span(3600 * record.core_hours)} of a core ({parts}) on "
            f"{plain_markdown(record.machine)}, {plain_markdown(record.instruction_set)}: "
            f"{3600 * record.core_hours / max(record.rows, 1):.1f} core-seconds a row."
        ]
    card = dataset / "README.md"
    write_text(card, read_text(card).rstrip("\n") + "\n" + "\n".join(lines) + "\n")
    write_sums(dataset)


def compare(record: Record, sums: Mapping[str, str]) -> Difference:
    """Return which files differ from the record."""
    known = record.sums
    return Difference(
        tuple(sorted(name for name in known.keys() & sums.keys() if known[name] != sums[name])),
        tuple(sorted(known.keys() - sums.keys())),
        tuple(sorted(sums.keys() - known.keys())),
    )


def _span(seconds: float) -> str:
    if seconds < 120:
        return f"{seconds:.0f} s"
    return f"{seconds / 60:.0f} minutes" if seconds < 7200 else f"{seconds / 3600:.1f} hours"
