"""Pictures for people: middle grey, clipping, white balance, and nights darker than days."""

from dataclasses import replace

import numpy as np
import pytest

from pbrnet.pipeline.photograph import (
    GREY,
    WHITE_STOPS,
    PhotoSettings,
    PhotoVariation,
    develop,
    meter,
    photograph,
    sharpened,
    varied_photograph,
)
from pbrnet.scenes.color import decode_srgb, encode_srgb, luminance
from pbrnet.scenes.photometry import LUMEN, blackbody


def room(average: float, seed: int = 0) -> np.ndarray:
    """Radiance of a grey room with this log-average luminance, and a range of four decades."""
    noise = np.random.default_rng(seed).normal(0, 1.0, (12, 16))
    values = average * np.exp(noise - noise.mean()).repeat(8, axis=0).repeat(8, axis=1)
    return np.repeat(values[..., None], 3, axis=2)


def test_middle_grey_stays_and_white_is_reached_where_a_sensor_clips() -> None:
    white = GREY * 2**WHITE_STOPS
    ramp = np.array([0.0, GREY, 0.99 * white, white, 100 * white])[:, None].repeat(3, axis=1)
    shown = develop(ramp, PhotoSettings(1.0))[:, 0]
    assert shown[0] == 0
    assert shown[1] == pytest.approx(encode_srgb(np.array([GREY]))[0], abs=1e-4)
    assert shown[2] < 1
    assert shown[3:] == pytest.approx(1)


def test_curve_rises_everywhere_and_has_more_contrast_than_the_scene_at_middle_grey() -> None:
    steps = GREY * 2 ** np.linspace(-8, WHITE_STOPS, 400)
    shown = decode_srgb(develop(steps[:, None].repeat(3, axis=1), PhotoSettings(1.0))[:, 0])
    slopes = np.diff(np.log(shown)) / np.diff(np.log(steps))
    assert (slopes > 0).all()
    assert slopes[np.searchsorted(steps, GREY)] > 1.1


def test_ten_times_less_light_gives_a_darker_picture_but_not_ten_times() -> None:
    day, night = room(40 * LUMEN), room(4 * LUMEN)
    ratio = meter(day).gain / meter(night).gain
    assert 0.1 < ratio < 1, "exposure makes up for the most part"
    assert photograph(night).mean() < 0.85 * photograph(day).mean()
    dimmer = meter(room(1e-9 * LUMEN)).gain * 1e-9 / (meter(day).gain * 40)
    assert dimmer > 2**-2, "never by more than two stops"


def test_lamplight_turns_nearly_white_and_stays_warm() -> None:
    image = room(10 * LUMEN) * blackbody(2700)
    before = image.mean(axis=(0, 1))
    linear = image * meter(image).balance
    after = linear.mean(axis=(0, 1))
    assert before[0] / before[2] > 4
    assert 1.1 < after[0] / after[2] < 2
    assert luminance(after) == pytest.approx(luminance(before), rel=0.02)
    assert meter(room(10 * LUMEN)).balance == pytest.approx((1, 1, 1))


def test_a_large_bright_window_lowers_the_exposure_a_little() -> None:
    image = room(40 * LUMEN)
    small, large = image.copy(), image.copy()
    small[:8, :8], large[:32, :32] = 1.0, 1.0
    low, high = (meter(each) for each in (large, small))
    average = np.log(luminance(large)).mean() - np.log(luminance(small)).mean()
    assert 2**-0.7 <= low.gain / high.gain * np.exp(average) < 1
    assert (photograph(large)[:32, :32] == 255).all(), "it still clips"


def test_sharpening_steepens_edges_within_its_halo_and_keeps_flat_parts_and_hues() -> None:
    edge = np.full((24, 48, 3), 10 * LUMEN, np.float32) * np.float32([1.0, 0.8, 0.6])
    edge[:, 24:] *= 2
    settings = meter(edge)
    soft = develop(edge, replace(settings, sharpening=0.0))[12]
    shown = photograph(edge, settings)[12] / 255.0
    luma, plain = shown @ [0.2126, 0.7152, 0.0722], soft @ [0.2126, 0.7152, 0.0722]
    assert luma[24] - luma[23] > 1.15 * (plain[24] - plain[23])
    assert np.abs(luma - plain).max() < 0.15
    assert np.abs(shown[[2, 45]] - soft[[2, 45]]).max() < 0.003
    linear = sharpened(edge, settings)
    assert linear[..., 2] / linear[..., 0] == pytest.approx(np.full((24, 48), 0.6), rel=1e-5)


def test_pictures_of_nothing_and_of_damaged_frames() -> None:
    assert (photograph(np.zeros((8, 8, 3), np.float32)) == 0).all()
    damaged = room(40 * LUMEN).astype(np.float32)
    damaged[0, :3] = [[np.nan] * 3, [np.inf] * 3, [-1.0] * 3]
    picture = photograph(damaged)
    assert (picture[0, 0] == 0).all() and (picture[0, 2] == 0).all()
    assert (picture[0, 1] == 255).all()


NONE = PhotoVariation((0, 0), (0, 0), (0, 0), (0, 0), (0, 0), (0, 0), (0, 0))


def test_variation_is_seeded_and_without_ranges_none() -> None:
    image = room(40 * LUMEN).astype(np.float32)
    first, again, other = (varied_photograph(image, seed) for seed in (1, 1, 2))
    assert np.array_equal(first, again)
    assert not np.array_equal(first, other)
    assert np.array_equal(varied_photograph(image, 1, NONE), photograph(image))


def test_each_variation_does_what_it_is_named_for() -> None:
    flat = np.full((96, 96, 3), 20 * LUMEN, np.float32)
    plain = photograph(flat).astype(float)

    def made(**ranges: tuple[float, float]) -> np.ndarray:
        return varied_photograph(flat, 3, replace(NONE, **ranges)).astype(float)

    assert (made(exposure=(1, 1)) > plain).all() and (made(exposure=(-1, -1)) < plain).all()
    warm = made(warmth=(0.3, 0.3))
    assert (warm[..., 0] > plain[..., 0]).all() and (warm[..., 2] < plain[..., 2]).all()
    dark = made(vignetting=(0.5, 0.5))
    assert dark[0, 0, 0] < 0.9 * dark[48, 48, 0] and dark[48, 48, 0] == plain[48, 48, 0]
    linear = decode_srgb(made(noise=(0.1, 0.1)) / 255)
    steepness = 1.35 * (1 - GREY)  # about the slope of the curve there, in logarithms
    level = decode_srgb(plain / 255).mean()
    shot = 0.1 * np.sqrt(GREY / level) if level < GREY else 0.1
    assert linear.std() / linear.mean() == pytest.approx(shot * steepness, rel=0.25)
    edge = flat.copy()
    edge[:, 48:] *= 3
    soft = varied_photograph(edge, 3, replace(NONE, blur=(2, 2)))
    assert np.abs(np.diff(soft.astype(int), axis=1)).max() < 0.3 * np.ptp(photograph(edge))
    assert np.abs(varied_photograph(edge, 3, replace(NONE, quality=(20, 20))) - plain).max() > 0
