"""Built surfaces: plaster, render, concrete, tiles, bricks, wallpaper and coverings of roofs."""

from __future__ import annotations

import numpy as np

from pbrnet.scenes.arrays import Float32Array
from pbrnet.scenes.procedural.textures.fields import (
    BLOTCH,
    CLOUD,
    CRUMB,
    GRIT,
    STREAK,
    Modules,
    Spectrum,
    Surface,
    axes,
    cells,
    constant,
    courses,
    drawn,
    hexagons,
    noise,
    smoothstep,
    tile,
    wave,
)
from pbrnet.scenes.seeds import Draw

_ROLLER = Spectrum(0.9, 130)  # bumps of a paint roller, on a tile of 1.6 m
_COMB = Spectrum(0.3, 12, 40.0)


def painted(rng: Draw, size: int, nap: float = 1.0) -> Surface:
    """Rolled wall paint; `nap` scales the height of the roller's texture."""
    roller = noise(rng, size, _ROLLER)
    cloud = noise(rng, size, CLOUD)
    height = 0.00012 * nap * roller + 0.00015 * cloud
    shade = 1 + 0.008 * cloud + 0.004 * roller
    return tile(1.6, shade=shade, rough=0.02 * cloud, height=height)


def trowelled(rng: Draw, size: int) -> Surface:
    """Lime or clay plaster smoothed by hand: overlapping strokes, mottled tone."""
    a = noise(rng, size, BLOTCH._replace(along=2.2))
    b = noise(rng, size, BLOTCH._replace(across=2.2))
    stroke = np.maximum(a, b)
    grit = noise(rng, size, GRIT)
    mix = 0.2 + 0.14 * a - 0.1 * b
    return tile(
        1.6, mix, 1 + 0.02 * stroke + 0.006 * grit, -0.05 * stroke, 0.0009 * stroke + 0.00005 * grit
    )


def rendered(rng: Draw, size: int, grain: float = 1.0) -> Surface:
    """Scratched render or roughcast of 1.2 m; `grain` scales its grains."""
    grit = noise(rng, size, GRIT)
    crumb = noise(rng, size, CRUMB)
    holes = smoothstep(1.2, 2.2, noise(rng, size, GRIT))
    height = grain * (0.0006 * grit + 0.0004 * crumb - 0.001 * holes)
    shade = 1 + 0.03 * grit - 0.12 * holes + 0.02 * noise(rng, size, CLOUD)
    return tile(1.2, shade=shade, rough=0.03, height=height)


def woodchip(rng: Draw, size: int) -> Surface:
    """Woodchip paper, painted: scattered chips under the paint."""
    chips = smoothstep(0.9, 1.8, noise(rng, size, Spectrum(0.8, 60, 1.8)))
    soft = noise(rng, size, _ROLLER)
    return tile(
        0.8, shade=1 + 0.01 * chips, rough=0.015 * soft, height=0.0005 * chips + 0.00006 * soft
    )


def brushed(rng: Draw, size: int) -> Surface:
    """Paint laid on with a brush, strokes along u."""
    strokes = noise(rng, size, _COMB)
    cloud = noise(rng, size, CLOUD)
    return tile(
        0.6, shade=1 + 0.012 * strokes + 0.012 * cloud, rough=0.03 * cloud, height=0.00004 * strokes
    )


def concrete(rng: Draw, size: int) -> Surface:
    """Fair-faced concrete with clouds, pores and the marks of shuttering boards."""
    metres = 2.0
    at = courses(size, metres, 1, 2)
    pores = smoothstep(2.2, 2.8, noise(rng, size, CRUMB))
    cloud, grit = noise(rng, size, CLOUD), noise(rng, size, GRIT)
    seam = 1 - smoothstep(0.001, 0.001 + 2 * metres / size, at.edge)
    shade = 1 + 0.07 * cloud + 0.02 * grit - 0.3 * pores - 0.06 * seam
    height = 0.00015 * grit - 0.0015 * pores + 0.0008 * seam
    return tile(
        metres, 0.3 + 0.2 * noise(rng, size, BLOTCH), shade, 0.05 * cloud + 0.1 * pores, height
    )


