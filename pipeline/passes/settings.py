"""Parameters of the frames: panoramas, path tracing, light groups, neutral reflectance."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal

from pbrnet.scenes.checked import OPTIONAL, param, within


def _check_even(width: int, where: str) -> None:
    """Raise ValueError for a panorama whose height is no whole number."""
    if width % 2:
        raise ValueError(f"{where}.width: {width} is odd; the height is half of it")


@dataclass(frozen=True)
class IlluminationParams:
    """Panorama of visible light sources; its height is half its width."""

    width: int = param(160, "pixels; the height is half", within(16, 4096))
    supersampling: int = param(4, "rays per axis and pixel", within(1, 16))
    light_samples: int = param(64, "samples per small light", within(1, 4096))
    shadow_rays: int = param(8, "rays per pixel, for data/visibility; 0: none", within(0, 1024))

    def verify(self, where: str) -> None:
        """Raise ValueError unless the height is a whole number."""
        _check_even(self.width, where)


@dataclass(frozen=True)
class GroundTruthParams:
    """Path-traced shading and colour."""

    spp: int = param(16, "samples per pixel", within(1, 1 << 20))
    block_spp: int = param(8, "maximum samples per seeded block", within(1, 4096))
    noise: float = param(0.0, "target relative noise per view; 0: always spp samples", within(0, 1))
    min_spp: int = param(
        16, "minimum samples with a noise target; spp is then the maximum", within(1, 1 << 20)
    )
    train_spp: int = param(
        0,
        "samples of training and validation views, without target; 0: spp",
        within(0, 1 << 20),
        OPTIONAL,
    )
    max_depth: int = param(11, "maximum segments of a path", within(1, 1000))
    rr_depth: int = param(3, "segments before Russian roulette starts", within(1, 1000))
    denoise: Literal["none", "oidn"] = param("oidn", "oidn or none")
    joint: bool = param(True, "render shading and colour in one trace, if the variant supports it")
    lights: Literal["planned", "uniform"] = param(
        "planned", "emitter sampling: planned, by contribution to the view, or uniform"
    )

    def verify(self, where: str) -> None:
        """Raise ValueError unless block_spp divides spp and min_spp is at most spp."""
        if self.noise and self.min_spp > self.spp:
            raise ValueError(f"{where}.min_spp: {self.min_spp} is more than spp ({self.spp})")
        if self.spp % self.block_spp and self.spp > self.block_spp:
            raise ValueError(f"{where}.spp: {self.spp} is not a multiple of block_spp")

    def sampled(self, spp: int, denoise: Literal["none", "oidn"] = "none") -> GroundTruthParams:
        """The same with exactly `spp` samples per pixel."""
        block = min(self.block_spp, spp & -spp)  # the largest power of two in spp
        return replace(self, spp=spp, block_spp=block, noise=0.0, train_spp=0, denoise=denoise)


@dataclass(frozen=True)
class LightParams:
    """Light groups, if `channels` names `light`."""

    groups: int = param(
        0, "lamps with a separate image, besides sky, sun and the rest; 0: none", within(0, 32)
    )

    @property
    def images(self) -> int:
        """Number of light groups: lamps, sky, sun and the rest; 0 without groups."""
        return self.groups + 3 if self.groups else 0


@dataclass(frozen=True)
class NoisyParams:
    """A few samples per pixel, independent of the ground truth, as input of a network."""

    spp: int = param(0, "independent samples per pixel, for train.hybrid; 0: none", within(0, 16))
    train: tuple[int, ...] = param(
        (), "[min, max] drawn per training and validation scene; []: spp", OPTIONAL
    )

    def verify(self, where: str) -> None:
        """Raise ValueError unless `train` is empty or a range that is above 0."""
        if not self.train:
            return
        if len(self.train) != 2 or not 1 <= self.train[0] <= self.train[1] <= 16:
            raise ValueError(f"{where}.train: {list(self.train)}; [least, most], from 1 to 16")
        if not self.spp:
            raise ValueError(f"{where}.train: {list(self.train)} needs spp, that of the test split")


@dataclass(frozen=True)
class EnvironmentParams:
    """Panorama of all that a camera position sees; its height is half its width."""

    width: int = param(160, "pixels; the height is half", within(16, 4096))
    spp: int = param(
        16, "samples per pixel; depth, lights and denoiser as for groundtruth", within(1, 1 << 20)
    )

    def verify(self, where: str) -> None:
        """Raise ValueError unless the height is a whole number."""
        _check_even(self.width, where)


@dataclass(frozen=True)
class ShadingParams:
    """Neutral reflectance of the textureless shading."""

    albedo: float = param(0.5, "grey that replaces all reflectances", within(0.01, 1))
