"""The illumination study (the paper's Fig. 10): does a prediction follow a change of light?

The light of a test view is changed, its panorama made anew as the illumination stage makes it, and
both given to the networks; the renderer gets the same change. Compared is how much brighter every
block of pixels got (`model.studies.illumination.compare`).
"""

from __future__ import annotations

import os
from collections import Counter, defaultdict
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import torch

from model.data.reader import Example
from model.evaluation.evaluate import open_split
from model.evaluation.inference import Networks
from model.methods import trained_baselines
from model.studies.illumination.agreement import BLOCK, LEAST
from model.studies.illumination.cases import cases_of, lamp_radiance
from model.studies.illumination.compare import Lit, Tally, compare
from model.studies.illumination.results import LightResult
from model.studies.illumination.sheet import light_sheet
from model.studies.relight import LightChange, open_changed
from model.studies.renders import (
    Renders,
    refuse_other_scene,
    scene_of,
    spread_over,
    views_of,
    with_samples,
)
from model.training.train import Folders
from pipeline.channels import TINT
from pipeline.farm.scene_digest import scene_digest
from pipeline.frames import fingerprint, kinds_of
from pipeline.images import png_bytes
from pipeline.params import Params
from pipeline.passes.denoise import denoiser_version
from pipeline.passes.illumination import render_illumination
from pipeline.passes.visibility import render_visibility
from pipeline.progress import Progress
from pipeline.render.scene import RenderScene, renderer_version, set_variant
from pipeline.views import View
from scenes.arrays import AnyArray
from scenes.checked import plain
from scenes.contract import Scene
from scenes.files import atomic_file, sweep, write_json

_NOTHING = LightChange()
AS_IT_IS = ""  # the name of the case without a change


@dataclass(frozen=True)
class Wish:
    """What to do."""

    views: int = 12  # at most
    spp: int = 64
    factor: float = 4.0  # lamps times it, outdoors divided by it
    strength: float = 1.0  # of the added lamp, see `lamp_radiance`


@dataclass(frozen=True)
class Subject:
    """A view of the study."""

    example: Example
    view: View
    scene: Scene
    digest: str  # of the scene in its own light


@dataclass(frozen=True)
class Case:
    """A subject in a changed light."""

    subject: Subject
    name: str  # of `model.studies.illumination.results.CHANGES`
    change: LightChange


@dataclass
class Plan:
    """All cases, and per kind of change how many views cannot have it and why."""

    cases: list[Case] = field(default_factory=list)
    skipped: dict[str, Counter[str]] = field(default_factory=lambda: defaultdict(Counter))


def study_illumination(
    params: Params, folders: Folders, wish: Wish, renders: Path
) -> tuple[LightResult, Path]:
    """Run the study; writes `metrics/studies/illumination.json` and the picture beside it.

    Frames are kept below `renders`; those that hold are not made again. Raises as `open_split`,
    and `InputError` if the scenes or cameras are not those that the dataset was made of.
    """
    torch.set_num_threads(len(os.sched_getaffinity(0)))
    folder = folders.metrics / "studies"
    for place in (folder, renders):
        sweep(place)
    baselines = [name for name in trained_baselines(folders.models) if name == "plus"]
    networks, dataset = open_split(params, folders, baselines)
    examples = spread_over(dataset, wish.views)
    scenes = {name: scene_of(folders.data, name) for name in {e.scene_id for e in examples}}
    views = views_of(folders.data, examples)
    set_variant(params.farm.variant)
    digests = {name: scene_digest(scene.folder) for name, scene in scenes.items()}
    subjects = [
        Subject(example, view, scenes[view.scene_id], digests[view.scene_id])
        for example, view in zip(examples, views, strict=True)
    ]
    plan = _planned(subjects, params, wish, networks)
    given = with_samples(params, wish.spp, denoise=True)
    _render_all(plan.cases, given, renders)
    tally = _compared(plan, subjects, networks, given, renders)
    result = LightResult(
        seed=params.seed,
        split=dataset.split,
        views=len(subjects),
        scenes=len(scenes),
        size=(views[0].width, views[0].height),
        spp=wish.spp,
        denoiser=denoiser_version(),
        renderer=renderer_version(),
        factor=wish.factor,
        strength=wish.strength,
        block=BLOCK,
        least=LEAST,
        models={name: card.sha256 for name, card in sorted(networks.cards.items())},
        changes=tally.changes(plan.skipped, params.seed),
    )
    with atomic_file(folder / "illumination.png") as partial:
        facts = {"study": "illumination", "credits": _credits(scenes)}
        partial.write_bytes(png_bytes(light_sheet(tally.rows()), facts))
    write_json(folder / "illumination.json", plain(result))
    return result, folder / "illumination.json"


