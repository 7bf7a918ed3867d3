"""Frames: self-describing OpenEXR files, one per view and kind, complete or absent.

Channels are linear and scene-referred; `pbrnet.pipeline.channels` lists them. The kinds:

* `inputs`: depth, normal, reflectance, valid mask, object index
* `illumination`: panorama of visible lamps and openings: intensity, distance, tint
* `visibility`: share of the direct light of the panorama's sources that reaches the surface; only
  if `illumination.shadow_rays` is above 0
* `shading`: radiance with every reflectance replaced by one grey
* `color`: radiance of the full scene
* `noisy`: colour and shading with few samples per pixel, independent of those of `color` and
  `shading`, as traced and denoised; only if `noisy.spp` is above 0
* `materials`: roughness, metalness, specular colour, bumped normal, emission, material ids; only
  if `channels` names that set
* `labels`: ids of instances, classes and materials, and tables that describe them; likewise
* `video`: optical flow to the neighbours in a trajectory, and what they do not see; likewise
* `environment`: panorama of all that the camera position sees: radiance, distance, normal; likewise
* `light`: direct light, diffusely reflected light and irradiance in `color`; likewise; light groups
  if `light.groups` is above 0

Attributes: `worldToCamera` (4x4, OpenCV axes) and `pbrnet`, a JSON object with the view, the seed,
spp, noise, renderer, `fingerprint` of everything that determines the pixels, and `digest` of the
pixels. Frames of radiance in half floats store it in a unit of their own, `radiance_scale`, also an
attribute of the file, `radianceScale`; reading multiplies by it (`pbrnet.pipeline.channels`).

Files are read and written with the package OpenEXR, because Mitsuba's bitmap code hangs if its
thread pool has one thread.
"""

from __future__ import annotations

import errno
import json
import os
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
import OpenEXR

from pbrnet.pipeline.channels import (
    HALF_MAX,
    RGB,
    Kind,
    is_scale,
    layout,
    radiance_halves,
    scale_for,
)
from pbrnet.pipeline.views import View
from pbrnet.scenes.arrays import AnyArray, Float32Array
from pbrnet.scenes.checked import build, plain, shown
from pbrnet.scenes.errors import InputError, MachineError
from pbrnet.scenes.files import atomic_file, digest_bytes, parse_json
from pbrnet.scenes.image_files import UnreadableImage, exr_channels, exr_header

Channels = dict[str, AnyArray]
Result = tuple[Channels, dict[str, Any]]  # channels, and further entries of the attribute

MAX_PIXELS = 2**28  # of a frame
EXPOSURE_TIME = "exposure_time"  # entry of the attribute where the camera moves in the exposure


@dataclass(frozen=True)
class Frame:
    """Pixels by channel name, each (H, W), and the `pbrnet` attribute.

    Radiance that is stored as half floats is float32 here, in the renderer's unit.
    """

    channels: Channels
    meta: dict[str, Any]

    def stack(self, *names: str) -> Float32Array:
        """Return several channels as float32 (H, W, len(names))."""
        return np.stack([self.channels[name].astype(np.float32) for name in names], axis=-1)

    @property
    def radiance_scale(self) -> float:
        """Unit in which the file stores radiance as half floats; 1 in older frames."""
        return float(self.meta.get("radiance_scale", 1.0))

    @property
    def rgb(self) -> Float32Array:
        """`R`, `G`, `B` as float32 (H, W, 3)."""
        return self.stack(*RGB)


def stacked(channels: Channels, names: Sequence[str] = RGB) -> AnyArray:
    """Return channels as one image, (H, W, len(names)); R, G and B unless named."""
    return np.stack([channels[name] for name in names], axis=-1)


def banded(image: AnyArray, names: Sequence[str] = RGB) -> Channels:
    """Return the bands of an image (H, W, len(names)) as channels of these names."""
    return {name: image[..., index] for index, name in enumerate(names)}


def fingerprint(**determined_by: Any) -> str:
    """Return a digest of everything that determines a frame's pixels."""
    text = json.dumps(plain(determined_by, brief=True), sort_keys=True, allow_nan=False)
    return digest_bytes(text.encode())


def frame_path(data: Path, kind: Kind, view: View) -> Path:
    """Return the path of a frame below the data folder."""
    return Path(data) / kind / view.scene_id / f"{view.view_id}.exr"


