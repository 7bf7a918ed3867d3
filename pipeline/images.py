"""Pictures of arrays: false colours, contact sheets, and PNG and JPEG encoding.

Functions named `*_picture` take linear, scene-referred arrays and return uint8 (H, W, 3) in sRGB.
"""

from __future__ import annotations

import io
import json
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt
from PIL import Image, ImageDraw, ImageFont
from PIL.PngImagePlugin import PngInfo

from pbrnet.pipeline.tonemap import Exposure, to_bytes, tonemap
from pbrnet.scenes.arrays import AnyArray, FloatingArray, UInt8Array
from pbrnet.scenes.color import encode_srgb
from pbrnet.scenes.image_files import open_image

Picture = UInt8Array

_DECADES = 4.0
_DARK = (24, 24, 27)  # between the pictures of a contact sheet
_CHUNK = "pbrnet"  # text chunk of a PNG that describes the picture
NOTHING = np.array([38, 38, 42], dtype=np.uint8)  # colour of pixels without surface or light


def color_map(values: FloatingArray, low: float, high: float, name: str = "viridis") -> Picture:
    """Map scalars (H, W) from `low` to `high` through one of matplotlib's colour maps."""
    import matplotlib  # here: most commands that write pictures do without

    span = high - low if high > low else 1.0
    unit = np.clip((np.asarray(values, dtype=np.float64) - low) / span, 0, 1)
    return to_bytes(matplotlib.colormaps[name](unit)[..., :3])


def depth_picture(depth: FloatingArray, valid: npt.NDArray[np.generic] | None = None) -> Picture:
    """Draw depth or distance (H, W) in metres, logarithmic: near is bright, far violet.

    Pixels without a surface, or without a light, are grey.
    """
    depth = np.asarray(depth, dtype=np.float64)
    there = depth > 0 if valid is None else np.asarray(valid) > 0
    # Logarithmic, so that distant houses outdoors do not use up the colours of the room.
    height = -np.log(np.maximum(depth, 1e-3))
    seen = height[there]
    near, far = (float(seen.max()), float(seen.min())) if seen.size else (1.0, 0.0)
    span = max(near - far, 1e-6)
    # The dark end of the map is not used: far must differ from no surface.
    picture = color_map(height, far - 0.25 * span, near, "magma")
    picture[~there] = NOTHING
    return picture


def normal_picture(normal: FloatingArray, valid: npt.NDArray[np.generic] | None = None) -> Picture:
    """Draw unit normals (H, W, 3) in camera axes: red right, green up, blue to the camera."""
    normal = np.asarray(normal, dtype=np.float32)
    there = (normal != 0).any(axis=-1) if valid is None else np.asarray(valid) > 0
    picture = to_bytes(0.5 + 0.5 * normal * np.array([1, -1, -1], dtype=np.float32))
    picture[~there] = NOTHING
    return picture


def reflectance_picture(reflectance: FloatingArray) -> Picture:
    """Draw linear reflectance (H, W, 3) in [0, 1]."""
    return to_bytes(encode_srgb(np.clip(np.asarray(reflectance, dtype=np.float32), 0, 1)))


def intensity_picture(intensity: FloatingArray) -> Picture:
    """Draw panorama luminance (h, w), logarithmic over `_DECADES` below its maximum."""
    intensity = np.asarray(intensity, dtype=np.float64)
    top = float(intensity.max(initial=0.0))
    if top <= 0:
        return np.broadcast_to(NOTHING, (*intensity.shape, 3)).copy()
    floor = top * 10.0**-_DECADES
    # Start above the dark end of the map, so that dim sources differ from no light.
    logarithm = np.log10(np.maximum(intensity, floor) / floor)
    picture = color_map(logarithm + 0.25 * _DECADES, 0, 1.25 * _DECADES, "inferno")
    picture[intensity <= 0] = NOTHING
    return picture


def tint_picture(tint: FloatingArray) -> Picture:
    """Draw colours of light (h, w, 3) of luminance 1 at full brightness; no light is grey."""
    tint = np.asarray(tint, dtype=np.float32)
    strongest = tint.max(axis=-1, keepdims=True)
    picture = reflectance_picture(tint / np.where(strongest > 0, strongest, 1))
    picture[strongest[..., 0] <= 0] = NOTHING
    return picture


def share_picture(share: FloatingArray) -> Picture:
    """Draw shares (H, W) in [0, 1]: 0 is black, 1 is white."""
    return to_bytes(np.repeat(np.asarray(share, dtype=np.float32)[..., None], 3, axis=-1))


def flow_picture(flow: FloatingArray) -> Picture:
    """Draw flow (H, W, 2), pixels, as a colour wheel: hue is direction, paler is shorter.

    Red moves right, green-yellow down. The longest flow but one in a hundred has full colour.
    """
    flow = np.asarray(flow, dtype=np.float64)
    length = np.sqrt((flow**2).sum(axis=-1))
    full = max(float(np.quantile(length, 0.99)), 1e-9)
    hue = np.arctan2(flow[..., 1], flow[..., 0]) / (2 * np.pi) % 1
    wheel = np.stack([hue, np.clip(length / full, 0, 1), np.ones_like(hue)], axis=-1)
    from matplotlib.colors import hsv_to_rgb

    return to_bytes(hsv_to_rgb(wheel))


