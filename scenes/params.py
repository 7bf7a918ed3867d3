"""Parameters of the assets and scenes stages."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Literal, get_args

from pbrnet.scenes.checked import AUTO, param, within
from pbrnet.scenes.looks import STYLES, Aspect, HomeSettings, LightSetting, StyleName
from pbrnet.scenes.registry import ImportEntry


@dataclass(frozen=True)
class AssetParams:
    """Optional furniture catalogues: those of a folder, else of Debian packages.

    Packages are taken from this machine where they are installed, else fetched.
    """

    enabled: bool = param(False, "download and convert furniture catalogues")
    folder: str = param("", "folder of .sh3f files or of pieces.csv; empty: the packages below")
    debian: tuple[str, ...] = param(("sweethome3d-furniture",), "packages with .sh3f files")
    max_triangles: int = param(
        200_000, "pieces with more triangles are refused", within(100, 2_000_000)
    )
    texture_size: int = param(1024, "pixels, longer side of an image", within(16, 8192))

    def verify(self, where: str) -> None:
        """Check that enabled assets have a source; raises ValueError."""
        if self.enabled and not self.folder and not self.debian:
            raise ValueError(f"{where}.folder: empty, and no package in debian; name either")
        for name in self.debian:
            if not re.fullmatch(r"[a-z0-9][a-z0-9+.-]+", name):
                raise ValueError(f"{where}.debian: {name!r} is not a package's name")


@dataclass(frozen=True)
class SceneParams:
    """Parameters of the `scenes` stage.

    Variants are scenes of one plan that differ in what `vary` names. Where ordinary homes take no
    catalogue furniture, furnished ones show networks what they were not trained on: see
    `dataset.splits.test_only`. An import beyond its limits is stopped and reported as failed.
    """

    homes: int = param(12, "number of procedural homes", within(0, 1_000_000))
    variants: int = param(1, "scenes per floor plan; all of them in one split", within(1, 1000))
    vary: tuple[Aspect, ...] = param(
        ("finishes", "furniture", "light", "outdoors"), "differences between variants"
    )
    rooms_min: int = param(1, "minimum rooms per home", within(1, 6))
    rooms_max: int = param(6, "maximum rooms per home", within(1, 6))
    lighting: tuple[LightSetting, ...] = param(
        ("day", "evening", "night", "mixed"),
        "day, evening, night, mixed, pbrs: in rotation, so that every split has each",
    )
    outdoors: Literal["surroundings", "none"] = param(
        "surroundings", "surroundings: street, garden or town outside; or none, as always for pbrs"
    )
    styles: tuple[StyleName, ...] = param(STYLES, "interior styles, drawn per home")
    texture_size: int = param(
        256, "pixels per side; auto: depends on image.width", within(64, 4096), AUTO
    )
    catalogue_share: float = param(
        0.0, "probability that a piece comes from the catalogues, if one fits", within(0, 1)
    )
    furnished_homes: int = param(
        0, "additional homes, furnished-0000 and so on, with the share below", within(0, 1_000_000)
    )
    furnished_share: float = param(0.7, "catalogue_share of the furnished homes", within(0.01, 1))
    catalogue_triangles: int = param(
        30_000, "catalogue pieces with more triangles are not used", within(100, 2_000_000)
    )
    imports: tuple[str | ImportEntry, ...] = param(
        (), "scene files, or {file: ..., options of `pbrnet import`}"
    )
    import_seconds: float = param(900.0, "time limit of an import", within(0.1, 1e6))
    import_memory: float = param(16.0, "GiB, memory limit of an import", within(0.25, 1e5))

    @property
    def most_scenes(self) -> int:
        """Homes and imports with all their variants, if none fails."""
        return (self.homes + self.furnished_homes + len(self.imports)) * self.variants

    def home(
        self, seed: int, lighting: LightSetting, variant: int = 0, catalogue: str = ""
    ) -> HomeSettings:
        """Settings of a home; `catalogue` is the digest of the furniture index that it needs."""
        return HomeSettings(
            seed,
            lighting,
            (self.rooms_min, self.rooms_max),
            self.styles,
            self.texture_size,
            (variant, *sorted(self.vary)) if variant else (),
            self.catalogue_share,
            self.catalogue_triangles if self.catalogue_share else 0,
            catalogue,
            self.outdoors,
        )

    def verify(self, where: str) -> None:
        """Checks across fields; raises ValueError."""
        if self.rooms_min > self.rooms_max:
            raise ValueError(
                f"{where}.rooms_min: {self.rooms_min} is more than rooms_max {self.rooms_max}"
            )
        if not self.lighting:
            allowed = ", ".join(get_args(LightSetting))
            raise ValueError(f"{where}.lighting: name at least one of {allowed}")
        if not self.styles:
            raise ValueError(f"{where}.styles: name at least one of {', '.join(STYLES)}")
        fixed: set[Aspect] = set()  # aspects of homes that cannot vary
        if self.homes or self.furnished_homes:
            fixed |= {"light", "outdoors"} if set(self.lighting) == {"pbrs"} else set()
            fixed |= {"outdoors"} if self.outdoors == "none" else set()
        if self.variants > 1 and fixed.issuperset(self.vary):
            possible = ", ".join(name for name in get_args(Aspect) if name not in fixed)
            raise ValueError(
                f"{where}.vary: {self.variants} variants that differ in nothing; name at least "
                f"one of {possible}"
            )
