"""Frames: self-describing OpenEXR files, one a view and kind, complete or absent.

Channels (linear, scene-referred; see `KINDS`):

* inputs        `Z` z-depth in metres (0: no surface), `N.X/Y/Z` unit normal in the camera's
                OpenCV axes, `albedo.R/G/B` reflectance in [0, 1], `valid` 0 or 1,
                `object` index + 1 into `scene.json`'s objects (0: none)
* illumination  `intensity.Y` luminance of the visible light source, `distance.Z` metres to it,
                `tint.R/G/B` its colour, linear RGB of luminance 1
* visibility    `visibility.Y` share of the direct light of the panorama's sources that reaches the
                surface; only where `illumination.shadow_rays` asks for it
* shading       `R`, `G`, `B` HDR radiance with every reflectance replaced by one grey
* color         `R`, `G`, `B` HDR radiance of the full scene
* noisy         colour again, and as `shading.R/G/B` shading, of a few samples a pixel that no
                other frame has; as `denoised.R/G/B` and `denoised.shading.R/G/B` what the denoiser
                makes of them; only where `noisy.spp` asks for it

Attributes: `worldToCamera` (4x4, OpenCV axes) and `pbrnet`, a JSON object with the view, the seed,
spp, noise, renderer, `fingerprint` of all that determined the pixels, and `digest` of the pixels.

Files are read and written with OpenEXR's own package only: Mitsuba's bitmap code hangs when
its thread pool has one thread.
"""

from __future__ import annotations

import errno
import json
import os
from dataclasses import dataclass
from pathlib import Path
from typing import Any, BinaryIO, Literal

import numpy as np
import OpenEXR

from pipeline.params import Params
from pipeline.views import View
from scenes.arrays import AnyArray, Float32Array
from scenes.checked import plain
from scenes.errors import InputError, MachineError
from scenes.files import atomic_file, digest_bytes

Kind = Literal["inputs", "illumination", "visibility", "shading", "color", "noisy"]
Channels = dict[str, AnyArray]

RGB = ("R", "G", "B")
TINT = ("tint.R", "tint.G", "tint.B")
NOISY_SHADING = ("shading.R", "shading.G", "shading.B")
DENOISED = ("denoised.R", "denoised.G", "denoised.B")
DENOISED_SHADING = ("denoised.shading.R", "denoised.shading.G", "denoised.shading.B")
KINDS: dict[Kind, dict[str, type]] = {
    "inputs": {
        "Z": np.float32,
        **{f"N.{axis}": np.float16 for axis in "XYZ"},
        **{f"albedo.{band}": np.float16 for band in RGB},
        "valid": np.float16,
        "object": np.uint32,
    },
    "illumination": {
        "intensity.Y": np.float32,
        "distance.Z": np.float32,
        **dict.fromkeys(TINT, np.float16),
    },
    "visibility": {"visibility.Y": np.float16},
    "shading": dict.fromkeys(RGB, np.float16),
    "color": dict.fromkeys(RGB, np.float16),
    "noisy": dict.fromkeys((*RGB, *NOISY_SHADING, *DENOISED, *DENOISED_SHADING), np.float16),
}
HALF_MAX = float(np.finfo(np.float16).max)


@dataclass(frozen=True)
class Frame:
    """Pixels by channel name, each (H, W), and the `pbrnet` attribute."""

    channels: Channels
    meta: dict[str, Any]

    def stack(self, *names: str) -> Float32Array:
        """Several channels as float32 (H, W, len(names))."""
        return np.stack([self.channels[name].astype(np.float32) for name in names], axis=-1)

    @property
    def rgb(self) -> Float32Array:
        """`R`, `G`, `B` as float32 (H, W, 3)."""
        return self.stack(*RGB)


def kinds_of(params: Params) -> tuple[Kind, ...]:
    """The frames that a view of the dataset needs, in the order in which they are made."""
    kinds: list[Kind] = ["inputs", "illumination", "shading", "color"]
    if params.illumination.shadow_rays:
        kinds.append("visibility")
    if params.noisy.spp:
        kinds.append("noisy")
    return tuple(kinds)


def fingerprint(**determined_by: Any) -> str:
    """A digest of all that determines a frame's pixels: parameters, view, scene, renderer."""
    text = json.dumps(plain(determined_by), sort_keys=True, allow_nan=False)
    return digest_bytes(text.encode())


def frame_path(data: Path, kind: Kind, view: View) -> Path:
    """Where a frame lies below the data folder."""
    return Path(data) / kind / view.scene_id / f"{view.view_id}.exr"


