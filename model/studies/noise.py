"""Training on noisy ground truth, tested against the clean one (Figure 11 of the paper).

The dataset's ground truth has many samples per pixel and may be denoised. So the training views are
rendered again with few samples, and these renderings replace shading and colour; the inputs stay
the same. The denoised variants use the same samples. Views, their order, steps and seeds are equal
in all trials. All are tested on the dataset's ground truth of other scenes.

Exposures are computed from the noisy images, because a dataset of noisy renderings has no others;
exposures of the clean images would pass information of thousands of samples into the targets. The
log average, over 8x8 pixel means, hardly depends on noise. White is set by the brightest pixel, so
a firefly compresses the highlights of its view. That is an effect of noisy ground truth, too.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import click

from pbrnet.model.data.reader import Dataset, Example
from pbrnet.model.options import renders_option
from pbrnet.model.studies.frame_store import (
    FrameStore,
    cameras_of,
    check_same_scene,
    load_dataset_scene,
    opened_scene,
    with_samples,
)
from pbrnet.model.studies.trials.command import TrialRequest, trial_command, views_option
from pbrnet.model.studies.trials.derived_splits import TruthImages, write_derived_split
from pbrnet.model.studies.trials.plan import (
    STAGES,
    TrainingSource,
    Trial,
    TrialStudy,
    Variant,
    plan,
)
from pbrnet.pipeline.channels import TRUTHS
from pbrnet.pipeline.farm.versions import scene_digest
from pbrnet.pipeline.params import Params
from pbrnet.pipeline.passes.registry import settings_of
from pbrnet.pipeline.passes.truth import postprocessed
from pbrnet.pipeline.progress import Progress
from pbrnet.pipeline.render.scene import set_variant
from pbrnet.pipeline.terminal import counted
from pbrnet.pipeline.views import View
from pbrnet.scenes.arrays import AnyArray
from pbrnet.scenes.checked import plain
from pbrnet.scenes.files import digest_bytes, sweep

SAMPLES = (4, 16, 64)  # per pixel, as in the paper
CLEAN = "clean"


@dataclass(frozen=True)
class NoisyTruth:
    """Ground truth with `spp` samples per pixel, raw or denoised."""

    spp: int
    denoised: bool

    @property
    def name(self) -> str:
        """Name of the variant and of the folder of frames."""
        return f"{'denoised' if self.denoised else 'raw'}-{self.spp}"

    @property
    def label(self) -> str:
        """Row label in the results."""
        return f"{self.spp} spp{', denoised' if self.denoised else ''}"


def noisy_truths(samples: Sequence[int]) -> list[NoisyTruth]:
    """Return the raw ground truths for all numbers of samples, then the denoised ones."""
    return [NoisyTruth(spp, denoised) for denoised in (False, True) for spp in sorted(set(samples))]


def noise_study(samples: Sequence[int] = SAMPLES) -> TrialStudy:
    """Return the study: both networks, trained on each ground truth and on the clean one."""
    return TrialStudy(
        name="noise",
        variants=(
            *(Variant(t.name, STAGES, {"pbrnet": t.label}) for t in noisy_truths(samples)),
            Variant(CLEAN, STAGES, {"pbrnet": CLEAN}),
        ),
        reference=CLEAN,
    )


class NoisyTruthStore:
    """Noisy ground truth of the training views, rendered on demand and kept by fingerprint."""

    def __init__(
        self, params: Params, data: Path, renders: Path, samples: Sequence[int], scenes: set[str]
    ) -> None:
        """`scenes`: all training scenes of the trials.

        Raises `InputError` if their folders or cameras do not match the dataset.
        """
        sweep(renders)
        set_variant(params.farm.variant)
        self.params, self.data, self.renders = params, data, renders
        self.truths: Mapping[str, NoisyTruth] = {t.name: t for t in noisy_truths(samples)}
        self.fingerprint = Dataset(data / "dataset", "train").fingerprint()
        self.digests = {
            name: scene_digest(load_dataset_scene(data, name).folder) for name in sorted(scenes)
        }
        self.panoramas: dict[str, tuple[str, AnyArray]] = {}  # first view of each scene
        self.views: dict[tuple[str, str], View] = {}
        for view in cameras_of(data, self._examples(scenes)):
            self.views[view.scene_id, view.view_id] = view

    def with_source(self, trial: Trial) -> Trial:
        """Return the trial with its variant's ground truth as training split."""
        name = trial.variant.name
        truth = self.truths.get(name)
        scenes = set(trial.scenes)
        views = [view for view in self.views.values() if view.scene_id in scenes]
        parts: list[object] = [name, self.fingerprint, trial.scenes]
        if truth is not None:
            store = self._store(truth)
            parts += [plain(self.params.tone)]
            parts += [self._fingerprint(store, view) for view in views]
        fingerprint = digest_bytes(*(repr(part).encode() for part in parts))
        folder = self.renders / "packs" / name
        return replace(
            trial,
            source=TrainingSource(
                folder, fingerprint, lambda: self._make(folder, fingerprint, trial, truth)
            ),
        )

    def due(self, spp: int, scenes: Sequence[str]) -> list[View]:
        """Return the views of these scenes with missing frames."""
        stores = [self._store(NoisyTruth(spp, denoised)) for denoised in (False, True)]
        wanted = set(scenes)
        return [
            view
            for view in self.views.values()
            if view.scene_id in wanted
            and any(store.missing(view, self.digests[view.scene_id]) for store in stores)
        ]

    def _make(self, folder: Path, fingerprint: str, trial: Trial, truth: NoisyTruth | None) -> None:
        """Render what is missing and write the trial's training split, unless it exists."""

        def parts() -> Iterator[Dataset]:
            if truth is not None:
                self._render(truth.spp, trial.scenes)
            yield Dataset(self.data / "dataset", "train", only=trial.scenes)

        def lookup(scene: str, view: str) -> TruthImages:
            assert truth is not None
            store = self._store(truth)
            return {kind: store.read(kind, self.views[scene, view]).rgb for kind in TRUTHS}

        found = None if truth is None else lookup
        write_derived_split(folder, fingerprint, parts, "train", self.params.tone, found)

    def _render(self, spp: int, scenes: Sequence[str]) -> None:
        """Path-trace missing frames, and denoise the same samples."""
        raw, denoised = (self._store(NoisyTruth(spp, smooth)) for smooth in (False, True))
        due = self.due(spp, scenes)
        if not due:
            return
        names = list(dict.fromkeys(view.scene_id for view in due))
        with Progress(len(due), f"study noise: {spp} samples per pixel", "views") as progress:
            for name in names:
                scene, digest = load_dataset_scene(self.data, name), self.digests[name]
                with opened_scene(scene) as opened:
                    first, packed = self.panoramas[name]
                    check_same_scene(
                        opened,
                        scene.folder,
                        self.views[name, first],
                        packed,
                        self.params.illumination,
                    )
                    for view in (view for view in due if view.scene_id == name):
                        for kind, truth in raw.made(TRUTHS, opened, view).items():
                            raw.write(kind, truth[0], view, digest, **truth[1])
                            settings = denoised.settings[kind]
                            smooth = postprocessed(kind, truth, opened, view, settings)
                            denoised.write(kind, smooth[0], view, digest, **smooth[1])
                        progress.advance()

    def _store(self, truth: NoisyTruth) -> FrameStore:
        own = with_samples(self.params.groundtruth, truth.spp, truth.denoised)
        settings = settings_of(replace(self.params, groundtruth=own), TRUTHS)
        return FrameStore(self.renders / truth.name, settings, self.params.seed)

    def _fingerprint(self, store: FrameStore, view: View) -> str:
        digest = self.digests[view.scene_id]
        return "".join(store.fingerprint(kind, view, digest) for kind in TRUTHS)

    def _examples(self, scenes: set[str]) -> Iterator[Example]:
        for example in Dataset(self.data / "dataset", "train", only=scenes).ordered():
            self.panoramas.setdefault(example.scene_id, (example.view_id, example["intensity"]))
            yield example


