"""Rows about shards: reading them compared with reading EXR frames, and writing.

Like is compared with like: pyarrow with OpenEXR alone, both to NumPy arrays of the stored types;
this project's reader with its reader of frames, both to the float32 images of a training loop in
the renderer's unit. All use all threads of the machine, read the same channels, and compare no
checksums. Files are in the page cache, so that the disk is not measured.
"""

from __future__ import annotations

import os
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Literal

import numpy as np
import OpenEXR
import pyarrow as pa
import pyarrow.parquet as pq

from benchmarks.bench import Bench
from benchmarks.rows import Row, at_least
from benchmarks.timing import Clock, Spent, by_turns, ratio, spread
from pbrnet.model.data.reader import OPTIONAL, PAPER, Dataset
from pbrnet.pipeline.channels import RGB, TINT, Kind
from pbrnet.pipeline.dataset.pack import pack_dataset
from pbrnet.pipeline.dataset.parquet import images_of
from pbrnet.pipeline.dataset.shards import LZ4_LEVEL
from pbrnet.pipeline.frames import frame_path, read_frame, write_pixels
from pbrnet.pipeline.params import Params
from pbrnet.pipeline.stages.cameras import run_cameras
from pbrnet.pipeline.stages.frame_stage import run_frames
from pbrnet.pipeline.views import ImageParams, View, load_cameras

KINDS: tuple[Kind, ...] = ("inputs", "illumination", "visibility", "shading", "color")
Denoise = Literal["none", "oidn"]
SMALL = "160x120"
_TURNS = 7  # reading is quick and noisy


def shard_rows(bench: Bench) -> Iterator[Row]:
    """Yield rows at two image sizes: the quick start's and the paper's kind."""
    for size in ((160, 120), bench.sizes.large):
        data, params = frames_of(bench, size)
        yield from _rows_at(data, partial(pack_dataset, data, params), f"{size[0]}x{size[1]}")