def write_frame(path: Path, kind: Kind, channels: Channels, view: View, **meta: Any) -> None:
    """Write a frame by rename; `meta` must hold `fingerprint`.

    `channels` holds exactly the names of `KINDS[kind]`, each (H, W). Values beyond half's
    range are clamped to it, and their number is kept in the attribute as `clamped`.
    Raises ValueError for wrong channels or NaN, `MachineError` for a full disk.
    """
    kinds = KINDS[kind]
    if set(channels) != set(kinds):
        raise ValueError(f"{path}: channels {sorted(channels)}, expected {sorted(kinds)}")
    pixels: Channels = {}
    clamped = 0
    for name, dtype in kinds.items():
        values = np.asarray(channels[name])
        if np.issubdtype(values.dtype, np.floating) and not np.isfinite(values).all():
            raise ValueError(f"{path}: channel {name} holds NaN or infinity")
        if dtype is np.float16:
            clamped += int((np.abs(values) > HALF_MAX).sum())
            values = np.clip(values, -HALF_MAX, HALF_MAX)
        pixels[name] = np.ascontiguousarray(values, dtype=dtype)
    write_pixels(path, pixels, view, {"kind": kind, "clamped": clamped, **meta})


def write_pixels(path: Path, pixels: Channels, view: View, meta: dict[str, Any]) -> None:
    """Write an OpenEXR of these channels, as they are, by rename; `read_frame` reads it.

    The view and a digest of the pixels are added to `meta`. Raises `MachineError` for a full disk.
    """
    meta = {"view": plain(view), **meta, "digest": pixels_digest(pixels)}
    header = {
        "compression": OpenEXR.ZIP_COMPRESSION,
        "type": OpenEXR.scanlineimage,
        "worldToCamera": np.linalg.inv(view.pose).astype(np.float32),
        "pbrnet": json.dumps(plain(meta), sort_keys=True, allow_nan=False),
    }
    with atomic_file(path) as partial:
        try:
            with OpenEXR.File(header, pixels) as file:
                file.write(str(partial))
        except (RuntimeError, ValueError) as error:
            raise _write_error(path, error) from error


def read_frame(path: Path, verify: bool = True) -> Frame:
    """Read a frame; `InputError` if it is missing, truncated, foreign or (if `verify`) damaged."""
    meta = read_meta(path)
    try:
        with OpenEXR.File(str(path), separate_channels=True) as file:
            channels = {name: channel.pixels for name, channel in file.channels().items()}
    except (RuntimeError, ValueError) as error:
        raise InputError(f"{path}: damaged or truncated EXR ({error})") from None
    if verify and pixels_digest(channels) != meta.get("digest"):
        raise InputError(f"{path}: the pixels do not match their checksum; the file is damaged")
    return Frame(channels, meta)


def read_meta(path: Path) -> dict[str, Any]:
    """Read only the `pbrnet` attribute of a frame; errors as in `read_frame`."""
    path = Path(path)
    if not path.is_file():
        raise InputError(f"{path}: no such frame")
    try:
        with OpenEXR.File(str(path), header_only=True) as file:
            text = file.header().get("pbrnet")
    except (RuntimeError, ValueError) as error:
        raise InputError(f"{path}: not a readable EXR ({error})") from None
    if not isinstance(text, str):
        raise InputError(f"{path}: an EXR, but not a pbrnet frame (no 'pbrnet' attribute)")
    try:
        meta: dict[str, Any] = json.loads(text)
    except json.JSONDecodeError:
        raise InputError(f"{path}: its 'pbrnet' attribute is not valid JSON") from None
    return meta


def holds(path: Path, expected: str, verify: bool = False) -> bool:
    """Whether a complete frame with this fingerprint lies at `path`; with `verify` its pixels are
    read, too, and compared with their checksum."""
    try:
        if read_meta(path).get("fingerprint") != expected or not is_complete(path):
            return False
        if verify:
            read_frame(path)
    except InputError:
        return False
    return True


def is_complete(path: Path) -> bool:
    """Whether a frame file is as long as its own table of chunks says: finds truncated files
    without reading pixels (OpenEXR file layout, single-part scan lines)."""
    try:
        with Path(path).open("rb") as stream:
            size = stream.seek(0, os.SEEK_END)
            stream.seek(8)  # magic number and version
            while _read_name(stream):
                _read_name(stream)  # the attribute's type
                stream.seek(int.from_bytes(stream.read(4), "little"), os.SEEK_CUR)
            table = stream.tell()
            first = int.from_bytes(stream.read(8), "little")
            if not table + 8 <= first < size:
                return False
            stream.seek(first - 8)  # chunks follow the table: its last entry lies before them
            last = int.from_bytes(stream.read(8), "little")
            stream.seek(last + 4)  # past the chunk's first line number
            length = int.from_bytes(stream.read(4), "little")
            return first <= last and last + 8 + length == size
    except OSError:
        return False


def pixels_digest(channels: Channels) -> str:
    """SHA-256 over channel names, shapes and pixel bytes, in name order."""
    parts = []
    for name in sorted(channels):
        values = np.ascontiguousarray(channels[name])
        parts += [name.encode(), str((values.dtype.str, values.shape)).encode(), values.tobytes()]
    return digest_bytes(*parts)


def _read_name(stream: BinaryIO) -> bytes:
    name = b""
    while (byte := stream.read(1)) not in (b"", b"\0"):
        name += byte
    return name


def _write_error(path: Path, error: Exception) -> Exception:
    words = str(error).lower()
    if "no space" in words or getattr(error, "errno", None) == errno.ENOSPC:
        return MachineError(f"{path}: the disk is full; free some space and run again")
    return MachineError(f"{path}: cannot be written ({error})")
