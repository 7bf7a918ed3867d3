"""What workers do that make scenes: a home from a seed, an import, a variant of one.

Apart from `pipeline.stages.render_jobs`: workers that render need not load generators and
importers.
"""

from __future__ import annotations

import tempfile
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from pipeline.farm.scene_digest import STAGE_MARK
from pipeline.stages.render_jobs import memory_columns
from scenes.contract import Scene, save_scene
from scenes.params import SceneParams
from scenes.procedural.home import make_home
from scenes.registry import import_scene
from scenes.variants.vary import vary_scene


@dataclass(frozen=True)
class HomeJob:
    """Make one procedural home."""

    folder: Path
    scene_id: str
    params: SceneParams
    seed: int
    lighting: str
    variant: int
    fingerprint: str
    assets: Path  # converted catalogues, for `scenes.catalogue_share`


@dataclass(frozen=True)
class ImportVariant:
    """Which variant of an imported scene is wanted: number 1 and up of the scene `of`."""

    of: str
    number: int
    params: SceneParams
    seed: int


@dataclass(frozen=True)
class ImportJob:
    """Bring in one scene of the user's, as it is or as a variant."""

    folder: Path
    scene_id: str
    path: Path
    fingerprint: str
    options: dict[str, Any] = field(default_factory=dict)  # of `import_scene`
    variant: ImportVariant | None = None


def make_scene(job: HomeJob | ImportJob) -> dict[str, Any]:
    """Write one scene folder, marked with what determined it."""
    if isinstance(job, HomeJob):
        scene = make_home(
            job.folder,
            job.scene_id,
            job.params,
            job.seed,
            job.lighting,
            job.variant,
            job.assets,
        )
    elif job.variant is None:
        scene = import_scene(job.path, job.folder, job.scene_id, **job.options)
    else:
        scene = _make_variant(job, job.variant)
    # Until this mark is written the folder does not hold, so a kill in between costs a repeat.
    marked = replace(scene, source={**scene.source, STAGE_MARK: job.fingerprint})
    save_scene(job.folder, marked)
    return {"costs": memory_columns()}


def _make_variant(job: ImportJob, variant: ImportVariant) -> Scene:
    """Import the scene once more, beside the data, and vary it."""
    with tempfile.TemporaryDirectory(prefix="pbrnet-variant-") as folder:
        base = Path(folder) / variant.of
        import_scene(job.path, base, variant.of, **job.options)
        return vary_scene(
            base, job.folder, job.scene_id, variant.number, variant.params, variant.seed
        )
