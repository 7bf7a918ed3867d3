"""The direct light of a panorama as a graph of tensors, for networks that leave this package.

The same as `model.data.direct_light.surface_light` and `model.data.encoding`'s `direct`, written
with what ONNX has: sources are gathered by matrices of membership, since sizes are known only
later, and sent to the pixels a row of cells at a time, which bounds memory.
"""

from __future__ import annotations

import math

import torch

from model.data.display import displayed, log_average, luminance
from model.data.encoding import FAINTEST, GREY, WHITE, centred
from pipeline.params import ToneParams
from pipeline.passes.panorama_lights import CELLS, NEAREST


def direct_light(
    depth: torch.Tensor,
    valid: torch.Tensor,
    normal: torch.Tensor,
    radiance: torch.Tensor,
    distance: torch.Tensor,
    intrinsics: torch.Tensor,
) -> tuple[torch.Tensor, torch.Tensor]:
    """`surface_light` and `seen_sources`, each (H, W, 3): their sum is `direct_shading`.

    float32 (H, W), (H, W), (H, W, 3), panorama (h, w, 3) and (h, w), (3, 3).
    """
    rays = pixel_rays(depth, intrinsics)
    points = (rays * depth[..., None]).reshape(-1, 3)
    normals = normal.reshape(-1, 3)
    places, power = cells(radiance, distance)
    squared = (points * points).sum(dim=1, keepdim=True)
    facing = (normals * points).sum(dim=1, keepdim=True)
    irradiance = torch.zeros_like(points)
    for row in range(CELLS[0]):
        place, emitted = places[row], power[row]  # (64, 3) each
        towards = squared + (place * place).sum(dim=1) - 2 * points @ place.T
        metres2 = towards.clamp(min=NEAREST**2)
        cosine = (normals @ place.T - facing).clamp(min=0)
        irradiance = irradiance + (cosine / (metres2 * torch.sqrt(metres2))) @ emitted
    lit = GREY / math.pi * irradiance * (valid > 0).reshape(-1, 1)
    return lit.reshape(normal.shape), seen(radiance, rays)


def light_color(lit: torch.Tensor) -> torch.Tensor:
    """`model.data.encoding.light_color` of (H, W, 3), as (1, 3, 1, 1)."""
    total = lit.sum(dim=(0, 1)).reshape(1, 3, 1, 1)
    bright = luminance(total)
    color = (total / torch.where(bright > 0, bright, torch.ones_like(bright))).clamp(min=FAINTEST)
    color = torch.where(bright > 0, color, torch.ones_like(color))
    return color / luminance(color)


def encoded_light(light: torch.Tensor, tint: torch.Tensor, arrives: torch.Tensor) -> torch.Tensor:
    """Radiance (H, W, 3) as the network's input `direct`, (1, 8, H, W).

    `tint` (1, 3, 1, 1); `arrives` (H, W) is the view's visibility, ones where it is not known.
    """
    key = ToneParams().key
    white = light.permute(2, 0, 1)[None] / tint
    scaled = white * (key / log_average(luminance(white)))
    log = torch.log((luminance(scaled) / key).clamp(min=1e-3)) / 4
    everywhere = torch.log(tint) + torch.zeros_like(scaled)
    shown = centred(displayed(scaled, WHITE))
    return torch.cat([shown, log, everywhere, arrives[None, None]], dim=1)


def cells(radiance: torch.Tensor, distance: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
    """Places (32, 64, 3) and radiant intensities (32, 64, 3) of the sources in each cell."""
    rows, columns = torch.ones_like(distance[:, 0]), torch.ones_like(distance[0])
    height, width = rows.sum(), columns.sum()
    number_y, number_x = torch.cumsum(rows, 0) - 1, torch.cumsum(columns, 0) - 1
    polar = (number_y + 0.5) / height * torch.pi
    azimuth = ((number_x + 0.5) / width * 2 - 1) * torch.pi
    # cos a - cos b = 2 sin((a + b) / 2) sin((b - a) / 2), which loses no digits
    strips = 2 * torch.sin(polar) * torch.sin(0.5 * torch.pi / height)
    angle = (strips * (2 * torch.pi / width))[:, None]
    x = torch.sin(polar)[:, None] * torch.sin(azimuth)
    y = -torch.cos(polar)[:, None] + 0 * x
    z = torch.sin(polar)[:, None] * torch.cos(azimuth)
    share = angle * distance**2
    power = luminance(radiance.permute(2, 0, 1)[None])[0, 0] * share
    up, across = _members(number_y, height, CELLS[0]), _members(number_x, width, CELLS[1])
    total = up @ power @ across.T
    some = torch.where(total > 0, total, torch.ones_like(total))
    centres = [up @ (power * distance * axis) @ across.T / some for axis in (x, y, z)]
    bands = [up @ (radiance[..., k] * share) @ across.T for k in range(3)]
    return torch.stack(centres, dim=-1), torch.stack(bands, dim=-1)


def seen(radiance: torch.Tensor, rays: torch.Tensor) -> torch.Tensor:
    """Radiance (H, W, 3) of the panorama's pixel in the direction of each ray (H, W, 3)."""
    # Shapes as tensors: the exporter cannot count with numbers that are only known later.
    line, column = torch.ones_like(radiance[:, 0, 0]), torch.ones_like(radiance[0, :, 0])
    height, width = line.sum(), column.sum()
    x, y, z = rays[..., 0], rays[..., 1], rays[..., 2]
    polar = torch.atan2(torch.sqrt(x * x + z * z), -y)
    row = torch.minimum(torch.floor(polar / torch.pi * height), height - 1)
    column = torch.floor((torch.atan2(x, z) / (2 * torch.pi) + 0.5) * width)
    column = torch.where(column >= width, column - width, column)
    return radiance.reshape(-1, 3)[(row * width + column).long()]  # exact below 2^24 pixels


def pixel_rays(depth: torch.Tensor, intrinsics: torch.Tensor) -> torch.Tensor:
    """Camera rays (H, W, 3) through the pixel centres of an image like `depth`, z = 1."""
    row = torch.cumsum(torch.ones_like(depth), 0) - 0.5
    column = torch.cumsum(torch.ones_like(depth), 1) - 0.5
    y = (row - intrinsics[1, 2]) / intrinsics[1, 1]
    x = (column - intrinsics[0, 2] - intrinsics[0, 1] * y) / intrinsics[0, 0]
    return torch.stack([x, y, torch.ones_like(x)], dim=-1)


def _members(number: torch.Tensor, size: torch.Tensor, count: int) -> torch.Tensor:
    """(count, size): 1 where a pixel belongs to a cell."""
    cell = torch.floor(number * count / size)
    return (cell == torch.arange(count, dtype=number.dtype)[:, None]).to(number.dtype)
