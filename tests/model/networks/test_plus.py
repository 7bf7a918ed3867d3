"""PBR-Net plus: what it computes is right before anything is learned, and it learns."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from model.data import display
from model.data.encoding import DEFAULT_WHITE, encode, interreflection
from model.data.reader import Dataset
from model.evaluation.product import linear_product
from model.networks.pbrnet import Architecture
from model.networks.plus import LightColor, PlusNet, multiplied
from pipeline.params import ToneParams
from pipeline.tonemap import Exposure, exposure_of, tonemap, untonemap
from scenes.color import encode_srgb, luminance
from tests.fixtures.model import box_dataset


class Card:
    """The fields of a model card that `linear_product` reads."""

    albedo = 0.5


def test_the_product_in_the_network_is_the_product() -> None:
    rng = np.random.default_rng(0)
    shading = rng.random((30, 40, 3), dtype=np.float32)
    reflectance = rng.random((30, 40, 3), dtype=np.float32)
    exposure = Exposure(1.0, DEFAULT_WHITE)
    expected = tonemap(linear_product(reflectance, shading, exposure, Card()), exposure)  # type: ignore[arg-type]
    given = [torch.from_numpy(i.transpose(2, 0, 1).copy())[None]
             for i in (shading, encode_srgb(reflectance))]  # fmt: skip
    found = multiplied(*given)[0].permute(1, 2, 0).numpy()
    assert found == pytest.approx(expected, abs=2e-4)


@pytest.mark.parametrize("value", [0.0, 1e-4, 0.5, 1.0])
def test_its_gradient_is_finite_everywhere(value: float) -> None:
    shading = torch.full((1, 3, 4, 4), value, requires_grad=True)
    multiplied(shading, torch.full((1, 3, 4, 4), value)).sum().backward()  # type: ignore[no-untyped-call]
    assert shading.grad is not None and shading.grad.isfinite().all()


def test_it_starts_as_the_room_without_shadows(tmp_path: Path) -> None:
    """Untrained, with its last layers at zero, it is direct light and its product already."""
    example = next(Dataset(box_dataset(tmp_path) / "dataset", "train").ordered())
    network = PlusNet(Architecture("plus", 8, 3))
    for unet in (network.shading.unet, network.correction):
        torch.nn.init.zeros_(unet.out.weight)
    given = encode([example], direct_light=True)
    with torch.no_grad():
        shading, color = network.parts(given)
    assert torch.equal(
        shading, display.tint_display((given["direct"][:, :3] + 1) / 2, given["tint"])
    )
    gain = 1 + given["depth"][:, 1:] * (given["gain"] - 1)
    assert torch.equal(color, multiplied(shading, (given["reflectance"] + 1) / 2, gain))


def test_light_bounces_as_in_an_integrating_sphere(tmp_path: Path) -> None:
    """Worked by hand: with nine tenths returned, red walls of 0.8 hold 0.55 / 0.28 of grey's."""
    example = next(Dataset(box_dataset(tmp_path) / "dataset", "train").ordered())
    walls = np.where(example.valid[..., None], np.float32([0.8, 0.5, 0.0]), 0)
    found = encode([replace(example, reflectance=walls)], direct_light=True)["gain"]
    assert found.flatten().tolist() == pytest.approx([0.55 / 0.28, 1.0, 0.55])
    nothing = replace(example, valid=np.zeros_like(example.valid), reflectance=0 * walls)
    assert encode([nothing], direct_light=True)["gain"].flatten().tolist() == [1, 1, 1]


def test_what_is_seen_outdoors_takes_no_colour_from_the_room(tmp_path: Path) -> None:
    example = next(Dataset(box_dataset(tmp_path) / "dataset", "train").ordered())
    valid = example.valid.copy()
    valid[:6, :6] = False
    network = PlusNet(Architecture("plus", 8, 3))
    for unet in (network.shading.unet, network.correction):
        torch.nn.init.zeros_(unet.out.weight)
    given = encode([replace(example, valid=valid)], direct_light=True)
    given["reflectance"] = torch.zeros_like(given["reflectance"])  # the grey of display values
    given["gain"] = torch.tensor([1.5, 1.0, 0.5]).reshape(1, 3, 1, 1)
    with torch.no_grad():
        color = network(given)[0]
    assert torch.allclose(color[0, :6, :6], color[2, :6, :6], atol=1e-6)
    assert (color[0, 6:, 6:] > color[2, 6:, 6:] + 0.05).all()


