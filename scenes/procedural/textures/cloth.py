"""Textiles: weaves, knits, piles and carpets."""

from __future__ import annotations

import numpy as np

from pbrnet.scenes.arrays import Float32Array
from pbrnet.scenes.procedural.textures.fields import (
    BLOTCH,
    CLOUD,
    CRUMB,
    GRIT,
    SLUB,
    STREAK,
    Spectrum,
    Surface,
    axes,
    cells,
    drawn,
    noise,
    smoothstep,
    tile,
    wave,
)
from pbrnet.scenes.seeds import Draw

_DRAFTS: dict[str, list[str]] = {  # rows of a weave's draft; x: the warp lies on top
    "plain": ["x.", ".x"],
    "basket": ["xx..", "xx..", "..xx", "..xx"],
    "twill": ["xx..", ".xx.", "..xx", "x..x"],
    "denim": ["xxx.", ".xxx", "x.xx", "xx.x"],
    "satin": ["xxxxx.xx", "xx.xxxxx", "xxxxxxx.", "xxxx.xxx", "x.xxxxxx", "xxxxxx.x", "xxx.xxxx",
              ".xxxxxxx"],
    "herringbone": ["xx..xx....xx..xx", ".xx..xx..xx..xx.", "..xx..xxxx..xx..", "x..xx..xx..xx..x"],
    "rib": ["xx", ".."],
    "birdseye": ["x..x", ".xx.", ".xx.", "x..x"],
}  # fmt: skip


def woven(
    rng: Draw,
    size: int,
    draft: str = "plain",
    pitch: float = 0.004,
    slub: float = 1.0,
    threads: str = "two",
) -> Surface:
    """Woven cloth with yarns `pitch` metres apart (visible bundles rather than single yarns).

    `threads`: "two" (weft in the accent colour), "one", "striped", "checked" or "melange".
    """
    rows = _DRAFTS[draft]
    period = max(len(rows), len(rows[0]))
    count = max(period, round(0.4 / pitch / period) * period)
    metres = count * pitch
    u, v = axes(size)
    across, along = u * count, v * count
    i, j = np.floor(across).astype(np.int64), np.floor(along).astype(np.int64)
    over = np.array([[cell == "x" for cell in row] for row in rows])[
        j % len(rows), i % len(rows[0])
    ]
    tx, ty = across - i, along - j
    warp = 1 - (2 * tx - 1) ** 2
    weft = 1 - (2 * ty - 1) ** 2
    crown = np.where(over, 0.6 * warp + 0.4 * warp * weft, 0.6 * weft + 0.4 * warp * weft)
    thick = noise(rng, size, SLUB._replace(along=1.0, across=12.0))
    thin = noise(rng, size, SLUB)
    uneven = np.where(over, thick, thin) * np.float32(slub)
    own = drawn(rng, (2, count))
    yarn = np.where(over, own[0][i], own[1][j])
    if threads == "two":
        mix = np.where(over, 0.0, 0.55)
    elif threads == "striped":
        coloured = _stripes(rng, count)
        mix = np.where(over, 0.9 * coloured[i], 0.45 * coloured[i])
    elif threads == "checked":
        coloured = _stripes(rng, count)
        mix = np.where(over, 0.9 * coloured[i], 0.9 * coloured[j])
    elif threads == "melange":
        mix = 0.3 + 0.22 * yarn + 0.16 * uneven
    else:
        mix = np.full(over.shape, 0.15)
    mix = mix + 0.09 * uneven
    fine = min(1.0, 3 * pitch / (metres / size) / 4)  # yarns finer than a texel fade
    shade = 1 + fine * (0.3 * crown - 0.2) + 0.04 * uneven + 0.02 * yarn
    shade = shade + 0.02 * noise(rng, size, CLOUD)
    height = 0.16 * pitch * crown * fine + 0.02 * pitch * uneven
    return tile(metres, mix, shade, 0.02 * uneven - 0.05 * crown * (draft == "satin"), height)


def _stripes(rng: Draw, count: int) -> Float32Array:
    """Colour, 0 to 1, of each of `count` yarns: groups of several widths, repeated."""
    wide, narrow = rng.whole(6, 16), rng.whole(1, 4)
    group = [1.0] * wide + [0.0] * wide + [0.6] * narrow + [0.0] * rng.whole(3, 10)
    times = max(1, round(count / len(group)))
    ends = np.linspace(0, len(group) * times, count, endpoint=False).astype(np.int64)
    return np.array(group, dtype=np.float32)[ends % len(group)]


