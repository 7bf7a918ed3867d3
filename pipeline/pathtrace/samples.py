"""Random numbers of paths: stratified within a pixel, and a function of seed and sample alone.

Each draw is a (0, 2)-net of Sobol's over the samples of a pixel, in an order of its own. A sample's
path depends neither on the number of lanes nor on what its lane traced before.
"""

from __future__ import annotations

from dataclasses import dataclass

import drjit as dr
import mitsuba as mi

_ROUNDS = 6  # of hashes: with 4, draws correlate by up to 0.04
_STEPS = (0x9E3779B9, 0x91E10DA5)  # of the places within strata, in 2^-32
_SHIFTS = (1, 2, 4, 8, 16)
_MASKS = (0x55555555, 0x33333333, 0x0F0F0F0F, 0x00FF00FF, 0x0000FFFF)


@dataclass
class PathSampler:
    """Random numbers of the samples that lanes trace; `spp` is a power of two.

    Samples are numbered by pixel, then within it.
    """

    seed: mi.UInt32
    spp: int
    pixel: mi.UInt32  # hash of the seed and the pixel
    index: mi.UInt32  # sample in the pixel
    dimension: mi.UInt32  # number of draws so far

    @staticmethod
    def of(samples: mi.UInt32, spp: int, seed: mi.UInt32) -> PathSampler:
        """Return the sampler of these samples, before their first draw."""
        zero = dr.zeros(mi.UInt32, dr.width(samples))
        sampler = PathSampler(seed, spp, zero, zero, zero)
        sampler.begin(samples, mi.Bool(True))
        return sampler

    def begin(self, samples: mi.UInt32, where: mi.Bool) -> None:
        """Go to the first draw of other samples, in some lanes."""
        bits = self.spp.bit_length() - 1
        pixel, _ = mi.sample_tea_32(samples >> bits, self.seed, _ROUNDS)
        self.pixel = dr.select(where, pixel, self.pixel)
        self.index = dr.select(where, samples & (self.spp - 1), self.index)
        self.dimension = dr.select(where, mi.UInt32(0), self.dimension)

    def next_1d(self, active: mi.Bool = True) -> mi.Float:
        """Return a number in [0, 1) for each lane."""
        index, scramble, _ = self._draw()
        return _number(dr.brev(index) ^ self._within(index, 0) ^ scramble)

    def next_2d(self, active: mi.Bool = True) -> mi.Point2f:
        """Return a point in [0, 1)^2 for each lane."""
        index, first, second = self._draw()
        bits = dr.brev(index)
        x = bits ^ self._within(index, 0) ^ first
        y = _sobol(bits) ^ self._within(index, 1) ^ second
        return mi.Point2f(_number(x), _number(y))

    def _within(self, index: mi.UInt32, axis: int) -> mi.UInt32:
        """Return the digits below the net's: else all samples had one place in their strata."""
        return (index * _STEPS[axis]) >> (self.spp.bit_length() - 1)

    def _draw(self) -> tuple[mi.UInt32, mi.UInt32, mi.UInt32]:
        """Return the place of this sample in the next draw, and two scrambles of its digits."""
        order, scramble = mi.sample_tea_32(self.pixel, self.dimension, _ROUNDS)
        self.dimension += 1
        place = mi.permute(self.index, self.spp, order) if self.spp > 1 else self.index
        return place, scramble, (scramble ^ order) * 0x9E3779B9


def _sobol(reversed_index: mi.UInt32) -> mi.UInt32:
    """Return the digits of Sobol's second dimension from an index with its bits reversed.

    Its generator matrix is Pascal's triangle modulo 2.
    """
    found = reversed_index
    for shift, mask in zip(_SHIFTS, _MASKS, strict=True):
        found ^= (found & mask) << shift
    return found


def _number(digits: mi.UInt32) -> mi.Float:
    """Return digits as a number in [0, 1)."""
    return mi.Float(digits >> 8) * 2.0**-24
