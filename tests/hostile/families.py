"""Table of the families of hostile input. A new format is one more entry."""

from random import Random

from tests.hostile.family import Family
from tests.hostile.project_files import (
    calibrations,
    catalogues,
    command_lines,
    dataset,
    exported_scenes,
    folders,
    frames,
    networks,
    params,
    photographs,
    submissions,
)
from tests.hostile.scene_files import (
    blender,
    buildings,
    compressed,
    homes,
    images,
    layout_formats,
    layouts,
    mitsuba,
    models,
    pbrt,
)

FAMILIES: tuple[Family, ...] = (
    *homes.FAMILIES,
    *mitsuba.FAMILIES,
    *models.FAMILIES,
    *images.FAMILIES,
    *layouts.FAMILIES,
    *buildings.FAMILIES,
    *compressed.FAMILIES,
    *layout_formats.FAMILIES,
    *pbrt.FAMILIES,
    *blender.FAMILIES,
    *params.FAMILIES,
    *calibrations.FAMILIES,
    *frames.FAMILIES,
    *dataset.FAMILIES,
    *submissions.FAMILIES,
    *networks.FAMILIES,
    *photographs.FAMILIES,
    *folders.FAMILIES,
    *exported_scenes.FAMILIES,
    *catalogues.FAMILIES,
    *command_lines.FAMILIES,
)
_CHEAP = 0.5  # seconds of a core


def all_cases() -> list[tuple[Family, int]]:
    """All cases of all families."""
    return [(family, number) for family in FAMILIES for number in range(family.cases)]


def sound_cases() -> list[tuple[Family, int]]:
    """Undamaged files with each command line of their family."""
    return [(family, -1 - n) for family in FAMILIES for n in range(len(family.sound))]


def sample(count: int, seed: int = 1) -> list[tuple[Family, int]]:
    """`count` cases, drawn evenly from the families whose cases are cheap."""
    cheap = [family for family in FAMILIES if family.seconds <= _CHEAP]
    rng = Random(seed)
    shares = [count // len(cheap) + (n < count % len(cheap)) for n in range(len(cheap))]
    return [
        (family, number)
        for family, share in zip(cheap, shares, strict=True)
        for number in sorted(
            rng.sample([n for n in range(family.cases) if n not in family.costly], share)
        )
    ]
