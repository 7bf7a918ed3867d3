"""Illumination study: predicted against rendered changes of light (Figure 10 of the paper).

The light of a test view is changed, and its panorama rendered again as by the illumination stage;
so is its light transport, for `plus`. The networks predict the view from the new light, and the
renderer renders the same change.
`pbrnet.model.studies.illumination.compare` compares the changes of brightness of pixel blocks.
"""

from __future__ import annotations

import os
from collections import Counter, defaultdict
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path

import click
import numpy as np
import torch

from pbrnet.model.data.reader import Example
from pbrnet.model.evaluation.inference import Networks
from pbrnet.model.methods import PRODUCTS, columns_of, trained_baselines
from pbrnet.model.studies.files import result_path, write_result
from pbrnet.model.studies.frame_store import (
    FrameStore,
    check_same_scene,
    open_views,
    with_samples,
)
from pbrnet.model.studies.illumination.agreement import BLOCK, LEAST_CHANGE
from pbrnet.model.studies.illumination.cases import lamp_radiance, possible_changes
from pbrnet.model.studies.illumination.compare import AgreementTally, LitView, compare
from pbrnet.model.studies.illumination.relight import LightChange, open_relit
from pbrnet.model.studies.illumination.results import IlluminationResult
from pbrnet.model.studies.illumination.sheet import comparison_sheet
from pbrnet.model.studies.options import option
from pbrnet.model.training.train import Folders
from pbrnet.pipeline.channels import TINT
from pbrnet.pipeline.commands.options import NumberRange
from pbrnet.pipeline.farm.versions import scene_digest
from pbrnet.pipeline.frames import fingerprint
from pbrnet.pipeline.images import png_bytes
from pbrnet.pipeline.params import Params
from pbrnet.pipeline.passes.denoise import denoiser_version
from pbrnet.pipeline.passes.illumination import render_illumination
from pbrnet.pipeline.passes.registry import settings_of
from pbrnet.pipeline.passes.settings import IlluminationParams
from pbrnet.pipeline.passes.visibility import render_visibility
from pbrnet.pipeline.progress import Progress
from pbrnet.pipeline.render.scene import RenderScene, renderer_version, set_variant
from pbrnet.pipeline.views import View
from pbrnet.scenes.arrays import AnyArray
from pbrnet.scenes.contract import Scene
from pbrnet.scenes.files import sweep

_NO_CHANGE = LightChange()
UNCHANGED = ""  # name of the case without a change


@dataclass(frozen=True)
class IlluminationConfig:
    """Size of the study and of the changes."""

    views: int = option(
        12, click.IntRange(1), "Maximum number of views, spread evenly over the split."
    )
    spp: int = option(
        64,
        click.IntRange(2, 1 << 16),
        "Samples per pixel of the renderings, which are denoised.",
    )
    factor: float = option(
        4.0,
        NumberRange(1.01, 1000),
        "Factor by which lamps get brighter, and sky and sun darker.",
    )
    strength: float = option(  # see `lamp_radiance`
        1.0,
        NumberRange(0.01, 1000),
        "Light of the added lamp at 2 m, relative to the view's average.",
    )


@dataclass(frozen=True)
class StudyView:
    """A view of the study and its scene."""

    example: Example
    view: View
    scene: Scene
    digest: str  # of the unchanged scene


@dataclass(frozen=True)
class LightCase:
    """A view under a changed light."""

    study_view: StudyView
    name: str  # of `pbrnet.model.studies.illumination.results.CHANGES`
    change: LightChange


Stores = Callable[[LightCase], FrameStore]  # where the frames of a case are kept


@dataclass
class CasePlan:
    """All cases; and for every kind of change the reasons against it, with numbers of views."""

    cases: list[LightCase] = field(default_factory=list)
    skipped: dict[str, Counter[str]] = field(default_factory=lambda: defaultdict(Counter))


