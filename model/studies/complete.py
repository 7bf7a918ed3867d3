"""`pbrnet study all`: every figure and plot of docs/results.md from the reference data.

Each part is a command of pbrnet that runs in a process of its own, so that timings have no
neighbour and a failure ends one part only. Parts that are up to date are kept; the studies resume
inside, so the whole may take days and be interrupted at will.
"""

from __future__ import annotations

import io
import subprocess
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Any

import click

from pbrnet.model.data.reader import Dataset, Split
from pbrnet.model.evaluation.inference import available
from pbrnet.pipeline.commands.options import FOLDER, Request, common_options
from pbrnet.pipeline.keys import keys, table
from pbrnet.pipeline.terminal import own_streams, say
from pbrnet.scenes.checked import plain
from pbrnet.scenes.errors import InputError
from pbrnet.scenes.files import atomic_file, digest_bytes, digest_file, read_json, write_json
from pbrnet.scenes.image_files import open_image

STUDIES_FOLDER = Path("metrics/studies")
RECORD = STUDIES_FOLDER / "all.json"
FLICKER_SCENES = 6
SHEET_METHODS = ("radiosity", "plus", "hybrid", "denoised", "pbrnet", "unet")
QUALITY, WIDEST = 88, 1600  # of the JPEG plots, pixels
_TRAINING = ("train", *(one for one in table() if one.startswith("networks.")), "studies.trials")
_RUN = "import sys; from pbrnet.pipeline.cli import main; sys.exit(main(sys.argv[1:]))"


@dataclass(frozen=True)
class Part:
    """One command and the files that it writes below the working folder."""

    name: str
    arguments: tuple[str, ...]
    result: Path
    picture: Path | None = None
    takes_models: bool = True  # trained networks, which must then be the same
    keys: tuple[str, ...] = ("evaluate",)  # of its code

    @property
    def command(self) -> str:
        """The command as a user would type it."""
        return " ".join(("pbrnet", *self.arguments))


def _study(name: str, *arguments: str, save_as: str = "", trains: bool = False) -> Part:
    """Return the part of a study; one that `trains` takes no trained networks."""
    result, picture = (STUDIES_FOLDER / f"{name}{suffix}" for suffix in (".json", ".png"))
    names = ("evaluate", *_TRAINING) if trains else ("evaluate", f"studies.{name}")
    return Part(save_as or name, ("study", name, *arguments), result, picture, not trains, names)


def _time(size: str, *arguments: str) -> Part:
    return _study("time", "--size", size, *arguments, save_as=f"time-{size}")


EVALUATION = Path("metrics/evaluation.json")
SHEET = Path("metrics/reference.png")
PARTS = (
    Part("evaluation", ("evaluate",), EVALUATION),
    Part(
        "reference",
        (
            *("reference", "--sheet", str(SHEET), "--views", "8"),
            *(word for method in SHEET_METHODS for word in ("--method", method)),
        ),
        Path("metrics/reference.json"),
        SHEET,
    ),
    _study("loss", "--steps", "1000", trains=True),
    _study("composition", "--steps", "1000", trains=True),
    _study("noise", "--views", "60", "--steps", "1000", trains=True),
    _study("decomposition", "--steps", "1000", "--method", "plus", trains=True),
    _study("table", "--views", "60", "--steps", "500", "--seeds", "3", trains=True),
    _study("generalisation", "--source", "furnished-*", "--steps", "1000", trains=True),
    _study("illumination", "--views", "24"),
    _time("160x120", "--views", "24", "--max-spp", "32", "--reference-spp", "256"),
    _time(
        *("480x360", "--views", "40", "--repeats", "1"),
        *("--max-spp", "16", "--reference-spp", "128"),
    ),
)


@click.command(
    "all",
    epilog="""\b
Examples:
  pbrnet study all --dry-run               list the parts, and which are up to date
  pbrnet study all --docs docs             make what is missing; copy figures and plots to docs
  pbrnet study all --only time-160x120 --only loss

Run it in the folder with the parameters, data and networks of the reference run. A part is up to
date while its command, parameters, dataset, networks, code and figures are those recorded in
metrics/studies/all.json. An interrupted part resumes. `make docs` then writes the tables of
docs/results.md.""",
)
@click.option("--only", multiple=True, metavar="PART", help="Make only this part (repeatable).")
@click.option("--dry-run", is_flag=True, help="Only list the parts.")
@click.option("--docs", type=FOLDER, help="Copy figures to FOLDER/data and plots to FOLDER/images.")
@common_options
def command(request: Request, only: tuple[str, ...], docs: Path | None) -> int:
    """Make every figure and plot of the results from one dataset."""
    parts = _chosen((*PARTS, *flicker_parts(request.params.evaluate.split, request.data)), only)
    known = _recorded()
    state = fingerprints(plain(request.params), request.data)
    failed = []
    for part in parts:
        words = (*part.arguments, repr(keys(*part.keys)), *state[part.takes_models])
        digest = digest_bytes(*map(str.encode, words))
        if known.get(part.name) == [digest, _result(part)]:
            say(f"{part.name}: up to date")
        elif request.dry_run:
            say(f"{part.name}: {part.command}")
            continue
        else:
            say(f"{part.name}: {part.command}")
            if not _run(part, request):
                failed.append(part.name)
                continue
            # Read anew: another process may have made other parts meanwhile.
            write_json(RECORD, {**_recorded(), part.name: [digest, _result(part)]})
        if docs is not None and not request.dry_run:
            record(part, docs)
    if failed:
        say(f"failed: {', '.join(failed)}; run the same command again", err=True)
    return 1 if failed else 0


