"""Execution of a stage's plan on the farm, with its ledger, failures and summary.

A stage adds its outdated files to a `StagePlan`, and changes nothing until it is complete. `begin`
says the plan and moves orphans; `execute` makes files on the farm; `finish` removes files that
could not be made again, writes the list of failures and returns the summary.
"""

from __future__ import annotations

import re
import time
from collections import Counter
from collections.abc import Callable, Collection, Iterable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any, TypeVar

from dask.system import cpu_count

from pbrnet.pipeline.costs.forecast import (
    Estimate,
    StageCost,
    ViewSize,
    costs_of,
    estimator,
    seconds_of,
    typical_costs,
)
from pbrnet.pipeline.costs.ledger import Ledger, read_ledger
from pbrnet.pipeline.farm.cluster import Farm, scheduler_address
from pbrnet.pipeline.farm.settings import FarmParams
from pbrnet.pipeline.farm.transfer import TransferService
from pbrnet.pipeline.farm.versions import code_version, scene_digest
from pbrnet.pipeline.farm.worker import Item, Outcome
from pbrnet.pipeline.farm.workspace import open_workspace, receive, scene_service
from pbrnet.pipeline.progress import COMPILING, Pace, Progress, span
from pbrnet.pipeline.records import Failure, Trash, save_failures, size_text
from pbrnet.pipeline.render.scene import renderer_version
from pbrnet.pipeline.render.variants import accepted, card_ids, choose
from pbrnet.pipeline.stages.render_jobs import use_code, use_renderer
from pbrnet.pipeline.terminal import counted, lines_of, say, views_of
from pbrnet.scenes.contract import Scene, load_scene, scene_folders
from pbrnet.scenes.errors import InputError, PbrnetError
from pbrnet.scenes.files import remove_partials

A = TypeVar("A")
B = TypeVar("B")
_WORTH_SAYING = 10  # seconds of a typical core
_SHOWN = 20  # failures listed on the terminal; data/failures holds all of them
SAFE_NAME = re.compile(r"[A-Za-z0-9_][A-Za-z0-9._-]{0,199}")


class StageError(PbrnetError):
    """Some scenes or views failed, and everything else is done; the message lists them."""

    exit_code = 1


@dataclass(frozen=True)
class Summary:
    """Numbers of files that a stage made, kept and removed, and its seconds if it ran alone."""

    stage: str
    made: int
    kept: int
    removed: int
    seconds: float | None
    notes: tuple[str, ...] = ()

    def __str__(self) -> str:
        parts = [f"{self.stage}: {self.made} made, {self.kept} kept, {self.removed} removed"]
        parts += [] if self.seconds is None else [f"{self.seconds:.1f} s"]
        return lines_of([", ".join(parts), *self.notes])


@dataclass(frozen=True)
class Target:
    """A file or folder that an item writes, with its stage, scene and view in the ledger."""

    path: Path
    stage: str
    scene_id: str
    view_id: str = ""


@dataclass(frozen=True)
class Pending:
    """Scenes that stages before will change (or their cameras), and scenes that they remove."""

    changed: frozenset[str] = frozenset()
    gone: frozenset[str] = frozenset()

    @property
    def scenes(self) -> frozenset[str]:
        """All of them."""
        return self.changed | self.gone


NOTHING_PENDING = Pending()