def frames_of(
    bench: Bench, size: tuple[int, int], name: str = "shards", denoise: Denoise = "none"
) -> tuple[Path, Params]:
    """Render frames of some views of the homes, at this size, below a folder of this name."""
    sizes = bench.sizes
    data = bench.folder / f"{name}-{size[0]}"
    options = bench.params
    params = replace(
        options,
        image=ImageParams(width=size[0], height=size[1]),
        illumination=replace(options.illumination, width=size[0]),
        groundtruth=replace(
            options.groundtruth,
            spp=sizes.rows_spp,
            block_spp=min(8, sizes.rows_spp),
            denoise=denoise,
        ),
        cameras=replace(options.cameras, views_per_scene=-(-sizes.rows // sizes.homes)),
    )
    data.mkdir()
    (data / "scenes").symlink_to(bench.data / "scenes")
    for stage in (
        run_cameras,
        partial(run_frames, "inputs"),
        partial(run_frames, "illumination"),
        partial(run_frames, "groundtruth"),
    ):
        stage(data, params)
    return data, params


def views_of(data: Path) -> list[View]:
    """Return all views below a data folder."""
    files = sorted((data / "cameras").glob("*.json"))
    return [view for path in files for view in load_cameras(path).views]


def _rows_at(data: Path, pack: Callable[[], object], size: str) -> Iterator[Row]:
    views = views_of(data)
    written = by_turns({"pack": pack}, 2)["pack"]
    folder = data / "dataset"
    count = len(Dataset(folder, "train"))
    megabytes = sum(path.stat().st_size for path in folder.glob("*.parquet")) / 1e6
    yield Row(
        f"packing {size}",
        f"{len(views)} views checked and packed, {megabytes / count:.2f} MB per row; rows/s",
        spread([len(views) / s.wall for s in written]),
        "/s",
        "wall",
    )
    keep_channels_of_rows(data, views)
    with ThreadPoolExecutor(len(os.sched_getaffinity(0))) as pool:
        ways: dict[str, Callable[[], object]] = {
            "exr": lambda: list(pool.map(partial(read_exr, data), views)),
            "arrow": partial(read_columns, folder, pool),
            "frames": lambda: list(pool.map(partial(read_view, data), views)),
            "stream": lambda: deque(Dataset(folder, "train").ordered(), maxlen=0),
        }
        spent = by_turns(ways, _TURNS)
    rows = {"exr": len(views), "arrow": count, "frames": len(views), "stream": count}
    per_row = {name: _each(spent[name], rows[name]) for name in ways}
    clocks: tuple[Clock, ...] = ("wall", "cpu")
    for clock in clocks:
        for name, other, shown in (
            ("arrow", "exr", "pyarrow to NumPy, stored types"),
            ("stream", "frames", "this project's reader, float32"),
        ):
            yield Row(
                f"shards {size}, {shown} ({clock})",
                "rows per second relative to the five EXR files of each view",
                ratio(per_row[other], per_row[name], clock),
                clock=clock,
                # Of small images most of the time is the calls'.
                goal=at_least(5) if clock == "wall" and size != SMALL else None,
            )
    yield Row(
        f"rows per second {size}",
        "pyarrow to NumPy, all images",
        spread([1 / s.wall for s in per_row["arrow"]]),
        "/s",
        "wall",
    )
    yield _bound_row(folder, per_row["exr"], size)


def _each(spent: list[Spent], rows: int) -> list[Spent]:
    return [Spent(s.cpu / rows, s.wall / rows) for s in spent]


def keep_channels_of_rows(data: Path, views: Sequence[View]) -> None:
    """Write the frames anew without the numbers of objects, which rows do not have."""
    for view in views:
        path = frame_path(data, "inputs", view)
        frame = read_frame(path)
        channels = {name: values for name, values in frame.channels.items() if name != "object"}
        write_pixels(path, channels, view, frame.meta)


def read_exr(data: Path, view: View) -> int:
    """Read a view's frames by OpenEXR alone; return the number of values."""
    count = 0
    for kind in KINDS:
        with OpenEXR.File(str(frame_path(data, kind, view)), separate_channels=True) as file:
            count += sum(channel.pixels.size for channel in file.channels().values())
    return count


def read_view(data: Path, view: View) -> dict[str, np.ndarray]:
    """Return a view's images from its frames, float32, by column name."""
    frames = {kind: read_frame(frame_path(data, kind, view), verify=False) for kind in KINDS}
    inputs, panorama = frames["inputs"], frames["illumination"].channels
    return {
        "depth": inputs.channels["Z"],
        "normal": inputs.stack("N.X", "N.Y", "N.Z"),
        "reflectance": inputs.stack(*(f"albedo.{band}" for band in RGB)),
        "valid": inputs.channels["valid"] > 0,
        "intensity": panorama["intensity.Y"],
        "distance": panorama["distance.Z"],
        "tint": frames["illumination"].stack(*TINT),
        "visibility": frames["visibility"].channels["visibility.Y"].astype(np.float32),
        "shading": frames["shading"].rgb,
        "color": frames["color"].rgb,
    }


def read_columns(folder: Path, pool: ThreadPoolExecutor) -> int:
    """Read all images of all shards with pyarrow alone; return the number of values."""
    count = 0
    for path in sorted(folder.glob("*.parquet")):
        groups = range(pq.read_metadata(path).num_row_groups)
        count += sum(pool.map(partial(_read_group, path), groups))
    return count


def _read_group(path: Path, group: int) -> int:
    with pq.ParquetFile(path) as file:
        names = [n for n in (*PAPER, *OPTIONAL) if n in file.schema_arrow.names]
        table = file.read_row_group(group, columns=names, use_threads=False)
    return sum(images_of(path, table, name).size for name in names)


def _bound_row(folder: Path, frames: list[Spent], size: str) -> Row:
    """Return the speed of decompressing alone, an upper bound for any reader."""
    packed = _packed_pages(folder)
    codec = pa.Codec("lz4_raw")
    spent = by_turns({"lz4": lambda: [codec.decompress(*page) for page in packed]}, _TURNS)
    rows = len(Dataset(folder, "train"))
    return Row(
        f"upper bound {size} (cpu)",
        "the same ratio for decompressing LZ4 alone, the limit of any reader on one core",
        ratio(frames, _each(spent["lz4"], rows), "cpu"),
        clock="cpu",
    )


def _packed_pages(folder: Path) -> list[tuple[bytes, int]]:
    """Return the images' cells as the shards compress them, with their raw sizes."""
    codec, pages = pa.Codec("lz4_raw", LZ4_LEVEL), []
    for path in sorted(folder.glob("*.parquet")):
        table = pq.read_table(path, columns=list(PAPER))
        for name in PAPER:
            for cell in table.column(name):
                content = cell.as_py()
                pages.append((codec.compress(content, asbytes=True), len(content)))
    return pages
