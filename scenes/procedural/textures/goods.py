"""Stone, metal, paint, plastic, ceramics, paper, leaves and grounds."""

from __future__ import annotations

import numpy as np

from pbrnet.scenes.procedural.textures.fields import (
    BLOTCH,
    CLOUD,
    CRUMB,
    GRIT,
    STREAK,
    Spectrum,
    Surface,
    axes,
    cells,
    noise,
    smoothstep,
    tile,
)
from pbrnet.scenes.seeds import Draw


def granite(rng: Draw, size: int) -> Surface:
    """Polished granite: crystals of several tones."""
    _, _, own = cells(rng, size, 64)
    specks = noise(rng, size, GRIT)
    large = noise(rng, size, CRUMB)
    mix = 0.5 * smoothstep(0.55, 0.75, own) + 0.3 * smoothstep(0.7, 1.5, specks)
    return tile(0.5, mix + 0.08 * large, 1 + 0.05 * specks, 0.01 * specks, 0.000006 * specks)


def marble(rng: Draw, size: int) -> Surface:
    """Marble with branching veins over clouds."""
    bend = noise(rng, size, CLOUD._replace(falloff=1.9))
    field = noise(rng, size, CLOUD) + 0.4 * bend
    main = field / 0.06
    fine = (noise(rng, size, BLOTCH) + 0.5 * field) / 0.05
    veins = 1 / (1 + main * main) + 0.4 / (1 + fine * fine)
    cloud = smoothstep(-1.5, 2.5, noise(rng, size, CLOUD))
    return tile(1.4, 0.6 * veins + 0.22 * cloud, 1 + 0.015 * bend, 0.04 * veins, -0.00001 * veins)


def travertine(rng: Draw, size: int) -> Surface:
    """Travertine or limestone: bands with elongated holes."""
    bands = noise(rng, size, Spectrum(1.2, 2, 7.0))
    holes = smoothstep(1.7, 2.3, noise(rng, size, CRUMB._replace(along=4.0)))
    mix = 0.3 + 0.2 * bands + 0.4 * holes
    shade = 1 + 0.03 * bands - 0.2 * holes
    return tile(1.0, mix, shade, 0.03 * bands + 0.3 * holes, -0.0012 * holes)


def slate(rng: Draw, size: int) -> Surface:
    """Riven slate: steps of thin layers."""
    field = 2.2 * noise(rng, size, BLOTCH)
    steps = np.floor(field) + smoothstep(0.8, 1.0, field - np.floor(field))
    grit = noise(rng, size, GRIT)
    shade = 1 + 0.04 * steps + 0.03 * grit
    return tile(0.9, 0.3 + 0.1 * steps, shade, 0.04 * grit, 0.0006 * steps + 0.00012 * grit)


def terrazzo(rng: Draw, size: int) -> Surface:
    """Chips of stone in cement, ground flat."""
    near, second, own = cells(rng, size, 26)
    chip = smoothstep(0.06, 0.12, second - near) * smoothstep(0.35, 0.4, own)
    _, gap, other = cells(rng, size, 64)
    small = smoothstep(0.7, 0.75, other) * smoothstep(0.3, 0.5, gap) * (1 - chip)
    tone = np.maximum(chip * own, 0.8 * small)
    shade = 1 + 0.12 * chip * (own - 0.7) + 0.015 * noise(rng, size, CLOUD)
    return tile(0.8, tone, shade, -0.06 * chip + 0.01 * noise(rng, size, CLOUD))


def composite(rng: Draw, size: int) -> Surface:
    """Quartz composite or laminate with fine speckles."""
    specks = noise(rng, size, GRIT)
    mix = 0.6 * smoothstep(1.2, 2.2, specks) + 0.3 * smoothstep(1.5, 2.5, -specks)
    return tile(0.5, mix, 1 + 0.02 * specks, 0.015 * noise(rng, size, CLOUD), 0.000008 * specks)


def lacquer(rng: Draw, size: int, peel: float = 1.0) -> Surface:
    """Sprayed lacquer or powder coat: orange peel of `peel`."""
    skin = noise(rng, size, Spectrum(0.9, 40))
    cloud = noise(rng, size, CLOUD)
    shade = 1 + 0.006 * cloud
    rough = 0.025 * cloud + 0.02 * peel * skin
    return tile(0.4, shade=shade, rough=rough, height=0.00002 * peel * skin + 0.00005 * cloud)