@dataclass
class StagePlan:
    """Outputs that a stage makes, keeps and removes, and failures known beforehand.

    `orphans` are files or folders that are no longer asked for; `returning` are out of date, and
    lie up to date in the trash.
    """

    data: Path
    farm: FarmParams
    view: ViewSize
    stage: str
    unit: str  # plural noun for the progress bar
    work: Callable[[Any], Any]
    accepted: tuple[str, ...] = ()  # renderers whose files hold, see `accepted_renderers`
    started: float = field(default_factory=time.monotonic)
    items: list[Item] = field(default_factory=list)
    held: list[Item] = field(default_factory=list)  # whose time comes while others are made
    failures: list[Failure] = field(default_factory=list)
    kept: int = 0
    removed: int = 0
    orphans: list[Path] = field(default_factory=list)
    returning: list[Path] = field(default_factory=list)
    # Files that may be made beside those, at most: their scenes or cameras change before.
    later: list[Target] = field(default_factory=list)
    views: dict[str, int] = field(default_factory=dict)  # of each scene, for its cameras: at most
    notes: list[str] = field(default_factory=list)  # further parts of its line
    # Views, by scene and id, that are not rendered, as the dataset's checks reject them: why.
    left_out: dict[tuple[str, str], str] = field(default_factory=dict)
    unsure: int = 0  # files of those scenes that are there now
    renders: bool = True  # whether the workers need a renderer and the scenes' files
    targets: dict[str, list[Target]] = field(default_factory=dict)  # by the item's key
    renderers: Counter[str] = field(default_factory=Counter)  # files by the renderer that made them

    @property
    def outputs(self) -> list[Target]:
        """Targets of all items."""
        return [target for targets in self.targets.values() for target in targets]

    @property
    def replaced(self) -> list[Path]:
        """Targets that exist; they are out of date."""
        return [target.path for target in self.outputs if target.path.exists()]

    @property
    def trash(self) -> Trash:
        """Trash of the data folder."""
        return Trash(self.data, self.farm.trash_days)

    def add(self, job: Any, *targets: Target, phase: int = 0, held: bool = False) -> None:
        """Add an item; the files now at its targets are out of date."""
        first = targets[0]
        key = f"{'+'.join(target.stage for target in targets)}/{first.scene_id}/{first.view_id}"
        (self.held if held else self.items).append(Item(key, first.scene_id, job, phase=phase))
        self.targets[key] = list(targets)


def plan_line(plan: StagePlan) -> str:
    """Return what a stage makes, keeps and removes, and its expected time, as text."""
    old, words = plan.replaced, ""
    if old:
        kept = "; the old ones to the trash" if plan.farm.trash_days else ""
        words = f" ({len(old)} of them out of date, {size_text(old)}{kept})"
    parts = [f"{len(plan.outputs)} to make{words}"]
    if plan.later:
        parts.append(f"at most {len(plan.later)} more after earlier stages")
    parts.append(f"{plan.kept} up to date")
    if plan.unsure:
        parts.append(f"{plan.unsure} to be kept, remade or moved to the trash")
    if plan.returning:
        parts.append(f"{len(plan.returning)} back from the trash")
    if plan.left_out:
        parts.append(f"{counted(len(plan.left_out), 'view')} skipped, rejected by dataset.checks")
    if plan.orphans:
        where = "to the trash" if plan.farm.trash_days else "to be deleted"
        parts.append(f"{len(plan.orphans)} no longer required, {size_text(plan.orphans)}, {where}")
    if plan.views:
        most = "at most " if plan.outputs or plan.later else ""
        parts.append(f"{most}{views_of(sum(plan.views.values()), len(plan.views))}")
    parts += plan.notes
    if seconds := plan_seconds(plan, costs_of(read_ledger(plan.data))):
        parts.append(f"about {span(seconds)} of one core, from the ledger")
    elif seconds is None and (typical := plan_seconds(plan, typical_costs()) or 0) > _WORTH_SAYING:
        parts.append(f"about {span(typical)} of a typical core")
    return f"{plan.stage}: {', '.join(parts)}"


def plan_seconds(plan: StagePlan, costs: Iterable[StageCost]) -> float | None:
    """Return the core-seconds of a plan by the costs of stages; None if these do not tell."""
    made = [(one.stage, one.scene_id, one.view_id) for one in (*plan.outputs, *plan.later)]
    return seconds_of(costs, made, plan.view)


def begin(plan: StagePlan) -> None:
    """Say on stderr what the stage will do; move files into the trash, and others back from it.

    In a run of several stages, the run has said it. Orphans go there, and what is about to be
    replaced. Without a trash the latter stay until then: a run that is started by mistake and
    interrupted loses only what it has replaced.
    """
    if _kept is None:
        say(plan_line(plan), err=True)
    plan.trash.put_back(plan.returning)
    plan.trash.add(plan.orphans)
    if plan.farm.trash_days:
        plan.trash.add(plan.replaced)
    plan.trash.sweep()
    plan.kept += len(plan.returning)
    plan.removed += len(plan.orphans)


# From the key of an item that has ended to the held items that may begin, and those that need not.
Following = Callable[[str], tuple[Sequence[Item], Sequence[Item]]]