def camera_of(view: View, kind: Kind, moves: bool = False) -> View:
    """Return the part of a view that determines pixels: without its score and object counts.

    The neighbours in a trajectory determine frames of `video`, and those that `moves` says are
    exposed while the camera moves.
    """
    camera = replace(
        view, score=0.0, seen={}, stereo_partner="", stereo_offset=0.0, view_set="", set_overlap=0.0
    )
    if kind == "video" or moves:
        return camera
    return replace(camera, trajectory="", frame=-1, pose_before=(), pose_after=())


def write_frame(path: Path, kind: Kind, channels: Channels, view: View, **meta: Any) -> None:
    """Write a frame of a view's camera by rename; `meta` must hold `fingerprint`.

    `channels` holds exactly the names of `layout(kind)`, each (H, W); a `light` frame also those of
    the groups in `light_names`. Half floats of radiance are stored in the unit `radiance_scale`,
    if `meta` does not hold it in that of `frame_scale`. Values beyond the range of half floats are
    clamped; the attribute `clamped` is their number. Raises ValueError for wrong channels, NaN or
    infinity, and `MachineError` for a full disk.
    """
    lights = len(meta.get("light_names", ()))
    dtypes = layout(kind, lights)
    if set(channels) != set(dtypes):
        raise ValueError(f"{path}: channels {sorted(channels)}, expected {sorted(dtypes)}")
    halves = radiance_halves(kind, lights)
    if halves:
        meta.setdefault("radiance_scale", frame_scale(kind, channels, lights))
    scale = meta.get("radiance_scale", 1.0)
    clamped = 0
    for name, dtype in dtypes.items():
        values = np.asarray(channels[name])
        if np.issubdtype(values.dtype, np.floating) and not np.isfinite(values).all():
            raise ValueError(f"{path}: channel {name} contains NaN or infinity")
        if dtype is np.float16:
            limit = HALF_MAX * (scale if name in halves else 1)
            clamped += int((np.abs(values, dtype=np.float64) > limit).sum())
    pixels = as_stored(kind, channels, scale, lights)
    camera = camera_of(view, kind, EXPOSURE_TIME in meta)
    write_pixels(path, pixels, camera, {"kind": kind, "clamped": clamped, **meta})


def frame_scale(kind: Kind, channels: Channels, lights: int = 0) -> float:
    """Return the unit in which a frame stores radiance as half floats, by its main image."""
    halves = radiance_halves(kind, lights)
    return scale_for(channels[band] for band in (RGB if set(RGB) <= set(halves) else halves))


def as_stored(kind: Kind, channels: Channels, scale: float, lights: int = 0) -> Channels:
    """Return channels in the types of the frame; half floats are clamped to their range.

    Half floats of radiance are divided by `scale`.
    """
    pixels: Channels = {}
    halves = radiance_halves(kind, lights)
    for name, dtype in layout(kind, lights).items():
        values = np.asarray(channels[name])
        if name in halves:
            values = values / scale
        if dtype is np.float16:
            values = np.clip(values, -HALF_MAX, HALF_MAX)
        pixels[name] = np.ascontiguousarray(values, dtype=dtype)
    return pixels


def write_pixels(path: Path, pixels: Channels, view: View, meta: dict[str, Any]) -> None:
    """Write an OpenEXR file of these channels, unchanged, by rename; `read_frame` reads it.

    The view and a digest of the pixels are added to `meta`. Raises `MachineError` for a full disk.
    """
    camera = plain(view, brief=True)
    for name in ("score", "seen"):  # of the choice of views, which camera files hold
        camera.pop(name, None)
    meta = {"view": camera, **meta, "digest": pixels_digest(pixels)}
    header = {
        "compression": OpenEXR.ZIP_COMPRESSION,
        "type": OpenEXR.scanlineimage,
        "worldToCamera": np.linalg.inv(view.pose).astype(np.float32),
        "pbrnet": json.dumps(plain(meta, brief=True), sort_keys=True, allow_nan=False),
    }
    if "radiance_scale" in meta:
        header["radianceScale"] = float(meta["radiance_scale"])
    with atomic_file(path) as partial:
        try:
            with OpenEXR.File(header, pixels) as file:
                file.write(str(partial))
        except (RuntimeError, ValueError) as error:
            raise write_error(path, error) from error