def test_under_the_policy_own_its_product_has_an_exposure_of_its_own(tmp_path: Path) -> None:
    """As near as the inputs tell: the log average of a product is about that of its factors."""
    example = next(Dataset(box_dataset(tmp_path) / "dataset", "train").ordered())
    dark = replace(example, reflectance=0.1 * example.reflectance)
    network = PlusNet(Architecture("plus", 8, 3, exposure="own"))
    for unet in (network.shading.unet, network.correction):
        torch.nn.init.zeros_(unet.out.weight)
    for view in (example, dark):
        given = encode([view], direct_light=True)
        with torch.no_grad():
            shading, color = network.parts(given)
        light = untonemap(shading[0].permute(1, 2, 0).numpy(), Exposure(1.0, DEFAULT_WHITE))
        held = light * view.reflectance / 0.5 * interreflection(view)
        own = exposure_of(held, ToneParams())
        expected = tonemap(held, Exposure(own.scale, DEFAULT_WHITE))
        assert color[0].permute(1, 2, 0).numpy() == pytest.approx(expected, abs=0.03)
        assert 0.3 < float(color.mean()) < 0.7, "neither too dark nor too bright"


def test_its_room_has_the_colour_of_its_light(tmp_path: Path) -> None:
    """Untrained: the shading under a warm lamp is that under a white one, times the colour."""
    example = next(Dataset(box_dataset(tmp_path) / "dataset", "train").ordered())
    color = np.float32([1.5, 0.9, 0.5])
    color /= luminance(color)
    network = PlusNet(Architecture("plus", 8, 3))
    for unet in (network.shading.unet, network.correction):
        torch.nn.init.zeros_(unet.out.weight)
    seen = []
    for tint in (np.ones(3, np.float32), color):
        view = replace(example, tint=(example.intensity > 0)[..., None] * tint)
        with torch.no_grad():
            shading = network.parts(encode([view], direct_light=True))[0]
        seen.append(untonemap(shading[0].permute(1, 2, 0).numpy(), Exposure(1.0, DEFAULT_WHITE)))
    unclipped = (seen[0] > 0.02).all(axis=-1) & (seen[0] < 0.3).all(axis=-1)
    assert unclipped.sum() > 100
    expected = np.broadcast_to(color, seen[0].shape)[unclipped]
    assert (seen[1] / np.maximum(seen[0], 1e-9))[unclipped] == pytest.approx(expected, rel=0.02)


def test_the_colour_of_a_room_can_be_learned_from_its_light() -> None:
    """Blue sky at the window and a white room; a warm lamp and a warm room: both at once."""
    seen = torch.tensor([[0.77, 1.03, 1.3], [1.3, 0.95, 0.6]])[..., None, None]
    wanted = torch.tensor([[1.0, 1.0, 1.0], [1.3, 0.95, 0.6]])[..., None, None]
    seen, wanted = seen / display.luminance(seen), wanted / display.luminance(wanted)
    torch.manual_seed(0)
    network = LightColor()
    assert torch.allclose(network(seen), seen)
    optimiser = torch.optim.Adam(network.parameters(), 3e-3)
    for _ in range(1500):
        optimiser.zero_grad()
        (network(seen) - wanted).square().mean().backward()  # type: ignore[no-untyped-call]
        optimiser.step()
    assert torch.allclose(network(seen), wanted, atol=0.02)
    assert torch.allclose(display.luminance(network(seen)), torch.ones(2, 1, 1, 1))


def test_any_size_and_no_light(tmp_path: Path) -> None:
    example = next(
        Dataset(box_dataset(tmp_path, width=37, height=23) / "dataset", "train").ordered()
    )
    dark = replace(example, intensity=0 * example.intensity)
    network = PlusNet(Architecture("plus", 8, 4)).eval()
    with torch.no_grad():
        color = network(encode([dark], direct_light=True))
    assert color.shape == (1, 3, 23, 37)
    assert color.isfinite().all()
