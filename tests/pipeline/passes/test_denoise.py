"""Denoiser: smaller error, the same energy, sharp edges where the guides have them."""

import numpy as np

from pbrnet.pipeline.passes.denoise import denoise, grey_guide


def scene(size: int = 96) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """A true image lit by a smooth gradient over two materials, with its guides."""
    ramp = np.linspace(0.2, 1.0, size, dtype=np.float32)
    albedo = np.full((size, size, 3), (0.8, 0.3, 0.2), np.float32)
    albedo[:, size // 2 :] = (0.1, 0.3, 0.6)
    normal = np.zeros((size, size, 3), np.float32)
    normal[..., 2] = -1
    return albedo * ramp[:, None, None], albedo, normal


def split(image: np.ndarray) -> dict[str, np.ndarray]:
    return {band: image[..., index] for index, band in enumerate("RGB")}


def test_error_falls_severalfold_and_energy_is_kept() -> None:
    truth, albedo, normal = scene()
    noise = np.random.default_rng(0).exponential(size=truth.shape).astype(np.float32)
    clean = np.stack(list(denoise(split(truth * noise), albedo, normal).values()), axis=-1)
    before = np.mean((truth * noise - truth) ** 2)
    assert np.mean((clean - truth) ** 2) < before / 10
    assert abs(clean.mean() / truth.mean() - 1) < 0.05
    edge = truth.shape[1] // 2
    step = clean[:, edge + 2, 0].mean() / clean[:, edge - 3, 0].mean()
    assert abs(step - 0.1 / 0.8) < 0.05


def test_equal_input_gives_equal_bits() -> None:
    truth, albedo, normal = scene()
    first, second = (denoise(split(truth), albedo, normal) for _ in range(2))
    for band in "RGB":
        np.testing.assert_array_equal(first[band], second[band])


def test_the_grey_guide_is_grey_on_surfaces_and_black_in_the_sky() -> None:
    normal = np.zeros((2, 2, 3), np.float32)
    normal[0, :, 2] = -1
    np.testing.assert_array_equal(grey_guide(normal, 0.5)[..., 0], [[0.5, 0.5], [0, 0]])
