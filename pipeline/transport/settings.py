"""Parameters of light transport without paths."""

from __future__ import annotations

from dataclasses import dataclass, replace

from pbrnet.scenes.checked import param, within

TRANSPORT_SAMPLES = (1, 2, 4, 8, 16, 64)
SURFELS_A_SAMPLE = 4000  # of light transport with few samples: balanced in error
USUAL_SURFELS = 16000  # in images of 160x120
MIN_SURFELS = 8


@dataclass(frozen=True)
class TransportParams:
    """Light transport without paths, if `channels` names `transport`."""

    samples: int = param(
        0, "per pixel, a power of two; 0: by image size, 16 at 160x120", within(0, 64)
    )
    surfels: int = param(
        0, "number of surfels; 0: by image size, 16,000 at 160x120", within(0, 32000)
    )
    bounces: int = param(8, "bounces of light between surfels", within(0, 64))

    def verify(self, where: str) -> None:
        """Raise ValueError for a number of samples that is no grid of nearly equal sides."""
        if self.samples and self.samples not in TRANSPORT_SAMPLES:
            raise ValueError(f"{where}.samples: {self.samples}; 0, 1, 2, 4, 8, 16 or 64")
        if 0 < self.surfels < MIN_SURFELS:
            raise ValueError(f"{where}.surfels: {self.surfels}; 0, or at least {MIN_SURFELS}")

    def reduced(self, samples: int) -> TransportParams:
        """The same with so many samples per pixel, and no more surfels than suit them."""
        enough = SURFELS_A_SAMPLE * samples
        surfels = enough if enough < (self.surfels or USUAL_SURFELS) else self.surfels
        return replace(self, samples=samples, surfels=surfels)
