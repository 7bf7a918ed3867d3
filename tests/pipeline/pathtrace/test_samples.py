"""Random numbers of paths: nets within a pixel, independent else, and the same for all lanes."""

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest
from scipy.stats import kstest

from pbrnet.pipeline.pathtrace.samples import PathSampler, _number, _sobol

pytestmark = pytest.mark.usefixtures("wavefront")


def rows(sampler: PathSampler, draws: int = 3) -> np.ndarray:
    """Points, each followed by a number, of each lane, (lanes, 3 draws)."""
    values = []
    for _ in range(draws):
        values += [*sampler.next_2d(), sampler.next_1d()]
    dr.eval(values)
    return np.stack([np.array(value) for value in values], axis=-1).astype(np.float64)


def sampler_of(samples: np.ndarray, spp: int, seed: int = 5) -> PathSampler:
    return PathSampler.of(mi.UInt32(samples), spp, dr.opaque(mi.UInt32, seed))


def by_pixel(pixels: int, spp: int, seed: int = 5, draws: int = 3) -> np.ndarray:
    """The same of all samples of the first pixels, (pixels, spp, 3 draws)."""
    sampler = sampler_of(np.arange(pixels * spp), spp, seed)
    return rows(sampler, draws).reshape(pixels, spp, -1)


@pytest.mark.parametrize("bits", [0, 3, 8])
def test_each_elementary_interval_holds_one_sample(bits: int) -> None:
    """Those of all shapes with area 1 / spp, in each pixel and draw; so are those of a number."""
    spp = 1 << bits
    values = by_pixel(16, spp)
    assert values.min() >= 0 and values.max() < 1
    for draw in range(0, values.shape[-1], 3):
        x, y, number = np.moveaxis(values[..., draw : draw + 3], -1, 0)
        cells = [
            np.floor(x * (1 << across)) * (spp >> across) + np.floor(y * (spp >> across))
            for across in range(bits + 1)
        ]
        for cell in (*cells, np.floor(number * spp)):
            np.testing.assert_array_equal(
                np.sort(cell, axis=1), np.broadcast_to(np.arange(spp), cell.shape)
            )


@pytest.mark.parametrize("spp", [4, 16, 64])
def test_places_within_strata_differ(spp: int) -> None:
    """A pixel's mean of a number errs no more than if each sample were anywhere in its stratum."""
    error = by_pixel(4096, spp).mean(axis=1).std(axis=0)
    assert (error < 1.05 * spp**-1.5 * np.sqrt(1 / 12)).all()


def test_the_second_dimension_is_sobols() -> None:
    index, scramble = np.arange(4096, dtype=np.uint32), 0x3A5C96E1
    digits = _sobol(dr.brev(mi.UInt32(index))) ^ scramble
    expected = mi.sobol_2(mi.UInt32(index), mi.UInt32(scramble))
    np.testing.assert_allclose(np.array(_number(digits)), np.array(expected), atol=2.0**-23)


@pytest.mark.parametrize("spp", [1, 16])
def test_numbers_are_uniform(spp: int) -> None:
    """Of one sample each in many pixels; those within a pixel are stratified."""
    values = by_pixel(1 << 14, spp)[:, spp // 2]
    np.testing.assert_allclose(values.mean(axis=0), 1 / 2, atol=4.5 * np.sqrt(1 / 12 / (1 << 14)))
    np.testing.assert_allclose(values.var(axis=0), 1 / 12, rtol=4.5 * np.sqrt(0.8 / (1 << 14)))
    for column in values.T:
        assert kstest(column, "uniform").pvalue > 1e-4


def largest_correlation(columns: np.ndarray) -> float:
    """Largest absolute correlation of different columns (values, columns), in its deviations."""
    found = np.corrcoef(columns, rowvar=False) - np.eye(columns.shape[1])
    return float(abs(found).max() * np.sqrt(len(columns)))


@pytest.mark.parametrize("spp", [1, 16])
def test_dimensions_pixels_and_seeds_are_uncorrelated(spp: int) -> None:
    """The two seeds are those of camera rays and paths of one launch."""
    values = {seed: by_pixel(1 << 14, spp, seed, 12)[:, 0] - 1 / 2 for seed in (5, 2**32 - 6)}
    columns = np.concatenate([*values.values(), np.roll(values[5], 1, axis=0)], axis=1)
    assert largest_correlation(columns) < 5.5  # of 5 778 pairs
    assert largest_correlation(np.roll(columns, 1, axis=1) * columns) < 5.5  # of three and four


def test_draws_of_a_pixel_have_orders_of_their_own() -> None:
    """Within a pixel, ranks of the samples in different draws are uncorrelated."""
    pixels, spp = 2048, 16
    values = by_pixel(pixels, spp, draws=12)
    values = values[..., np.arange(values.shape[-1]) % 3 != 1]  # one number of each draw
    ranks = np.argsort(np.argsort(values, axis=1), axis=1)
    assert largest_correlation(ranks.reshape(pixels * spp, -1)) < 5


def test_numbers_of_a_sample_do_not_depend_on_the_lane() -> None:
    spp, samples = 8, np.array([9, 70, 3, 200])
    sampler = sampler_of(samples, spp)
    before = rows(sampler)
    np.testing.assert_array_equal(before, rows(sampler_of(np.arange(256), spp))[samples])
    begins = np.array([True, False, True, False])
    sampler.begin(mi.UInt32(np.array([200, 1, 9, 2])), mi.Bool(begins))
    after = rows(sampler)
    np.testing.assert_array_equal(after[begins], before[[3, 0]])
    assert (after[~begins] != before[~begins]).all(), "lanes that do not begin go on"
    longer = sampler_of(samples, spp)
    rows(longer)
    np.testing.assert_array_equal(after[~begins], rows(longer)[~begins])
