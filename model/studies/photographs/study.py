"""Trainings and tests of the study's rows, kept by fingerprint."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
import torch
from safetensors.torch import load_file

from pbrnet.model.studies.photographs.measures import LABELS, MEASURES, confusion, measured
from pbrnet.model.studies.photographs.network import PhotographNetwork, new_network
from pbrnet.model.studies.photographs.results import FILE, PLOTS, PhotographsResult, figures
from pbrnet.model.studies.photographs.rows import Row, Source
from pbrnet.model.studies.photographs.samples import (
    FOCAL,
    VARIATIONS,
    Pool,
    Sample,
    load_samples,
    resampled,
)
from pbrnet.model.studies.photographs.sets.contract import PhotographSet
from pbrnet.model.studies.photographs.sets.layouts import open_set
from pbrnet.model.studies.photographs.sheet import sheet
from pbrnet.model.studies.photographs.summary import Scores, Tested, summary
from pbrnet.model.studies.photographs.training import BATCH, SCHEDULE, predict, train
from pbrnet.model.training.weights import write_weights
from pbrnet.pipeline.keys import table
from pbrnet.pipeline.photograph import PhotoVariation
from pbrnet.pipeline.progress import Progress
from pbrnet.scenes.checked import build, plain
from pbrnet.scenes.errors import InputError
from pbrnet.scenes.files import atomic_file, digest_bytes, read_bytes, read_json, sweep, write_json
from pbrnet.scenes.seeds import generator

_SHOWN = 2  # pictures of each kind on a sheet


@dataclass(frozen=True)
class PhotographConfig:
    """Settings of a study: rows, test, and the folders of trainings and results."""

    rows: tuple[Row, ...]
    photographs: Path
    work: Path
    metrics: Path
    steps: int
    seeds: int  # trainings of each row
    root: int  # seed
    reference: str


@dataclass(frozen=True)
class Training:
    """Contract of `training.json`: a finished training, beside its weights."""

    fingerprint: str
    pictures: int
    seconds_per_step: float


class PhotographStudy:
    """Rows of a study; sets are opened, and pictures read, when they are needed."""

    def __init__(self, config: PhotographConfig, log: Callable[[str], None]) -> None:
        self.config, self.log = config, log
        self.device = torch.device("cuda" if torch.cuda.is_available() else "cpu")
        self._sets: dict[Path, PhotographSet] = {}
        self._pools: dict[tuple[Source, bool], Pool] = {}

    @cached_property
    def photographs(self) -> PhotographSet:
        """The pictures of the test."""
        return open_set(self.config.photographs, "test")

    @cached_property
    def samples(self) -> list[Sample]:
        """The pictures of the test, read and resampled."""
        every = range(len(self.photographs.keys))
        return load_samples(self.photographs, every, self.config.photographs.name)

    def kept(self, row: Row, seed: int) -> Training | None:
        """Return the record of a finished training, None if it must be made."""
        path = self._folder(row, seed) / "training.json"
        if not path.is_file() or not path.with_name("weights.safetensors").is_file():
            return None
        record = build(Training, read_json(path), str(path), InputError)
        return record if record.fingerprint == self._fingerprint(row, seed) else None

    def survey(self) -> list[str]:
        """Return a line for each set and each training; reads the first picture of every set.

        Raises `InputError` as the readers do.
        """
        paths = {s.path for row in self.config.rows for stage in row.stages for s in stage}
        sets = [("test", self.photographs), *(("train", self._set(one)) for one in sorted(paths))]
        found = [f"{purpose}: {_described(pictures)}" for purpose, pictures in sets]
        for row in self.config.rows:
            for seed in range(self.config.seeds):
                state = "train" if self.kept(row, seed) is None else "kept"
                found.append(f"{row.name}, seed {seed}: {state}")
        return found

    def run(self) -> PhotographsResult:
        """Make missing trainings and tests, and write the results after each row.

        Raises `InputError` for damaged pictures; finished trainings are kept then.
        """
        config = self.config
        sweep(config.work)
        tested: list[Tested] = []
        for row in config.rows:
            trainings = [self._trained(row, seed) for seed in range(config.seeds)]
            scores = tuple(
                self._scores(row, seed, training.fingerprint)
                for seed, training in enumerate(trainings)
            )
            pace = float(np.mean([training.seconds_per_step for training in trainings]))
            tested.append(Tested(row, trainings[0].pictures, pace, scores))
            result = self._summary(tested)
            write_json(config.metrics / FILE, plain(result))
            for name, figure in zip(PLOTS, figures(result), strict=False):
                with atomic_file(config.metrics / name) as partial:
                    figure.savefig(partial, format="png", metadata={"Software": None})
        return result

    def _summary(self, tested: Sequence[Tested]) -> PhotographsResult:
        config = self.config
        facts = {
            "test": config.photographs.name,
            "steps": config.steps,
            "batch": BATCH,
            "focal": FOCAL,
            "seed": config.root,
            "reference": config.reference,
        }
        return summary(tested, [key.run for key in self.photographs.keys], facts)

    def _folder(self, row: Row, seed: int) -> Path:
        """Folder of a training: weights, records, sheet of pictures."""
        return self.config.work / row.folder / str(seed)

    def _fingerprint(self, row: Row, seed: int) -> str:
        """Digest of everything that determines the weights."""
        sets = [[(self._set(one.path).fingerprint(), one.views) for one in s] for s in row.stages]
        ranges = tuple(plain(PhotoVariation()).values())
        settings = (self.config.steps, self.config.root, seed, SCHEDULE, FOCAL, VARIATIONS, ranges)
        number = table()["studies.photographs"]
        return digest_bytes(repr((number, sets, row.varied, settings)).encode())

    def _trained(self, row: Row, seed: int) -> Training:
        """Return a training's record; it is made now unless it is kept."""
        record, folder = self.kept(row, seed), self._folder(row, seed)
        label = f"{row.name}, seed {seed}"
        if record is not None:
            self.log(f"{label}: kept")
            return record
        stages = self._stages(row)
        begin = time.perf_counter()
        network = train(stages, self.config.steps, self.config.root + seed, self.device, label)
        pace = (time.perf_counter() - begin) / self.config.steps
        pictures = sum(len(pool.samples) for stage in stages for pool in stage)
        record = Training(self._fingerprint(row, seed), pictures, pace)
        state = {name: value.cpu().contiguous() for name, value in network.state_dict().items()}
        write_weights(folder / "weights.safetensors", state)
        write_json(folder / "training.json", plain(record))
        return record

    def _set(self, path: Path) -> PhotographSet:
        """Return a training set; raises `InputError` if it shares pictures with the test."""
        if path not in self._sets:
            found = open_set(path, "train")
            shared = {key.name for key in found.keys} & {key.name for key in self.photographs.keys}
            if shared and found.path.resolve() == self.photographs.path.resolve():
                raise InputError(
                    f"{path}: {len(shared)} pictures to train on are also those of the test; list "
                    "others in train.txt and test.csv, or name another set"
                )
            self._sets[path] = found
        return self._sets[path]

    def _stages(self, row: Row) -> list[list[Pool]]:
        """Return the pools of a row; those of the row before that it shares are used again."""
        held, self._pools = self._pools, {}
        stages = []
        for stage in row.stages:
            for one in stage:
                key = (one, row.varied)
                self._pools[key] = held.get(key) or self._pools.get(key) or self._pool(one, row)
            stages.append([self._pools[one, row.varied] for one in stage])
        return stages

    def _pool(self, source: Source, row: Row) -> Pool:
        pictures = self._set(source.path)
        numbers = chosen(pictures, source.views, self.config.root)
        samples = load_samples(pictures, numbers, source.path.name)
        return Pool(samples, row.varied, self.config.root)

    def _scores(self, row: Row, seed: int, fingerprint: str) -> Scores:
        """Return the scores of a training; the test is made now unless it is kept."""
        path = self._folder(row, seed) / "scores.npz"
        digest = digest_bytes(fingerprint.encode(), self.photographs.fingerprint().encode())
        if path.is_file() and (found := Scores.read(read_bytes(path), digest)) is not None:
            return found
        network = self._network(path.with_name("weights.safetensors"))
        scores = self._test(network, f"{row.name}, seed {seed}")
        with atomic_file(path.with_name("pictures.png")) as partial:
            examples = [self.samples[place] for place in scores.examples(_SHOWN)]
            found_in = [predict(network, sample, self.device) for sample in examples]
            partial.write_bytes(sheet(examples, found_in))
        with atomic_file(path) as partial:
            partial.write_bytes(scores.to_bytes(digest))
        return scores

    def _network(self, weights: Path) -> PhotographNetwork:
        network = new_network(0)
        network.load_state_dict(load_file(weights))
        return network.eval().to(self.device)

    def _test(self, network: PhotographNetwork, label: str) -> Scores:
        """Test a network on all pictures."""
        values = np.full((len(self.samples), len(MEASURES)), np.nan)
        names = [name for name in MEASURES if name not in LABELS]
        tables = {
            count: np.zeros((len(self.samples), count, count), np.int32)
            for count in set(LABELS.values())
        }
        with Progress(len(self.samples), f"test {label}", "pictures") as progress:
            for place, sample in enumerate(self.samples):
                found = predict(network, sample, self.device)
                own = measured(sample, found)
                values[place, : len(names)] = [own.get(name, np.nan) for name in names]
                for count, table in tables.items():
                    name = f"label{count}"
                    table[place] = confusion(getattr(sample, name), getattr(found, name), count)
                progress.advance()
        return Scores(dict(zip(names, values.T, strict=False)), tables)


