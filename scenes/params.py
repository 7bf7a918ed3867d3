"""Parameters of the assets and scenes stages."""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from typing import Literal, get_args

from pbrnet.scenes.checked import within
from pbrnet.scenes.import_options import ImportEntry

LightSetting = Literal["day", "evening", "night", "mixed"]
Aspect = Literal["finishes", "furniture", "light", "outdoors"]
StyleName = Literal[
    "scandinavian", "mid-century", "industrial", "farmhouse", "classic", "minimal", "bohemian",
    "seventies", "japandi", "eclectic",
]  # fmt: skip
STYLES: tuple[StyleName, ...] = get_args(StyleName)


@dataclass(frozen=True)
class AssetParams:
    """Optional furniture catalogues: `.sh3f` files of a folder, else of Debian packages."""

    enabled: bool = False
    folder: str = ""  # the `.sh3f` files in it are used, and nothing is fetched
    # Packages that hold `.sh3f` files; taken from this machine where they are installed.
    debian: tuple[str, ...] = ("sweethome3d-furniture",)
    max_triangles: int = field(default=200_000, metadata=within(100, 2_000_000))  # of one piece
    texture_size: int = field(default=1024, metadata=within(16, 8192))  # pixels, longer side

    def verify(self, where: str) -> None:
        """Check that enabled assets have a source; raises ValueError."""
        if self.enabled and not self.folder and not self.debian:
            raise ValueError(f"{where}.folder: empty, and no package in debian; name either")
        for name in self.debian:
            if not re.fullmatch(r"[a-z0-9][a-z0-9+.-]+", name):
                raise ValueError(f"{where}.debian: {name!r} is not a package's name")


@dataclass(frozen=True)
class SceneParams:
    """Parameters of the `scenes` stage."""

    homes: int = field(default=12, metadata=within(0, 1_000_000))
    # Scenes of one plan: the home itself, and others that differ in what `vary` names.
    variants: int = field(default=1, metadata=within(1, 1000))
    vary: tuple[Aspect, ...] = ("finishes", "furniture", "light", "outdoors")
    rooms_min: int = field(default=1, metadata=within(1, 6))
    rooms_max: int = field(default=6, metadata=within(1, 6))
    # Light settings, dealt out in turn so that every split sees each.
    lighting: tuple[LightSetting, ...] = ("day", "evening", "night", "mixed")
    styles: tuple[StyleName, ...] = STYLES  # of the homes' interiors, drawn per home
    # Pixels a side; a parameter file may say `auto`, see `pbrnet.pipeline.params.texture_size_for`.
    texture_size: int = field(default=256, metadata=within(64, 4096))
    # Share of the furniture that comes from the catalogues of the `assets` stage, where those
    # have something fitting; 0: all of it is the generator's own.
    catalogue_share: float = field(default=0.0, metadata=within(0, 1))
    # More homes, furnished-0000 and so on, with another share of catalogue furniture. Where the
    # homes above take none, these show networks what they were not trained on: see
    # `dataset.splits.test_only`.
    furnished_homes: int = field(default=0, metadata=within(0, 1_000_000))
    furnished_share: float = field(default=0.7, metadata=within(0.01, 1))
    # Catalogue pieces with more triangles than this are not used in homes.
    catalogue_triangles: int = field(default=30_000, metadata=within(100, 2_000_000))
    # Scenes of one's own: files that `pbrnet import` reads, brought in by the same stage.
    imports: tuple[str | ImportEntry, ...] = ()
    # An import that takes longer, or more memory, is stopped and reported as failed.
    import_seconds: float = field(default=900.0, metadata=within(0.1, 1e6))
    import_memory: float = field(default=16.0, metadata=within(0.25, 1e5))  # GiB

    def verify(self, where: str) -> None:
        """Checks across fields; raises ValueError."""
        if self.rooms_min > self.rooms_max:
            raise ValueError(
                f"{where}.rooms_min: {self.rooms_min} is more than rooms_max {self.rooms_max}"
            )
        if not self.lighting:
            raise ValueError(f"{where}.lighting: name at least one of day, evening, night, mixed")
        if not self.styles:
            raise ValueError(f"{where}.styles: name at least one of {', '.join(STYLES)}")
        if self.variants > 1 and not self.vary:
            raise ValueError(
                f"{where}.vary: {self.variants} variants that differ in nothing; name at least "
                "one of finishes, furniture, light, outdoors"
            )
