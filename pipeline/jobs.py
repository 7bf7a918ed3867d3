"""What workers do: make a scene, sample its cameras, render a frame. One function each.

A job is a small frozen dataclass that travels to the worker; the result is small, too. Pixels
go from the worker to the disk.
"""

from __future__ import annotations

import gc
import tempfile
from collections import OrderedDict
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, cast

import drjit as dr

from pipeline.cameras import sample_cameras
from pipeline.frames import Channels, Kind, frame_path, write_frame
from pipeline.params import Params, Variant
from pipeline.passes import PASSES, camera_of, pass_seed, render_truths
from pipeline.renderer import RenderScene, open_scene, renderer_version, set_variant
from pipeline.views import View, save_cameras
from scenes.contract import Scene, load_scene, save_scene
from scenes.errors import InputError, MachineError
from scenes.params import SceneParams
from scenes.procedural.home import make_home
from scenes.registry import import_scene
from scenes.variants.vary import vary_scene

# One: Dr.Jit compiles the materials of every open scene into each kernel.
_OPEN_SCENES = 1
_open: OrderedDict[tuple[str, str], RenderScene] = OrderedDict()
_threads_set = 0


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


@dataclass(frozen=True)
class CameraJob:
    """Sample the views of one scene."""

    path: Path
    scene_folder: Path
    scene_digest: str
    params: Params
    seed: int
    fingerprint: str


@dataclass(frozen=True)
class FrameJob:
    """Render one kind of frame of one view, or both of its truths."""

    data: Path
    view: View
    scene_digest: str
    params: Params
    fingerprints: dict[Kind, str]  # of the frames to write


def no_renderer(threads: int) -> None:
    """Set-up of workers that do not render."""


def use_renderer(variant: str, renderer: str, threads: int) -> None:
    """Set-up of workers that render: the variant and the threads, once per process.

    Raises `MachineError` if this worker cannot render with `variant`, or its renderer is not
    the `renderer` that the fingerprints were made for.
    """
    global _threads_set
    set_variant(cast(Variant, variant))
    # Workers that compile the same kernel at the same time race for its place in Dr.Jit's cache,
    # and one of them warns; that is harmless.
    dr.set_log_level(dr.LogLevel.Error)
    if renderer_version() != renderer:
        raise MachineError(
            f"a worker has {renderer_version()}, this command has {renderer}: install the same "
            "version of everything on all workers"
        )
    if threads and threads != _threads_set:
        dr.set_thread_count(threads)
        _threads_set = threads


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
    return {"rooms": len(scene.rooms), "objects": len(scene.objects)}


def _make_variant(job: ImportJob, variant: ImportVariant) -> Scene:
    """Import the scene once more, beside the data, and vary it."""
    with tempfile.TemporaryDirectory(prefix="pbrnet-variant-") as folder:
        base = Path(folder) / variant.of
        import_scene(job.path, base, variant.of, **job.options)
        return vary_scene(
            base, job.folder, job.scene_id, variant.number, variant.params, variant.seed
        )


STAGE_MARK = "made_by_stage"  # key in scene.json's `source`: the fingerprint, ours to replace


def sample_scene(job: CameraJob) -> dict[str, Any]:
    """Sample one scene's cameras and write its camera file."""
    _require(job.scene_folder)
    opened = _opened(job.scene_folder, job.scene_digest)
    cameras = sample_cameras(opened, opened.scene, job.params, job.seed)
    save_cameras(job.path, replace(cameras, fingerprint=job.fingerprint))
    return {
        "views": len(cameras.views),
        "candidates": cameras.candidates,
        "rejected": cameras.rejected,
    }


def render_frames(job: FrameJob) -> dict[str, Any]:
    """Render a job's frames and write them; returns what the ledger wants to know.

    A frame's pixels are the same whether it is rendered alone or with its sister. Where one of
    two cannot be rendered, the other is, and `failed` says by its kind why not.
    """
    folder = job.data / "scenes" / job.view.scene_id
    _require(folder)
    opened = _opened(folder, job.scene_digest)
    if len(job.fingerprints) > 1:
        try:
            both = render_truths(opened, job.view, job.params, _seed(job, "color"))
            return {"spp": max(_write(job, kind, *both[kind]) for kind in job.fingerprints)}
        except InputError:
            pass
    spp, failed = 0, {}
    for kind in job.fingerprints:
        try:
            rendered = PASSES[kind].render(opened, job.view, job.params, _seed(job, kind))
        except InputError as error:
            if len(job.fingerprints) == 1:
                raise
            failed[kind] = str(error)
        else:
            spp = _write(job, kind, *rendered)
    return {"spp": spp, "failed": failed}


def _seed(job: FrameJob, kind: Kind) -> int:
    return pass_seed(kind, job.view, job.params.seed)


def _write(job: FrameJob, kind: Kind, channels: Channels, stats: dict[str, Any]) -> int:
    """Write one frame; returns its samples a pixel."""
    write_frame(
        frame_path(job.data, kind, job.view),
        kind,
        channels,
        camera_of(job.view),
        **stats,
        **({"seed": _seed(job, kind)} if PASSES[kind].seeded else {}),
        renderer=renderer_version(),
        fingerprint=job.fingerprints[kind],
    )
    return int(stats.get("spp", 0))


def _opened(folder: Path, digest: str) -> RenderScene:
    """The scene, from this process's few open ones if its content is the same."""
    key = (str(folder), digest)
    if key in _open:
        _open.move_to_end(key)
        return _open[key]
    while len(_open) >= _OPEN_SCENES:
        _open.popitem(last=False)
        gc.collect()
        dr.flush_malloc_cache()
    _open[key] = open_scene(load_scene(folder))
    return _open[key]


def _require(folder: Path) -> None:
    if not folder.is_dir():
        raise MachineError(
            f"a worker does not see {folder}: all workers need the project folder under the "
            "same path"
        )
