"""Images of an imported scene: checked, and copied or re-encoded into the scene folder."""

from __future__ import annotations

import re
import shutil
from collections.abc import Callable
from pathlib import Path

import numpy as np
import OpenEXR
from PIL import Image

from pbrnet.scenes.arrays import Float32Array, Float64Array, FloatingArray, UInt8Array
from pbrnet.scenes.color import decode_srgb, encode_srgb
from pbrnet.scenes.errors import InputError
from pbrnet.scenes.image_files import (
    MAX_PIXELS,
    UnreadableImage,
    eight_bits,
    exr_channels,
    is_intact,
    open_image,
)
from pbrnet.scenes.importing.changes import Changes

_COPIED = {"JPEG": (".jpg", ("RGB", "L")), "PNG": (".png", ("RGB", "L", "RGBA", "LA"))}
_MIN_SIDE = 2  # pixels of a texture that Mitsuba takes
_EXR_MAGIC = b"\x76\x2f\x31\x01"


class TextureStore:
    """Stores images in `folder`, each use of an image once, under unique names.

    Every method takes the path of a source image and returns the path of the stored file,
    relative to the scene folder. Raises `UnreadableImage` for damaged images.
    """

    def __init__(self, folder: Path, changes: Changes) -> None:
        self.folder, self.changes = folder, changes
        self._stored: dict[tuple[Path, str], str] = {}

    def color(self, path: Path) -> str:
        """Store a colour image."""
        return self._store(path, "color", self._write_color)

    def alpha(self, path: Path) -> str | None:
        """Store the alpha channel as greyscale; None if the image has none."""
        if _is_exr(path):
            return None
        image = open_image(path)
        if "A" not in image.getbands() and "transparency" not in image.info:
            return None
        return self._store(path, "alpha", lambda source, name: self._write_channel(source, name, 3))

    def channel(self, path: Path, index: int) -> str:
        """Store one channel (0 red ... 3 alpha) as greyscale."""
        return self._store(
            path, f"channel{index}", lambda source, name: self._write_channel(source, name, index)
        )

    def scaled(self, path: Path, factor: Float64Array) -> str:
        """Store a colour image with its linear values times `factor` (3,), clipped to [0, 1]."""

        def write(source: Path, name: str) -> str:
            linear = _decode(read_rgb(source)) if not _is_exr(source) else read_exr(source)
            return self._save_rgb(np.clip(linear * factor, 0, 1), name)

        return self._store(path, f"scaled{factor.tolist()}", write)

    def channel_scaled(self, path: Path, index: int, factor: float) -> str:
        """Store one channel (0 red ... 3 alpha) times `factor`, clipped, as greyscale."""

        def write(source: Path, name: str) -> str:
            band = _band(source, index).astype(np.float64)
            return self._save_grey(np.clip(band * factor, 0, 255), name)

        return self._store(path, f"channel{index}x{factor}", write)

    def cutout(self, path: Path, factor: float, cutoff: float) -> str:
        """Store a mask, white where alpha times `factor` is at least `cutoff` (both [0, 1])."""

        def write(source: Path, name: str) -> str:
            alpha = _band(source, 3).astype(np.float64)
            return self._save_grey(255.0 * (alpha * factor >= 255 * cutoff), name)

        return self._store(path, f"cutout{factor}-{cutoff}", write)

    def radiance(
        self,
        path: Path,
        factor: tuple[float, float, float] = (1.0, 1.0, 1.0),
        convert: Callable[[Float32Array], Float32Array] | None = None,
    ) -> str:
        """Store an HDR image (environment, emission) times `factor` as EXR, RGB float32.

        `convert` changes the pixels (H, W, 3) first; such an image is stored at each call.
        """

        def write(source: Path, name: str) -> str:
            pixels = read_radiance(source)
            scaled = (pixels if convert is None else convert(pixels)) * np.array(factor, np.float32)
            return self._save_exr(scaled.astype(np.float32), name)

        use = f"radiance{factor}"
        if convert is not None:
            use += f"-{len(self._stored)}"
        return self._store(path, use, write)

    def _store(self, path: Path, use: str, write: object) -> str:
        key = (path, use)
        if key not in self._stored:
            stem = re.sub(r"[^A-Za-z0-9-]+", "_", path.stem).strip("_")[:80] or "image"
            name = stem if use == "color" else f"{stem}_{re.sub(r'[^a-z0-9].*', '', use)}"
            taken = {Path(stored).stem.lower() for stored in self._stored.values()}
            unique, count = name, 1
            while unique.lower() in taken:
                count += 1
                unique = f"{name}_{count}"
            self._stored[key] = write(path, unique)  # type: ignore[operator]
        return self._stored[key]

    def _write_color(self, path: Path, name: str) -> str:
        if _is_exr(path):
            self.changes.note("EXR texture stored as 8-bit PNG: {}", path.name)
            return self._save_rgb(np.clip(read_exr(path), 0, 1), name)
        image = open_image(path)
        suffix, modes = _COPIED.get(image.format or "", ("", ()))
        if suffix and image.mode in modes and not is_intact(path):
            self.changes.note("an image with wrong checksums was written anew: {}", path.name)
        elif suffix and image.mode in modes and min(image.size) >= _MIN_SIDE:
            shutil.copyfile(path, self.folder / (name + suffix))
            (self.folder / (name + suffix)).chmod(0o644)
            return f"{self.folder.name}/{name}{suffix}"
        return self._save_png(_to_rgb8(image), name)

    def _write_channel(self, path: Path, name: str, index: int) -> str:
        return self._save_png(_band(path, index), name)

    def _save_rgb(self, linear: FloatingArray, name: str) -> str:
        return self._save_png(np.rint(encode_srgb(linear) * 255).astype(np.uint8), name)

    def _save_grey(self, pixels: FloatingArray, name: str) -> str:
        return self._save_png(np.rint(pixels).astype(np.uint8), name)

    def _save_png(self, pixels: UInt8Array, name: str) -> str:
        """Save 8-bit pixels (H, W) or (H, W, 3), repeated where Mitsuba would refuse so few."""
        for axis in (0, 1):
            if pixels.shape[axis] < _MIN_SIDE:
                pixels = np.repeat(pixels, _MIN_SIDE, axis=axis)
        Image.fromarray(pixels).save(self.folder / f"{name}.png")
        return f"{self.folder.name}/{name}.png"

    def _save_exr(self, pixels: Float32Array, name: str) -> str:
        header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
        with OpenEXR.File(header, {"RGB": np.ascontiguousarray(pixels)}) as file:
            file.write(str(self.folder / f"{name}.exr"))
        return f"{self.folder.name}/{name}.exr"


