"""Derivation of seeds from one root seed by names."""

from __future__ import annotations

import numpy as np

from pbrnet.scenes.files import digest_bytes


def derive(root: int, *names: str | int) -> int:
    """A 64-bit seed for the purpose that `names` state, e.g. `derive(0, "home", 3, "plan")`.

    Equal arguments give equal seeds on every machine; any difference gives an unrelated one.
    """
    parts = [str(int(root)).encode(), *(str(name).encode() for name in names)]
    return int(digest_bytes(*parts)[:16], 16)


def derive32(root: int, *names: str | int) -> int:
    """The same, truncated to the 32 bits that Mitsuba's samplers and torch's workers accept."""
    return derive(root, *names) & 0xFFFFFFFF


def generator(root: int, *names: str | int) -> np.random.Generator:
    """Return an independent NumPy generator (PCG64) for the purpose that `names` state."""
    return np.random.Generator(np.random.PCG64(derive(root, *names)))