@trial_command(
    "noise",
    """
  pbrnet study noise --dry-run                    list the renderings and trainings
  pbrnet study noise --views 60 --steps 2000      at 4, 16 and 64 samples, raw and denoised
  pbrnet study noise --spp 1 --spp 8 --seeds 3
""",
    click.option(
        "--spp",
        "samples",
        type=click.IntRange(1, 1 << 16),
        multiple=True,
        help="Samples per pixel of a noisy ground truth (repeatable).  [default: 4, 16, 64]",
    ),
    renders_option("Folder of the rendered frames.  [default: DATA/studies/noise]"),
    views_option,
    notes="Requires the scenes and cameras of the dataset. The frames in "
    "DATA/studies/noise may be deleted after training.",
)
def command(request: TrialRequest, samples: tuple[int, ...], renders: Path | None) -> None:
    """Train on noisy ground truth, raw and denoised (Figure 11).

    The training views are rendered again with few samples; tests use the dataset's ground truth.
    """
    params, data = request.params, request.folders.data
    samples = tuple(sorted(set(samples or SAMPLES)))
    study = noise_study(samples)
    trials = plan(study, params, request.folders, request.config)
    scenes = {scene for trial in trials for scene in trial.scenes}
    truths = NoisyTruthStore(params, data, renders or data / "studies" / "noise", samples, scenes)
    due = {spp: len(truths.due(spp, sorted(scenes))) for spp in samples}
    lines = [
        f"{counted(count, 'view')} to render with {spp} samples first" for spp, count in due.items()
    ]
    request.run(study, [truths.with_source(trial) for trial in trials], lines)