def tiled(
    rng: Draw,
    size: int,
    columns: int = 4,
    rows: int = 4,
    joint: float = 0.004,
    shift: float = 0.0,
    body: str = "glazed",
    metres: float = 1.2,
    hexagon: bool = False,
) -> Surface:
    """Tiles with joints in the accent colour; each tile is tilted and toned a little apart.

    `body`: "glazed" (pillowed, bright), "matt" (stoneware), "stone" (veined), "handmade" (uneven),
    "inlaid" (a pattern of the accent on each tile).
    """
    if hexagon:
        at = hexagons(size, metres, columns)
    else:
        shifts = None
        if shift:
            shifts = (shift * (np.arange(rows) % round(1 / shift))).astype(np.float32)
        at = courses(size, metres, columns, rows, shifts)
    return _joined(rng, size, metres, at, joint, body, (columns, 1 if hexagon or shift else rows))


def _joined(
    rng: Draw,
    size: int,
    metres: float,
    at: Modules,
    joint: float,
    body: str,
    modules: tuple[int, int],
) -> Surface:
    texel = metres / size
    soft = max(texel, 0.0012)
    grout = 1 - smoothstep(joint / 2 - 0.5 * soft, joint / 2 + 0.5 * soft, at.edge)
    tilt = drawn(rng, (4, at.count))
    lean = {"handmade": 0.012, "stone": 0.002}.get(body, 0.004)
    plane = lean * (tilt[0][at.number] * at.x + tilt[1][at.number] * at.y)
    tone = tilt[2][at.number]
    cloud, grit = noise(rng, size, CLOUD), noise(rng, size, GRIT)
    edge = smoothstep(0.0, 0.006, at.edge - np.float32(joint / 2))
    mix = grout
    if body == "glazed":
        rough, pillow, depth = 0.012 * cloud, 0.0004, 0.0010
        shade = 1 + 0.018 * tone + 0.012 * cloud
    elif body == "handmade":
        wavy = noise(rng, size, BLOTCH)
        rough, pillow, depth = 0.04 * wavy, 0.0008, 0.0014
        plane = plane + 0.0004 * wavy
        shade = 1 + 0.09 * tone + 0.05 * wavy
    elif body == "stone":
        vein = np.abs(noise(rng, size, CLOUD) + 0.3 * noise(rng, size, BLOTCH))
        vein = 1 - smoothstep(0.0, 0.12, vein)
        rough, pillow, depth = 0.03 * cloud + 0.05 * vein, 0.0002, 0.0008
        shade = 1 + 0.05 * tone + 0.05 * cloud - 0.18 * vein
    else:
        rough, pillow, depth = 0.04 * grit, 0.0003, 0.0012
        shade = 1 + 0.035 * tone + 0.025 * cloud + 0.015 * grit
        plane = plane + 0.00006 * grit
    if body == "inlaid":
        mix = np.maximum(grout, np.float32(0.8) * _inlay(rng, metres, at))
    body_height = plane + pillow * edge
    dirt = 1 + 0.07 * grit + 0.05 * cloud
    return tile(
        metres,
        mix,
        shade * (1 - grout) + grout * dirt,
        rough * (1 - grout) + 0.5 * grout,
        body_height * (1 - grout) - depth * grout + 0.0001 * grit * grout,
        modules=modules,
    )


