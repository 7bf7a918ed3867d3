"""PBR-Net plus: it starts as light transport, keeps the light's unit and colour, and learns."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import torch

from pbrnet.model.data.encoding import INPUTS, encode, radiances, targets
from pbrnet.model.data.reader import Dataset, Example, mirrored
from pbrnet.model.methods import METHODS
from pbrnet.model.networks.build import revision_of
from pbrnet.model.networks.flip import Flip
from pbrnet.model.networks.objective import Batch, ExposedLoss, Setting
from pbrnet.model.networks.pbrnet import Architecture
from pbrnet.model.networks.plus import MAX_GLOSS, MAX_LOG_FACTOR, PlusNet
from pbrnet.model.settings import StageTrainParams, TrainParams
from pbrnet.model.training.store import load_model
from pbrnet.model.training.train import Folders, train_network
from pbrnet.pipeline.params import Params
from pbrnet.pipeline.tonemap import tonemap
from pbrnet.scenes.arrays import AnyArray
from pbrnet.scenes.errors import InputError
from tests.fixtures.model import box_dataset
from tests.fixtures.predictor import untrained_models

TRANSPORT = INPUTS["transport"].columns
SMALL = StageTrainParams(epochs=1, width=4, levels=2)


@pytest.fixture(scope="module")
def view(tmp_path_factory: pytest.TempPathFactory) -> Example:
    """A box room whose light transport lacks a fifth of the light, in light of three bands."""
    folder = box_dataset(tmp_path_factory.mktemp("view"), 2, 0, 0, transport=True)
    example = next(Dataset(folder / "dataset", "train", TRANSPORT).ordered())
    rng = np.random.default_rng(0)
    valid = example["valid"].copy()
    valid[:5, :7] = False  # sky: without light on a surface, but bright
    lit = valid[..., None] * np.float32([1.3, 1.0, 0.6])
    gloss = rng.exponential(0.02, example["color"].shape).astype(np.float32)
    return example.having(
        valid=valid,
        transport_direct=lit * example["transport_direct"],
        transport_indirect=lit * example["transport_indirect"],
        transport_color=lit * example["transport_color"] + gloss + ~valid[..., None],
    )


def untrained(spread: float = 0.0, levels: int = 3) -> PlusNet:
    """A network whose last layer says as much as `spread`."""
    torch.manual_seed(0)
    network = PlusNet(Architecture("plus", 8, levels))
    torch.nn.init.normal_(network.bands.unet.out.weight, std=spread)
    return network.eval()


def color_of(network: PlusNet, example: Example) -> AnyArray:
    with torch.no_grad():
        found = network(encode([example], METHODS["plus"].inputs))
    return found[0].permute(1, 2, 0).numpy()


def lit(example: Example, change: Callable[[AnyArray], AnyArray]) -> Example:
    """The view under another light."""
    return example.having(**{name: change(example[name]) for name in TRANSPORT})


@pytest.mark.parametrize("levels", [1, 2, 4])
@pytest.mark.parametrize("crop", [(30, 40), (23, 37), (5, 3), (1, 1)])
def test_it_starts_as_the_picture_of_light_transport(
    view: Example, crop: tuple[int, int], levels: int
) -> None:
    images = ("depth", "normal", "reflectance", "valid", *TRANSPORT)
    part = view.having(**{n: view[n][: crop[0], : crop[1]] for n in images})
    assert np.array_equal(color_of(untrained(levels=levels), part), part["transport_color"])


def test_lamps_k_times_as_bright_make_a_picture_k_times_as_bright(view: Example) -> None:
    network = untrained(spread=1.0)
    bright = lit(view, lambda image: np.float32(1000) * image)
    dim = color_of(network, view)
    assert np.abs(dim - view["transport_color"]).max() > 0.1, "it says something"
    np.testing.assert_allclose(color_of(network, bright), 1000 * dim, rtol=2e-3, atol=1e-3)


def test_each_band_is_seen_apart_and_alike(view: Example) -> None:
    """Swapped bands swap the picture's; a change in one band changes no other."""
    network = untrained(spread=1.0)
    swapped = lit(view, lambda image: image[..., [2, 0, 1]])
    swapped = swapped.having(reflectance=view["reflectance"][..., [2, 0, 1]])
    found = color_of(network, view)
    np.testing.assert_allclose(color_of(network, swapped), found[..., [2, 0, 1]], rtol=1e-4)
    # The level is a mean over the bands: more blue, less red.
    shift = 0.1 * view["transport_indirect"][..., :1]
    other = view.having(transport_indirect=view["transport_indirect"] + shift * [-1, 0, 1])
    again = color_of(network, other)
    np.testing.assert_allclose(again[..., 1], found[..., 1], rtol=1e-3)
    assert np.abs(again[..., 2] - found[..., 2]).max() > 1e-3