def study_illumination(
    params: Params, folders: Folders, config: IlluminationConfig, renders: Path
) -> tuple[IlluminationResult, Path]:
    """Run the study and write `metrics/studies/illumination.json` and its picture.

    Returns the result and the path of the JSON file. Frames below `renders` with a current
    fingerprint are reused. Raises as `open_split`, and `InputError` if the scenes or cameras do not
    match the dataset.
    """
    torch.set_num_threads(len(os.sched_getaffinity(0)))
    target = result_path(folders.metrics, "illumination")
    for place in (target.parent, renders):
        sweep(place)
    baselines = [name for name in trained_baselines(folders.models) if name == "plus"]
    set_variant(params.farm.variant)
    methods = ("pbrnet", *PRODUCTS, *baselines)
    found = open_views(params.evaluate.split, params.tone, folders, methods, config.views)
    networks, scenes, views = found.networks, found.scenes, found.views
    digests = {name: scene_digest(scene.folder) for name, scene in scenes.items()}
    views_of_study = [
        StudyView(example, view, scenes[view.scene_id], digests[view.scene_id])
        for example, view in zip(found.examples, views, strict=True)
    ]
    plan = _planned(views_of_study, params.illumination, config, networks)
    truth = with_samples(params.groundtruth, config.spp, denoise=True)
    kinds = [*replace(params, channels=("paper",)).kinds]
    if "transport_color" in columns_of(networks.baselines):
        kinds.append("transport")
    made = [kind for kind in kinds if kind not in ("inputs", "noisy")]
    settings = settings_of(replace(params, groundtruth=truth), made)

    def stores(case: LightCase) -> FrameStore:
        return FrameStore(renders / (case.name or "as-it-is"), settings, params.seed)

    _render_all(plan.cases, stores)
    tally = _compared(plan, views_of_study, networks, stores)
    result = IlluminationResult(
        seed=params.seed,
        split=found.split,
        views=len(views_of_study),
        scenes=len(scenes),
        size=(views[0].width, views[0].height),
        spp=config.spp,
        denoiser=denoiser_version(),
        renderer=renderer_version(),
        factor=config.factor,
        strength=config.strength,
        block=BLOCK,
        least=LEAST_CHANGE,
        models={name: card.sha256 for name, card in sorted(networks.cards.items())},
        changes=tally.changes(plan.skipped, params.seed),
    )
    facts = {"study": "illumination", "credits": _credits(scenes)}
    write_result(target, result, png_bytes(comparison_sheet(tally.rows()), facts))
    return result, target


def _planned(
    views_of_study: list[StudyView],
    params: IlluminationParams,
    config: IlluminationConfig,
    networks: Networks,
) -> CasePlan:
    """Find the possible changes of every view; check that the scenes match the dataset."""
    plan = CasePlan()
    key, albedo = networks.card.tone["key"], networks.card.albedo
    with Progress(len(views_of_study), "study illumination: planning", "views") as progress:
        for scene in {
            study_view.scene.scene_id: study_view.scene for study_view in views_of_study
        }.values():
            with open_relit(scene, _NO_CHANGE) as opened:
                for study_view in views_of_study:
                    if study_view.scene is not scene:
                        continue
                    packed = study_view.example["intensity"]
                    check_same_scene(opened, scene.folder, study_view.view, packed, params)
                    average = key / study_view.example.exposure_shading.scale
                    radiance = lamp_radiance(average, albedo, config.strength)
                    found = possible_changes(
                        opened, study_view.view, params, config.factor, radiance
                    )
                    plan.cases.append(LightCase(study_view, UNCHANGED, _NO_CHANGE))
                    plan.cases += [LightCase(study_view, *item) for item in found.changes.items()]
                    for name, reason in found.skipped.items():
                        plan.skipped[name][reason] += 1
                    progress.advance()
    return plan


