"""Reading of image files from outside: the one place that opens them.

Pillow selects a decoder by a file's content, not its name, and some decoders run other programs
(EPS starts Ghostscript). `open_image` therefore admits a fixed list of formats, regular files
only, and a bounded number of pixels. Textures of Basis Universal (KTX 2.0 files, as in glTF's
KHR_texture_basisu) are decoded by the library opengl_basisu, under the same limits.
"""

from __future__ import annotations

import io
import stat
import sys
import threading
import warnings
from pathlib import Path
from typing import Any

import numpy as np
import OpenEXR
from PIL import Image, ImageOps

from pbrnet.scenes.arrays import AnyArray
from pbrnet.scenes.errors import InputError, MachineError
from pbrnet.scenes.files import regular_file
from pbrnet.scenes.installation import optional

FORMATS = ("PNG", "JPEG", "BMP", "GIF", "TGA", "TIFF", "PPM", "WEBP")
MAX_PIXELS = 100_000_000
MAX_KTX_BYTES = 512 * 2**20
MAX_EXR_BYTES = 2**32
_KTX_MAGIC = b"\xabKTX 20\xbb\r\n\x1a\n"


class UnreadableImage(InputError):
    """The file is not an image of a known format, is damaged, or too large."""


def open_image(source: Path | bytes, *, load: bool = True, upright: bool = False) -> Image.Image:
    """Return the image in a file or in bytes; with `load=False` only the header is read.

    `upright`: turn a photograph as its EXIF orientation says.

    Raises `UnreadableImage` for everything that is wrong with it.
    """
    try:
        if isinstance(source, Path) and not stat.S_ISREG(source.stat().st_mode):
            raise UnreadableImage("not a regular file")
        if _starts_with_ktx(source):
            return _open_ktx(source)
        with warnings.catch_warnings():
            warnings.simplefilter("error", Image.DecompressionBombWarning)
            image: Image.Image = Image.open(
                io.BytesIO(source) if isinstance(source, bytes) else source, formats=FORMATS
            )
            if image.width * image.height > MAX_PIXELS:
                raise UnreadableImage(f"{image.width} x {image.height} pixels")
            if load:
                image.load()
            if upright:
                image = ImageOps.exif_transpose(image)
    except (MachineError, UnreadableImage):
        raise
    except (Image.DecompressionBombError, Image.DecompressionBombWarning) as error:
        raise UnreadableImage(str(error)) from None
    except Image.UnidentifiedImageError:
        raise UnreadableImage(
            f"not an image of a known format ({', '.join(FORMATS)}, KTX2)"
        ) from None
    except (OSError, ValueError, TypeError, SyntaxError, EOFError, MemoryError) as error:
        raise UnreadableImage(str(error)) from None
    except Exception as error:  # decoders raise what their authors did not foresee
        raise UnreadableImage(f"damaged ({type(error).__name__}: {error})") from None
    return image


def eight_bits(image: Image.Image) -> Image.Image:
    """Return an image with 8 bits a channel: Pillow's conversions clip 16 bits instead of scaling.

    Raises `UnreadableImage` for floating-point pixels, whose range no such format states.
    """
    if image.mode == "F":
        raise UnreadableImage("floating-point pixels; save it as EXR or with 16 bits")
    if not image.mode.startswith("I"):
        return image
    return Image.fromarray((np.clip(np.asarray(image), 0, 0xFFFF) >> 8).astype(np.uint8))


