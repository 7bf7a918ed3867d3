"""Hostile pictures of a benchmark's views, and what their makers say about them."""

import os
import struct
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from tests.hostile.family import Arguments, Family, Made, Victim
from tests.hostile.made import case, with_file, with_link, with_value
from tests.hostile.mutations import LONG, damaged_bytes, damaged_json, deep
from tests.hostile.project_files.dataset import write_dataset

SCORE = "score pictures --dataset data/dataset --out scores.json"
LISTED = "score pictures --dataset data/dataset --views views.json"
PIN = "score --dataset data/dataset --pin"
PICTURE = "pictures/view.exr"  # its name is that of the view once the case is written


def _submission(folder: Path) -> None:
    from pbrnet.model.benchmark.views import pin_views, save_views
    from pbrnet.pipeline.export.rows import DatasetRows

    write_dataset(folder)
    rows = DatasetRows(folder / "data" / "dataset", ("test",))
    save_views(folder / "views.json", pin_views(rows, 0, "list", "1"))
    (folder / "pictures").mkdir()
    _exr(folder / PICTURE, np.full((24, 32, 3), 0.5, np.float32))
    (folder / "pictures/about.json").write_text('{"samples": 4}')
    (view,) = rows.rows
    (folder / "name").write_text(f"{view.scene_id}--{view.view_id}")
    table = f"scene_id,view_id,seconds\n{view.scene_id},{view.view_id},1.5\n"
    (folder / "pictures/seconds.csv").write_text(table)


def _named(folder: Path) -> None:
    """Give the picture the name of its view."""
    for path in (folder / "pictures").glob("view.*"):
        path.rename(path.with_name((folder / "name").read_text() + path.suffix))


def _exr(path: Path, pixels: Any, **header: Any) -> None:
    import OpenEXR

    known = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    with OpenEXR.File({**known, **header}, {"RGB": pixels}) as file:
        file.write(str(path))


@case
def _picture(folder: Path, make: Callable[[Path], Any]) -> str:
    make(folder / PICTURE)
    _named(folder)
    return SCORE


def _filled(value: float, kind: Any = np.float32) -> Made:
    return _picture(lambda path: _exr(path, np.full((24, 32, 3), value, kind)))


def _deep(path: Path) -> None:
    import OpenEXR

    cells = np.empty((24, 32), dtype=object)
    for place in np.ndindex(24, 32):
        cells[place] = np.ones(2, np.float32)
    header = {"type": OpenEXR.deepscanline, "compression": OpenEXR.ZIPS_COMPRESSION}
    with OpenEXR.File(header, dict.fromkeys("RGB", cells)) as file:
        file.write(str(path))


def _subsampled(path: Path) -> None:
    """32 x 24 pixels without compression, green at every second pixel and line."""

    def attribute(name: str, kind: str, value: bytes) -> bytes:
        return f"{name}\0{kind}\0".encode() + struct.pack("<i", len(value)) + value

    sampling = {"B": 1, "G": 2, "R": 1}
    channels = b"".join(
        name.encode() + b"\0" + struct.pack("<iiii", 2, 0, n, n) for name, n in sampling.items()
    )
    window = struct.pack("<4i", 0, 0, 31, 23)
    head = b"\x76\x2f\x31\x01\x02\0\0\0" + b"".join(
        (
            attribute("channels", "chlist", channels + b"\0"),
            attribute("compression", "compression", b"\0"),
            attribute("dataWindow", "box2i", window),
            attribute("displayWindow", "box2i", window),
            attribute("lineOrder", "lineOrder", b"\0"),
            attribute("pixelAspectRatio", "float", struct.pack("<f", 1)),
            attribute("screenWindowCenter", "v2f", struct.pack("<2f", 0, 0)),
            attribute("screenWindowWidth", "float", struct.pack("<f", 1)),
            b"\0",
        )
    )
    lines = [
        struct.pack("<80f" if y % 2 == 0 else "<64f", *[1.0] * (80 if y % 2 == 0 else 64))
        for y in range(24)
    ]
    starts, place = [], len(head) + 8 * 24
    for line in lines:
        starts.append(place)
        place += 8 + len(line)
    chunks = [struct.pack("<ii", y, len(line)) + line for y, line in enumerate(lines)]
    path.write_bytes(head + struct.pack("<24Q", *starts) + b"".join(chunks))


