"""Networks that learn from noisy truth (the paper's Fig. 11), judged against the clean one.

The dataset's own truth has many samples a pixel, and may be denoised: nothing noisy is in it. So
the training views are rendered again with few samples each, and the networks learn from the same
inputs with those renderings in the place of shading and colour. What is denoised are the very same
samples. Views, steps, seeds and the order of views are equal in all trials. They are measured on
the dataset's own truth of other scenes, as every network is.

Exposures are those of the noisy images themselves. Whoever has nothing but noisy renderings
has no other; the clean images' would carry what thousands of samples know into the targets. It
matters: the log average hardly depends on noise (it is one of 8x8 means), but white is where the
brightest pixel is, which is a firefly where there is one, and so the targets get a little darker
in their highlights. That is part of what noisy truth does.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from model.data.reader import Dataset, Example
from model.studies.relight import LightChange, open_changed
from model.studies.renders import Renders, refuse_other_scene, scene_of, views_of, with_samples
from model.studies.trials.packs import TRUTHS, Truth, pack
from model.studies.trials.plan import STAGES, Source, Study, Trial, Variant
from pipeline.farm.scene_digest import scene_digest
from pipeline.params import Params
from pipeline.passes.registry import pass_seed, postprocessed, render_truths
from pipeline.progress import Progress
from pipeline.render.scene import set_variant
from pipeline.views import View
from scenes.arrays import AnyArray
from scenes.checked import plain
from scenes.files import digest_bytes, sweep

SAMPLES = (4, 16, 64)  # a pixel, as in the paper
CLEAN = "clean"


@dataclass(frozen=True)
class NoisyTruth:
    """A truth of so many samples a pixel."""

    spp: int
    denoised: bool

    @property
    def name(self) -> str:
        """Of its variant, and of the folder of its frames."""
        return f"{'denoised' if self.denoised else 'raw'}-{self.spp}"

    @property
    def label(self) -> str:
        """In the results."""
        return f"{self.spp} spp{', denoised' if self.denoised else ''}"


def truths_of(samples: Sequence[int]) -> list[NoisyTruth]:
    """Of every number of samples as they are, then denoised."""
    return [NoisyTruth(spp, denoised) for denoised in (False, True) for spp in sorted(set(samples))]


def noise_study(samples: Sequence[int] = SAMPLES) -> Study:
    """The two networks, trained on each truth and on the clean one."""
    return Study(
        name="noise",
        variants=(
            *(Variant(t.name, STAGES, {"pbrnet": t.label}) for t in truths_of(samples)),
            Variant(CLEAN, STAGES, {"pbrnet": CLEAN}),
        ),
        reference=CLEAN,
    )


class NoisyTruths:
    """Noisy truths of the training views: rendered when they are due, kept by fingerprint."""

    def __init__(
        self, params: Params, data: Path, renders: Path, samples: Sequence[int], scenes: set[str]
    ) -> None:
        """`scenes`: all that may be asked for.

        Raises `InputError` if their folders or cameras are not those that the dataset was made of.
        """
        sweep(renders)
        set_variant(params.farm.variant)
        self.params, self.data, self.renders = params, data, renders
        self.truths: Mapping[str, NoisyTruth] = {t.name: t for t in truths_of(samples)}
        self.fingerprint = Dataset(data / "dataset", "train").fingerprint()
        self.digests = {name: scene_digest(scene_of(data, name).folder) for name in sorted(scenes)}
        self.panoramas: dict[str, tuple[str, AnyArray]] = {}  # of each scene's first view
        self.views: dict[tuple[str, str], View] = {}
        for view in views_of(data, self._examples(scenes)):
            self.views[view.scene_id, view.view_id] = view

    def with_source(self, trial: Trial) -> Trial:
        """The trial, learning from its variant's truth."""
        name = trial.variant.name
        truth = self.truths.get(name)
        scenes = set(trial.scenes)
        views = [view for view in self.views.values() if view.scene_id in scenes]
        parts: list[object] = [name, self.fingerprint, trial.scenes]
        if truth is not None:
            store = self._store(truth)
            parts += [plain(self.params.tone)]
            parts += [self._mark(store, view) for view in views]
        mark = digest_bytes(*(repr(part).encode() for part in parts))
        place = self.renders / "packs" / name
        return replace(
            trial, source=Source(place, mark, lambda: self._make(place, mark, trial, truth))
        )

    def due(self, spp: int, scenes: Sequence[str]) -> list[View]:
        """Views of these scenes that have to be rendered."""
        stores = [self._store(NoisyTruth(spp, denoised)) for denoised in (False, True)]
        wanted = set(scenes)
        return [
            view
            for view in self.views.values()
            if view.scene_id in wanted
            and any(store.missing(view, self.digests[view.scene_id]) for store in stores)
        ]

    def _make(self, place: Path, mark: str, trial: Trial, truth: NoisyTruth | None) -> None:
        """The trial's training split, unless it is there."""

        def parts() -> Iterator[Dataset]:
            if truth is not None:
                self._render(truth.spp, trial.scenes)
            yield Dataset(self.data / "dataset", "train", only=trial.scenes)

        def find(scene: str, view: str) -> Truth:
            assert truth is not None
            store = self._store(truth)
            return {kind: store.read(kind, self.views[scene, view]).rgb for kind in TRUTHS}

        pack(place, mark, parts, "train", self.params.tone, None if truth is None else find)

    def _render(self, spp: int, scenes: Sequence[str]) -> None:
        """Trace what is missing, and denoise the same samples."""
        raw, denoised = (self._store(NoisyTruth(spp, which)) for which in (False, True))
        due = self.due(spp, scenes)
        if not due:
            return
        names = list(dict.fromkeys(view.scene_id for view in due))
        with Progress(len(due), f"study noise: {spp} samples a pixel", "views") as progress:
            for name in names:
                scene, digest = scene_of(self.data, name), self.digests[name]
                with open_changed(scene, LightChange()) as opened:
                    first, packed = self.panoramas[name]
                    refuse_other_scene(
                        opened, scene.folder, self.views[name, first], packed, self.params
                    )
                    for view in (view for view in due if view.scene_id == name):
                        seed = pass_seed("color", view, self.params.seed)
                        for kind, truth in render_truths(opened, view, raw.params, seed).items():
                            raw.write(kind, truth[0], view, digest, **truth[1])
                            smooth = postprocessed(kind, truth, opened, view, denoised.params)
                            denoised.write(kind, smooth[0], view, digest, **smooth[1])
                        progress.advance()

    def _store(self, truth: NoisyTruth) -> Renders:
        params = with_samples(self.params, truth.spp, truth.denoised)
        return Renders(self.renders / truth.name, params)

    def _mark(self, store: Renders, view: View) -> str:
        digest = self.digests[view.scene_id]
        return "".join(store.mark(kind, view, digest) for kind in TRUTHS)

    def _examples(self, scenes: set[str]) -> Iterator[Example]:
        for example in Dataset(self.data / "dataset", "train", only=scenes).ordered():
            self.panoramas.setdefault(example.scene_id, (example.view_id, example.intensity))
            yield example