def exr_header(path: Path, most: int = MAX_PIXELS) -> dict[str, Any]:
    """Return the header of an EXR image from outside, whose pixels can be read.

    Raises `UnreadableImage` for damage, deep images, subsampled channels, and more than `most`
    pixels, or 16 times as many numbers.
    """
    regular_file(path, MAX_EXR_BYTES)
    try:
        with OpenEXR.File(str(path), header_only=True) as file:
            header = dict(file.header())  # the library's own is emptied with the file
            low, high = header["dataWindow"]
            width, height = (int(b) - int(a) + 1 for a, b in zip(low, high, strict=True))
            sampling = [(each.xSampling, each.ySampling) for each in header["channels"]]
    except (AttributeError, KeyError, OSError, RuntimeError, TypeError, ValueError) as error:
        raise UnreadableImage(str(error)) from None
    if min(width, height) < 1 or width * height * max(1, len(sampling) / 16) > most:
        raise UnreadableImage(f"{width} x {height} pixels, {len(sampling)} channels")
    if "deep" in str(header.get("type", "")):
        raise UnreadableImage("a deep image; expected one value a pixel")
    if set(sampling) - {(1, 1)}:
        raise UnreadableImage("subsampled channels; expected a value for each pixel")
    return header


def exr_channels(path: Path, most: int = MAX_PIXELS) -> dict[str, AnyArray]:
    """Return the channels of an EXR image from outside by name, each (H, W).

    Raises `UnreadableImage` as `exr_header` does, and for pixels that cannot be decoded: the
    library may leave them at 0 and print that.
    """
    exr_header(path, most)
    try:
        with _LISTENER as said, OpenEXR.File(str(path), separate_channels=True) as file:
            channels = {name: channel.pixels for name, channel in file.channels().items()}
    except (RuntimeError, ValueError):
        raise UnreadableImage("damaged or truncated") from None
    if "Exception raised" in said.getvalue():
        raise UnreadableImage("damaged pixels")
    return channels


class _Listener:
    """Standard output while the library OpenEXR reads, which prints there what it cannot decode.

    Each thread that reads gets what it prints itself; what other threads print passes through.
    """

    def __init__(self) -> None:
        self._lock, self._readers = threading.Lock(), 0
        self._own, self._here = sys.stdout, threading.local()

    def __enter__(self) -> io.StringIO:
        said = self._here.said = io.StringIO()
        with self._lock:
            if not self._readers:
                self._own, sys.stdout = sys.stdout, self  # type: ignore[assignment]
            self._readers += 1
        return said

    def __exit__(self, *_: object) -> None:
        del self._here.said
        with self._lock:
            self._readers -= 1
            if not self._readers:
                sys.stdout = self._own

    def write(self, text: str) -> int:
        return getattr(self._here, "said", self._own).write(text)

    def __getattr__(self, name: str) -> Any:
        return getattr(self._own, name)


_LISTENER = _Listener()


def _starts_with_ktx(source: Path | bytes) -> bool:
    if isinstance(source, bytes):
        return source.startswith(_KTX_MAGIC)
    with source.open("rb") as stream:
        return stream.read(len(_KTX_MAGIC)) == _KTX_MAGIC


def _open_ktx(source: Path | bytes) -> Image.Image:
    """The first image of a KTX 2.0 file, decoded from ETC1S or UASTC to 8-bit RGB or RGBA."""
    if isinstance(source, Path) and source.stat().st_size > MAX_KTX_BYTES:
        raise UnreadableImage(f"larger than the limit of {MAX_KTX_BYTES >> 20} MiB")
    basis = optional("opengl_basisu")
    try:
        texture = basis.open(source)
        if texture.width * texture.height > MAX_PIXELS:
            raise UnreadableImage(f"{texture.width} x {texture.height} pixels")
        mode = "RGBA" if texture.has_alpha else "RGB"
        pixels = texture.transcode("rgba8").data
    except basis.BasisuError as error:
        raise UnreadableImage(
            f"a KTX2 image that cannot be decoded ({error}); convert the model's textures to PNG "
            "or WebP, for example with 'gltf-transform webp'"
        ) from None
    return Image.fromarray(pixels[:, :, : len(mode)])


def is_intact(path: Path) -> bool:
    """Return whether all checksums of an image file are right and its end is there.

    Pillow decodes some files with such errors; libpng, and so Mitsuba, refuses them.
    """
    try:
        with Image.open(path, formats=FORMATS) as image:
            image.verify()
    except Exception:
        return False
    return True