def _planned(subjects: list[Subject], params: Params, wish: Wish, networks: Networks) -> Plan:
    """What every view can have; looks at the scenes, and that they are the dataset's."""
    plan = Plan()
    key, albedo = networks.card.tone["key"], networks.card.albedo
    with Progress(len(subjects), "study illumination: looking", "views") as progress:
        for scene in {subject.scene.scene_id: subject.scene for subject in subjects}.values():
            with open_changed(scene, _NOTHING) as opened:
                for subject in subjects:
                    if subject.scene is not scene:
                        continue
                    packed = subject.example.intensity
                    refuse_other_scene(opened, scene.folder, subject.view, packed, params)
                    average = key / subject.example.exposure_shading.scale
                    radiance = lamp_radiance(average, albedo, wish.strength)
                    found = cases_of(
                        opened, subject.view, params.illumination, wish.factor, radiance
                    )
                    plan.cases.append(Case(subject, AS_IT_IS, _NOTHING))
                    plan.cases += [Case(subject, *item) for item in found.changes.items()]
                    for name, reason in found.skipped.items():
                        plan.skipped[name][reason] += 1
                    progress.advance()
    return plan


def _render_all(cases: list[Case], params: Params, renders: Path) -> None:
    """Make every frame that is not there; a scene is opened once for each light it has."""
    groups: dict[tuple[str, LightChange], list[Case]] = defaultdict(list)
    for case in cases:
        groups[case.subject.scene.scene_id, case.change].append(case)
    kept = 0
    with Progress(len(cases), "study illumination: rendering", "views") as progress:
        for (_, change), group in groups.items():
            due = [case for case in group if _missing(case, _store(case, params, renders))]
            kept += len(group) - len(due)
            progress.advance(len(group) - len(due))
            if not due:
                continue
            with open_changed(due[0].subject.scene, change) as opened:
                for case in due:
                    _render(opened, case, _store(case, params, renders))
                    progress.advance()
        if kept:
            progress.write(f"study illumination: {kept} of {len(cases)} were there already")


def _render(opened: RenderScene, case: Case, store: Renders) -> None:
    """The panorama, its shadows and both truths of a case."""
    view, digest = _frame(case)
    settings = store.params.illumination
    panorama = render_illumination(opened, view, settings)
    store.write("illumination", panorama, view, digest)
    if settings.shadow_rays:
        store.write("visibility", render_visibility(opened, view, settings, panorama), view, digest)
    if store.missing(view, digest):
        store.render(opened, view, digest)


def _missing(case: Case, store: Renders) -> bool:
    """Whether any frame of the case is not there."""
    made = [kind for kind in kinds_of(store.params) if kind not in ("inputs", "noisy")]
    return bool(store.missing(*_frame(case), made))


def _store(case: Case, params: Params, renders: Path) -> Renders:
    return Renders(renders / (case.name or "as-it-is"), params)


def _frame(case: Case) -> tuple[View, str]:
    """The view, and the digest of its scene in the case's light."""
    subject = case.subject
    return subject.view, fingerprint(scene=subject.digest, change=case.change)


def _compared(
    plan: Plan, subjects: list[Subject], networks: Networks, params: Params, renders: Path
) -> Tally:
    """Predict every case and compare it with what was rendered, or with the next view's light."""
    tally = Tally()
    with Progress(len(subjects), "study illumination: comparing", "views") as progress:
        for subject in subjects:
            lit = {
                case.name: _lit(case, params, renders)
                for case in plan.cases
                if case.subject is subject
            }
            before = lit.pop(AS_IT_IS)
            other = _stranger(subject, subjects)
            if other is not None:
                theirs = other.example
                lit["exchanged"] = Lit(
                    before.example,
                    theirs.intensity,
                    theirs.distance,
                    theirs.tint,
                    np.ones_like(before.example.depth),  # nobody knows its shadows here
                )
            else:
                plan.skipped["exchanged"]["no other view"] += 1
            tally.add(compare(networks, before, lit))
            progress.advance()
    return tally


def _lit(case: Case, params: Params, renders: Path) -> Lit:
    store, view = _store(case, params, renders), case.subject.view
    panorama = store.read("illumination", view)
    return Lit(
        case.subject.example,
        panorama.channels["intensity.Y"],
        panorama.channels["distance.Z"],
        panorama.stack(*TINT),
        _shadows(store, view),
        store.read("shading", view).rgb,
        store.read("color", view).rgb,
    )


def _shadows(store: Renders, view: View) -> AnyArray | None:
    if not store.params.illumination.shadow_rays:
        return None
    return store.read("visibility", view).channels["visibility.Y"].astype(np.float32)


def _stranger(subject: Subject, subjects: list[Subject]) -> Subject | None:
    """The next view of another scene, or if there is none of the same; None if it is alone."""
    start = subjects.index(subject)
    others = subjects[start + 1 :] + subjects[:start]
    strange = [other for other in others if other.scene is not subject.scene]
    return next(iter(strange or others), None)


def _credits(scenes: dict[str, Scene]) -> list[str]:
    """Whose work the scenes in the picture are."""
    named = (credit for scene in scenes.values() for credit in scene.credits)
    return list(dict.fromkeys(f"{c.title} by {c.author}, {c.licence}" for c in named))
