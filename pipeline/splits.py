"""Scenes of the dataset with their cameras, their split, and samples that depend on it."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from fnmatch import fnmatchcase
from pathlib import Path

from pbrnet.pipeline.passes.settings import GroundTruthParams, NoisyParams
from pbrnet.pipeline.views import CameraFile, View, load_cameras
from pbrnet.scenes.checked import param, within
from pbrnet.scenes.contract import Scene, load_scene, scene_folders
from pbrnet.scenes.errors import InputError
from pbrnet.scenes.seeds import derive, generator

SPLITS = ("train", "validation", "test")


@dataclass(frozen=True)
class SplitParams:
    """Shares of the floor plans in each split; the rest is the training split.

    `test_only` holds names of plans, or of scenes for their whole plan, or patterns such as
    "villa-*".
    """

    validation: float = param(0.1, "", within(0, 0.9))
    test: float = param(0.2, "", within(0, 0.9))
    test_only: tuple[str, ...] = param((), "additional test plans or scenes: names or patterns")


@dataclass(frozen=True)
class Source:
    """A scene with its camera file, which is None if the cameras stage wrote none."""

    scene: Scene
    cameras: CameraFile | None

    @property
    def plan(self) -> str:
        """Name of the floor plan; scenes of one plan are in one split."""
        return self.scene.plan or self.scene.scene_id

    @property
    def views(self) -> list[View]:
        """Sampled views, sorted by id."""
        views = self.cameras.views if self.cameras else ()
        return sorted(views, key=lambda view: view.view_id)


def read_sources(data: Path) -> list[Source]:
    """Return all scenes below `data`, sorted by id, with their camera files.

    Raises `InputError` if there are none, or if a camera file has no scene.
    """
    cameras = {}
    for path in sorted((data / "cameras").glob("*.json")):
        file = load_cameras(path)
        if file.scene_id != path.stem:
            raise InputError(
                f"{path}: contains the cameras of {file.scene_id!r}; rename or remove it"
            )
        cameras[file.scene_id] = file
    sources = []
    for folder in scene_folders(data / "scenes"):
        scene = load_scene(folder)
        sources.append(Source(scene, cameras.pop(scene.scene_id, None)))
    if cameras:
        name = min(cameras)
        raise InputError(
            f"{data}/cameras/{name}.json: there is no scene {name!r} in {data}/scenes; "
            "run: pbrnet cameras"
        )
    if not any(source.views for source in sources):
        raise InputError(f"{data}: no scene has any view yet; run: pbrnet scenes, pbrnet cameras")
    return sources


def split_plans(sources: Sequence[Source], shares: SplitParams, seed: int) -> dict[str, str]:
    """Return plan -> split, so that whole plans are in one split; deterministic in `seed`.

    Every plan draws a number from the seed and its own name. Within a light setting, plans are
    ordered by their numbers and spaced evenly over [0, 1). In the merged order of all settings the
    first plans are the test split, the next ones the validation split, the others the training
    split. So each split has the light settings in proportion, no split is empty by chance (there is
    a test plan from two plans on and a validation plan from three on, if their shares are above 0),
    and a further scene moves at most the plans at the borders. Plans that `shares.test_only` names
    are in the test split beforehand.
    """
    plans = {source.scene.scene_id: source.plan for source in sources}
    held_out = kept_back(shares.test_only, plans)
    strata: dict[str, dict[str, int]] = defaultdict(dict)
    settings: dict[str, str] = {}
    for source in sorted(sources, key=lambda source: source.scene.scene_id):
        if source.plan in held_out:
            continue
        setting = settings.setdefault(source.plan, source.scene.lighting)
        strata[setting][source.plan] = derive(seed, "split", source.plan)
    places: dict[str, tuple[float, int]] = {}
    for draws in strata.values():
        for rank, plan in enumerate(sorted(draws, key=lambda plan: (draws[plan], plan))):
            places[plan] = ((rank + 0.5) / len(draws), draws[plan])
    order = sorted(places, key=lambda plan: (places[plan], plan))
    test = _quota(shares.test, len(order), least=2)
    validation = _quota(shares.validation, len(order), least=3)
    while order and test + validation >= len(order):
        if validation >= test and validation:
            validation -= 1
        else:
            test -= 1
    names = ["test"] * test + ["validation"] * validation
    dealt = dict(zip(order, names + ["train"] * (len(order) - len(names)), strict=True))
    return dealt | dict.fromkeys(sorted(held_out), "test")


def kept_back(test_only: Sequence[str], plans: Mapping[str, str]) -> set[str]:
    """Return the plans that the names and patterns of `test_only` match.

    `plans` maps scene ids to plans; a match of a scene holds out its whole plan.
    """
    return {
        plan
        for scene, plan in plans.items()
        if any(fnmatchcase(name, pattern) for name in (scene, plan) for pattern in test_only)
    }


def split_sampling(
    scenes: Sequence[Scene],
    truth: GroundTruthParams,
    noisy: NoisyParams,
    shares: SplitParams,
    seed: int,
) -> dict[str, tuple[GroundTruthParams, NoisyParams]]:
    """Return the sampling of each scene's views by its id, which may depend on its split.

    Views of the training and validation splits have `truth.train_spp` samples, and a number of
    noisy samples drawn from `noisy.train`, small ones more often: ln(number) is uniform. The views
    of a scene have the same number, because a launch of another number is compiled anew.
    """
    if not truth.train_spp and not noisy.train:
        return {scene.scene_id: (truth, noisy) for scene in scenes}
    sources = [Source(scene, None) for scene in scenes]
    splits = split_plans(sources, shares, seed)
    tested = (replace(truth, train_spp=0), replace(noisy, train=()))
    trained = tested[0]
    if truth.train_spp:
        trained = replace(trained, spp=truth.train_spp, noise=0.0)
    return {
        source.scene.scene_id: tested
        if splits[source.plan] == "test"
        else (trained, _training_noisy(noisy, source.scene.scene_id, seed))
        for source in sources
    }


def _training_noisy(noisy: NoisyParams, scene_id: str, seed: int) -> NoisyParams:
    if not noisy.train:
        return noisy
    least, most = noisy.train
    rng = generator(seed, "noisy samples", scene_id)
    number = least * ((most + 1) / least) ** rng.random()
    return replace(noisy, spp=min(most, int(number)), train=())


def _quota(share: float, plans: int, least: int) -> int:
    return max(1, round(share * plans)) if share > 0 and plans >= least else 0
