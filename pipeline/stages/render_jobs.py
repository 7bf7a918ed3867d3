"""What workers do that render: sample a scene's cameras, render a frame. One function each.

A job is a small frozen dataclass that travels to the worker; the result is small, too. Pixels
go from the worker to the disk, or where the worker does not see it, back to the command as files.
"""

from __future__ import annotations

import contextlib
import resource
import time
from collections import OrderedDict
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, cast

import drjit as dr
import psutil

from pipeline.farm.workspace import SentFile, Site, require_data, scene_folder, use_site, writing
from pipeline.frames import Channels, Kind, frame_path, write_frame
from pipeline.params import Params, Variant
from pipeline.passes.registry import PASSES, Result, camera_of, pass_seed, render_truths
from pipeline.render.scene import (
    RenderScene,
    free_memory,
    open_scene,
    renderer_version,
    set_variant,
)
from pipeline.stages.view_sampling import sample_cameras
from pipeline.versions import require_code
from pipeline.views import View, save_cameras
from scenes.contract import load_scene
from scenes.errors import InputError, MachineError

# One: Dr.Jit compiles the materials of every open scene into each kernel.
_OPEN_SCENES = 1
_open: OrderedDict[tuple[str, str], tuple[RenderScene, contextlib.ExitStack]] = OrderedDict()
_threads_set = 0


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


def use_code(code: str, site: Site, threads: int) -> None:
    """Set-up of workers that do not render.

    Raises `MachineError` if theirs is not the `code` of `pipeline.versions`, or if they do not
    see the data folder: their scenes and models would stay with them.
    """
    require_code(code)
    require_data(site)


def use_renderer(variant: str, renderer: str, code: str, site: Site | None, threads: int) -> None:
    """Set-up of workers that render: the variant and the threads, once per process; and where
    scenes are found and frames left.

    Raises `MachineError` if this worker runs other code, cannot render with `variant`, or its
    renderer is not the `renderer` that the fingerprints were made for.
    """
    global _threads_set
    require_code(code)
    use_site(site)
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


def sample_scene(job: CameraJob) -> dict[str, Any]:
    """Sample one scene's cameras and write its camera file."""
    opened, opening = _opened(job.scene_folder, job.scene_digest)
    cameras = sample_cameras(opened, opened.scene, job.params, job.seed)
    sent: dict[str, SentFile] = {}
    with writing(job.path, sent, "cameras") as path:
        save_cameras(path, replace(cameras, fingerprint=job.fingerprint))
    costs = {**opening, "threads": dr.thread_count(), **memory_columns()}
    return {"costs": costs, "files": sent}


def render_frames(job: FrameJob) -> dict[str, Any]:
    """Render a job's frames and write them; returns what the ledger wants to know.

    A frame's pixels are the same whether it is rendered alone or with its sister. Where one of
    two cannot be rendered, the other is, and `failed` says by its kind why not.
    """
    opened, opening = _opened(job.data / "scenes" / job.view.scene_id, job.scene_digest)
    rendered, failed = _rendered(opened, job)
    sent: dict[str, SentFile] = {}
    frames = {kind: _write(job, kind, *frame, sent) for kind, frame in rendered.items()}
    costs = {**opening, "threads": dr.thread_count(), **memory_columns(), "frames": frames}
    return {"costs": costs, "failed": failed, "files": sent}


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


def _write(
    job: FrameJob,
    kind: Kind,
    channels: Channels,
    stats: dict[str, Any],
    sent: dict[str, SentFile],
) -> dict[str, Any]:
    """Write one frame, or add it to what is `sent`; returns its columns of the ledger."""
    with writing(frame_path(job.data, kind, job.view), sent, kind) as path:
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
        size = path.stat().st_size
    return {
        "width": next(iter(channels.values())).shape[1],
        "height": next(iter(channels.values())).shape[0],
        "spp": stats.get("spp"),
        "noise": stats.get("noise"),
        "bytes": size,
    }


def memory_columns() -> dict[str, float]:
    """This process's columns of the ledger: the memory that it holds, and the most so far, MB."""
    now = psutil.Process().memory_info().rss / (1 << 20)
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    return {"memory_mb": now, "peak_mb": max(now, peak)}


def _opened(folder: Path, digest: str) -> tuple[RenderScene, dict[str, Any]]:
    """The scene, from this process's few open ones if its content is the same.

    Also the ledger's columns on it: `opening` seconds, and whether this is its `first` use.
    """
    started = time.perf_counter()
    key = (str(folder), digest)
    first = key not in _open
    if first:
        while len(_open) >= _OPEN_SCENES:
            _, (_, stack) = _open.popitem(last=False)
            stack.close()
            free_memory()
        with contextlib.ExitStack() as stack:
            place = stack.enter_context(scene_folder(folder, digest))
            _open[key] = open_scene(load_scene(place)), stack.pop_all()
    _open.move_to_end(key)
    return _open[key][0], {"opening": time.perf_counter() - started, "first": first}
