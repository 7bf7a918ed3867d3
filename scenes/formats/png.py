"""Writing of PNG files that hold noise, such as textures with grain.

Pillow tries all five filters on each row, which takes most of its time and saves a twentieth of
such a file. Here every row is the difference to the left neighbour, and Huffman coding alone
follows: noise hardly repeats.
"""

from __future__ import annotations

import struct
import zlib
from pathlib import Path

import numpy as np

from scenes.arrays import UInt8Array

_SIGNATURE = b"\x89PNG\r\n\x1a\n"
_SUB = 1  # filter: difference to the byte of the same channel in the pixel to the left
_COLOR_TYPES = {1: 0, 3: 2}  # channels -> grey or RGB


def write_png(path: Path, image: UInt8Array) -> None:
    """Write an image, uint8 (H, W) or (H, W, 3), of at least one pixel.

    Source: Portable Network Graphics (PNG) Specification, third edition, sections 5, 9 and 11.
    """
    pixels = image[:, :, None] if image.ndim == 2 else image
    height, width, channels = pixels.shape
    rows = np.empty((height, 1 + width * channels), dtype=np.uint8)
    rows[:, 0] = _SUB
    filtered = rows[:, 1:].reshape(height, width, channels)
    filtered[:, 0] = pixels[:, 0]
    np.subtract(pixels[:, 1:], pixels[:, :-1], out=filtered[:, 1:])  # modulo 256
    coder = zlib.compressobj(1, zlib.DEFLATED, 15, 9, zlib.Z_HUFFMAN_ONLY)
    header = struct.pack(">IIBBBBB", width, height, 8, _COLOR_TYPES[channels], 0, 0, 0)
    path.write_bytes(
        _SIGNATURE
        + _chunk(b"IHDR", header)
        + _chunk(b"IDAT", coder.compress(rows.data) + coder.flush())
        + _chunk(b"IEND", b"")
    )


def _chunk(kind: bytes, data: bytes) -> bytes:
    return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))