def execute(
    plans: Sequence[StagePlan], scheduler: str | None, following: Following = lambda key: ((), ())
) -> dict[Path, bool]:
    """Run the items of plans on the farm; return for each target whether it was made.

    Plans of one data folder and one work function are run together, a scene after the other.
    `following` is asked for held items whenever an item has ended. Workers of this machine have its
    best variant; those of a scheduler choose theirs, one of the accepted ones. Failures are added
    to the plans.
    """
    made = {target.path: False for plan in plans for target in plan.outputs}
    plans = [plan for plan in plans if plan.targets]
    if not plans:
        return made
    plan_of = {key: plan for plan in plans for key in plan.targets}
    data, params, first = plans[0].data, plans[0].farm, plans[0]
    ledger, count = Ledger(data), len(plan_of)
    earlier = read_ledger(data)
    known = [plan_seconds(plan, costs_of(earlier)) for plan in plans]
    forecast = None if None in known else sum(seconds or 0.0 for seconds in known)
    estimate = estimator(earlier)

    def weighted(items: Iterable[Item]) -> list[Item]:
        return [replace(item, weight=_weight(item, plan_of[item.key], estimate)) for item in items]

    def expected(workers: int) -> float | None:
        return None if forecast is None else forecast / min(workers, count)

    accepted = first.accepted if first.renders else None
    kept, workers = sum(plan.kept for plan in plans), params.workers or cpu_count()
    label, unit = (first.stage, first.unit) if len(plans) == 1 else ("frames", "frames")
    note = COMPILING if first.renders else ""
    with Progress(kept + len(made), label, unit, kept, expected(workers), note) as progress:
        sizes = {
            plan.stage: max(plan.view.samples(one.stage) for one in plan.outputs) for plan in plans
        }
        pace = Pace(Counter(plan_of[key].stage for key in plan_of), sizes)
        if forecast is None:
            progress.pace = pace

        def finished(key: str, seconds: float) -> None:
            pace.ended(plan_of[key].stage, seconds)
            progress.announce(key, len(plan_of[key].targets[key]))

        try:
            with opened_farm(data, params, scheduler, count, accepted) as farm:
                pace.workers = min(farm.count, count)
                progress.expected = expected(farm.count)
                progress.write(farm.workers)
                items = weighted(item for plan in plans for item in plan.items)
                for outcome in farm.run(first.work, items, finished):
                    plan = plan_of[outcome.key]
                    made.update(_record(outcome, plan, ledger, progress))
                    if outcome.error:
                        pace.dropped(plan.stage)
                    begun, dropped = following(outcome.key)
                    farm.add(weighted(begun))
                    for item in dropped:
                        plan = plan_of[item.key]
                        pace.dropped(plan.stage)
                        progress.advance(len(plan.targets.pop(item.key)))
        finally:
            for folder in sorted({target.parent for target in made}):
                remove_partials(folder)
            ledger.save()
    return made


_kept: tuple[ExitStack, dict[object, Farm]] | None = None  # workers, and those that there are


@contextmanager
def stages_together(trash: Trash) -> Iterator[None]:
    """Keep workers that render for all stages of the block; say of the trash at its end only.

    Their plans are said before.
    """
    global _kept
    with ExitStack() as stack:
        _kept = stack, {}
        try:
            yield
        finally:
            _kept = None
            if said := trash.described():
                say(said)


@contextmanager
def opened_farm(
    data: Path,
    params: FarmParams,
    scheduler: str | None,
    items: int,
    renderers: tuple[str, ...] | None = None,
) -> Iterator[Farm]:
    """Provide workers for so many items; those that render have one of the `renderers`.

    Workers that do not render write into the data folder, which they must see.
    """
    if _kept is None or renderers is None:
        with _started_farm(data, params, scheduler, items, renderers) as farm:
            yield farm
        return
    stack, farms = _kept
    asked = data, params, scheduler, renderers
    if asked not in farms:
        farms[asked] = stack.enter_context(_started_farm(data, params, scheduler, items, renderers))
    farms[asked].serve(items)
    yield farms[asked]


@contextmanager
def _started_farm(
    data: Path,
    params: FarmParams,
    scheduler: str | None,
    items: int,
    renderers: Collection[str] | None,
) -> Iterator[Farm]:
    with open_workspace(data, params.transfer, params.cache_mb) as workspace:
        setup: Callable[[int], None] = partial(use_code, code_version(), workspace)
        service: TransferService | None = None
        needed: Path | None = workspace.token_path
        cards: tuple[str, ...] = ()
        if renderers is not None:
            variant = params.variant
            if not scheduler_address(scheduler):
                variant = choose(variant)
                cards = card_ids() if variant.startswith("cuda") else ()
            setup = partial(use_renderer, variant, renderers, code_version(), workspace)
            service, needed = scene_service(workspace), None
        with Farm(params, scheduler, setup, items, service, needed, cards) as farm:
            yield farm