def read_frame(path: Path, verify: bool = True) -> Frame:
    """Read a frame, radiance in the renderer's unit.

    Raises `InputError` if it is missing, truncated, no pbrnet frame, or, with `verify`, damaged.
    """
    meta = read_meta(path)
    try:
        channels = exr_channels(path, MAX_PIXELS)
    except UnreadableImage as error:
        raise InputError(f"{path}: damaged or truncated EXR ({error})") from None
    if verify and pixels_digest(channels) != meta.get("digest"):
        raise InputError(f"{path}: the pixels do not match their checksum; the file is damaged")
    return Frame(_multiplied(channels, meta, path), meta)


def _multiplied(channels: Channels, meta: dict[str, Any], path: Path) -> Channels:
    """Return channels as read, with half floats of radiance as float32 in the renderer's unit."""
    if "radiance_scale" not in meta:
        return channels
    scale, names = meta["radiance_scale"], meta.get("light_names")
    if not is_scale(scale):
        raise InputError(f"{path}: radiance_scale: {shown(scale)}, expected a power of two")
    halves = radiance_halves(str(meta.get("kind")), len(names) if isinstance(names, list) else 0)
    scaled = {
        name: channels[name].astype(np.float32) * np.float32(scale)
        for name in halves
        if name in channels
    }
    return channels | scaled


def read_meta(path: Path) -> dict[str, Any]:
    """Read only the `pbrnet` attribute of a frame; raises `InputError` like `read_frame`."""
    path = Path(path)
    if not path.exists():
        raise InputError(f"{path}: no such frame")
    try:
        text = exr_header(path, MAX_PIXELS).get("pbrnet")
    except UnreadableImage as error:
        raise InputError(f"{path}: not a readable EXR ({error})") from None
    if not isinstance(text, str):
        raise InputError(f"{path}: an EXR, but not a pbrnet frame (no 'pbrnet' attribute)")
    meta = parse_json(text, f"{path}: its 'pbrnet' attribute")
    if not isinstance(meta, dict):
        raise InputError(f"{path}: its 'pbrnet' attribute is not a JSON object; not a pbrnet frame")
    return meta


def view_of(meta: dict[str, Any], path: Path) -> View:
    """Return the view that a frame's attribute names; `InputError` if there is none."""
    return build(View, meta.get("view"), f"{path}: view", InputError)


def check_frame(
    frame: Frame, path: Path, names: Iterable[str], size: tuple[int, int] | None
) -> None:
    """Raise `InputError` unless a frame has these channels, a size (width, height) and no NaN.

    Without `size`, all channels must have one size.
    """
    kind = frame.meta.get("kind")
    for name in names:
        if name not in frame.channels:
            raise InputError(f"{path}: a frame of {shown(kind)}, without the channel {name!r}")
    for name, values in frame.channels.items():
        size = size or values.shape[1::-1]
        if values.shape != size[::-1]:
            found = " x ".join(map(str, values.shape[::-1]))
            raise InputError(f"{path}: {name} has {found} pixels, expected {size[0]} x {size[1]}")
        if np.issubdtype(values.dtype, np.floating) and not np.isfinite(values).all():
            raise InputError(f"{path}: the channel {name!r} holds NaN or infinity; render it again")


def holds(path: Path, expected: Iterable[str], verify: bool = False) -> bool:
    """Test whether a complete frame with one of these fingerprints lies at `path`.

    With `verify` its pixels are read as well, and compared with their checksum.
    """
    try:
        if str(read_meta(path).get("fingerprint")) not in expected or not is_complete(path):
            return False
        if verify:
            read_frame(path)
    except InputError:
        return False
    return True


def is_complete(path: Path) -> bool:
    """Test whether a frame file is as long as its own table of chunks says.

    Detects truncated files without reading pixels (OpenEXR file layout, single-part scan lines).
    """
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
    """Return the SHA-256 digest of channel names, shapes and pixel bytes, in name order."""
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


def write_error(path: Path, error: Exception) -> MachineError:
    """Return the error of an OpenEXR file that could not be written."""
    message = str(error).lower()
    if "no space" in message or getattr(error, "errno", None) == errno.ENOSPC:
        return MachineError(f"{path}: the disk is full; free some space and run again")
    return MachineError(f"{path}: cannot be written ({error})")
