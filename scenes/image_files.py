"""Reading of image files from outside: the one place that opens them.

Pillow selects a decoder by a file's content, not its name, and some decoders run other programs
(EPS starts Ghostscript). `open_image` therefore admits a fixed list of formats, regular files
only, and a bounded number of pixels.
"""

from __future__ import annotations

import io
import stat
import warnings
from pathlib import Path

from PIL import Image

from scenes.errors import InputError

FORMATS = ("PNG", "JPEG", "BMP", "GIF", "TGA", "TIFF", "PPM", "WEBP")
MAX_PIXELS = 100_000_000


class UnreadableImage(InputError):
    """The file is not an image of a known format, is damaged, or too large."""


def open_image(source: Path | bytes, *, load: bool = True) -> Image.Image:
    """Return the image in a file or in bytes; with `load=False` only its header is read.

    Raises `UnreadableImage` for everything that is wrong with it.
    """
    try:
        if isinstance(source, Path) and not stat.S_ISREG(source.stat().st_mode):
            raise UnreadableImage("not a regular file")
        with warnings.catch_warnings():
            warnings.simplefilter("error", Image.DecompressionBombWarning)
            image = Image.open(
                io.BytesIO(source) if isinstance(source, bytes) else source, formats=FORMATS
            )
            if image.width * image.height > MAX_PIXELS:
                raise UnreadableImage(f"{image.width} x {image.height} pixels")
            if load:
                image.load()
    except (Image.DecompressionBombError, Image.DecompressionBombWarning) as error:
        raise UnreadableImage(str(error)) from None
    except Image.UnidentifiedImageError:
        raise UnreadableImage(f"not an image of a known format ({', '.join(FORMATS)})") from None
    except (OSError, ValueError, TypeError, SyntaxError, EOFError, MemoryError) as error:
        raise UnreadableImage(str(error)) from None
    except Exception as error:  # decoders raise what their authors did not foresee
        raise UnreadableImage(f"damaged ({type(error).__name__}: {error})") from None
    return image


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
