"""The baselines have their papers' layouts, and their losses their papers' values."""

import math
from contextlib import nullcontext
from typing import Any, get_args

import pytest
import torch
from torch import nn
from torch.nn import functional

from pbrnet.model.baselines import cyclegan, pix2pix
from pbrnet.model.baselines.can import CAN, AdaptiveNorm, MeanSquares
from pbrnet.model.baselines.cyclegan import (
    BUFFER_SIZE,
    REFLECTANCE,
    CycleObjective,
    ForwardGenerator,
    ImageBuffer,
    Residual,
)
from pbrnet.model.baselines.layers import STACKED, BatchNorm, InstanceNorm, stacked
from pbrnet.model.baselines.pix2pix import AdversarialObjective, Generator, PatchDiscriminator
from pbrnet.model.data.encoding import input_named
from pbrnet.model.methods import BASELINES, METHODS, PAPER_INPUTS, columns_of
from pbrnet.model.networks.build import is_current, revision_of
from pbrnet.model.networks.objective import Batch, Objective, Setting
from pbrnet.model.networks.pbrnet import Architecture
from pbrnet.model.settings import Baseline, TrainParams
from pbrnet.model.titles import METHOD_TITLES, NETWORK_TITLES


def inputs(height: int, width: int) -> dict[str, torch.Tensor]:
    """Random encoded inputs of one view; the panorama 16 wide."""
    random = torch.Generator().manual_seed(0)
    shapes = {name: (8, 16) if name in ("intensity", "distance") else (height, width)
              for name in PAPER_INPUTS}  # fmt: skip
    channels = {name: input_named(name).channels for name in PAPER_INPUTS}
    given = {n: torch.rand(1, c, *shapes[n], generator=random) for n, c in channels.items()}
    given["normal"] = functional.normalize(given["normal"] - 0.5, dim=1)
    return given


def kernels(network: nn.Module, kind: type[nn.Module] = nn.Conv2d) -> list[Any]:
    return [module for module in network.modules() if isinstance(module, kind)]


def parameters(network: nn.Module) -> int:
    return sum(value.numel() for value in network.parameters())


def field(gradient: torch.Tensor) -> tuple[int, int]:
    """Rows and columns of the smallest box around all that is not zero in (1, C, H, W)."""
    seen = gradient[0].abs().sum(dim=0) > 0
    return tuple(
        int(hit.nonzero().max() - hit.nonzero().min()) + 1
        for hit in (seen.any(dim=1), seen.any(dim=0))
    )  # type: ignore[return-value]


# The registry


def test_the_registry_and_the_parameters_name_the_same_baselines() -> None:
    assert get_args(Baseline) == BASELINES
    for name in METHODS:
        assert getattr(TrainParams(), name).epochs > 0


def test_the_report_has_words_for_every_baseline() -> None:
    assert set(BASELINES) <= METHOD_TITLES.keys() & NETWORK_TITLES.keys()


def test_the_registry_knows_which_networks_need_more_than_the_paper_gives() -> None:
    light = tuple(f"transport_{part}" for part in ("direct", "indirect", "color"))
    samples = ("noisy_color", "noisy_half", "denoised_color", "noisy_spp")
    assert {name: method.columns for name, method in METHODS.items() if method.columns} == {
        "plus": light,
        "hybrid": (*light, *samples),
    }
    assert columns_of(["unet", "plus", "hybrid"]) == (*light, *samples)
    assert is_current(Architecture("unet", 4, 3, revision=revision_of("unet")))
    assert not is_current(Architecture("unet", 4, 3)), "weights without a revision are the first"


