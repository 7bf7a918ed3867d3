"""A graphics card against LLVM on one machine: `python -m benchmarks.card`, at most eight minutes.

Each step runs both variants in processes of their own, and the results are written after each:
benchmarks/card.json, and with it a section of docs/benchmarks.md. The same command resumes where
an earlier one stopped, with the homes and frames in its folder. Without a card LLVM takes its
place: that tries the program at small sizes, and its figures mean nothing.
"""

from __future__ import annotations

import contextlib
import json
import os
import shutil
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import click
import numpy as np

from benchmarks.bench import python
from benchmarks.memory import courses
from benchmarks.results import CARD, measured_on, write_card
from benchmarks.rows import Row, at_least, at_most, missing
from benchmarks.run import show
from benchmarks.timing import Spread
from pbrnet.pipeline.frames import read_frame
from pbrnet.pipeline.render.scene import set_variant
from pbrnet.pipeline.render.variants import cards
from pbrnet.scenes.arrays import AnyArray, Float64Array
from pbrnet.scenes.color import luminance
from pbrnet.scenes.files import read_json, write_text

LLVM, CUDA = "llvm_ad_rgb", "cuda_ad_rgb"
_PARAMETERS = """
farm: {{variant: {variant}, workers: {workers}}}
image: {{width: {sizes.width}, height: {sizes.height}}}
channels: [paper, materials, labels]
scenes: {{homes: {sizes.homes}}}
cameras: {{views_per_scene: {sizes.views}}}
groundtruth: {{spp: {sizes.spp}, block_spp: 16}}
dataset: {{splits: {{test: 0, validation: 0}}, checks: {{max_noise: 1000000}}}}
train: {{shading: {{epochs: 1, steps_per_epoch: {sizes.steps}}}}}
"""
_NEAR = 1e-4  # metres, and units of directions and reflectances
_SE = at_most(3)


@dataclass(frozen=True)
class Sizes:
    """Amounts of work: for a card, or small for trying the program."""

    homes: int = 6
    views: int = 4
    width: int = 480
    height: int = 360
    spp: int = 64
    replicates: int = 16
    scenes: int = 50
    steps: int = 100


SMALL = Sizes(1, 1, 48, 36, 4, 8, 4, 2)


class OutOfTimeError(Exception):
    """The time that the command was given is over."""


@dataclass(frozen=True)
class Trial:
    """One comparison: its folder, the second variant, amounts, and when it has to end."""

    folder: Path
    variant: str
    sizes: Sizes
    deadline: float  # by time.monotonic()

    def data(self, name: str) -> Path:
        """Return the data folder of `llvm` or `card`; the homes and cameras are the same."""
        data = self.folder / name
        parameters = self._parameters(name)
        if not (data / "cameras").is_dir():
            if name == "llvm":
                for stage in ("scenes", "cameras"):
                    self.command(stage, "--data", str(data), "--params", str(parameters))
            else:
                for part in ("scenes", "cameras"):
                    shutil.copytree(self.data("llvm") / part, data / part)
        return data

    def stage(self, name: str, stage: str) -> float:
        """Run a stage on `llvm` or `card`; return its seconds."""
        data, started = self.data(name), time.monotonic()
        self.command(stage, "--data", str(data), "--params", str(self._parameters(name)))
        return time.monotonic() - started

    def command(self, *words: str) -> None:
        """Run a pbrnet command."""
        self.python("-m", "pbrnet.pipeline.cli", *words)

    def python(self, *words: str) -> None:
        """Run this interpreter in the project folder; raises `OutOfTimeError`."""
        try:
            python(*words, seconds=max(self.deadline - time.monotonic(), 0.01))
        except subprocess.TimeoutExpired:
            raise OutOfTimeError from None

    def _parameters(self, name: str) -> Path:
        file = self.folder / f"{name}.yaml"
        variant = LLVM if name == "llvm" else self.variant
        small = self.sizes == SMALL  # one worker: the tests share their machine
        text = _PARAMETERS.format(sizes=self.sizes, variant=variant, workers=int(small))
        if not file.is_file():
            write_text(file, text)
        return file


def surface_rows(trial: Trial) -> Iterator[Row]:
    """Yield how nearly frames of surfaces are equal."""
    for name in ("llvm", "card"):
        trial.stage(name, "inputs")
    for kind in ("inputs", "materials", "labels"):
        apart: list[Float64Array] = []
        for path in sorted((trial.data("llvm") / kind).rglob("*.exr")):
            twin = trial.data("card") / path.relative_to(trial.data("llvm"))
            ours, theirs = read_frame(path).channels, read_frame(twin).channels
            apart.append(
                np.max([np.abs(ours[name].astype(float) - theirs[name]) for name in ours], axis=0)
            )
        differ = np.concatenate([each.ravel() for each in apart]) > _NEAR
        yield Row(
            f"{kind}: pixels that differ",
            f"share of pixels in which a channel of `{kind}` differs by over {_NEAR:g}, "
            f"{len(apart)} views",
            _one(float(differ.mean())),
            goal=at_most(1e-3),
        )


