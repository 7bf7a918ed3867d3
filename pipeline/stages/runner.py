"""What all stages that fill the data folder do alike: a plan, the farm at work on it, its books.

A stage adds to its `Work` what is to be made; `carry_out` has the farm make it, and `finish`
removes what could not be made, writes the list of failures and says what was done.
"""

from __future__ import annotations

import shutil
import time
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any, TypeVar

from pipeline.costs.estimates import estimator
from pipeline.costs.ledger import Ledger, read_ledger
from pipeline.farm.cluster import Farm, Outcome
from pipeline.farm.scheduling import Item
from pipeline.farm.transfer import Supply
from pipeline.farm.workspace import open_site, receive, supply
from pipeline.params import Params
from pipeline.progress import Progress
from pipeline.records import Failure, save_failures
from pipeline.render.scene import set_variant
from pipeline.stages.render_jobs import use_code, use_renderer
from pipeline.versions import code_version
from scenes.errors import PbrnetError
from scenes.files import remove_partials

A = TypeVar("A")
B = TypeVar("B")
_SHOWN = 20  # failures named on the terminal; all of them are in data/failures


class StageError(PbrnetError):
    """Everything else was done, but some scenes or views failed; the text names them."""

    exit_code = 1


@dataclass(frozen=True)
class Summary:
    """What a stage did."""

    stage: str
    made: int
    kept: int
    removed: int
    seconds: float
    notes: tuple[str, ...] = ()

    def __str__(self) -> str:
        parts = [f"{self.stage}: {self.made} made, {self.kept} kept, {self.removed} removed"]
        return "\n".join([f"{parts[0]}, {self.seconds:.1f} s", *self.notes])


@dataclass(frozen=True)
class Target:
    """What an item writes: a frame, a camera file or a scene, and by what names it is listed."""

    path: Path
    stage: str
    scene_id: str
    view_id: str = ""


@dataclass
class Work:
    """A stage's plan: what is to be done, how, and what is already known to fail."""

    stage: str
    unit: str
    work: Callable[[Any], Any]
    items: list[Item] = field(default_factory=list)
    failures: list[Failure] = field(default_factory=list)
    kept: int = 0
    removed: int = 0
    renders: bool = True

    targets: dict[str, list[Target]] = field(default_factory=dict)  # key -> what the item writes

    def add(self, job: Any, *targets: Target) -> None:
        """Add an item; what lies at its targets now is out of date."""
        first = targets[0]
        key = f"{'+'.join(target.stage for target in targets)}/{first.scene_id}/{first.view_id}"
        self.items.append(Item(key, first.scene_id, job))
        self.targets[key] = list(targets)


def carry_out(
    data: Path, params: Params, scheduler: str | None, work: Work, renderer: str = ""
) -> dict[Path, bool]:
    """Have the farm do the work; says of each target whether it was made, and adds to the
    work's failures."""
    made = {target.path: False for targets in work.targets.values() for target in targets}
    if not work.items:
        return made
    ledger = Ledger(data)
    farm_params = params.farm
    with (
        Progress(work.kept + len(made), work.stage, work.unit) as progress,
        open_site(data, farm_params.transfer, farm_params.cache_mb) as site,
    ):
        progress.advance(work.kept)
        setup: Callable[[int], None] = partial(use_code, code_version(), site)
        files: Supply | None = None
        needed: Path | None = site.mark
        if work.renders:
            variant = set_variant(farm_params.variant)
            setup = partial(use_renderer, variant, renderer, code_version(), site)
            files, needed = supply(site), None
        try:
            with Farm(farm_params, scheduler, setup, len(work.items), files, needed) as farm:
                for outcome in farm.run(work.work, _weighed(data, work)):
                    made.update(_record(outcome, work, renderer, ledger, progress))
        finally:
            for folder in sorted({target.parent for target in made}):
                remove_partials(folder)
            ledger.save()
    return made


def _weighed(data: Path, work: Work) -> list[Item]:
    """The items, each with the seconds that it may take."""
    estimate = estimator(read_ledger(data))
    return [
        replace(
            item,
            weight=sum(
                estimate(target.stage, target.scene_id, target.view_id)
                for target in work.targets[item.key]
            ),
        )
        for item in work.items
    ]


def _record(
    outcome: Outcome, work: Work, renderer: str, ledger: Ledger, progress: Progress
) -> dict[Path, bool]:
    """Book an outcome: failures, costs, progress; says of each of its targets whether it was made.

    Frames from one trace share its seconds evenly, so that the ledger's sum is what was spent.
    """
    targets, value = work.targets[outcome.key], outcome.value or {}
    failed, costs = value.get("failed", {}), dict(value.get("costs", {}))
    frames = costs.pop("frames", {})
    errors = {target.path: outcome.error or failed.get(target.stage, "") for target in targets}
    sent = value.get("files", {})
    for target in targets:
        if target.stage in sent and not errors[target.path]:
            receive(target.path, sent[target.stage])
    sharing = max(1, sum(not error for error in errors.values()))
    spent = {"seconds": outcome.seconds, "opening": costs.pop("opening", None)}
    shared = {name: value / sharing for name, value in spent.items() if value is not None}
    for target in targets:
        key = (target.stage, target.scene_id, target.view_id)
        if errors[target.path]:
            failure = Failure(*key, errors[target.path])
            work.failures.append(failure)
            progress.write(f"failed: {failure}")
        else:
            ledger.add(
                key,
                **shared,
                **costs,
                **frames.get(target.stage, {}),
                worker=outcome.worker,
                attempt=outcome.attempt,
                ended=outcome.ended,
                renderer=renderer or None,
            )
        progress.advance(1, target.scene_id)
    return {path: not error for path, error in errors.items()}


def finish(
    data: Path,
    work: Work,
    made: dict[Path, bool],
    started: float,
    notes: Callable[[], Iterable[str]] = tuple,
) -> Summary:
    """Remove what is out of date and could not be made again, and write the failures list.

    Raises `StageError` if there is anything on it. (Out-of-date files go only now, not before
    the work: a run begun by mistake and interrupted loses nothing that it has not replaced.)
    """
    for path in [path for path, fine in made.items() if not fine]:
        if path.is_dir():
            shutil.rmtree(path)
        else:
            path.unlink(missing_ok=True)
    failures = sorted(work.failures, key=lambda f: (f.scene_id, f.view_id, f.stage))
    save_failures(data, work.stage, failures)
    count = sum(made.values())
    if failures:
        named = [f"  {failure}" for failure in failures[:_SHOWN]]
        if len(failures) > _SHOWN:
            named.append(f"  and {len(failures) - _SHOWN} more")
        raise StageError(
            f"{work.stage}: {len(failures)} failed, {count} made, {work.kept} kept\n"
            + "\n".join(named)
            + f"\nThe whole list is in {data / 'failures' / (work.stage + '.json')}; everything "
            "else is done. Run the same command again to retry."
        )
    seconds = time.monotonic() - started
    return Summary(work.stage, count, work.kept, work.removed, seconds, tuple(notes()))


def threaded(function: Callable[[A], B], values: Sequence[A]) -> list[B]:
    """Map over values with a few threads: the time goes into reading files."""
    with ThreadPoolExecutor(4) as pool:
        return list(pool.map(function, values))