def _zeroed(path: Path) -> None:
    """Compressed pixels that no decoder takes, which the library leaves at 0."""
    import OpenEXR

    pixels = np.linspace(0, 1, 24 * 32 * 3, dtype=np.float32).reshape(24, 32, 3)
    _exr(path, pixels, compression=OpenEXR.PIZ_COMPRESSION)
    data = bytearray(path.read_bytes())
    data[-1500:-300] = b"\xff" * 1200
    path.write_bytes(data)


@case
def _beside(folder: Path, name: str, text: str | bytes) -> Arguments:
    made = with_file(f"pictures/{name}", text, SCORE)
    _named(folder)
    if name == "seconds.json":
        (folder / "pictures/seconds.csv").unlink()
    return made(folder)


@case
def _listed(folder: Path, *path: str | int, value: Any) -> Arguments:
    made = with_value("views.json", LISTED, path, value)
    _named(folder)
    return made(folder)


@case
def _target(folder: Path, put: Callable[[Path], object], command: str) -> Arguments:
    """An output that is there and no regular file."""
    _named(folder)
    put(folder / "target")
    return [*command.split(), "target"]


@case
def _named_folder(folder: Path, name: str) -> Arguments:
    """A submission whose name steers a terminal."""
    _named(folder)
    (folder / "pictures").rename(folder / name)
    return ["score", name, "--dataset", "data/dataset"]


SUBMISSIONS_MADE = (
    _picture(_deep),
    _picture(_subsampled),
    _picture(_zeroed),
    *(_filled(value) for value in (3e38, -3e38, 1e20, 1e-45, float("nan"), float("inf"), 0.0)),
    _filled(65504, np.float16),
    _picture(lambda path: _exr(path, np.ones((4, 4, 3), np.float32))),
    _picture(lambda path: _exr(path, np.ones((240, 3200, 3), np.float32))),
    *(_beside("about.json", text) for text in ('{"a":1e400}', '{"a": NaN}', deep(), LONG, "[]")),
    *(
        _beside("seconds.csv", text)
        for text in (
            "scene_id,view_id,seconds\na,b," + "1" * 200_000,
            "scene_id,view_id,seconds\na,b,nan",
            "scene_id,view_id,seconds\na,b,-1",
            "scene_id,view_id\n",
            "scene_id,view_id,seconds\n1,2,3,4,5\n",
            b"scene_id,view_id,seconds\n\xff\0,1,1\n",
        )
    ),
    *(_beside("seconds.json", text) for text in ("1e400", "-1", '{"a": "b"}', "true", LONG)),
    *(
        _listed("views", 0, name, value=value)
        for name in ("scene_id", "view_id", "digest")
        for value in ("a\nError: forged", "\x1b[2J\x07", "", 3)
    ),
    _listed("name", value="\x1b]0;title\x07\nforged"),
    _listed("version", value="\u202e\r1"),
    *(
        _target(put, command)
        for put in (os.mkfifo, lambda path: path.symlink_to("/dev/null"), Path.mkdir)
        for command in (PIN, SCORE.removesuffix(" scores.json"))
    ),
    *(_named_folder(name) for name in ("a\nError: forged", "\x1b[31m\x07", "-x", "$\\frac{")),
    with_link("pictures/view.exr", "/dev/zero", SCORE),
)


FAMILIES = (
    Family(
        "submissions",
        len(SUBMISSIONS_MADE) + 40,
        _submission,
        (
            Victim(PICTURE, damaged_bytes, (SCORE,)),
            Victim("views.json", damaged_json, (LISTED,)),
            Victim("pictures/seconds.csv", damaged_bytes, (SCORE,)),
        ),
        SUBMISSIONS_MADE,
        _named,
        ends_early=(SCORE, LISTED),  # undamaged files are not named by their view
    ),
)
