"""What workers do: make a scene, sample its cameras, render a frame. One function each.

A job is a small frozen dataclass that travels to the worker; the result is small, too. Pixels
go from the worker to the disk.
"""

from __future__ import annotations

import contextlib
import gc
import resource
import tempfile
import time
from collections import OrderedDict
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, cast

import drjit as dr

from pipeline.cameras import sample_cameras
from pipeline.frames import Channels, Kind, frame_path, write_frame
from pipeline.params import Params, Variant
from pipeline.passes import PASSES, Result, camera_of, pass_seed, render_truths
from pipeline.renderer import RenderScene, open_scene, renderer_version, set_variant
from pipeline.versions import require_code
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


def use_code(code: str, threads: int) -> None:
    """Set-up of workers that do not render; `MachineError` if theirs is not the `code` of
    `pipeline.versions`."""
    require_code(code)


def use_renderer(variant: str, renderer: str, code: str, threads: int) -> None:
    """Set-up of workers that render: the variant and the threads, once per process.

    Raises `MachineError` if this worker runs other code, cannot render with `variant`, or its
    renderer is not the `renderer` that the fingerprints were made for.
    """
    global _threads_set
    require_code(code)
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
    return {"costs": {"peak_mb": _peak_memory()}}


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
    opened, opening = _opened(job.scene_folder, job.scene_digest)
    cameras = sample_cameras(opened, opened.scene, job.params, job.seed)
    save_cameras(job.path, replace(cameras, fingerprint=job.fingerprint))
    return {"costs": {**opening, "threads": dr.thread_count(), "peak_mb": _peak_memory()}}


def render_frames(job: FrameJob) -> dict[str, Any]:
    """Render a job's frames and write them; returns what the ledger wants to know.

    A frame's pixels are the same whether it is rendered alone or with its sister. Where one of
    two cannot be rendered, the other is, and `failed` says by its kind why not.
    """
    folder = job.data / "scenes" / job.view.scene_id
    _require(folder)
    opened, opening = _opened(folder, job.scene_digest)
    rendered, failed = _rendered(opened, job)
    frames = {kind: _write(job, kind, *frame) for kind, frame in rendered.items()}
    costs = {**opening, "threads": dr.thread_count(), "peak_mb": _peak_memory(), "frames": frames}
    return {"costs": costs, "failed": failed}


def _rendered(opened: RenderScene, job: FrameJob) -> tuple[dict[Kind, Result], dict[Kind, str]]:
    """The frames that are wanted, and of those that cannot be, why."""
    if len(job.fingerprints) > 1:
        with contextlib.suppress(InputError):
            both = render_truths(opened, job.view, job.params, _seed(job, "color"))
            return {kind: both[kind] for kind in job.fingerprints}, {}
    rendered: dict[Kind, Result] = {}
    failed: dict[Kind, str] = {}
    for kind in job.fingerprints:
        try:
            rendered[kind] = PASSES[kind].render(opened, job.view, job.params, _seed(job, kind))
        except InputError as error:
            if len(job.fingerprints) == 1:
                raise
            failed[kind] = str(error)
    return rendered, failed


def _seed(job: FrameJob, kind: Kind) -> int:
    return pass_seed(kind, job.view, job.params.seed)


def _write(job: FrameJob, kind: Kind, channels: Channels, stats: dict[str, Any]) -> dict[str, Any]:
    """Write one frame; returns its columns of the ledger."""
    path = frame_path(job.data, kind, job.view)
    write_frame(
        path,
        kind,
        channels,
        camera_of(job.view),
        **stats,
        **({"seed": _seed(job, kind)} if PASSES[kind].seeded else {}),
        renderer=renderer_version(),
        fingerprint=job.fingerprints[kind],
    )
    return {
        "width": next(iter(channels.values())).shape[1],
        "height": next(iter(channels.values())).shape[0],
        "spp": stats.get("spp"),
        "noise": stats.get("noise"),
        "bytes": path.stat().st_size,
    }


def _peak_memory() -> float:
    """The most memory that this process has held so far, in MB."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024


def _opened(folder: Path, digest: str) -> tuple[RenderScene, dict[str, Any]]:
    """The scene, from this process's few open ones if its content is the same.

    Also the ledger's columns on it: `opening` seconds, and whether this is its `first` use.
    """
    started = time.perf_counter()
    key = (str(folder), digest)
    first = key not in _open
    if first:
        while len(_open) >= _OPEN_SCENES:
            _open.popitem(last=False)
            gc.collect()
            dr.flush_malloc_cache()
        _open[key] = open_scene(load_scene(folder))
    _open.move_to_end(key)
    return _open[key], {"opening": time.perf_counter() - started, "first": first}


def _require(folder: Path) -> None:
    if not folder.is_dir():
        raise MachineError(
            f"a worker does not see {folder}: all workers need the project folder under the "
            "same path"
        )