def read_rgb(path: Path) -> UInt8Array:
    """Read an image as 8-bit sRGB, uint8 (H, W, 3)."""
    return _to_rgb8(open_image(path))


def is_encoded(path: Path) -> bool:
    """Test whether an image has 8 or 16 bits of a display's range, not linear radiance."""
    return not _is_exr(path) and path.suffix.lower() not in (".hdr", ".rgbe", ".pic", ".pfm")


def read_radiance(path: Path) -> Float32Array:
    """Read an EXR, Radiance HDR, PFM or 8-bit image as linear RGB, float32 (H, W, 3), positive."""
    if _is_exr(path):
        pixels = read_exr(path)
    elif path.suffix.lower() in (".hdr", ".rgbe", ".pic"):
        pixels = read_rgbe(path)
    elif path.suffix.lower() == ".pfm":
        pixels = read_pfm(path)
    else:
        pixels = _decode(read_rgb(path))
    if not np.isfinite(pixels).all():
        pixels = np.where(np.isfinite(pixels), pixels, 0)
    return np.maximum(pixels, 0).astype(np.float32)


def read_exr(path: Path) -> Float32Array:
    """Read the colour of an EXR as float32 (H, W, 3); a grey channel is repeated."""
    channels = exr_channels(path)
    bands = [
        next((c for n, c in channels.items() if n == band or n.endswith("." + band)), None)
        for band in "RGB"
    ]
    if any(band is None for band in bands):
        if not channels:
            raise UnreadableImage("no channels")
        grey = channels.get("Y", next(iter(channels.values())))
        bands = [grey] * 3
    return np.stack([np.asarray(band, dtype=np.float32) for band in bands], axis=-1)


