"""FLIP as a loss against the authors' library."""

import numpy as np
import pytest
import torch
from scipy.ndimage import gaussian_filter

from pbrnet.model.evaluation.metrics import flip_map
from pbrnet.model.networks.flip import Flip
from pbrnet.scenes.arrays import AnyArray


def batch(*images: AnyArray) -> torch.Tensor:
    return torch.from_numpy(np.stack([image.transpose(2, 0, 1) for image in images]))


def picture(rng: np.random.Generator, width: int, height: int) -> AnyArray:
    """Soft blotches of all colours, black and white among them, and a hard edge."""
    soft = gaussian_filter(rng.random((height, width, 3)), (3, 3, 0))
    soft = np.clip((soft - 0.5) * 8 + 0.5, 0, 1)
    soft[height // 3 : height // 2, width // 4 : width // 2] = rng.random(3)
    return soft.astype(np.float32)


@pytest.mark.parametrize("size", [(160, 120), (97, 41), (24, 30)])
@pytest.mark.parametrize("noise", [0.003, 0.05, 0.4])
def test_errors_are_those_of_the_library(size: tuple[int, int], noise: float) -> None:
    rng = np.random.default_rng(0)
    truth = picture(rng, *size)
    wide = gaussian_filter(rng.normal(size=truth.shape), (4, 4, 0))
    change = noise * (rng.normal(size=truth.shape) + 5 * wide + rng.normal(size=3))
    image = np.clip(truth + change, 0, 1).astype(np.float32)
    wanted = flip_map(truth, image)
    found = Flip().errors(batch(image), batch(truth))[0, 0].numpy()
    np.testing.assert_allclose(found, wanted, atol=0.015)
    assert found.mean() == pytest.approx(wanted.mean(), rel=0.01)


@pytest.mark.parametrize("pair", ["equal", "black", "white", "far"])
def test_gradients_are_finite(pair: str) -> None:
    truth = picture(np.random.default_rng(1), 32, 24)
    image = {"equal": truth, "black": 0 * truth, "white": 0 * truth + 1, "far": 1 - truth}[pair]
    prediction = batch(image).requires_grad_()
    loss = Flip()(prediction, batch(truth))
    loss.backward()  # type: ignore[no-untyped-call]
    assert prediction.grad is not None and prediction.grad.isfinite().all()
    assert loss.item() < 0.002 if pair == "equal" else loss.item() > 0.1


def test_an_image_moves_towards_the_truth() -> None:
    truth, other = (batch(picture(np.random.default_rng(seed), 32, 24)) for seed in (2, 3))
    image, loss = other.clone().requires_grad_(), Flip()
    optimiser = torch.optim.Adam([image], 0.02)
    first = loss(image, truth).item()
    for _ in range(150):
        optimiser.zero_grad()
        loss(image, truth).backward()
        optimiser.step()
    assert loss(image, truth).item() < 0.15 * first


def test_a_batch_is_the_mean_of_its_images() -> None:
    rng = np.random.default_rng(4)
    ones, others = ([picture(rng, 32, 24) for _ in range(2)] for _ in range(2))
    pairs = zip(ones, others, strict=True)
    single = [Flip()(batch(one), batch(other)).item() for one, other in pairs]
    assert Flip()(batch(*ones), batch(*others)).item() == pytest.approx(np.mean(single), rel=1e-5)