def label_picture(labels: AnyArray) -> Picture:
    """Draw numbers (H, W) of objects, materials or classes in different colours; 0 is grey."""
    hashed = labels.astype(np.uint32) * np.uint32(2654435761)
    shifts = [(hashed >> np.uint32(shift)).astype(np.uint8) for shift in (8, 16, 24)]
    picture: Picture = (np.stack(shifts, axis=-1) // 2 + 96).astype(np.uint8)
    picture[labels == 0] = 40
    return picture


def tone_picture(image: FloatingArray, exposure: Exposure) -> Picture:
    """Tone-map linear HDR (H, W, 3)."""
    return to_bytes(tonemap(image, exposure))


def error_picture(error: FloatingArray) -> Picture:
    """Draw errors (H, W) from 0 (dark) to 1 (bright)."""
    return color_map(error, 0.0, 1.0, "magma")


def fit(picture: Picture, width: int) -> Picture:
    """Shrink a picture to at most `width` pixels by area averaging."""
    height_now, width_now = picture.shape[:2]
    if width_now <= width:
        return picture
    height = max(1, round(height_now * width / width_now))
    return np.asarray(Image.fromarray(picture).resize((width, height), Image.Resampling.BOX))


def enlarge(picture: Picture, width: int) -> Picture:
    """Enlarge a small picture by a whole factor, to at most `width` pixels, with hard edges."""
    factor = max(1, width // picture.shape[1])
    return picture.repeat(factor, axis=0).repeat(factor, axis=1)


def contact_sheet(
    pictures: Sequence[Picture],
    columns: int,
    labels: Sequence[str] = (),
    gap: int = 6,
) -> Picture:
    """Arrange pictures in rows of `columns`, each centred in its cell above its label."""
    if not pictures:
        return np.full((32, 32, 3), _DARK, dtype=np.uint8)
    columns = max(1, min(columns, len(pictures)))
    rows = -(-len(pictures) // columns)
    font = ImageFont.load_default(13)
    label_height = 18 if labels else 0
    cell_width = max(picture.shape[1] for picture in pictures)
    heights = [
        max(picture.shape[0] for picture in pictures[row * columns : (row + 1) * columns])
        for row in range(rows)
    ]
    size = (
        gap + columns * (cell_width + gap),
        gap + sum(height + label_height + gap for height in heights),
    )
    sheet = Image.new("RGB", size, _DARK)
    draw = ImageDraw.Draw(sheet)
    top = gap
    for row in range(rows):
        for column in range(columns):
            index = row * columns + column
            if index >= len(pictures):
                break
            picture = pictures[index]
            left = gap + column * (cell_width + gap)
            sheet.paste(
                Image.fromarray(picture),
                (
                    left + (cell_width - picture.shape[1]) // 2,
                    top + (heights[row] - picture.shape[0]) // 2,
                ),
            )
            if index < len(labels):
                text = _shorten(draw, labels[index], font, cell_width)
                draw.text((left, top + heights[row] + 1), text, (228, 228, 231), font)
        top += heights[row] + label_height + gap
    return np.asarray(sheet)


def png_bytes(picture: Picture, facts: Mapping[str, Any] | None = None) -> bytes:
    """Encode as PNG, deterministically (without a time stamp).

    `facts`, such as content and author of the picture, go into one text chunk as JSON.
    """
    stream, text = io.BytesIO(), PngInfo()
    if facts is not None:
        text.add_itxt(_CHUNK, json.dumps(facts, ensure_ascii=False, sort_keys=True))
    Image.fromarray(picture).save(stream, "PNG", compress_level=4, pnginfo=text)
    return stream.getvalue()


def png_facts(source: bytes) -> dict[str, Any] | None:
    """Return the facts that `png_bytes` stored in a PNG; None if there are none."""
    with open_image(source) as image:
        text = image.info.get(_CHUNK)
    facts = json.loads(text) if isinstance(text, str) else None
    return facts if isinstance(facts, dict) else None


def jpeg_bytes(picture: Picture, quality: int = 85) -> bytes:
    """Encode as JPEG."""
    stream = io.BytesIO()
    Image.fromarray(picture).save(stream, "JPEG", quality=quality, optimize=True)
    return stream.getvalue()


def read_picture(source: bytes) -> Picture:
    """Decode PNG or JPEG bytes to uint8 (H, W, 3)."""
    with open_image(source) as image:
        return np.asarray(image.convert("RGB"))


def _shorten(
    draw: ImageDraw.ImageDraw,
    text: str,
    font: ImageFont.FreeTypeFont | ImageFont.ImageFont,
    width: int,
) -> str:
    if draw.textlength(text, font) <= width:
        return text
    while text and draw.textlength(text + "…", font) > width:
        text = text[:-1]
    return text + "…"
