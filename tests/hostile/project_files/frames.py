"""Hostile camera files and frames."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from tests.hostile.family import Family, Made, Victim
from tests.hostile.made import case, with_file, with_link, with_value
from tests.hostile.mutations import LONG, damaged_bytes, damaged_json, damaged_text, deep
from tests.hostile.project_files.base import FRAME, PREDICT, write_frames


@case
def _exr(
    folder: Path,
    meta: Callable[[dict[str, Any]], Any] | None = None,
    channels: Callable[[dict[str, Any]], Any] | None = None,
    path: str = FRAME,
    command: str = PREDICT,
    text: str | None = None,
) -> str:
    """A frame with another attribute or other channels, its digest right."""
    import OpenEXR

    from pbrnet.pipeline.frames import pixels_digest, read_frame

    frame = read_frame(folder / path)
    pixels = dict(frame.channels)
    if channels:
        channels(pixels)
    pixels = {name: np.ascontiguousarray(values) for name, values in pixels.items()}
    content = {**frame.meta, "digest": pixels_digest(pixels)}
    changed = meta(content) if meta else None
    content = content if changed is None else changed
    words = text if text is not None else json.dumps(content)
    with OpenEXR.File({"pbrnet": words}, pixels) as file:
        file.write(str(folder / path))
    return command


def _but(**changes: Any) -> Callable[[dict[str, Any]], Any]:
    return lambda content: content.update(changes)


def _view(**changes: Any) -> Callable[[dict[str, Any]], Any]:
    return lambda content: content["view"].update(changes)


def _resized(pixels: dict[str, Any]) -> None:
    for name, values in pixels.items():
        pixels[name] = values[:5, :7]


def _filled(value: float, *names: str) -> Callable[[dict[str, Any]], Any]:
    def change(pixels: dict[str, Any]) -> None:
        for name in names:
            pixels[name] = np.full_like(pixels[name], value)

    return change


INSPECT = f"inspect {FRAME} --out p.png"

FRAMES_MADE = (
    *(
        _exr(text=text, command=command)
        for text in (
            "[]",
            "3",
            "null",
            '"x"',
            "{",
            deep(),
            LONG,
            "{}",
            '{"view": []}',
            '{"view": {"scene_id": "\\ud800"}}',
        )
        for command in (PREDICT, INSPECT)
    ),
    _exr(_view(view_id="v9")),
    _exr(_view(scene_id="../../x")),
    _exr(_view(width=10**400)),
    _exr(_view(width=200_000, height=200_000)),
    _exr(_view(K=[[1, 2], [3]])),
    _exr(_view(K=[[0] * 3] * 3)),
    _exr(_view(camera_to_world=[[1e308] * 4] * 4)),
    _exr(_view(view_id="a/b"), command=INSPECT),
    _exr(_but(view=None), command=INSPECT),
    _exr(_but(kind=["x"]), command=INSPECT),
    _exr(_but(noise={"a": [1]}), command=INSPECT),
    *(
        _exr(channels=lambda pixels, name=name: pixels.pop(name))  # type: ignore[misc]
        for name in ("Z", "N.X", "albedo.G", "valid", "object")
    ),
    *(
        _exr(
            channels=lambda pixels, name=name: pixels.pop(name),  # type: ignore[misc]
            path="data/illumination/box/v0.exr",
        )
        for name in ("intensity.Y", "distance.Z", "tint.R")
    ),
    _exr(channels=_resized),
    _exr(channels=_resized, path="data/illumination/box/v0.exr"),
    _exr(channels=_resized, path="data/color/box/v0.exr", command=PREDICT + " --compare"),
    _exr(channels=_filled(float("nan"), "Z")),
    _exr(channels=_filled(float("nan"), "N.X", "N.Y")),
    _exr(channels=_filled(float("inf"), "intensity.Y"), path="data/illumination/box/v0.exr"),
    _exr(channels=_filled(-1.0, "Z", "albedo.R")),
    _exr(channels=_filled(0.0, "valid", "Z")),
    _exr(
        channels=_filled(float("nan"), "R"),
        path="data/color/box/v0.exr",
        command=PREDICT + " --compare",
    ),
    _exr(channels=_filled(float("nan"), "Z"), command=INSPECT),
    with_link(FRAME, "v0.exr", PREDICT),
    with_link(FRAME, "/dev/zero", INSPECT),
)

CAMERAS = "data/cameras/box.json"

CAMERA = (
    f"inspect {CAMERAS} --out p.png",
    f"inspect {CAMERAS} --json --text-only",
    f"predict data/scenes/box --camera {CAMERAS} --view v0 --models models --data data",
    f"predict data/scenes/box --camera {CAMERAS} --all-views --models data --data data",
)


def _camera(*path: str | int, value: Any, command: int = 2) -> Made:
    return with_value(CAMERAS, CAMERA[command], path, value)


CAMERAS_MADE = (
    *(
        with_file(CAMERAS, text, CAMERA[command])
        for command in (0, 2)
        for text in (
            "",
            "[]",
            "null",
            deep(),
            LONG,
            '{"views": ' + deep() + "}",
            '{"scene_id": "box", "views": [' + "1" * 400 + "]}",
            "\ud800",
            "NaN",
        )
    ),
    *(_camera("views", 0, "view_id", value=value) for value in ("../../x", "", "a/b", "-v", "\0")),
    *(
        _camera("scene_id", value=value, command=0)
        for value in ("../../..", "/etc", "box/../box", "\ud800")
    ),
    *(_camera("views", 0, "width", value=value) for value in (200_000, 0, -1, 10**400, 2**31)),
    _camera("views", 0, "height", value=200_000),
    _camera("views", 0, "score", value=10**400),
    _camera("views", 0, "seen", value={"\ud800": 1}, command=0),
    _camera("views", 0, "camera_to_world", value=[[1e308] * 4] * 4),
    _camera(
        "views",
        0,
        "camera_to_world",
        value=[[1, 0, 0, 1e300], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]],
        command=0,
    ),
    _camera("views", 0, "K", value=[[1e300, 0, 0], [0, 1e-300, 0], [0, 0, 1]]),
    _camera("rejected", value={str(n): n for n in range(5000)}, command=0),
)


FAMILIES = (
    Family(
        "cameras",
        130,
        write_frames,
        (
            Victim(CAMERAS, damaged_json, (*CAMERA[:2], CAMERA[0], CAMERA[3])),
            Victim(CAMERAS, damaged_text, CAMERA[:2]),
        ),
        CAMERAS_MADE,
        ends_early=CAMERA[3:],
    ),
    Family(
        "frames",
        160,
        write_frames,
        (
            Victim(FRAME, damaged_bytes, (INSPECT, PREDICT)),
            Victim("data/illumination/box/v0.exr", damaged_bytes, (PREDICT,)),
        ),
        FRAMES_MADE,
    ),
)