def light_rows(trial: Trial) -> Iterator[Row]:
    """Yield how far mean and noise of colour and shading are apart, in standard errors."""
    sizes, images = trial.sizes, {}
    size = f"{max(48, sizes.width * 2 // 5)}x{max(36, sizes.height * 2 // 5)}"
    for index, name in enumerate(("llvm", "card")):
        out = trial.folder / f"{name}.npz"
        if not out.is_file():
            partial = trial.folder / f"partial-{name}.npz"
            variant = LLVM if name == "llvm" else trial.variant
            words = (str(trial.data("llvm")), str(partial), str(sizes.replicates), "16", size)
            trial.python("-m", "benchmarks.replicates", variant, *words, str(1000 * index))
            partial.rename(out)
        with np.load(out) as stored:
            images[name] = dict(stored)
    found = [agreement(images["llvm"][key], images["card"][key]) for key in images["llvm"]]
    about = f"{len(found)} images, {sizes.replicates} renders of 16 samples by each, {size}"
    for place, (name, meaning) in enumerate(
        (("mean", "mean luminance"), ("noise", "variance of a pixel, fireflies clamped"))
    ):
        apart = [abs(each[place]) for each in found]
        yield Row(
            f"light: {name}, standard errors apart",
            f"difference of the {meaning} over its standard error: largest, and range; {about}",
            Spread(max(apart), min(apart), max(apart), len(apart)),
            goal=_SE,
        )


