"""The direct light of a panorama as a graph of tensors, for networks that leave this package.

The same as `model.irradiance.direct_shading` and `model.encoding`'s `direct`, written with what
ONNX has: sources are gathered by matrices of membership, since sizes are known only later, and
sent to the pixels a row of cells at a time, which bounds memory.
"""

from __future__ import annotations

import math

import torch
from torch.nn import functional

from model.encoding import GREY, WHITE, centred
from model.irradiance import CELLS, NEAREST
from pipeline.params import ToneParams

BLOCK = 8  # pixels a side over which the log average takes means, as `pipeline.tonemap` has it


def direct_light(
    depth: torch.Tensor,
    valid: torch.Tensor,
    normal: torch.Tensor,
    intensity: torch.Tensor,
    distance: torch.Tensor,
    intrinsics: torch.Tensor,
) -> torch.Tensor:
    """Radiance (H, W) of a grey matte copy of the view, as `direct_shading` has it.

    float32 (H, W), (H, W), (H, W, 3), panorama (h, w) twice, (3, 3); see `model.data.Example`.
    """
    rays = pixel_rays(depth, intrinsics)
    points = (rays * depth[..., None]).reshape(-1, 3)
    normals = normal.reshape(-1, 3)
    places, power = cells(intensity, distance)
    squared = (points * points).sum(dim=1, keepdim=True)
    facing = (normals * points).sum(dim=1, keepdim=True)
    irradiance = torch.zeros_like(points[:, 0])
    for row in range(CELLS[0]):
        place, emitted = places[row], power[row]  # (64, 3), (64,)
        towards = squared + (place * place).sum(dim=1) - 2 * points @ place.T
        metres2 = towards.clamp(min=NEAREST**2)
        cosine = (normals @ place.T - facing).clamp(min=0)
        irradiance = irradiance + (cosine / (metres2 * torch.sqrt(metres2))) @ emitted
    lit = GREY / math.pi * irradiance * (valid > 0).reshape(-1)
    return lit.reshape(depth.shape) + seen(intensity, rays)


def encoded_light(light: torch.Tensor) -> torch.Tensor:
    """(H, W) radiance as the network's input `direct`: (1, 2, H, W)."""
    key = ToneParams().key
    scaled = light * (key / log_average(light))
    mapped = scaled * (1 + scaled / WHITE**2) / (1 + scaled)
    high = 1.055 * mapped.clamp(min=0.0031308) ** (1 / 2.4) - 0.055
    display = torch.where(mapped <= 0.0031308, 12.92 * mapped, high).clamp(0, 1)
    log = torch.log((scaled / key).clamp(min=1e-3)) / 4
    return torch.stack([centred(display), log])[None]


def log_average(light: torch.Tensor) -> torch.Tensor:
    """exp of the mean logarithm of block means above 0; the key where all is dark."""
    height, width = light.shape
    pad = (0, -width % BLOCK, 0, -height % BLOCK)
    sums, counts = (
        functional.avg_pool2d(functional.pad(image[None, None], pad), BLOCK)
        for image in (light, torch.ones_like(light))
    )
    means = sums / counts  # blocks at the right and bottom may be cut
    lit = (means > 0).to(light.dtype)
    logs = torch.log(torch.where(means > 0, means, torch.ones_like(means)))
    average = torch.exp((logs * lit).sum() / lit.sum().clamp(min=1))
    return torch.where(lit.sum() > 0, average, torch.full_like(average, ToneParams().key))


def cells(intensity: torch.Tensor, distance: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
    """Places (32, 64, 3) and radiant intensities (32, 64) of the sources in each cell."""
    rows, columns = torch.ones_like(intensity[:, 0]), torch.ones_like(intensity[0])
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
    power = intensity * angle * distance**2
    up, across = _members(number_y, height, CELLS[0]), _members(number_x, width, CELLS[1])
    total = up @ power @ across.T
    some = torch.where(total > 0, total, torch.ones_like(total))
    centres = [up @ (power * distance * axis) @ across.T / some for axis in (x, y, z)]
    return torch.stack(centres, dim=-1), total


def seen(intensity: torch.Tensor, rays: torch.Tensor) -> torch.Tensor:
    """Radiance (H, W) of the panorama's pixel in the direction of each ray (H, W, 3)."""
    # Shapes as tensors: the exporter cannot count with numbers that are only known later.
    height, width = torch.ones_like(intensity[:, 0]).sum(), torch.ones_like(intensity[0]).sum()
    x, y, z = rays[..., 0], rays[..., 1], rays[..., 2]
    polar = torch.atan2(torch.sqrt(x * x + z * z), -y)
    row = torch.minimum(torch.floor(polar / torch.pi * height), height - 1)
    column = torch.floor((torch.atan2(x, z) / (2 * torch.pi) + 0.5) * width)
    column = torch.where(column >= width, column - width, column)
    return intensity.reshape(-1)[(row * width + column).long()]  # exact below 2^24 pixels


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
