"""Work function of the `scenes` stage: a home from a seed, an import, or a variant of an import.

Separate from `pbrnet.pipeline.stages.render_jobs`, so that workers that render do not load
generators and importers. Imports run in child processes within limits.
"""

from __future__ import annotations

import tempfile
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any

from pbrnet.pipeline.farm.versions import STAGE_FILES_KEY, STAGE_KEY, memory_columns
from pbrnet.pipeline.stages.limits import Limits, StoppedError, run_limited
from pbrnet.scenes.contract import Scene, save_scene
from pbrnet.scenes.opened_files import OpenedFiles
from pbrnet.scenes.params import SceneParams
from pbrnet.scenes.procedural.home import make_home
from pbrnet.scenes.registry import import_scene
from pbrnet.scenes.variants.vary import vary_scene


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
    """A variant of the imported scene `of`; `number` is 1 or more."""

    of: str
    number: int
    params: SceneParams
    seed: int


@dataclass(frozen=True)
class ImportJob:
    """Import one scene file, as it is or as a variant."""

    folder: Path
    scene_id: str
    path: Path
    fingerprint: str
    limits: Limits
    options: dict[str, Any] = field(default_factory=dict)  # of `import_scene`
    variant: ImportVariant | None = None

    @property
    def source_folder(self) -> Path:
        """Folder that the import reads from."""
        return self.path if self.path.is_dir() else self.path.parent


def make_scene(job: HomeJob | ImportJob) -> dict[str, Any]:
    """Write one scene folder, with the job's fingerprint in its `scene.json`.

    Returns its costs, or why an import was stopped, which another attempt would not change.
    """
    if isinstance(job, HomeJob):
        scene = make_home(
            job.folder, job.scene_id, job.params, job.seed, job.lighting, job.variant, job.assets
        )
        _stamp(job, scene)
        return {"costs": memory_columns()}
    try:
        peak = run_limited(partial(_import, job), job.limits, str(job.path)) / (1 << 20)
    except StoppedError as error:
        return {"failed": {"scenes": str(error)}}
    return {"costs": {"memory_mb": peak, "peak_mb": peak}}


def _import(job: ImportJob) -> None:
    opened = OpenedFiles(job.source_folder)
    if job.variant is None:
        scene = import_scene(job.path, job.folder, job.scene_id, opened, **job.options)
    else:
        scene = _make_variant(job, job.variant, opened)
    _stamp(job, scene, **{STAGE_FILES_KEY: opened.record()})


def _stamp(job: HomeJob | ImportJob, scene: Scene, **keys: Any) -> None:
    """Write the fingerprint and further keys to a scene's source.

    Until then the folder is out of date: a kill in between costs a repeat.
    """
    save_scene(
        job.folder, replace(scene, source={**scene.source, STAGE_KEY: job.fingerprint, **keys})
    )


def _make_variant(job: ImportJob, variant: ImportVariant, opened: OpenedFiles) -> Scene:
    """Import the scene into a temporary folder and write a variant of it."""
    with tempfile.TemporaryDirectory(prefix="pbrnet-variant-") as folder:
        base = Path(folder) / variant.of
        import_scene(job.path, base, variant.of, opened, **job.options)
        return vary_scene(
            base, job.folder, job.scene_id, variant.number, variant.params, variant.seed
        )