def read_rgbe(path: Path) -> Float32Array:
    """Read a Radiance HDR file, flat or run-length coded, as linear RGB float32 (H, W, 3).

    Ward, *Real Pixels* (Graphics Gems II, 1991).
    """
    data = path.read_bytes()
    match = re.search(rb"\n\n-Y (\d{1,6}) \+X (\d{1,6})\n", data[:65536])
    if not data.startswith(b"#?") or match is None:
        raise UnreadableImage("not a Radiance HDR image in the usual orientation")
    height, width = int(match[1]), int(match[2])
    if height * width > MAX_PIXELS or height * width == 0:
        raise UnreadableImage(f"{width} x {height} pixels")
    body = np.frombuffer(data, dtype=np.uint8, offset=match.end())
    if body.size < 4 * height:
        raise UnreadableImage("truncated")
    rgbe = np.zeros((height, width, 4), dtype=np.uint8)
    at = 0
    for row in range(height):
        coded = 8 <= width < 32768 and at + 4 <= body.size
        if not (coded and body[at] == 2 and body[at + 1] == 2):
            if body.size - at < 4 * width:
                raise UnreadableImage("truncated")
            rgbe[row] = body[at : at + 4 * width].reshape(width, 4)
            at += 4 * width
            continue
        at += 4
        for band in range(4):
            column = 0
            while column < width:
                if at + 1 >= body.size:
                    raise UnreadableImage("truncated")
                length = int(body[at])
                if length > 128:
                    length -= 128
                    piece = np.full(length, body[at + 1])
                    at += 2
                else:
                    piece = body[at + 1 : at + 1 + length]
                    at += 1 + length
                if length == 0 or column + length > width or piece.size != length:
                    raise UnreadableImage("damaged run-length code")
                rgbe[row, column : column + length, band] = piece
                column += length
    scale = np.ldexp(1.0, rgbe[..., 3].astype(int) - 136)
    return (rgbe[..., :3] * scale[..., None]).astype(np.float32)


def read_pfm(path: Path) -> Float32Array:
    """Read a portable float map, colour or grey, as float32 (H, W, 3)."""
    data = path.read_bytes()
    match = re.match(rb"P([Ff])\s+(\d{1,6})\s+(\d{1,6})\s+(-?\d[\d.eE+-]{0,20})\s", data[:4096])
    if match is None:
        raise UnreadableImage("not a portable float map")
    width, height, bands = int(match[2]), int(match[3]), 3 if match[1] == b"F" else 1
    if not 1 <= width * height <= MAX_PIXELS:
        raise UnreadableImage(f"{width} x {height} pixels")
    order = "<f4" if match[4].startswith(b"-") else ">f4"
    if len(data) - match.end() < 4 * bands * width * height:
        raise UnreadableImage("truncated")
    values = np.frombuffer(data, order, bands * width * height, match.end())
    pixels = values.reshape(height, width, bands)[::-1].astype(np.float32)  # bottom row first
    return np.repeat(pixels, 3, axis=2) if bands == 1 else pixels


def _to_rgb8(image: Image.Image) -> UInt8Array:
    return np.asarray(eight_bits(image).convert("RGB"))


def _band(path: Path, index: int) -> UInt8Array:
    """Read one channel (0 red ... 3 alpha) of an image, uint8 (H, W)."""
    return np.asarray(eight_bits(open_image(path)).convert("RGBA").getchannel(index))


def _decode(pixels: UInt8Array) -> Float32Array:
    return decode_srgb(pixels.astype(np.float32) / 255)


def _is_exr(path: Path) -> bool:
    try:
        with path.open("rb") as stream:
            return stream.read(4) == _EXR_MAGIC
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror})") from None