def _weight(item: Item, plan: StagePlan, estimate: Estimate) -> float:
    """Return the estimated seconds of an item."""
    targets = plan.targets[item.key]
    return sum(estimate(one.stage, one.scene_id, one.view_id) for one in targets)


def _record(
    outcome: Outcome, plan: StagePlan, ledger: Ledger, progress: Progress
) -> dict[Path, bool]:
    """Record an outcome's files, failures, costs and progress; return which targets were made.

    Frames of one trace share its seconds evenly, so that the ledger's sum is the time spent.
    """
    targets, value = plan.targets[outcome.key], outcome.value or {}
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
            plan.failures.append(failure)
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
            )
            if "renderer" in costs:
                plan.renderers[costs["renderer"]] += 1
    progress.advance(len(targets), targets[0].scene_id, outcome.key)
    return {path: not error for path, error in errors.items()}


def finish(
    plan: StagePlan, made: dict[Path, bool], notes: Callable[[], Iterable[str]] = tuple
) -> Summary:
    """Move out-of-date files that could not be made again to the trash; write the failures.

    Raises `StageError` if there are failures.
    """
    plan.trash.add(path for path, fine in made.items() if not fine and path.exists())
    failures = sorted(plan.failures, key=lambda f: (f.scene_id, f.view_id, f.stage))
    save_failures(plan.data, plan.stage, failures)
    count = sum(made.values())
    if failures:
        named = [f"  {failure}" for failure in failures[:_SHOWN]]
        if len(failures) > _SHOWN:
            named.append(f"  and {len(failures) - _SHOWN} more")
        raise StageError(
            f"{plan.stage}: {len(failures)} failed, {count} made, {plan.kept} kept",
            *named,
            f"The whole list is in {plan.data / 'failures' / (plan.stage + '.json')}. Everything "
            "else is done; run the same command again to retry.",
        )
    seconds = time.monotonic() - plan.started
    said = [*_mixture(plan.renderers), *notes()]
    said += [plan.trash.described()] if _kept is None else []
    return Summary(plan.stage, count, plan.kept, plan.removed, seconds, tuple(filter(None, said)))


def _mixture(renderers: Counter[str]) -> Iterable[str]:
    """Yield a note if the files of a run are of several renderers."""
    if len(renderers) > 1:
        each = ", ".join(f"{count} by {name}" for name, count in sorted(renderers.items()))
        yield (
            f"note: workers of several kinds: {each}. Light agrees within its noise, everything "
            "else to rounding; farm.variant chooses one kind"
        )


def threaded(function: Callable[[A], B], values: Sequence[A]) -> list[B]:
    """Map a function that mostly reads files over values, with a few threads."""
    with ThreadPoolExecutor(4) as pool:
        return list(pool.map(function, values))


def accepted_renderers(params: FarmParams) -> tuple[str, ...]:
    """Return the versions of the renderer whose frames and cameras hold, the preferred one first.

    One for each variant that workers may choose.
    """
    return tuple(renderer_version(variant) for variant in accepted(params.variant))


def list_scenes(plan: StagePlan, without: Collection[str] = ()) -> dict[str, Scene]:
    """Return all readable scenes by id; add the others to the plan's failures.

    Scenes of the names `without` are left aside. Raises `InputError` if there are none at all.
    """
    scenes = {}
    for folder in scene_folders(plan.data / "scenes"):
        if folder.name in without:
            continue
        try:
            scene = load_scene(folder)
            if scene.scene_id != folder.name:
                raise InputError(
                    f"{folder}: its scene.json says {scene.scene_id!r}; rename the folder"
                )
            if not SAFE_NAME.fullmatch(scene.scene_id):
                raise InputError(
                    f"{folder}: a scene id may contain letters, digits, '.', '_' and '-' only"
                )
            scenes[scene.scene_id] = scene
        except InputError as error:
            plan.failures.append(Failure(plan.stage, folder.name, "", str(error)))
    if not scenes and not plan.failures and not without:
        raise InputError(f"{plan.data / 'scenes'}: there are no scenes; run first: pbrnet scenes")
    return scenes


def scene_digests(data: Path, scenes: Iterable[str]) -> dict[str, str]:
    """Return the content digest of each scene by id."""
    names = list(scenes)
    digests = threaded(lambda name: scene_digest(data / "scenes" / name), names)
    return dict(zip(names, digests, strict=True))