def knitted(rng: Draw, size: int, pitch: float = 0.007) -> Surface:
    """Stocking stitch, its wales along v; `pitch` is the width of a stitch."""
    count = round(0.42 / pitch)
    metres = count * pitch
    u, v = axes(size)
    a, b = u * count, v * count
    i = np.floor(a).astype(np.int64)
    side = a - i - np.float32(0.5)
    row = b + 1.3 * np.abs(side)  # stitches are Vs
    j = np.floor(row)
    body = (1 - (2 * (row - j) - 1) ** 2) * (1 - (4 * np.abs(np.abs(side) - 0.25)) ** 2)
    body = np.clip(body, 0, 1)
    fuzz = noise(rng, size, GRIT)
    yarn = drawn(rng, (count,))[(j.astype(np.int64)) % count]
    mix = 0.25 + 0.1 * fuzz + 0.1 * yarn
    shade = 0.72 + 0.36 * body + 0.04 * fuzz
    return tile(metres, mix, shade, 0.02 * fuzz, 0.2 * pitch * body + 0.0001 * fuzz)


def cabled(rng: Draw, size: int) -> Surface:
    """Chunky cable knit of 0.4 m."""
    metres = 0.4
    u, v = axes(size)
    a = u * 10
    i = np.floor(a).astype(np.int64)
    twist = wave((v * 8 + 0.25 * (i % 2)).astype(np.float32))
    x = a - i - np.float32(0.5)
    one = np.clip(1 - ((x - 0.2 * twist) * 3.4) ** 2, 0, 1)
    two = np.clip(1 - ((x + 0.2 * twist) * 3.4) ** 2, 0, 1)
    rope = np.maximum(one, two)
    fuzz = noise(rng, size, GRIT)
    shade = 0.7 + 0.36 * rope + 0.05 * fuzz
    return tile(metres, 0.25 + 0.12 * fuzz, shade, 0.02 * fuzz, 0.004 * rope + 0.0002 * fuzz)


def pile(rng: Draw, size: int, nap: float = 1.0, metres: float = 0.6) -> Surface:
    """Velvet, chenille or fleece: a short pile whose lie varies."""
    lie = noise(rng, size, CLOUD)
    strokes = noise(rng, size, BLOTCH._replace(along=2.0))
    fibre = noise(rng, size, GRIT)
    shade = 1 + 0.04 * lie * nap + 0.025 * strokes + 0.04 * fibre
    mix = 0.25 + 0.07 * strokes + 0.04 * lie
    return tile(metres, mix, shade, 0.02 * lie, 0.0006 * nap * lie + 0.00025 * fibre * nap)


def corduroy(rng: Draw, size: int, wales: int = 64) -> Surface:
    """Cords along v, `wales` in 0.32 m."""
    metres = 0.32
    u, _ = axes(size)
    t = u * wales
    body = 1 - (2 * (t - np.floor(t)) - 1) ** 2
    lie, fuzz = noise(rng, size, CLOUD), noise(rng, size, GRIT)
    fine = min(1.0, size / wales / 5)
    shade = 1 + fine * (0.4 * body - 0.26) + 0.05 * fuzz + 0.04 * lie
    return tile(metres, 0.3 + 0.05 * lie, shade, 0.02 * fuzz, fine * 0.0012 * body + 0.0001 * fuzz)


def looped(
    rng: Draw, size: int, across: int = 44, curl: float = 1.0, metres: float = 0.36
) -> Surface:
    """Loops or curls: bouclé, terry towels, looped carpets; `across` of them a tile."""
    near, _, own = cells(rng, size, across)
    bump = np.clip(1 - (1.35 * near) ** 2, 0, 1)
    lie, fuzz = noise(rng, size, CLOUD), noise(rng, size, GRIT)
    pitch = metres / across
    fine = min(1.0, pitch / (metres / size) / 4)
    shade = 1 + fine * curl * (0.4 * bump - 0.24) + 0.03 * lie + 0.03 * fuzz
    return tile(
        metres, 0.2 + 0.3 * own + 0.05 * lie, shade, 0.02 * fuzz, fine * 0.3 * pitch * curl * bump
    )