def test_light_changes_by_bounded_factors_and_never_below_black(view: Example) -> None:
    found = color_of(untrained(spread=500.0), view)
    light = view["transport_direct"] + view["transport_indirect"]
    most = view["reflectance"] * light + np.abs(
        view["transport_color"] - view["reflectance"] * light
    )
    bound = np.exp(MAX_LOG_FACTOR) * (most + MAX_GLOSS * light)
    assert np.isfinite(found).all() and found.min() >= 0
    assert (found <= 1.001 * bound + 1e-6).all()


def test_gloss_on_metal_in_the_sun_stays_near_the_level_of_the_view(view: Example) -> None:
    """Black but for its gloss, a thousand times as brightly lit as the room."""
    place = np.s_[3:5, 4:6]
    sun = 1000 * np.median(view["transport_direct"])
    metal = {name: view[name].copy() for name in ("reflectance", *TRANSPORT)}
    for name, value in (("reflectance", 0), ("transport_direct", sun), ("transport_color", 0)):
        metal[name][place] = value
    network = untrained()
    with torch.no_grad():
        network.bands.unet.out.bias[12:] = 0.05
    found = color_of(network, view.having(**metal))
    assert 0 < found[place].max() < 0.01 * sun


def test_no_light_is_black_and_has_gradients(view: Example) -> None:
    dark = lit(view, lambda image: 0 * image)
    network = untrained(spread=1.0)
    assert not color_of(network, dark).any()
    exposed_loss(network, dark).backward()  # type: ignore[no-untyped-call]
    assert all(p.grad is not None and p.grad.isfinite().all() for p in network.parameters())


def exposed_loss(network: PlusNet, example: Example) -> torch.Tensor:
    objective = ExposedLoss(
        Setting(network, Flip(), None, 8, lambda: torch.autocast("cpu", enabled=False))
    )
    inputs = encode([example], METHODS["plus"].inputs)
    truth = targets([example], "own")["color"]
    return objective.loss(Batch(inputs, truth, radiances([example], "own")))


def test_it_learns_the_light_that_transport_lacks(tmp_path: Path) -> None:
    folder = box_dataset(tmp_path, 2, 0, 0, transport=True)
    example = next(Dataset(folder / "dataset", "train").ordered())
    network = untrained(spread=0.01)
    optimiser = torch.optim.Adam(network.parameters(), 3e-3)

    def error(color: AnyArray) -> float:
        shown = (tonemap(image, example.exposure_color) for image in (color, example["color"]))
        found, truth = shown
        return float(np.abs(found - truth).mean())

    before = error(example["transport_color"])
    for _ in range(60):
        optimiser.zero_grad()
        exposed_loss(network, example).backward()  # type: ignore[no-untyped-call]
        optimiser.step()
    assert error(color_of(network, example)) < 0.3 * before


def test_materials_reach_it_and_transport_turns_with_the_view(view: Example) -> None:
    network = untrained(spread=1.0)
    rough = np.full_like(view["depth"], 0.5)
    known = view.having(roughness=rough, metalness=rough, material_known=np.ones_like(rough))
    assert np.abs(color_of(network, known) - color_of(network, view)).max() > 1e-3
    for name in (*TRANSPORT, "roughness"):
        assert np.array_equal(mirrored(known)[name], known[name][:, ::-1])


def test_without_transport_it_says_what_to_do(tmp_path: Path) -> None:
    box_dataset(tmp_path, 2, 0, 0)
    params = Params(train=TrainParams(plus=SMALL))
    with pytest.raises(InputError, match=r"no transport_direct.*add 'transport' to channels"):
        train_network("plus", params, Folders(tmp_path, tmp_path))
    (example, _) = Dataset(tmp_path / "dataset", "train").ordered()
    with pytest.raises(InputError, match="no transport_direct; add 'transport' to channels"):
        encode([example], ("transport",))


def test_weights_of_an_earlier_form_end_in_one_line(tmp_path: Path) -> None:
    models = untrained_models(tmp_path, ("plus",), levels=2)
    card = models / "plus.json"
    revision = f'"revision": {revision_of("plus")}'
    assert revision in card.read_text()
    card.write_text(card.read_text().replace(revision, '"revision": 1'))
    with pytest.raises(InputError, match=r"earlier form of plus.*pbrnet train plus"):
        load_model(models / "plus.safetensors")