def plastic(rng: Draw, size: int, spark: float = 0.0) -> Surface:
    """Moulded plastic: smooth, or with an eroded texture of `spark`."""
    grain = noise(rng, size, GRIT)
    cloud = noise(rng, size, CLOUD)
    shade = 1 + 0.01 * cloud + 0.02 * spark * grain
    rough = 0.02 * cloud + 0.05 * spark * grain
    return tile(0.24, shade=shade, rough=rough, height=0.00005 * spark * grain + 0.00006 * cloud)


def brushed(rng: Draw, size: int) -> Surface:
    """Metal brushed along u."""
    lines = noise(rng, size, Spectrum(0.25, 16, 60.0))
    cloud = noise(rng, size, CLOUD)
    return tile(
        0.3, shade=1 + 0.03 * lines, rough=0.05 * lines + 0.03 * cloud, height=0.000012 * lines
    )


def polished(rng: Draw, size: int) -> Surface:
    """Plated or polished metal with smears of hands."""
    smear = smoothstep(0.6, 2.0, noise(rng, size, BLOTCH))
    rough = 0.12 * smear + 0.01 * noise(rng, size, CLOUD)
    return tile(0.4, shade=1 - 0.03 * smear, rough=rough, height=0.00003 * noise(rng, size, CLOUD))


def cast(rng: Draw, size: int) -> Surface:
    """Cast iron or aluminium with a sandy skin."""
    sand, crumb = noise(rng, size, GRIT), noise(rng, size, CRUMB)
    return tile(
        0.3, 0.2 + 0.1 * crumb, 1 + 0.04 * sand, 0.06 * crumb, 0.00009 * sand + 0.0001 * crumb
    )


def hammered(rng: Draw, size: int) -> Surface:
    """Metal with the dents of a hammer, 1.5 cm wide."""
    near, _, own = cells(rng, size, 20)
    return tile(
        0.3, shade=1 + 0.03 * own, rough=0.05 * noise(rng, size, CLOUD), height=0.0006 * near * near
    )


def patinated(rng: Draw, size: int) -> Surface:
    """Aged brass or galvanised steel: patches of other tone and gloss."""
    _, _, own = cells(rng, size, 22)
    patch = noise(rng, size, BLOTCH)
    mix = 0.3 + 0.25 * patch + 0.2 * (own - 0.5)
    return tile(0.4, mix, 1 + 0.08 * (own - 0.5), 0.07 * patch + 0.06 * own, 0.00005 * patch)


def glazed(rng: Draw, size: int, wavy: float = 1.0) -> Surface:
    """Glazed ceramic with slight waves and pinholes."""
    waves = noise(rng, size, CLOUD)
    pins = smoothstep(3.0, 3.4, noise(rng, size, CRUMB))
    mix = np.float32(0.4) * pins
    return tile(0.4, mix, 1 + 0.01 * waves, 0.015 * waves + 0.3 * pins, 0.00025 * wavy * waves)


def speckled(rng: Draw, size: int) -> Surface:
    """Stoneware glaze with iron specks and rings of the wheel."""
    specks = smoothstep(2.0, 2.6, noise(rng, size, GRIT))
    rings = noise(rng, size, Spectrum(0.6, 10, 60.0))
    cloud = noise(rng, size, CLOUD)
    mix = 0.7 * specks + 0.1 + 0.1 * cloud
    return tile(0.3, mix, 1 + 0.03 * cloud + 0.01 * rings, 0.04 * cloud, 0.0001 * rings)


def earthenware(rng: Draw, size: int) -> Surface:
    """Unglazed clay with bloom of lime."""
    grit, cloud = noise(rng, size, GRIT), noise(rng, size, BLOTCH)
    bloom = smoothstep(0.8, 2.0, cloud)
    return tile(
        0.3, 0.15 + 0.1 * cloud, 1 + 0.05 * grit + 0.15 * bloom, 0.03 * grit, 0.00008 * grit
    )