def felt(rng: Draw, size: int) -> Surface:
    """Felt or needle fleece: tangled fibres without direction."""
    a = noise(rng, size, STREAK._replace(along=6.0))
    b = noise(rng, size, STREAK._replace(along=1.0, across=6.0))
    lie = noise(rng, size, CLOUD)
    mix = 0.3 + 0.14 * a + 0.14 * b
    return tile(0.5, mix, 1 + 0.03 * (a + b) + 0.03 * lie, height=0.00008 * (a + b) + 0.0002 * lie)


def carpet(rng: Draw, size: int, tuft: float = 1.0, metres: float = 1.0) -> Surface:
    """Cut pile: tufts, and a lie that walking leaves."""
    tufts = noise(rng, size, GRIT)
    clump = noise(rng, size, Spectrum(0.5, 40))
    worn = noise(rng, size, CLOUD)
    mix = 0.25 + 0.13 * tufts + 0.1 * worn
    shade = 1 + 0.09 * tufts * tuft + 0.06 * clump * tuft + 0.05 * worn
    rough = 0.02 * tufts
    return tile(metres, mix, shade, rough, tuft * (0.001 * tufts + 0.0014 * clump) + 0.0006 * worn)


def sisal(rng: Draw, size: int) -> Surface:
    """Coarse natural fibre in ribs of 7 mm."""
    base = woven(rng, size, "rib", pitch=0.007, slub=1.8, threads="melange")
    dark = smoothstep(1.4, 2.2, noise(rng, size, STREAK))
    return tile(base.metres, base.mix + 0.3 * dark, base.shade, base.rough, base.height)


def rag(rng: Draw, size: int) -> Surface:
    """Rag rug: strips of many tones along u, 1.2 cm high."""
    metres, rows = 0.96, 80
    _, v = axes(size)
    t = v * rows
    j = np.floor(t).astype(np.int64)
    body = 1 - (2 * (t - j) - 1) ** 2
    tone = (rng.integers(0, 256, rows) / 256).astype(np.float32)[j]
    crumple = noise(rng, size, CRUMB._replace(along=2.0))
    shade = 0.78 + 0.26 * body + 0.06 * crumple
    return tile(metres, tone + 0.1 * crumple, shade, height=0.0025 * body + 0.0006 * crumple)


def kilim(rng: Draw, size: int) -> Surface:
    """Flat weave with stepped diamonds, 0.9 m."""
    metres, steps = 0.9, 60
    u, v = axes(size)
    a = np.floor(u * steps) / steps
    b = np.floor(v * steps) / steps
    count = rng.pick([3, 4, 5])
    x = np.abs((a * count) % 1 - 0.5)
    y = np.abs((b * 3) % 1 - 0.5)
    ring = np.floor((x + y) * rng.whole(4, 8))
    mix = (ring % 2) * (0.55 + 0.35 * (np.floor(b * 3) % 2))
    t = v * 180
    rib = 1 - (2 * (t - np.floor(t)) - 1) ** 2
    slub = noise(rng, size, SLUB)
    fine = min(1.0, size / 180 / 4)
    shade = 1 + fine * (0.22 * rib - 0.15) + 0.04 * slub
    return tile(metres, mix + 0.08 * slub, shade, 0.02 * slub, fine * 0.0006 * rib + 0.00015 * slub)


def leather(rng: Draw, size: int, grain: float = 1.0, count: int = 60) -> Surface:
    """Leather of 0.32 m: a net of creases, folds; `grain` is the depth of the creases."""
    near, second, own = cells(rng, size, count)
    crease = 1 - smoothstep(0.0, 0.3, second - near)
    folds = noise(rng, size, CLOUD)
    fine = min(1.0, size / count / 4)
    mix = 0.15 + 0.5 * fine * grain * crease - 0.06 * folds
    shade = 1 + 0.03 * folds + 0.03 * own - 0.08 * fine * crease
    rough = 0.15 * crease * fine * grain - 0.03 * folds
    return tile(0.32, mix, shade, rough, -0.0003 * grain * fine * crease + 0.0006 * folds)


def suede(rng: Draw, size: int) -> Surface:
    """Suede or microfibre: strokes of the nap."""
    return pile(rng, size, nap=0.5, metres=0.5)
