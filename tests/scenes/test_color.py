"""Colour: sRGB, luminance and XYZ against their standards."""

import numpy as np
import pytest

from pbrnet.scenes.color import (
    REC709,
    XYZ_TO_RGB,
    decode_srgb,
    decode_srgb_value,
    encode_srgb,
    luminance,
)
from pbrnet.scenes.geometry.directions import fibonacci_sphere, pixel_directions


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_srgb_goes_there_and_back_in_its_dtype(dtype: type) -> None:
    ramp = np.linspace(0, 1, 4097, dtype=dtype)
    assert encode_srgb(ramp).dtype == decode_srgb(ramp).dtype == dtype
    np.testing.assert_allclose(decode_srgb(encode_srgb(ramp)), ramp, atol=1e-6)
    # IEC 61966-2-1: the linear piece ends at 0.0031308, middle grey lies at 0.21404.
    known = np.array([0, 0.0031308, 0.21404114, 1], dtype=dtype)
    np.testing.assert_allclose(encode_srgb(known), [0, 0.04045, 0.5, 1], atol=1e-5)
    assert (np.diff(encode_srgb(ramp)) > 0).all()


def test_one_value_decodes_as_an_array_of_them() -> None:
    codes = np.arange(256) / 255
    single = [decode_srgb_value(float(code)) for code in codes]
    np.testing.assert_allclose(single, decode_srgb(codes), rtol=1e-15, atol=0)


def test_white_has_luminance_1_and_y_is_luminance() -> None:
    assert luminance(np.ones((2, 2, 3), np.float32)).dtype == np.float32
    np.testing.assert_allclose(luminance(np.ones((2, 2, 3))), 1, rtol=1e-12)
    # The Y of XYZ is luminance: the matrix takes any XYZ to an RGB of that luminance.
    xyz = np.random.default_rng(0).uniform(size=(50, 3))
    np.testing.assert_allclose((xyz @ XYZ_TO_RGB.T) @ REC709, xyz[:, 1], atol=1e-3)


def test_a_fibonacci_sphere_is_even() -> None:
    directions = fibonacci_sphere(2000)
    np.testing.assert_allclose(np.linalg.norm(directions, axis=1), 1, rtol=1e-12)
    # The mean of d d^T over the sphere is a third of the identity.
    np.testing.assert_allclose(directions.T @ directions / 2000, np.eye(3) / 3, atol=1e-3)
    nearest = np.sort(directions @ directions.T, axis=1)[:, -2]
    apart = np.degrees(np.arccos(nearest))
    assert apart.min() > 0.6 * apart.max()


def test_pixels_lie_where_the_intrinsics_put_them() -> None:
    intrinsics = np.array([[100.0, 0, 32], [0, 100.0, 24], [0, 0, 1]])
    rays = pixel_directions(intrinsics, 64, 48)
    assert rays.shape == (48, 64, 3)
    np.testing.assert_allclose(rays[0, 0], [(0.5 - 32) / 100, (0.5 - 24) / 100, 1])
    projected = rays @ intrinsics.T
    np.testing.assert_allclose(projected[..., 0][7], np.arange(64) + 0.5)