def paper(rng: Draw, size: int, fold: float = 1.0) -> Surface:
    """Paper or card: fibres and a slight cockle."""
    fibre, cockle = noise(rng, size, GRIT), noise(rng, size, CLOUD)
    mix = 0.1 + 0.05 * fibre
    return tile(0.3, mix, 1 + 0.012 * fibre, 0.01 * fibre, 0.00002 * fibre + 0.0003 * fold * cockle)


def corrugated(rng: Draw, size: int) -> Surface:
    """Corrugated board: brown fibres over faint flutes."""
    u, _ = axes(size)
    t = u * 60
    flute = 1 - (2 * (t - np.floor(t)) - 1) ** 2
    fibre = noise(rng, size, STREAK)
    height = 0.0001 * flute + 0.0003 * noise(rng, size, CLOUD)
    return tile(0.4, 0.3 + 0.1 * fibre, 1 + 0.03 * fibre + 0.02 * flute, 0.02 * fibre, height)


def canvas(rng: Draw, size: int) -> Surface:
    """Primed canvas or heavy paper under a picture; a tile is the picture, about 0.6 m."""
    threads = noise(rng, size, Spectrum(0.2, 60))
    brush = noise(rng, size, CRUMB)
    return tile(0.6, rough=0.05 * brush, height=0.00008 * threads + 0.0002 * brush)


def leaf(rng: Draw, size: int) -> Surface:
    """Leaves: mottled, with a net of veins."""
    near, second, _ = cells(rng, size, 24)
    vein = 1 - smoothstep(0.0, 0.15, second - near)
    mottle = noise(rng, size, BLOTCH)
    mix = 0.3 + 0.22 * mottle + 0.2 * vein
    shade = np.clip(1 + 0.1 * noise(rng, size, CRUMB), 0.5, 1.5)
    return tile(0.3, mix, shade, 0.06 * mottle, -0.0003 * vein + 0.0004 * mottle)


def soil(rng: Draw, size: int, crumbs: float = 1.0) -> Surface:
    """Potting soil or mulch: crumbs and bits of bark."""
    near, _, own = cells(rng, size, 26)
    crumb = noise(rng, size, CRUMB)
    clod = np.clip(1 - near, 0, 1)
    mix = 0.2 + 0.4 * own + 0.15 * crumb
    shade = np.clip(0.7 + 0.5 * clod + 0.15 * crumb, 0.3, 1.8)
    return tile(0.3, mix, shade, height=crumbs * (0.004 * clod + 0.001 * crumb))


def gravel(rng: Draw, size: int) -> Surface:
    """Pebbles of 1 to 3 cm."""
    near, second, own = cells(rng, size, 40)
    stone = smoothstep(0.0, 0.35, second - near)
    mix = own + 0.1 * noise(rng, size, GRIT)
    return tile(0.8, mix, 0.45 + 0.6 * stone + 0.06 * noise(rng, size, GRIT), height=0.008 * stone)


def lawn(rng: Draw, size: int, long: float = 1.0) -> Surface:
    """Grass from above: blades, tufts, thin and dry patches."""
    blades = noise(rng, size, Spectrum(0.3, 30, 1.0, 2.5))
    other = noise(rng, size, Spectrum(0.3, 30, 2.5))
    tuft = noise(rng, size, CRUMB)
    patches = noise(rng, size, CLOUD)
    blade = np.maximum(blades, other)
    mix = 0.3 + 0.18 * patches + 0.12 * blade + 0.08 * tuft
    shade = np.clip(0.9 + 0.2 * blade + 0.1 * tuft, 0.3, 1.8)
    return tile(3.0, mix, shade, height=long * (0.006 * blade + 0.008 * tuft))


def asphalt(rng: Draw, size: int) -> Surface:
    """Asphalt with its stones worn bare, and tar repairs."""
    near, second, own = cells(rng, size, 90)
    stone = smoothstep(0.0, 0.3, second - near) * smoothstep(0.4, 0.5, own)
    cloud = noise(rng, size, CLOUD)
    tar = 1 - smoothstep(0.0, 0.035, np.abs(noise(rng, size, CLOUD._replace(falloff=1.9))))
    mix = 0.2 + 0.5 * stone
    return tile(1.6, mix, 1 + 0.06 * cloud - 0.35 * tar + 0.1 * stone, -0.2 * tar, 0.002 * stone)