def flicker_parts(split: Split, data: Path) -> list[Part]:
    """Return the flicker study of scenes spread over the test split, of each its first view."""
    dataset = Dataset(data / "dataset", split)
    first: dict[str, str] = {}
    for scene, view in zip(dataset.column("scene_id"), dataset.column("view_id"), strict=True):
        first.setdefault(scene, view)
    scenes = sorted(first)
    count = min(FLICKER_SCENES, len(scenes))
    chosen = [scenes[k * len(scenes) // count] for k in range(count)]
    methods = [word for name in available(Path("models")) for word in ("--method", name)]
    parts = []
    for scene in chosen:
        result = STUDIES_FOLDER / f"flicker-{scene}.json"
        view = ("--view", first[scene], "--out", str(result))
        arguments = ("study", "flicker", str(data / "scenes" / scene), *view, *methods)
        names = ("evaluate", "studies.flicker")
        parts.append(Part(f"flicker-{scene}", arguments, result, keys=names))
    return parts


def fingerprints(params: Mapping[str, Any], data: Path) -> dict[bool, tuple[str, ...]]:
    """Return what parts depend on, by `Part.takes_models`: parameters, dataset, networks."""
    settings = {name: value for name, value in params.items() if name != "farm"}
    shards = sorted((data / "dataset").glob("*.parquet"))
    common = (version("pbrnet"), repr(settings), *map(digest_file, shards))
    cards = sorted(Path("models").glob("*.json"))
    return {False: common, True: (*common, *map(digest_file, cards))}


def record(part: Part, docs: Path) -> None:
    """Copy the result of a part to `docs`/data and its plot, as JPEG, to `docs`/images."""
    if part.result != Path("metrics/reference.json"):  # it has its place
        write_json(docs / "data" / f"{part.name}.json", read_json(_saved(part, ".json")))
    picture = _saved(part, ".png")
    if picture.is_file():
        name = "reference" if part.picture == SHEET else f"study-{part.name}"
        with atomic_file(docs / "images" / f"{name}.jpg") as partial:
            partial.write_bytes(_jpeg(picture))


def _result(part: Part) -> str:
    """Digest of the part's figures; empty if there are none."""
    path = _saved(part, ".json")
    return digest_file(path) if path.is_file() else ""


def _recorded() -> dict[str, list[str]]:
    """Return the digest of each part that is made."""
    return read_json(RECORD) if RECORD.is_file() else {}


def _chosen(parts: Sequence[Part], only: Sequence[str]) -> list[Part]:
    names = [part.name for part in parts]
    unknown = [name for name in only if name not in names]
    if unknown:
        raise InputError(f"--only: no part {unknown[0]!r} (there are: {', '.join(names)})")
    return [part for part in parts if not only or part.name in only]


def _run(part: Part, request: Request) -> bool:
    """Run the command of a part; keep its files under the part's own name. True if it succeeded."""
    words = [*part.arguments, "--data", str(request.data), "--seed", str(request.params.seed)]
    words += ["--params", str(request.params_file)]
    done = subprocess.run([sys.executable, "-c", _RUN, *words], **own_streams())
    if done.returncode or not part.result.is_file():
        return False
    for path, suffix in ((part.result, ".json"), (part.picture, ".png")):
        if path is not None and path.is_file() and path != (kept := _saved(part, suffix)):
            with atomic_file(kept) as partial:
                partial.write_bytes(path.read_bytes())
    return True


def _saved(part: Part, suffix: str) -> Path:
    """Return the place of a part's result (.json) or plot (.png) under its own name."""
    if suffix == ".json":
        return part.result.with_name(f"{part.name}.json")
    return STUDIES_FOLDER / f"{part.name}.png"


def _jpeg(path: Path) -> bytes:
    stream = io.BytesIO()
    picture = open_image(path).convert("RGB")
    picture.thumbnail((WIDEST, 10 * WIDEST))
    picture.save(stream, "JPEG", quality=QUALITY)
    return stream.getvalue()