def _described(pictures: PhotographSet) -> str:
    (sample,) = map(resampled, pictures.read([0]))
    height, width = sample.depth.shape
    shares = [float(np.mean(known)) for known in (sample.depth > 0, sample.label13 > 0)]
    normals = float((sample.normal != 0).any(-1).mean())
    return (
        f"{pictures.path}: {len(pictures.keys)} pictures of {len({k.run for k in pictures.keys})} "
        f"runs; the first, {sample.key.name}, becomes {width}x{height} pixels, with depth in "
        f"{shares[0]:.0%}, normals in {normals:.0%}, classes in {shares[1]:.0%} of them"
    )


def chosen(pictures: PhotographSet, views: int | None, root: int) -> list[int]:
    """Return the numbers of `views` pictures: whole runs in random order, the last one in part.

    More views include those of fewer. Raises `InputError` if there are not as many.
    """
    if views is not None and views > len(pictures.keys):
        raise InputError(f"{pictures.path}: {len(pictures.keys)} pictures, a row takes {views}")
    runs: dict[str, list[int]] = {}
    for number, key in enumerate(pictures.keys):
        runs.setdefault(key.run, []).append(number)
    order = generator(root, "photographs", "views").shuffled(sorted(runs))
    return sorted([number for run in order for number in runs[run]][:views])