def _render_all(cases: list[LightCase], stores: Stores) -> None:
    """Render missing frames; a scene is opened once for each light."""
    groups: dict[tuple[str, LightChange], list[LightCase]] = defaultdict(list)
    for case in cases:
        groups[case.study_view.scene.scene_id, case.change].append(case)
    kept = 0
    with Progress(len(cases), "study illumination: rendering", "views") as progress:
        for (_, change), group in groups.items():
            due = [case for case in group if _missing(case, stores(case))]
            kept += len(group) - len(due)
            progress.advance(len(group) - len(due))
            if not due:
                continue
            with open_relit(due[0].study_view.scene, change) as opened:
                for case in due:
                    _render(opened, case, stores(case))
                    progress.advance()
        if kept:
            progress.write(f"study illumination: {kept} of {len(cases)} cases are already rendered")


def _render(opened: RenderScene, case: LightCase, store: FrameStore) -> None:
    """Render all kinds of frames of a case."""
    view, digest = _frame(case)
    panorama = render_illumination(opened, view, store.settings["illumination"])
    store.write("illumination", panorama, view, digest)
    if rays := store.settings.get("visibility"):
        store.write("visibility", render_visibility(opened, view, rays, panorama), view, digest)
    if "transport" in store.settings:
        channels, stats = store.made(["transport"], opened, view)["transport"]
        store.write("transport", channels, view, digest, **stats)
    if store.missing(view, digest):
        store.render(opened, view, digest)


def _missing(case: LightCase, store: FrameStore) -> bool:
    """Return whether any frame of the case is missing."""
    return bool(store.missing(*_frame(case), tuple(store.settings)))


def _frame(case: LightCase) -> tuple[View, str]:
    """Return the view, and the digest of its scene under the case's light."""
    study_view = case.study_view
    return study_view.view, fingerprint(scene=study_view.digest, change=case.change)


def _compared(
    plan: CasePlan,
    views_of_study: list[StudyView],
    networks: Networks,
    stores: Stores,
) -> AgreementTally:
    """Predict every case and compare it with the rendering; exchange panoramas between views."""
    tally = AgreementTally()
    with Progress(len(views_of_study), "study illumination: comparing", "views") as progress:
        for study_view in views_of_study:
            lit = {
                case.name: _lit(case, stores)
                for case in plan.cases
                if case.study_view is study_view
            }
            before = lit.pop(UNCHANGED)
            other = _view_of_other_scene(study_view, views_of_study)
            if other is not None:
                exchanged = other.example
                lit["exchanged"] = LitView(
                    before.example,
                    exchanged["intensity"],
                    exchanged["distance"],
                    exchanged.images.get("tint"),
                    np.ones_like(before.example["depth"]),  # shadows are unknown
                )
            else:
                plan.skipped["exchanged"]["no other view"] += 1
            tally.add(compare(networks, before, lit))
            progress.advance()
    return tally


def _lit(case: LightCase, stores: Stores) -> LitView:
    store, view = stores(case), case.study_view.view
    panorama = store.read("illumination", view)
    return LitView(
        case.study_view.example,
        panorama.channels["intensity.Y"],
        panorama.channels["distance.Z"],
        panorama.stack(*TINT),
        _shadows(store, view),
        store.read("shading", view).rgb,
        store.read("color", view).rgb,
        store.read("transport", view).channels if "transport" in store.settings else None,
    )


def _shadows(store: FrameStore, view: View) -> AnyArray | None:
    if "visibility" not in store.settings:
        return None
    return store.read("visibility", view).channels["visibility.Y"].astype(np.float32)


def _view_of_other_scene(
    study_view: StudyView, views_of_study: list[StudyView]
) -> StudyView | None:
    """Return the next view of another scene, else of the same scene; None if there is none."""
    start = next(i for i, other in enumerate(views_of_study) if other is study_view)
    others = views_of_study[start + 1 :] + views_of_study[:start]
    elsewhere = [other for other in others if other.scene is not study_view.scene]
    return next(iter(elsewhere or others), None)


def _credits(scenes: dict[str, Scene]) -> list[str]:
    """Return the credits of the scenes in the picture."""
    named = (credit for scene in scenes.values() for credit in scene.credits)
    return list(dict.fromkeys(f"{c.title} by {c.author}, {c.licence}" for c in named))
