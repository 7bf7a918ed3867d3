"""Reinhard's operator: known values, its inverse, and what the two exposure policies promise."""

import numpy as np
import pytest

from pbrnet.pipeline.tonemap import Exposure, ToneParams, exposure_of, tonemap, untonemap
from pbrnet.scenes.color import decode_srgb, luminance

TONE = ToneParams()


def test_a_constant_image_lands_at_the_key() -> None:
    """Log-average luminance maps to key; a grey image is its own maximum: L (1 + L/w^2)/(1 + L)."""
    image = np.full((8, 8, 3), 0.003, np.float32)
    exposure = exposure_of(image, TONE)
    assert exposure.scale * 0.003 == pytest.approx(0.8)
    white = 0.8 * 0.8**2
    assert exposure.white == pytest.approx(white)
    expected = min(0.8 * (1 + 0.8 / white**2) / 1.8, 1)
    assert decode_srgb(tonemap(image, exposure)) == pytest.approx(expected, abs=1e-4)


def test_scaling_the_light_changes_nothing() -> None:
    image = np.random.default_rng(0).lognormal(size=(16, 16, 3)).astype(np.float32)
    first = tonemap(image, exposure_of(image, TONE))
    second = tonemap(image * 1000, exposure_of(image * 1000, TONE))
    np.testing.assert_allclose(first, second, atol=1e-5)


def test_black_pixels_do_not_move_the_exposure() -> None:
    image = np.random.default_rng(0).lognormal(size=(16, 16, 3))
    padded = np.concatenate([image, np.zeros_like(image)])
    assert exposure_of(padded, TONE) == exposure_of(image, TONE)
    assert exposure_of(np.zeros((4, 4, 3)), TONE).scale == 1


def test_noise_does_not_move_the_exposure() -> None:
    """One sample in ten finds the light: the same mean, and pixels at a tenth of it or at none."""
    rng = np.random.default_rng(0)
    clean = np.full((120, 160, 3), 0.2)
    noisy = clean * np.where(rng.random((120, 160, 1)) < 0.1, 9.1, 0.1)
    assert exposure_of(noisy, TONE).scale == pytest.approx(exposure_of(clean, TONE).scale, rel=0.2)


def test_blocks_cut_by_the_edge_count_by_their_mean() -> None:
    image = np.full((13, 9, 3), 0.2)
    assert exposure_of(image, TONE).scale == pytest.approx(TONE.key / 0.2)


def test_the_inverse_undoes_it_below_white() -> None:
    image = np.random.default_rng(0).uniform(1e-3, 0.5, size=(16, 16, 3)).astype(np.float32)
    exposure = Exposure(scale=1.0, white=20.0)
    np.testing.assert_allclose(untonemap(tonemap(image, exposure), exposure), image, rtol=2e-3)


def test_chromaticity_is_kept() -> None:
    image = np.array([[[0.2, 0.1, 0.05]]], np.float32)
    mapped = decode_srgb(tonemap(image, Exposure(1.0, 10.0)))
    np.testing.assert_allclose(mapped / mapped[..., :1], image / image[..., :1], rtol=1e-3)


def test_luminance_is_rec709() -> None:
    np.testing.assert_allclose(luminance(np.eye(3)), [0.2126, 0.7152, 0.0722])