def test_only_baselines_with_their_own_loss_have_an_optimiser_of_their_own() -> None:
    for name, method in METHODS.items():
        assert (method.adam is not None) == name.endswith("_own")
        assert bool(method.own_loss) == (name.endswith("_own") or name in ("plus", "hybrid"))
    ours = TrainParams(learning_rate=7e-3)
    assert METHODS["pix2pix"].rate(ours.learning_rate, 0, 100) == 7e-3
    rates = [
        METHODS["cyclegan_own"].rate(ours.learning_rate, step, 200) for step in (0, 100, 150, 199)
    ]
    assert rates == pytest.approx([2e-4, 2e-4, 1e-4, 2e-6])  # flat, then linearly to nothing
    assert METHODS["pix2pix_own"].rate(ours.learning_rate, 199, 200) == 2e-4
    assert METHODS["can_own"].rate(ours.learning_rate, 199, 200) == 1e-4


# CAN


def test_can32_has_ten_layers_of_32_channels_with_doubling_dilations() -> None:
    network = CAN(Architecture("can", 32, 10, "resize"))
    *layers, last = kernels(network)
    assert [layer.dilation[0] for layer in layers] == [1, 2, 4, 8, 16, 32, 64, 128, 1]
    assert {layer.kernel_size for layer in layers} == {(3, 3)} and last.kernel_size == (1, 1)
    assert [layer.in_channels for layer in layers] == [STACKED] + [32] * 8
    assert {layer.out_channels for layer in layers} == {32} and last.out_channels == 3
    assert {layer.stride for layer in layers} == {(1, 1)}
    assert all(layer.bias is None for layer in layers) and last.bias is not None
    assert len(kernels(network, AdaptiveNorm)) == 9


def test_can24_has_nine_layers() -> None:
    layers = kernels(CAN(Architecture("can", 24, 9, "resize")))
    assert [layer.dilation[0] for layer in layers] == [1, 2, 4, 8, 16, 32, 64, 1, 1]
    assert {layer.out_channels for layer in layers[:-1]} == {24}


@pytest.mark.parametrize(("depth", "side"), [(10, 513), (9, 257), (5, 17)])
def test_cans_receptive_field(depth: int, side: int) -> None:
    torch.manual_seed(0)
    network = CAN(Architecture("can", 2, depth, "resize"))
    for layer in kernels(network):
        nn.init.uniform_(layer.weight, 0.5, 1)  # nothing cancels
    given = inputs(side + 6, side + 6)
    given["reflectance"].requires_grad_(True)
    middle = side // 2 + 3
    network(given)[0, 0, middle, middle].backward()
    assert field(given["reflectance"].grad) == (side, side)


def test_cans_layers_start_as_the_identity() -> None:
    layer = CAN(Architecture("can", 4, 4, "resize")).layers[1]
    image = torch.rand(1, 4, 9, 9)
    assert torch.allclose(layer(image), image)


def test_adaptive_normalisation_by_hand() -> None:
    # Values 1 and 3: mean 2, deviation 1; so BN is -1 and 1, here shifted by 0.5.
    norm = AdaptiveNorm(1)
    image = torch.tensor([[[[1.0, 3.0]]]])
    assert torch.equal(norm(image), image)
    with torch.no_grad():
        norm.keep.fill_(2.0)
        norm.mix.fill_(10.0)
        norm.norm.bias.fill_(0.5)
    wanted = [2 * 1 + 10 * (-1 + 0.5), 2 * 3 + 10 * (1 + 0.5)]
    assert norm(image).flatten().tolist() == pytest.approx(wanted, rel=1e-2)


# pix2pix


@pytest.fixture(scope="module")
def generator() -> Generator:
    return Generator(Architecture("pix2pix", 64, 8, "resize"))


def test_pix2pixs_encoder(generator: Generator) -> None:
    layers = [down.conv for down in generator.down]
    assert [layer.out_channels for layer in layers] == [64, 128, 256, 512, 512, 512, 512, 512]
    assert {(layer.kernel_size, layer.stride) for layer in layers} == {((4, 4), (2, 2))}
    normed = [isinstance(down.norm, BatchNorm) for down in generator.down]
    assert normed == [False] + [True] * 6 + [False]


