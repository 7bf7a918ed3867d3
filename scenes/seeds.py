"""Seeds derived from one root seed by names, and the random draws that they decide."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TypeVar

import numpy as np

from pbrnet.scenes.files import digest_bytes

Item = TypeVar("Item")


class Draw(np.random.Generator):
    """NumPy generator with the draws of generated scenes, each one call of the base class.

    `generator` makes one from a seed and names; array draws (`uniform`, `normal`, `permutation`)
    are the base class's own.
    """

    def between(self, low: float, high: float) -> float:
        """Draw a number uniformly from [low, high)."""
        return float(self.uniform(low, high))

    def whole(self, low: int, high: int | None = None) -> int:
        """Draw a whole number from [low, high), or from [0, low) without `high`."""
        return int(self.integers(low, high))

    def chance(self, share: float) -> bool:
        """Draw whether something that is so with probability `share` is so."""
        return float(self.random()) < share

    def pick(self, items: Sequence[Item]) -> Item:
        """Draw one of the items, each as likely; the same draw as `choice` of a list."""
        return items[int(self.integers(len(items)))]

    def weighted(self, items: Sequence[Item], shares: Sequence[float]) -> Item:
        """Draw one of the items with the probabilities `shares`, whose sum is 1."""
        return items[int(self.choice(len(items), p=shares))]

    def shuffled(self, items: Sequence[Item]) -> list[Item]:
        """Draw an order of the items."""
        return [items[index] for index in self.permutation(len(items)).tolist()]

    def variant(self) -> int:
        """Draw the seed of a pattern, a whole number below 2^30."""
        return int(self.integers(1 << 30))


def derive(root: int, *names: str | int) -> int:
    """A 64-bit seed for the purpose that `names` state, e.g. `derive(0, "home", 3, "plan")`.

    Equal arguments give equal seeds on every machine; any difference gives an unrelated one.
    """
    parts = [str(int(root)).encode(), *(str(name).encode() for name in names)]
    return int(digest_bytes(*parts)[:16], 16)


def derive32(root: int, *names: str | int) -> int:
    """The same, truncated to the 32 bits that Mitsuba's samplers and torch's workers accept."""
    return derive(root, *names) & 0xFFFFFFFF


def generator(root: int, *names: str | int) -> Draw:
    """Return an independent NumPy generator (PCG64) for the purpose that `names` state."""
    return Draw(np.random.PCG64(derive(root, *names)))
