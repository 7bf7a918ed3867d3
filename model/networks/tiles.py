"""Tiled inference of large images, with the same result as inference of the whole image.

The receptive field of a U-Net is bounded. A tile that is computed from a window with this margin
equals the same part of the whole result: there are no seams and nothing is blended. Tiles start at
multiples of the network's stride, so that its pooling cells are those of the whole image. Every
tile gets the whole panorama, and the position of its pixels for networks that resize the panorama
to the image. Networks that normalise by statistics of the whole image (CAN, pix2pix, CycleGAN)
cannot be tiled.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import torch

from pbrnet.model.data.encoding import INPUTS, Tensors
from pbrnet.model.methods import MIN_TILE
from pbrnet.model.networks.bands import FOLD
from pbrnet.model.networks.pbrnet import Architecture
from pbrnet.scenes.errors import InputError

WHOLE = [name for name, given in INPUTS.items() if given.whole]  # each tile gets them whole

# Margin of each network's receptive field around an aligned block, in pixels: a `Branch` has 1, and
# the margins of networks in series add up.
_MARGINS: dict[str, Callable[[int], int]] = {
    "shading": lambda levels: 1 + unet_margin(levels),
    "composition": lambda levels: unet_margin(levels),
    "unet": lambda levels: 1 + unet_margin(levels),
    "plus": lambda levels: FOLD * (1 + unet_margin(levels)),
}
# Pixels of the image that a side of a network's finest pixel spans, where it is not 1.
_FOLDS = {"plus": FOLD}


@dataclass(frozen=True)
class Tile:
    """Rows and columns of a tile, and of the larger window that it is computed from."""

    rows: slice
    columns: slice
    window_rows: slice
    window_columns: slice


def unet_margin(levels: int) -> int:
    """Margin of the receptive field of `UNet` around a block of `2^(levels - 1)` aligned pixels.

    Computed from the output back to the input: a double convolution adds 2 pixels on each side,
    bilinear upsampling reads the neighbouring cell, and max pooling reads two pixels a side.
    """
    block = 2 ** (levels - 1)

    def encoder(level: int, low: int, high: int) -> tuple[int, int]:
        low, high = low - 2, high + 2
        return (low, high) if level == 0 else encoder(level - 1, 2 * low, 2 * high + 1)

    def decoder(level: int, low: int, high: int) -> tuple[int, int]:
        if level == levels - 1:
            return encoder(level, low, high)
        low, high = low - 2, high + 2
        deep = decoder(level + 1, (low - 1) // 2, (high + 1) // 2)
        skip = encoder(level, low, high)
        return min(deep[0], skip[0]), max(deep[1], skip[1])

    low, high = decoder(0, 0, block - 1)
    return max(-low, high - (block - 1))


def margin(architecture: Architecture) -> int:
    """Pixels that a tile's window needs on each side, a multiple of `stride`.

    Raises `InputError` for a network whose receptive field is the whole image.
    """
    if architecture.kind not in _MARGINS:
        raise InputError(
            f"a network of the kind {architecture.kind!r} cannot work in tiles: it needs "
            "statistics of the whole picture, or its margin is not known; leave out --tile"
        )
    step = stride(architecture)
    return -(-_MARGINS[architecture.kind](architecture.levels) // step) * step


def stride(architecture: Architecture) -> int:
    """Pixels of the image that the network's coarsest pixel spans."""
    return int(_FOLDS.get(architecture.kind, 1) * 2 ** (architecture.levels - 1))


def tile_grid(height: int, width: int, tile: int, architecture: Architecture) -> Iterator[Tile]:
    """Tiles of `tile` x `tile` pixels, rounded up to whole strides, that cover an image."""
    step, overlap = stride(architecture), margin(architecture)
    side = -(-max(tile, MIN_TILE) // step) * step

    def spans(size: int) -> Iterator[tuple[slice, slice]]:
        for start in range(0, size, side):
            end = min(start + side, size)
            yield slice(start, end), slice(max(0, start - overlap), min(end + overlap, size))

    for rows, window_rows in spans(height):
        for columns, window_columns in spans(width):
            yield Tile(rows, columns, window_rows, window_columns)


def tiled(
    network: Callable[[Tensors], torch.Tensor],
    architecture: Architecture,
    inputs: Tensors,
    tile: int,
) -> torch.Tensor:
    """`network(inputs)`, (N, C, H, W), in tiles of about `tile` pixels a side; 0: no tiling.

    Memory depends on the tile and its `margin`, not on the size of the image. Raises `InputError`
    as `margin` does.
    """
    if not tile:
        return network(inputs)
    images = [name for name in inputs if name not in WHOLE]
    height, width = inputs[images[0]].shape[-2:]
    whole: torch.Tensor | None = None
    for region in tile_grid(height, width, tile, architecture):
        window = {
            name: value
            if name in WHOLE
            else value[..., region.window_rows, region.window_columns].contiguous()
            for name, value in inputs.items()
        }
        window["place"] = _positions(region, height, width)
        output = network(window)
        if whole is None:
            whole = output.new_empty((*output.shape[:2], height, width))
        top = region.rows.start - region.window_rows.start
        left = region.columns.start - region.window_columns.start
        rows = slice(top, top + region.rows.stop - region.rows.start)
        columns = slice(left, left + region.columns.stop - region.columns.start)
        whole[..., region.rows, region.columns] = output[..., rows, columns]
    assert whole is not None
    return whole


def _positions(region: Tile, height: int, width: int) -> torch.Tensor:
    """Pixel centres of the window in the image: (1, h, w, 2), x and y, [-1, 1]."""
    y = torch.arange(region.window_rows.start, region.window_rows.stop, dtype=torch.float64)
    x = torch.arange(region.window_columns.start, region.window_columns.stop, dtype=torch.float64)
    y, x = (2 * y + 1) / height - 1, (2 * x + 1) / width - 1
    rows, columns = torch.meshgrid(y, x, indexing="ij")
    return torch.stack([columns, rows], dim=-1)[None].float()
