"""Images of an exported scene, in the forms that interchange formats take."""

from __future__ import annotations

import io
from pathlib import Path

import numpy as np
from PIL import Image

from pbrnet.pipeline.scene_export.looks import Look, Picture
from pbrnet.scenes.arrays import UInt8Array
from pbrnet.scenes.color import decode_srgb, encode_srgb
from pbrnet.scenes.errors import InputError
from pbrnet.scenes.files import read_bytes
from pbrnet.scenes.image_files import UnreadableImage, open_image
from pbrnet.scenes.importing.materials.textures import read_radiance, read_rgb

_LEAST_LIFT = 1.005
_JPEG_QUALITY = 95
_CUT = 8  # of 255: values this near to 0 or 1 make an opacity a cut-out


def color_bytes(folder: Path, picture: Picture) -> bytes:
    """Return a colour image in sRGB as PNG or JPEG, unchanged if it is one."""
    return png(_srgb(folder, picture)) if picture.raw else stored_bytes(folder, picture)


def stored_bytes(folder: Path, picture: Picture) -> bytes:
    """Return the values of an image, such as a normal map, as PNG or JPEG."""
    path = folder / picture.file
    data = read_bytes(path)
    if data.startswith((b"\x89PNG\r\n\x1a\n", b"\xff\xd8\xff")):
        return data
    return png(_rgb(path))


def lifted_bytes(folder: Path, picture: Picture, lift: float) -> tuple[bytes, float]:
    """Return a colour image times `lift`, or less if it would be clipped, and that factor.

    It stays PNG or JPEG. Divided by the factor, a PNG has its old values again.
    """
    linear = decode_srgb(_srgb(folder, picture).astype(np.float32) / 255)
    lift = min(lift, 1 / max(float(linear.max(initial=0.0)), 1e-3))
    data = color_bytes(folder, picture)
    if lift < _LEAST_LIFT:
        return data, 1.0
    pixels = np.rint(255 * encode_srgb(np.clip(linear * np.float32(lift), 0, 1))).astype(np.uint8)
    if data.startswith(b"\x89PNG"):
        return png(pixels), lift
    target = io.BytesIO()
    Image.fromarray(pixels).save(target, "JPEG", quality=_JPEG_QUALITY, subsampling=0)
    return target.getvalue(), lift


def roughness_bytes(folder: Path, look: Look) -> bytes:
    """Return glTF's image of roughness (green) and metalness (blue) as PNG; numbers are white."""
    bands = [_band(folder, one) for one in (look.roughness, look.metallic)]
    height, width = next(band.shape for band in bands if band is not None)
    pixels = np.full((height, width, 3), 255, np.uint8)
    for channel, band in zip((1, 2), bands, strict=True):
        if band is not None:
            image = Image.fromarray(band).resize((width, height), Image.Resampling.NEAREST)
            pixels[..., channel] = np.asarray(image)
    return png(pixels)


def opacity_bytes(folder: Path, look: Look) -> tuple[bytes, bool]:
    """Return colour and opacity as one PNG, and whether the opacity is a cut-out."""
    assert isinstance(look.opacity, Picture)
    alpha = _band(folder, look.opacity)
    assert alpha is not None
    size = (alpha.shape[1], alpha.shape[0])
    if isinstance(look.base, Picture):
        color = Image.fromarray(_srgb(folder, look.base))
        size = (max(size[0], color.width), max(size[1], color.height))
        color = color.resize(size, Image.Resampling.BILINEAR)
    else:
        rgb = np.rint(255 * encode_srgb(np.clip(np.array(look.base), 0, 1))).astype(np.uint8)
        color = Image.fromarray(np.broadcast_to(rgb, (size[1], size[0], 3)).copy())
    mask = Image.fromarray(alpha).resize(size, Image.Resampling.NEAREST)
    color.putalpha(mask)
    return png(np.asarray(color)), is_cut(alpha)


def glow_bytes(folder: Path, picture: Picture) -> tuple[bytes, float]:
    """Return an image of radiance as PNG (sRGB), and the radiance that its white stands for."""
    try:
        radiance = read_radiance(folder / picture.file)
    except UnreadableImage as error:
        raise InputError(f"{folder / picture.file}: {error}") from None
    brightest = max(float(radiance.max(initial=0.0)), 1e-12)
    return png(np.rint(255 * encode_srgb(radiance / brightest)).astype(np.uint8)), brightest


def grey(folder: Path, picture: Picture) -> UInt8Array:
    """Return a grey image, uint8 (H, W)."""
    band = _band(folder, picture)
    assert band is not None
    return band


def is_cut(band: UInt8Array) -> bool:
    """Test whether an opacity is a cut-out: 0 or 1 nearly everywhere."""
    return bool(((band < _CUT) | (band > 255 - _CUT)).all())


def png(pixels: UInt8Array) -> bytes:
    """Return pixels as PNG."""
    target = io.BytesIO()
    Image.fromarray(np.ascontiguousarray(pixels)).save(target, "PNG")
    return target.getvalue()


def _band(folder: Path, value: float | Picture) -> UInt8Array | None:
    if not isinstance(value, Picture):
        return None
    try:
        band = np.asarray(open_image(folder / value.file).convert("L"))
    except UnreadableImage as error:
        raise InputError(f"{folder / value.file}: {error}") from None
    if value.raw:
        return band
    return np.rint(255 * decode_srgb(band.astype(np.float32) / 255)).astype(np.uint8)


def _srgb(folder: Path, picture: Picture) -> UInt8Array:
    """A colour image (H, W, 3), its values encoded if they are linear."""
    pixels = _rgb(folder / picture.file)
    if not picture.raw:
        return pixels
    return np.rint(255 * encode_srgb(pixels.astype(np.float32) / 255)).astype(np.uint8)


def _rgb(path: Path) -> UInt8Array:
    try:
        return read_rgb(path)
    except UnreadableImage as error:
        raise InputError(f"{path}: {error}") from None
