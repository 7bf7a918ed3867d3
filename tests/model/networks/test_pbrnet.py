"""Layout of the networks, counted; any size; and how the panorama meets the image."""

from typing import Any

import numpy as np
import pytest
import torch
from torch import nn

from pbrnet.model.data.direct_light import look_up
from pbrnet.model.data.display import DEFAULT_WHITE, displayed_product
from pbrnet.model.data.encoding import NEUTRAL, centred, input_named, to_batch, to_image
from pbrnet.model.methods import JOINS, METHODS, Panorama
from pbrnet.model.networks.build import build_network
from pbrnet.model.networks.pbrnet import (
    Architecture,
    CompositionNet,
    NormalPanorama,
    averaged,
)
from pbrnet.model.training.backbone import EfficientNetLite0, Vgg19
from pbrnet.pipeline.tonemap import Exposure, ToneParams, exposure_of, tonemap
from pbrnet.scenes.color import encode_srgb

KINDS = tuple(dict.fromkeys(method.kind for method in METHODS.values()))


def inputs(
    height: int, width: int, panorama: int = 32, kind: str = "shading", join: Panorama = "normal"
) -> dict[str, torch.Tensor]:
    """Random encoded inputs of one view, with what only networks of this kind are given."""
    random = torch.Generator().manual_seed(0)
    tensors = {}
    for name in METHODS[kind].inputs_with(join):
        sizes = {
            **dict.fromkeys(("level", "samples"), (1, 1)),
            **dict.fromkeys(("intensity", "distance"), (panorama // 2, panorama)),
        }
        size = sizes.get(name, (height, width))
        tensors[name] = torch.rand(1, input_named(name).channels, *size, generator=random)
    tensors["normal"] = nn.functional.normalize(tensors["normal"] - 0.5, dim=1)
    return tensors


def run(network: nn.Module, given: dict[str, torch.Tensor]) -> torch.Tensor:
    """The network's output; the composition network takes reflectance for shading, too."""
    with torch.no_grad():
        if isinstance(network, CompositionNet):
            given = network.images(given["reflectance"], given["reflectance"])
        return network(given)


def convolutions(network: nn.Module) -> list[nn.Conv2d]:
    return [module for module in network.modules() if isinstance(module, nn.Conv2d)]


@pytest.mark.parametrize("levels", [1, 2, 3, 5])
def test_the_u_net_has_two_convolutions_per_level_and_side(levels: int) -> None:
    network = build_network(Architecture("composition", 8, levels))
    kernels = [conv.kernel_size[0] for conv in convolutions(network)]
    # Down: two a level; up: two a level but the deepest; a 1x1 per doubling, one to three channels.
    assert kernels.count(3) == 2 * levels + 2 * (levels - 1)
    assert kernels.count(1) == (levels - 1) + 1


def test_channels_double_up_to_eight_times_the_first() -> None:
    network: Any = build_network(Architecture("composition", 4, 6))
    assert [level[2].out_channels for level in network.unet.down] == [4, 8, 16, 32, 32, 32]
    # Skips are concatenated: each way up starts from twice its level's channels.
    assert [level[0].in_channels for level in network.unet.up] == [8, 16, 32, 64, 64]
    assert network.unet.out.out_channels == 3


def test_the_shading_network_convolves_each_input_apart() -> None:
    network: Any = build_network(Architecture("shading", 16, 5, "resize"))
    assert set(network.branches) == {"depth", "normal"}
    first = [network.branches["depth"][0], network.branches["normal"][0]]
    first += [network.panorama.intensity[0], network.panorama.distance[0]]
    assert [conv.in_channels for conv in first] == [2, 3, 1, 1]
    assert [conv.out_channels for conv in first] == [8] * 4
    assert network.unet.down[0][0].in_channels == 4 * 8
    assert len(convolutions(network)) == 4 + 18 + 5


def test_the_joins_add_panorama_convolutions() -> None:
    normal, resize, *direct = (
        len(convolutions(build_network(Architecture("shading", 16, 5, panorama))))
        for panorama in JOINS
    )
    assert normal == resize + 4
    assert set(direct) == {normal + 1}  # the direct light


def test_the_direct_u_net_sees_reflectance_too() -> None:
    network: Any = build_network(Architecture("unet", 16, 5))
    assert set(network.branches) == {"depth", "normal", "reflectance"}
    assert network.unet.down[0][0].in_channels == 5 * 8


def test_composition_is_the_shorter_network() -> None:
    shading, composition = (
        build_network(Architecture(kind, 32, levels))
        for kind, levels in (("shading", 5), ("composition", 3))
    )
    sizes = [sum(p.numel() for p in net.parameters()) for net in (shading, composition)]
    assert sizes[1] < sizes[0] / 5
    assert composition.unet.down[0][0].in_channels == 6  # type: ignore[union-attr,index]


def test_composition_in_its_own_exposure_gets_the_product_exposed_like_an_image() -> None:
    """All bounces, up to 0.4, get the room's colours."""
    random = np.random.default_rng(5)
    light = random.exponential(1.0, (40, 56, 1)) * np.ones(3)
    light[:9] *= 0.05
    reflectance = random.uniform([0.02, 0.1, 0.3], [0.5, 0.6, 0.9], (40, 56, 3))
    exposure = Exposure(exposure_of(light, ToneParams()).scale, DEFAULT_WHITE)
    display = tonemap(light.astype(np.float32), exposure)
    encoded = centred(to_batch(encode_srgb(reflectance.astype(np.float32))))
    found = displayed_product(to_batch(display), encoded, NEUTRAL)
    mean = reflectance.mean((0, 1))
    exposed = light * exposure.scale
    product = reflectance * (exposed + (mean / (1 - mean) - 1) * exposed.clip(max=0.4))
    expected = tonemap(product, exposure_of(product, ToneParams()))
    apart = np.abs(to_image(found) - expected)  # most where the display is nearly white
    assert apart.mean() < 1e-3 and np.quantile(apart, 0.99) < 5e-3
    # shading that was predicted too bright is exposed anew
    brighter = Exposure(1.4 * exposure.scale, DEFAULT_WHITE)
    predicted = tonemap(light.astype(np.float32), brighter)
    same = displayed_product(to_batch(predicted), encoded, NEUTRAL)
    assert torch.allclose(same, found, atol=0.01)
    own = build_network(Architecture("composition", 8, 2, exposure="own"))
    assert isinstance(own, CompositionNet)
    images = own.images(to_batch(display), encoded)
    assert list(images) == ["shading", "reflectance", "product"]
    assert own(images).shape == (1, 3, 40, 56)
    nn.init.zeros_(own.unet.out.weight)  # then its correction is 0
    assert torch.allclose(own(images), to_batch(to_image(found)), atol=1e-6)


def test_the_product_is_finite_in_the_dark_and_at_white() -> None:
    for shading in (torch.zeros(1, 3, 16, 16), torch.ones(1, 3, 16, 16)):
        for reflectance in (-torch.ones(1, 3, 16, 16), torch.ones(1, 3, 16, 16)):
            found = displayed_product(shading, reflectance, NEUTRAL)
            assert found.isfinite().all() and found.min() >= 0 and found.max() <= 1


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("size", [(1, 1), (2, 3), (17, 31), (48, 64)])
def test_any_size_in_is_the_same_size_out(kind: str, size: tuple[int, int]) -> None:
    network = build_network(Architecture(kind, 4, 5))
    assert run(network, inputs(*size, kind=kind)).shape == (1, 3, *size)


@pytest.mark.parametrize("panorama", JOINS)
@pytest.mark.parametrize("width", [8, 64, 130])
def test_any_panorama_size_is_taken(panorama: Panorama, width: int) -> None:
    network = build_network(Architecture("shading", 4, 3, panorama))
    assert run(network, inputs(12, 16, width, join=panorama)).shape == (1, 3, 12, 16)


@pytest.mark.parametrize("panorama", JOINS)
@pytest.mark.parametrize(
    "kind", ["unet", "end_to_end", "can", "pix2pix", "cyclegan", "plus", "hybrid"]
)
def test_every_input_reaches_the_output(kind: str, panorama: Panorama) -> None:
    torch.manual_seed(0)  # of some weights no feature of the panorama is above 0
    network = build_network(Architecture(kind, 16, 3, panorama))
    given = inputs(16, 16, kind=kind, join=panorama)
    for value in given.values():
        value.requires_grad_(True)
    network(given).sum().backward()
    for name, value in given.items():
        assert value.grad is not None and value.grad.abs().sum() > 0, name


@pytest.mark.parametrize(
    ("direction", "row", "column"),
    [
        ((0, 0, 1), 0.5, 0.5),  # ahead: the centre
        ((1, 0, 0), 0.5, 0.75),  # the camera's right: right of the centre
        ((-1, 0, 0), 0.5, 0.25),
        ((0, -1, 0), 0.0, None),  # up (y points down): the top row, any column
        ((0, 1, 0), 1.0, None),
        ((0.6, -0.64, 0.48), None, None),
    ],
)
def test_directions_find_their_panorama_pixel(
    direction: tuple[float, float, float], row: float | None, column: float | None
) -> None:
    height, width = 64, 128
    y, x = torch.meshgrid(
        (torch.arange(height) + 0.5) / height, (torch.arange(width) + 0.5) / width, indexing="ij"
    )
    panorama = torch.stack([y, x])[None]
    asked = torch.tensor(direction, dtype=torch.float32).view(1, 3, 1, 1)
    found = look_up(panorama, asked)[0, :, 0, 0]
    if row is None:  # elsewhere: by the definition of azimuth and elevation
        row = 0.5 + np.arcsin(direction[1]) / np.pi
        column = 0.5 + np.arctan2(direction[0], direction[2]) / (2 * np.pi)
    assert found[0] == pytest.approx(row, abs=0.6 / height)
    if column is not None:
        assert found[1] == pytest.approx(column, abs=0.6 / width)


def test_straight_behind_is_between_the_last_and_the_first_column() -> None:
    panorama = torch.zeros(1, 1, 4, 8)
    panorama[..., 0], panorama[..., -1] = 2.0, 4.0
    behind = torch.tensor([1e-7, 0.0, -1.0]).view(1, 3, 1, 1)
    assert look_up(panorama, behind).item() == pytest.approx(3.0, abs=1e-3)


def test_turning_the_camera_turns_what_a_normal_reads() -> None:
    """A panorama rolled by a quarter and normals turned by a quarter read the same features."""
    torch.manual_seed(1)
    join = NormalPanorama(4)
    given = inputs(6, 6, 64)
    turned = dict(given)
    for name in ("intensity", "distance"):
        turned[name] = given[name].roll(16, dims=-1)
    x, y, z = given["normal"].unbind(dim=1)
    turned["normal"] = torch.stack([z, y, -x], dim=1)  # +90 degrees of azimuth
    with torch.no_grad():
        assert torch.allclose(join(given), join(turned), atol=1e-5)


def test_averaging_keeps_energy_and_weights_distance_by_it() -> None:
    intensity, distance = torch.zeros(1, 1, 64, 128), torch.zeros(1, 1, 64, 128)
    intensity[0, 0, 10, 20], distance[0, 0, 10, 20] = 30.0, 2.0
    intensity[0, 0, 10, 21], distance[0, 0, 10, 21] = 10.0, 6.0
    mean, metres = averaged(intensity, distance)
    assert mean.sum() * 4 == pytest.approx(40.0)
    assert metres[0, 0, 5, 10] == pytest.approx((30 * 2 + 10 * 6) / 40)
    assert metres.count_nonzero() == 1


def test_vgg19_has_torchvisions_names_and_shapes() -> None:
    # Configuration E of Simonyan and Zisserman; the indices count ReLUs and pools too.
    widths = {
        0: (64, 3),
        2: (64, 64),
        5: (128, 64),
        7: (128, 128),
        10: (256, 128),
        12: (256, 256),
        14: (256, 256),
        16: (256, 256),
        19: (512, 256),
        21: (512, 512),
        23: (512, 512),
        25: (512, 512),
        28: (512, 512),
        30: (512, 512),
        32: (512, 512),
        34: (512, 512),
    }
    expected = {}
    for index, (outputs, given) in widths.items():
        expected[f"features.{index}.weight"] = (outputs, given, 3, 3)
        expected[f"features.{index}.bias"] = (outputs,)
    network = Vgg19()
    assert {name: tuple(v.shape) for name, v in network.state_dict().items()} == expected
    assert all(isinstance(network.features[tap], nn.ReLU) for tap in network.taps)


@pytest.mark.parametrize("network", [Vgg19(), EfficientNetLite0().eval()])
def test_feature_maps_lie_at_strides_1_2_4_8_16(network: nn.Module) -> None:
    with torch.no_grad():
        maps = network(torch.zeros(1, 3, 64, 96))
        assert [tuple(m.shape[-2:]) for m in maps] == [(64 // s, 96 // s) for s in (1, 2, 4, 8, 16)]
        assert [len(network(torch.zeros(1, 3, 64, 96), depth)) for depth in range(6)] == [*range(6)]
        assert len(network(torch.zeros(1, 3, 5, 7))) == 5


def test_only_networks_of_colour_get_the_product() -> None:
    given = {name: method.inputs_with("product") for name, method in METHODS.items()}
    of_shading = {name for name, inputs in given.items() if "direct_shadows" in inputs}
    assert of_shading == {"shading", "composition", "end_to_end"}
    of_colour = {name for name, inputs in given.items() if "direct_product" in inputs}
    assert of_colour == {name for name in METHODS if "intensity" in given[name]} - of_shading
    assert {"unet", "can", "pix2pix", "cyclegan"} < of_colour