def test_pix2pixs_decoder_has_skips_and_drops_in_its_first_three(generator: Generator) -> None:
    layers = [up.conv for up in generator.up]
    assert [layer.out_channels for layer in layers] == [512, 512, 512, 512, 256, 128, 64]
    # All but the first are given the encoder's layer of their size too: twice as many channels.
    assert [layer.in_channels for layer in layers] == [512, 1024, 1024, 1024, 1024, 512, 256]
    assert (generator.out.in_channels, generator.out.out_channels) == (128, 3)
    rates = [getattr(up.drop, "p", 0.0) for up in generator.up]
    assert rates == [0.5] * 3 + [0.0] * 4
    assert all(isinstance(up.norm, BatchNorm) for up in generator.up)


def test_a_picture_of_256_pixels_becomes_one() -> None:
    network = Generator(Architecture("pix2pix", 1, 8, "resize"))
    sizes: list[tuple[int, ...]] = []
    for down in network.down:
        down.register_forward_hook(lambda _m, _given, out: sizes.append(tuple(out.shape[-2:])))
    with torch.no_grad():
        network(inputs(256, 256))
    assert sizes == [(2**level, 2**level) for level in (7, 6, 5, 4, 3, 2, 1, 0)]


def test_dropout_is_for_training_only() -> None:
    torch.manual_seed(0)
    network = Generator(Architecture("pix2pix", 4, 5))
    given = inputs(40, 50)
    with torch.no_grad():
        assert not torch.equal(network(given), network(given))
        network.eval()
        assert torch.equal(network(given), network(given))


def test_the_discriminators_layers() -> None:
    layers = kernels(PatchDiscriminator(STACKED + 3, 64, BatchNorm))
    assert [layer.out_channels for layer in layers] == [64, 128, 256, 512, 1]
    assert [layer.stride[0] for layer in layers] == [2, 2, 2, 1, 1]
    assert {layer.kernel_size for layer in layers} == {(4, 4)}
    # The authors' own program prints 2.765 M for three channels, instance norm.
    network = PatchDiscriminator(3, 64, lambda _: InstanceNorm())
    assert parameters(network) == 2_764_737