def _inlay(rng: Draw, metres: float, at: Modules) -> Float32Array:
    """Ornament of an encaustic tile: rings, a star or petals, soft by 0.6 mm."""
    half = np.float32(np.abs(at.x).max())
    x, y = np.abs(at.x) / half, np.abs(at.y) / half
    radius = np.sqrt(x * x + y * y)
    kind = rng.whole(4)
    if kind == 0:  # rings around the centre and the corners
        corner = np.sqrt((1 - x) ** 2 + (1 - y) ** 2)
        line = np.minimum(np.abs(radius - 0.55), np.abs(corner - 0.45)) - np.float32(0.09)
    elif kind == 1:  # an eight-pointed star
        line = np.maximum(np.maximum(x, y), (x + y) * np.float32(0.7072)) - np.float32(0.62)
        line = np.maximum(line, np.float32(0.3) - radius)
    elif kind == 2:  # four petals towards the corners
        line = np.maximum(np.abs(x - y) - np.float32(0.28) * (1 - np.abs(x + y - 1)), radius - 1.1)
    else:  # diamond within a frame
        line = np.minimum(np.abs(x + y - np.float32(0.75)) - 0.14, 0.86 - np.maximum(x, y))
    return 1 - smoothstep(-0.02, 0.02, line.astype(np.float32))


def brickwork(rng: Draw, size: int, bond: str = "running", worn: float = 1.0) -> Surface:
    """Bricks of 0.25 m x 0.075 m with 10 mm of mortar in the accent colour."""
    metres, columns, rows = 1.5, 6, 20
    step = {"running": (0.0, 0.5), "third": (0.0, 1 / 3, 2 / 3, 1 / 3), "stack": (0.0,)}[bond]
    shifts = np.array([step[k % len(step)] for k in range(rows)], dtype=np.float32)
    at = courses(size, metres, columns, rows, shifts)
    grit, crumb = noise(rng, size, GRIT), noise(rng, size, CRUMB)
    ragged = at.edge + np.float32(0.0012 * worn) * crumb
    mortar = 1 - smoothstep(0.004, 0.0075, ragged)
    tilt = drawn(rng, (4, at.count))
    tone = tilt[0][at.number]
    plane = 0.01 * (tilt[1][at.number] * at.x + tilt[2][at.number] * at.y)
    shade = (1 + 0.13 * tone + 0.07 * crumb + 0.04 * grit) * (1 - mortar) + mortar * (
        1 + 0.06 * grit
    )
    height = (plane + 0.0006 * crumb + 0.0004 * grit) * (1 - mortar) - mortar * (
        0.004 - 0.0004 * grit
    )
    return tile(
        metres, mortar, np.clip(shade, 0.35, 1.7), 0.03 * grit, height, modules=(columns, 1)
    )


def roof_tiles(rng: Draw, size: int) -> Surface:
    """Pantiles of 0.25 m x 0.3 m."""
    metres, columns, rows = 1.5, 6, 5
    at = courses(size, metres, columns, rows)
    tone = drawn(rng, (at.count,))[at.number]
    hump = wave(at.x * np.float32(columns / metres))
    lap = at.y * np.float32(rows / metres)
    shade = 0.85 + 0.12 * hump + 0.09 * tone + 0.05 * noise(rng, size, BLOTCH) - 0.25 * (lap > 0.42)
    mix = 0.25 + 0.15 * noise(rng, size, BLOTCH)
    return tile(metres, mix, shade, height=0.02 * hump - 0.03 * lap, modules=(columns, rows))