def agreement(first: AnyArray, second: AnyArray) -> tuple[float, float]:
    """Return the differences of mean and noise of two sets of renders, in standard errors.

    Each is float (N, H, W, 3), N independent renders. Noise is half the squared difference of two
    renders in sequence; radiance above 4 times the 99 % quantile counts as that.
    """
    sets = [luminance(each.astype(np.float64)) for each in (first, second)]
    limit = 4 * np.quantile(np.mean([each.mean(axis=0) for each in sets], axis=0), 0.99)
    means = [each.mean(axis=(1, 2)) for each in sets]
    clamped = [np.minimum(each, limit) for each in sets]
    noises = [
        ((each[0::2][: len(each) // 2] - each[1::2]) ** 2).mean(axis=(1, 2)) / 2 for each in clamped
    ]
    return _apart(*means), _apart(*noises)


def _apart(first: Float64Array, second: Float64Array) -> float:
    """Return the difference of two means over its standard error; 0 for equal values."""
    difference = float(first.mean() - second.mean())
    error = float(np.sqrt(first.var(ddof=1) / len(first) + second.var(ddof=1) / len(second)))
    return 0.0 if difference == 0 else difference / max(error, 1e-300)


def speed_rows(trial: Trial) -> Iterator[Row]:
    """Yield views an hour of the ground truth, start and denoising included."""
    sizes, spent = trial.sizes, {}
    for name in ("card", "llvm"):
        shutil.rmtree(trial.data(name) / "color", ignore_errors=True)
        shutil.rmtree(trial.data(name) / "shading", ignore_errors=True)
        spent[name] = trial.stage(name, "groundtruth")
    views = len(list((trial.data("card") / "color").rglob("*.exr")))
    about = (
        f"the whole stage `groundtruth`, {views} views of {sizes.homes} homes, "
        f"{sizes.width}x{sizes.height}, {sizes.spp} samples, denoised"
    )
    for name, title in (("card", "card"), ("llvm", f"LLVM, {len(os.sched_getaffinity(0))} CPUs")):
        hourly = _one(3600 * views / spent[name])
        yield Row(f"views an hour, {title}", about, hourly, unit="views /h", clock="wall")
    ratio = _one(spent["llvm"] / spent["card"])
    yield Row("card / LLVM", f"views an hour of both; {about}", ratio, clock="wall")


def memory_rows(trial: Trial) -> Iterator[Row]:
    """Yield the growth of a worker's memory, and of the card's, over many scenes."""
    folder, homes = trial.folder / "memory", min(5, max(2, trial.sizes.scenes // 4))
    shutil.rmtree(folder, ignore_errors=True)
    watched = CardMemory()
    with watched:
        what = f"Path({str(folder)!r}), {homes}, {trial.sizes.scenes}, variant={trial.variant!r}"
        code = f"from pathlib import Path; from benchmarks.memory import measure; measure({what})"
        trial.python("-c", code)
    (course,) = courses(folder, homes, ("truth",))
    about = f"highest after the first round of {homes} homes, {trial.sizes.scenes} scenes opened"
    name, meaning = "growth of a worker's memory", f"resident memory of its process, {about}"
    yield Row(name, meaning, _one(course.growth), goal=at_most(0.1))
    name, meaning = "growth of the card's memory", f"memory in use on the card, {about}"
    if len(watched.used) < 4:
        yield missing(name, meaning, "nvidia-smi does not answer", at_most(0.1))
        return
    half = len(watched.used) // 2
    rise = max(watched.used[half:]) / max(watched.used[:half]) - 1
    yield Row(name, meaning, _one(rise), goal=at_most(0.1))


class CardMemory:
    """MiB in use on the first card, once a second while the context is open."""

    _COMMAND = ("nvidia-smi", "--query-gpu=memory.used", "--format=csv,noheader,nounits", "-l1")

    def __init__(self) -> None:
        self.used: list[int] = []
        self._process: subprocess.Popen[str] | None = None

    def __enter__(self) -> None:
        with contextlib.suppress(OSError):
            self._process = subprocess.Popen(self._COMMAND, stdout=subprocess.PIPE, text=True)

    def __exit__(self, *_: object) -> None:
        if self._process is not None:
            self._process.terminate()
            lines = self._process.communicate()[0].split()
            self.used = [int(line) for line in lines if line.isdigit()]


def training_rows(trial: Trial) -> Iterator[Row]:
    """Yield training steps a second of the shading network on the card."""
    name = "training steps a second"
    meaning = (
        f"the shading network, {trial.sizes.width}x{trial.sizes.height}, batch 1, with its loss"
    )
    if trial.variant == CUDA:
        import torch  # takes seconds, for this alone

        if not torch.cuda.is_available():
            yield missing(name, meaning, "this build of torch has no CUDA")
            return
    for stage in ("inputs", "illumination", "groundtruth", "dataset"):
        trial.stage("card", stage)
    models, places = trial.folder / "models", ("--data", str(trial.data("card")))
    shutil.rmtree(models, ignore_errors=True)
    words = ("--models", str(models), "--params", str(trial.folder / "card.yaml"), *places)
    trial.command("backbone", *words)
    trial.command("train", "shading", "--backbone", str(models), *words)
    (file,) = models.rglob("train_shading.json")
    seconds = json.loads(file.read_text())["seconds_per_step"]
    yield Row(name, meaning, _one(1 / seconds), unit="/s", clock="wall", goal=at_least(1))


def _one(value: float) -> Spread:
    return Spread(value, value, value, 1)


STEPS: dict[str, Callable[[Trial], Iterator[Row]]] = {
    "surfaces": surface_rows,
    "light": light_rows,
    "speed": speed_rows,
    "memory": memory_rows,
    "training": training_rows,
}


def run(trial: Trial, json_file: Path, names: Sequence[str]) -> dict[str, Any]:
    """Run the steps that the file does not hold yet; write it after each, and return its content.

    A file of another machine, renderer, code or size is replaced.
    """
    found = cards()
    record: dict[str, Any] = {
        "measured_on": measured_on("small" if trial.sizes == SMALL else "full"),
        "card": found.names[0] if trial.variant == CUDA else "",
        "steps": {},
    }
    before = read_json(json_file) if json_file.is_file() else {}
    if {**before, "steps": {}} == record:
        record["steps"] = before["steps"]
    for name in names:
        if name in record["steps"]:
            continue
        click.echo(name)
        started, rows = time.monotonic(), []
        try:
            for row in STEPS[name](trial):
                show(row)
                rows.append(row.plain())
        except OutOfTimeError:
            click.echo("  out of time; run the same command again to go on")
            break
        seconds = round(time.monotonic() - started, 1)
        record["steps"][name] = {"rows": rows, "seconds": seconds}
        write_card(json_file, record)
    return record


@click.command(
    epilog="""\b
Examples:
  python -m benchmarks.card                   on a machine with a card
  python -m benchmarks.card --small --out /tmp/card   try the program, with LLVM in its place"""
)
@click.option("--only", multiple=True, type=click.Choice(list(STEPS)), help="Only this step.")
@click.option("--minutes", default=8.0, show_default=True, help="Time after which it stops.")
@click.option("--small", is_flag=True, help="Small sizes; the figures mean nothing.")
@click.option(
    "--out",
    type=click.Path(path_type=Path, file_okay=False),
    help="Folder for card.json, instead of benchmarks/ and the page.",
)
@click.option(
    "--folder",
    type=click.Path(path_type=Path, file_okay=False),
    default=Path("build/card"),
    show_default=True,
    help="Folder of homes and frames, for resuming.",
)
def main(
    only: tuple[str, ...], minutes: float, small: bool, out: Path | None, folder: Path
) -> None:
    """Compare the card of this machine with LLVM.

    Exits with 4 where there is no usable card, except for --small.
    """
    deadline = time.monotonic() + 60 * minutes
    usable = cards().usable
    if not (usable or small):
        click.echo(f"no usable card: {cards().problem or 'none was found'}", err=True)
        sys.exit(4)
    set_variant(LLVM)  # of this process, which renders nothing
    folder.mkdir(parents=True, exist_ok=True)
    sizes = SMALL if small else Sizes()
    trial = Trial(folder.resolve(), CUDA if usable else LLVM, sizes, deadline)
    file = CARD if out is None else out / "card.json"
    run(trial, file, only or list(STEPS))
    click.echo(f"Written: {file}")


if __name__ == "__main__":
    main()