def test_a_patch_is_70_pixels_wide() -> None:
    network = PatchDiscriminator(3, 4, lambda _: nn.Identity())
    image = torch.rand(1, 3, 160, 160, requires_grad=True)
    logits = network(image)
    logits[0, 0, logits.shape[2] // 2, logits.shape[3] // 2].backward()
    assert field(image.grad) == (70, 70)


def setting(network: nn.Module) -> Setting:
    return Setting(network, functional.l1_loss, None, 4, nullcontext)


def constant(discriminator: nn.Module, output: float) -> None:
    """Make its output constant."""
    last = kernels(discriminator)[-1]
    nn.init.zeros_(last.weight)
    nn.init.constant_(last.bias, output)


def by_module(objective: Objective, batch: Batch) -> dict[str, float]:
    return {name: float(loss.detach()) for name, loss in objective.losses(batch)}


def test_pix2pixs_losses_by_hand() -> None:
    network = Generator(Architecture("pix2pix", 4, 3))
    nn.init.zeros_(network.out.weight)
    nn.init.zeros_(network.out.bias)  # type: ignore[arg-type]  # so it paints 0.5
    objective = AdversarialObjective(setting(network))
    constant(objective.discriminator, 1.0)
    batch = Batch(inputs(24, 24), torch.full((1, 3, 24, 24), 0.6))
    losses = by_module(objective, batch)
    real, fake = math.log(1 + math.exp(-1)), math.log(1 + math.exp(1))
    assert losses["discriminator"] == pytest.approx((real + fake) / 2, rel=1e-5)
    # Off by 0.1 of [0, 1] is 0.2 of [-1, 1].
    assert losses["network"] == pytest.approx(real + 100 * 0.2, rel=1e-5)
    assert float(objective.loss(batch)) == pytest.approx(losses["network"])
    assert list(losses) == ["discriminator", "network"]


def test_the_generator_meets_the_discriminator_after_its_update() -> None:
    torch.manual_seed(0)
    objective = AdversarialObjective(setting(Generator(Architecture("pix2pix", 4, 3)).eval()))
    batch = Batch(inputs(24, 24), torch.rand(1, 3, 24, 24))
    before = float(objective.loss(batch))
    losses = objective.losses(batch)
    next(losses)
    constant(objective.discriminator, 20.0)  # as an update might: all is real
    assert float(next(losses)[1]) < before
    assert float(objective.loss(batch)) < before


def test_the_discriminator_does_not_teach_the_generator() -> None:
    objective = AdversarialObjective(setting(Generator(Architecture("pix2pix", 4, 3))))
    _, loss = next(objective.losses(Batch(inputs(24, 24), torch.rand(1, 3, 24, 24))))
    loss.backward()
    assert all(value.grad is None for value in objective.network.parameters())


# CycleGAN


@pytest.mark.parametrize("blocks", [6, 9])
def test_cyclegans_generator(blocks: int) -> None:
    network = cyclegan.Generator(3, 3, 64, blocks)
    layers = kernels(network)
    ends = [(layers[0], 3, 64), (layers[-1], 64, 3)]
    for layer, given, made in ends:
        assert (layer.kernel_size, layer.in_channels, layer.out_channels) == ((7, 7), given, made)
    down = layers[1:3]
    assert [(d.kernel_size, d.stride, d.out_channels) for d in down] == [
        ((3, 3), (2, 2), 128),
        ((3, 3), (2, 2), 256),
    ]
    assert len(kernels(network, Residual)) == blocks
    assert [layer.out_channels for layer in layers[3:-1]] == [256] * 2 * blocks
    up = kernels(network, nn.ConvTranspose2d)
    assert [layer.out_channels for layer in up] == [128, 64]
    assert len(kernels(network, nn.ReflectionPad2d)) == 2 + 2 * blocks
    assert len(kernels(network, InstanceNorm)) == 5 + 2 * blocks
    # The authors' own program prints 11.378 M for nine blocks.
    assert parameters(network) == {6: 7_837_699, 9: 11_378_179}[blocks]


def test_cyclegans_losses_by_hand() -> None:
    network = ForwardGenerator(Architecture("cyclegan", 4, 1))
    cycles = CycleObjective(setting(network))
    for generator in (network.generator, cycles.inverse):  # grey pictures, empty stacks
        last = kernels(generator)[-1]
        nn.init.zeros_(last.weight)
        nn.init.zeros_(last.bias)
    for discriminator in cycles.discriminators.values():
        constant(discriminator, 0.25)
    batch = Batch(inputs(24, 24), torch.full((1, 3, 24, 24), 0.8))  # 0.6 of [-1, 1]
    losses = by_module(cycles, batch)
    stack = stacked(batch.inputs)
    around = float(stack.abs().mean()) + 0.6
    same = float(stack[:, REFLECTANCE].abs().mean()) + 0.6
    wanted = 2 * 0.75**2 + 10 * around + 5 * same
    assert losses["network"] == pytest.approx(wanted, rel=1e-5)
    assert losses["discriminators"] == pytest.approx(2 * 0.5 * (0.75**2 + 0.25**2), rel=1e-5)
    assert list(losses) == ["network", "discriminators"]


def test_reflectance_lies_where_identity_puts_the_picture() -> None:
    given = inputs(6, 8)
    assert torch.equal(stacked(given)[:, REFLECTANCE], given["reflectance"])
    picture = torch.rand(1, 3, 6, 8)
    stack = cyclegan.as_stack(picture, STACKED)
    assert torch.equal(stack[:, REFLECTANCE], picture)
    assert float(stack.abs().sum()) == pytest.approx(float(picture.sum()))


def test_pictures_come_from_the_step_before() -> None:
    """A view's stack and its picture are not seen together."""
    cycles = CycleObjective(setting(ForwardGenerator(Architecture("cyclegan", 4, 1))))
    seen: list[float] = []
    inner = cycles._generator_loss

    def spy(stack: torch.Tensor, color: torch.Tensor) -> Any:
        seen.append(float(color.mean()))
        return inner(stack, color)

    cycles._generator_loss = spy  # type: ignore[method-assign]
    for value in (0.5, 0.75, 1.0):
        by_module(cycles, Batch(inputs(16, 16), torch.full((1, 3, 16, 16), value)))
    assert seen == pytest.approx([0.0, 0.0, 0.5])


def test_the_buffer_holds_fifty_images_and_returns_stored_ones_half_the_time() -> None:
    torch.manual_seed(0)
    buffer = ImageBuffer()
    images = [torch.full((1, 1, 1, 1), float(index)) for index in range(450)]
    given = [float(buffer.exchange(image)) for image in images]
    assert BUFFER_SIZE == 50 and given[:50] == list(range(50))
    old = [value < index for index, value in enumerate(given[50:], 50)]
    assert len(buffer.images) == 50
    assert 0.4 < sum(old) / 400 < 0.6
    assert len({value for value, was in zip(given[50:], old, strict=True) if was}) == sum(old)


def test_generated_images_of_another_size_are_not_exchanged() -> None:
    torch.manual_seed(0)
    buffer = ImageBuffer()
    for _ in range(BUFFER_SIZE):
        buffer.exchange(torch.zeros(1, 1, 2, 2))
    for _ in range(20):
        assert buffer.exchange(torch.ones(1, 1, 3, 3)).shape == (1, 1, 3, 3)
    assert all(image.shape == (1, 1, 2, 2) for image in buffer.images)


# All


def test_mean_squares_by_hand() -> None:
    class Fixed(nn.Module):
        def forward(self, given: dict[str, torch.Tensor]) -> torch.Tensor:
            return given["picture"]

    truth = torch.full((1, 3, 1, 2), 0.5)
    picture = truth + torch.tensor([0.1, -0.3])
    loss = MeanSquares(setting(Fixed())).loss(Batch({"picture": picture}, truth))
    assert float(loss) == pytest.approx((0.01 + 0.09) / 2)


@pytest.mark.parametrize("size", [(1, 1), (17, 31), (40, 30)])
@pytest.mark.parametrize("name", ["pix2pix_own", "cyclegan_own", "can_own"])
def test_losses_of_views_of_any_size(name: str, size: tuple[int, int]) -> None:
    torch.manual_seed(0)
    layouts = {"pix2pix": Generator, "cyclegan": ForwardGenerator, "can": CAN}
    layout = METHODS[name].kind
    network = layouts[layout](Architecture(layout, 4, 4))
    objective = METHODS[name].objective(setting(network))
    batch = Batch(inputs(*size), torch.rand(1, 3, *size))
    for module, loss in objective.losses(batch):
        loss.backward()
        assert torch.isfinite(loss), module
        grown = [p.grad for p in objective.modules[module].parameters() if p.grad is not None]
        assert grown and all(bool(torch.isfinite(g).all()) for g in grown)


def test_normalisation_by_the_image_at_hand() -> None:
    image = torch.rand(1, 3, 8, 8) * 5 + 2
    for norm in (BatchNorm(3), InstanceNorm()):
        for mode in (True, False):
            made = norm.train(mode)(image)
            assert made.mean(dim=(2, 3)).abs().max() < 1e-5
            assert made.std(dim=(2, 3), correction=0).sub(1).abs().max() < 1e-3


def test_pix2pix_starts_from_narrow_gaussians() -> None:
    torch.manual_seed(0)
    weights = [layer.weight for layer in kernels(pix2pix.PatchDiscriminator(3, 32, BatchNorm))]
    assert all(float(w.std()) == pytest.approx(0.02, rel=0.1) for w in weights)