def papered(rng: Draw, size: int, print_of: str) -> Surface:
    """Wallpaper of two rolls' width, with its seams: what is printed has the accent colour."""
    metres = 1.06
    u, v = axes(size)
    soft = 1.5 / size
    rough, relief = constant(size, 0.0), constant(size, 0.0)
    if print_of == "stripes":
        count = rng.pick([8, 12, 20])
        band = np.abs((u * count) % 1 - np.float32(0.5)) - np.float32(rng.integers(20, 36) / 100)
        mix = smoothstep(-count * soft, count * soft, band)
        rough = -0.15 * mix  # satin stripes on a matt ground
    elif print_of == "diamonds":
        count = rng.pick([6, 9])
        a, b = (u + v) * count % 1, (u - v) * count % 1
        line = np.minimum(np.minimum(a, 1 - a), np.minimum(b, 1 - b))
        mix = 0.8 * (1 - smoothstep(0.03, 0.03 + 2 * count * soft, line))
    elif print_of == "hexagons":
        at = hexagons(size, metres, rng.pick([7, 14]))
        mix = 1 - smoothstep(0.002, 0.002 + 2 * metres / size, np.abs(at.edge - 0.006))
    elif print_of == "scales":
        at = courses(size, metres, 8, 16, (np.arange(16) % 2 * 0.5).astype(np.float32))
        radius = np.sqrt(at.x**2 + (at.y + 0.033) ** 2)
        mix = 1 - smoothstep(0.003, 0.003 + 2 * metres / size, np.abs(radius - 0.058))
        relief = 0.0003 * smoothstep(0.02, 0.06, radius)
    elif print_of == "sprigs":
        at = courses(size, metres, 6, 6, (np.arange(6) % 2 * 0.5).astype(np.float32))
        mix = _sprigs(at, metres / size)
    elif print_of == "damask":
        count = rng.pick([4, 5])
        a, b = wave(u * count), wave(v * count)
        c, d = wave((u + v) * count), wave((u - v) * count)
        field = a * b + np.float32(0.45) * c * d + np.float32(0.25) * wave(2 * u * count) * b
        leaf = np.minimum(np.abs(field - 0.62) - 0.2, np.abs(field + 0.45) - 0.07)
        mix = 1 - smoothstep(-3 * count * soft, 3 * count * soft, leaf.astype(np.float32))
        rough, relief = -0.2 * mix, 0.0002 * mix
    else:  # grasscloth
        threads = noise(rng, size, Spectrum(0.3, 8, 30.0))
        mix = 0.4 + 0.18 * threads
        rough, relief = 0.03 * threads, 0.0003 * threads
    seam = 1 - smoothstep(0.0, 0.0008 + 0.5 * metres / size, np.abs((u * 2) % 1 - 0.5))
    grain = noise(rng, size, GRIT)
    shade = 1 + 0.01 * grain - 0.05 * seam * min(1.0, 0.002 * size)
    return tile(metres, mix, shade, rough, relief + 0.00003 * grain - 0.0001 * seam)


def _sprigs(at: Modules, texel: float) -> Float32Array:
    """A stem with pairs of leaves in each module of 0.18 m."""
    x, y = np.abs(at.x), at.y
    best = np.maximum(x - 0.0012, np.abs(y) - 0.055)
    for place, long in ((-0.03, 0.02), (0.0, 0.026), (0.03, 0.018)):
        along = np.float32(0.8) * x + np.float32(0.6) * (y - np.float32(place))
        across = np.float32(0.8) * (y - np.float32(place)) - np.float32(0.6) * x
        t = along / np.float32(long)
        leaf = np.abs(across) - np.float32(0.4 * long) * np.clip(1 - (2 * t - 1) ** 2, 0, 1)
        best = np.minimum(best, np.where((t > 0) & (t < 1), leaf, 1.0))
    return 1 - smoothstep(-0.5 * texel, texel, best.astype(np.float32))


def crazed(rng: Draw, size: int) -> Surface:
    """Glaze with a net of fine cracks."""
    near, second, _ = cells(rng, size, 18)
    crack = 1 - smoothstep(0.0, 0.05, second - near)
    mix = np.float32(0.5) * crack
    shade = 1 + 0.015 * noise(rng, size, CLOUD)
    return tile(0.3, mix, shade, 0.05 * crack, -0.00005 * crack + 0.0001 * noise(rng, size, CLOUD))


def planked(rng: Draw, size: int) -> Surface:
    """Painted tongue-and-groove panelling: boards of 0.1 m along v."""
    metres = 1.2
    at = courses(size, metres, 12, 1)
    groove = 1 - smoothstep(0.001, 0.0055, at.edge)
    strokes = noise(rng, size, _COMB._replace(along=1.0, across=40.0))
    shade = 1 - 0.16 * groove + 0.01 * strokes
    rough = 0.02 * noise(rng, size, STREAK._replace(along=1.0, across=24.0))
    height = -0.003 * groove + 0.00004 * strokes
    return tile(metres, shade=shade, rough=rough, height=height, modules=(12, 1))
