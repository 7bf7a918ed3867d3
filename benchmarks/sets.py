"""Rows about sets of channels: what each adds to a view's processor time and to its row's bytes."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import pyarrow.parquet as pq

from benchmarks.bench import Bench, resized
from benchmarks.rows import Row, at_most
from benchmarks.timing import Spent, beyond, by_turns, ratio, spread, sums
from pbrnet.pipeline.channels import KINDS, SURFACES, TRACED, TRUTHS, ChannelSet, Kind
from pbrnet.pipeline.dataset.columns import dataset_columns
from pbrnet.pipeline.dataset.pack import pack_dataset
from pbrnet.pipeline.frames import Result, frame_path, write_frame
from pbrnet.pipeline.params import Params
from pbrnet.pipeline.passes.registry import TRACES, render, settings_of, trace_seed
from pbrnet.pipeline.passes.settings import EnvironmentParams, IlluminationParams, LightParams
from pbrnet.pipeline.passes.surfaces import render_surfaces
from pbrnet.pipeline.render.scene import RenderScene
from pbrnet.pipeline.views import CameraFile, ImageParams, View, as_matrix, save_cameras

_LAMPS = 8  # with a light group of their own
_STEP = 0.06  # metres from frame to frame of a walk
_TOGETHER = "materials and labels"
_GROUPS = "light with groups"
# What the rows name: sets beside `paper`.
_SETS: dict[str, tuple[ChannelSet, ...]] = {
    "materials": ("materials",),
    "labels": ("labels",),
    _TOGETHER: ("materials", "labels"),
    "video": ("video",),
    "light": ("light",),
    _GROUPS: ("light",),
    "environment": ("environment",),
    "transport": ("transport",),
    "all": ("all",),
}
_GOALS = {_TOGETHER: 1.05, "light": 1.15}


def set_rows(bench: Bench) -> Iterator[Row]:
    """Yield for each set its processor time relative to the set `paper`, and its bytes a row."""
    params, scene = _params(bench), bench.open(bench.home)
    views = [
        _moving(resized(view, (params.image.width, params.image.height)))
        for view in bench.views[bench.home]
    ]
    data = bench.folder / "sets"
    (data / "scenes").mkdir(parents=True)
    (data / "scenes" / bench.home).symlink_to(bench.data / "scenes" / bench.home)
    save_cameras(data / "cameras" / f"{bench.home}.json", CameraFile(bench.home, tuple(views)))
    for view in views:  # compiles, too
        _write_frames(data, scene, view, settings_of(params, params.kinds), params.seed)
    pack_dataset(data, params)
    sizes = _bytes_a_row(data / "dataset")
    ways = _ways(scene, views[0], settings_of(params, KINDS), params.seed)
    for work in ways.values():  # twice with the round below: launches of kinds in turn are
        work()  # recorded a second time
    spent = by_turns(ways, bench.sizes.repeats)
    paper = sums(*(spent[name] for name in ("truth", "inputs", "illumination", "visibility")))
    size = f"{params.image.width}x{params.image.height}, {params.groundtruth.spp} spp"
    yield Row(
        "paper",
        f"shading and colour, denoised, inputs and panorama of a view, {size}",
        spread([each.cpu for each in paper]),
        "s",
        "cpu",
    )
    for name in _SETS:
        yield Row(
            f"{name} / paper",
            f"a view with these images added (groups: of {_LAMPS} lamps), relative to one with "
            "`paper` alone",
            ratio(sums(paper, *_added(name, spent)), paper, "cpu"),
            clock="cpu",
            goal=at_most(_GOALS[name]) if name in _GOALS else None,
        )
    for name in ("paper", *_SETS):
        own = _columns(params, name)
        yield Row(
            f"{name}, per row",
            f"bytes in the shards of the columns of `paper` and these, mean of {len(views)} views, "
            f"{size}",
            spread([sum(count for column, count in sizes.items() if column in own) / 1e3]),
            "kB",
        )


def _params(bench: Bench) -> Params:
    """Return parameters of all sets at the middle size, with the denoiser."""
    width, height = bench.sizes.middle
    return replace(
        bench.params,
        image=ImageParams(width=width, height=height),
        channels=("all",),
        groundtruth=replace(bench.params.groundtruth, denoise="oidn"),
        light=LightParams(_LAMPS),
        illumination=IlluminationParams(width=width),
        environment=EnvironmentParams(width=width, spp=bench.params.groundtruth.spp),
    )


def _moving(view: View) -> View:
    """Return a view in the middle of a walk straight ahead."""
    poses = []
    for step in (-_STEP, _STEP):
        pose = view.pose.copy()
        pose[:3, 3] += step * pose[:3, 2]
        poses.append(as_matrix(pose))
    return replace(view, trajectory="walk", frame=1, pose_before=poses[0], pose_after=poses[1])


def _ways(
    scene: RenderScene, view: View, settings: Mapping[Kind, Any], seed: int
) -> dict[str, Callable[[], object]]:
    """Return what is timed: traces with and without what a set takes from them, other passes."""
    traces: dict[str, tuple[Kind, ...]] = {
        "inputs": ("inputs",),
        "materials": ("inputs", "materials"),
        "labels": ("inputs", "labels"),
        _TOGETHER: ("inputs", "materials", "labels"),
        "video": ("inputs", "video"),
        "surfaces": SURFACES,
    }
    alone: tuple[Kind, ...] = ("illumination", "visibility", "environment", "transport")

    def trace(*kinds: Kind, **other: Any) -> Callable[[], object]:
        own = {kind: settings[kind] for kind in kinds} | other
        return partial(render, scene, view, own, seed)

    return {
        **{name: partial(render_surfaces, scene, view, kinds) for name, kinds in traces.items()},
        "truth": trace(*TRUTHS),
        "light": trace(*TRACED, light=replace(settings["light"], groups=LightParams().groups)),
        _GROUPS: trace(*TRACED),
        **{kind: trace(kind) for kind in alone},
    }


def _added(name: str, spent: dict[str, list[Spent]]) -> list[list[Spent]]:
    """Return the seconds that a set of `_SETS` adds to those of `paper`, in parts."""
    if name == "all":
        parts = [beyond(spent["surfaces"], spent["inputs"]), beyond(spent[_GROUPS], spent["truth"])]
        return [*parts, spent["environment"], spent["transport"]]
    if name in ("environment", "transport"):
        return [spent[name]]
    base = "truth" if name in ("light", _GROUPS) else "inputs"
    return [beyond(spent[name], spent[base])]


def _write_frames(
    data: Path, scene: RenderScene, view: View, settings: Mapping[Kind, Any], seed: int
) -> None:
    """Render and write all frames of a view."""
    frames: dict[Kind, Result] = {}
    for trace in TRACES:
        if own := {kind: settings[kind] for kind in trace.kinds if kind in settings}:
            frames |= render(scene, view, own, trace_seed(trace.kinds[0], view, seed))
    for kind, (channels, about) in frames.items():
        path = frame_path(data, kind, view)
        write_frame(path, kind, channels, view, **about, fingerprint="")


def _bytes_a_row(folder: Path) -> dict[str, float]:
    """Return the compressed bytes a row of each column of a dataset's shards."""
    found: dict[str, float] = {}
    rows = 0
    for path in sorted(folder.glob("*.parquet")):
        metadata = pq.read_metadata(path)
        rows += metadata.num_rows
        for group in range(metadata.num_row_groups):
            for index in range(metadata.num_columns):
                chunk = metadata.row_group(group).column(index)
                name = chunk.path_in_schema.partition(".")[0]
                found[name] = found.get(name, 0) + chunk.total_compressed_size
    return {name: count / rows for name, count in found.items()}


def _columns(params: Params, name: str) -> set[str]:
    """Return the columns of a dataset of `paper` and the set `name` of `_SETS`."""
    own = replace(params, channels=_SETS.get(name, ("paper",)))
    if name not in (_GROUPS, "all"):
        own = replace(own, light=LightParams())
    return {column.name for column in dataset_columns(own)}
