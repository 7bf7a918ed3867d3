"""Work functions of the rendering stages: sample a scene's cameras, render a view's frames.

A job is a small frozen dataclass that travels to the worker, and the result is small, too. The
worker writes pixels to the data folder or, if it does not see that, returns them as files.
"""

from __future__ import annotations

import contextlib
import time
from collections import OrderedDict
from collections.abc import Collection
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import drjit as dr

from pbrnet.pipeline.cameras.camera_files import make_cameras
from pbrnet.pipeline.cameras.settings import ViewParams
from pbrnet.pipeline.cameras.shared_cameras import take_cameras
from pbrnet.pipeline.cameras.trajectory_files import Trajectory
from pbrnet.pipeline.channels import SURFACES, Kind
from pbrnet.pipeline.farm.settings import Variant
from pbrnet.pipeline.farm.versions import instruction_set, memory_columns, require_code
from pbrnet.pipeline.farm.workspace import (
    SentFile,
    Workspace,
    require_data,
    scene_folder,
    use_workspace,
    writing,
)
from pbrnet.pipeline.frames import Channels, Result, frame_path, write_frame
from pbrnet.pipeline.passes.registry import TRACE_OF, render
from pbrnet.pipeline.render.scene import (
    RenderScene,
    free_memory,
    open_scene,
    renderer_version,
    set_variant,
)
from pbrnet.pipeline.views import View, save_cameras
from pbrnet.scenes.contract import load_scene
from pbrnet.scenes.errors import InputError, MachineError

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
    params: ViewParams
    seed: int
    fingerprint: dict[str, str]  # by the version of the renderer
    trajectories: tuple[Trajectory, ...] = ()
    shared: tuple[View, ...] | None = None  # the cameras of another scene of the plan


@dataclass(frozen=True)
class FrameJob:
    """Render kinds of frames of one view that one trace makes."""

    data: Path
    view: View
    scene_digest: str
    settings: dict[Kind, Any]  # of the trace, of the frames to write
    fingerprints: dict[Kind, dict[str, str]]  # by the version of the renderer
    seed: int


def use_code(code: str, workspace: Workspace, threads: int) -> None:
    """Set up a worker that does not render.

    Raises `MachineError` if its code version is not `code` (`pbrnet.pipeline.farm.versions`), or if
    it does not see the data folder, into which it must write.
    """
    require_code(code)
    require_data(workspace)


def use_renderer(
    variant: Variant, renderers: Collection[str], code: str, workspace: Workspace, threads: int
) -> None:
    """Set up a worker that renders: its workspace, Mitsuba variant and number of threads.

    Raises `MachineError` if this worker runs other code, cannot render with `variant`, or has
    none of the `renderers` whose frames the command accepts.
    """
    global _threads_set
    require_code(code)
    use_workspace(workspace)
    set_variant(variant)
    # Workers that compile the same kernel at the same time race for one entry of Dr.Jit's cache,
    # and one of them prints a harmless warning.
    dr.set_log_level(dr.LogLevel.Error)
    if renderer_version() not in renderers:
        raise MachineError(
            f"a worker has {renderer_version()}, this command accepts {' or '.join(renderers)}: "
            "install the same version of everything on all workers"
        )
    if threads and threads != _threads_set:
        dr.set_thread_count(threads)
        _threads_set = threads


def sample_scene(job: CameraJob) -> dict[str, Any]:
    """Sample one scene's cameras, or take those of another scene, and write its camera file."""
    opened, opening = _opened(job.scene_folder, job.scene_digest)
    if job.shared is None:
        cameras = make_cameras(opened, job.params, job.seed, job.trajectories)
    else:
        cameras = take_cameras(opened, job.params, job.shared)
    sent: dict[str, SentFile] = {}
    with writing(job.path, sent, "cameras") as path:
        fingerprint = job.fingerprint[renderer_version()]
        save_cameras(path, replace(cameras, fingerprint=fingerprint))
    costs = {**opening, **_machine_columns()}
    return {"costs": costs, "files": sent}


def render_frames(job: FrameJob) -> dict[str, Any]:
    """Render a job's frames and write them; return costs, failures and files to send.

    If one of several frames cannot be rendered, the others still are; `failed` holds the message by
    kind.
    """
    opened, opening = _opened(job.data / "scenes" / job.view.scene_id, job.scene_digest)
    rendered, failed = _rendered(opened, job)
    sent: dict[str, SentFile] = {}
    frames = {kind: _write(job, kind, *frame, sent) for kind, frame in rendered.items()}
    costs = {**opening, **_machine_columns(), "frames": frames}
    return {"costs": costs, "failed": failed, "files": sent}


def _rendered(opened: RenderScene, job: FrameJob) -> tuple[dict[Kind, Result], dict[Kind, str]]:
    """Return the job's frames by kind, and the error messages of those that failed."""
    try:
        return render(opened, job.view, job.settings, job.seed), {}
    except InputError:
        if len(job.settings) == 1:
            raise
    rendered: dict[Kind, Result] = {}
    failed: dict[Kind, str] = {}
    for kind, own in job.settings.items():
        try:
            rendered |= render(opened, job.view, {kind: own}, job.seed)
        except InputError as error:
            failed[kind] = str(error)
    return rendered, failed


def _write(
    job: FrameJob, kind: Kind, channels: Channels, stats: dict[str, Any], sent: dict[str, SentFile]
) -> dict[str, Any]:
    """Write one frame, or add it to `sent`; return its columns of the ledger."""
    with writing(frame_path(job.data, kind, job.view), sent, kind) as path:
        write_frame(
            path,
            kind,
            channels,
            job.view,
            **stats,
            **({"seed": job.seed} if TRACE_OF[kind].seed else {}),
            renderer=renderer_version(),
            **({} if kind in SURFACES else {"instruction_set": instruction_set()}),
            fingerprint=job.fingerprints[kind][renderer_version()],
        )
        size = path.stat().st_size
    return {
        "width": next(iter(channels.values())).shape[1],
        "height": next(iter(channels.values())).shape[0],
        "spp": stats.get("spp"),
        "noise": stats.get("noise"),
        "bytes": size,
    }


def _machine_columns() -> dict[str, Any]:
    """Return the ledger's columns about this worker."""
    return {"renderer": renderer_version(), "threads": dr.thread_count(), **memory_columns()}


def _opened(folder: Path, digest: str) -> tuple[RenderScene, dict[str, Any]]:
    """Return the open scene with this digest, and the ledger's columns about opening it.

    The columns are the `opening` seconds and whether this is the process's `first` use of it.
    """
    started = time.perf_counter()
    key = (str(folder), digest)
    first = key not in _open
    if first:
        while len(_open) >= _OPEN_SCENES:
            _close_oldest()
            free_memory()
        with contextlib.ExitStack() as stack:
            place = stack.enter_context(scene_folder(folder, digest))
            _open[key] = open_scene(load_scene(place)), stack.pop_all()
    _open.move_to_end(key)
    return _open[key][0], {"opening": time.perf_counter() - started, "first": first}


def _close_oldest() -> None:
    """Close the scene that was opened first; no name must keep it while the next one opens.

    Kernels have places of materials compiled in, which depend on what else there is.
    """
    _, (_, stack) = _open.popitem(last=False)
    stack.close()
