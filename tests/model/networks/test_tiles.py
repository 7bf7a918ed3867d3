"""Tiled inference equals inference of the whole image."""

from pathlib import Path

import numpy as np
import pytest
import torch

from pbrnet.model.data.reader import Dataset, Example
from pbrnet.model.evaluation.inference import load_networks
from pbrnet.model.methods import JOINS, Panorama
from pbrnet.model.networks.pbrnet import Architecture, UNet
from pbrnet.model.networks.tiles import margin, stride, tile_grid, tiled, unet_margin
from pbrnet.scenes.errors import InputError
from tests.fixtures.model import box_dataset
from tests.fixtures.predictor import untrained_models


@pytest.fixture(scope="module")
def example(tmp_path_factory: pytest.TempPathFactory) -> Example:
    """A view of odd size, several tiles wide and high."""
    size = {"width": 187, "height": 141}
    data = box_dataset(tmp_path_factory.mktemp("large"), 0, 0, 2, transport=True, **size)
    view = next(Dataset(data / "dataset", "test").ordered())
    share = np.random.default_rng(0).random(view["depth"].shape, dtype=np.float32)
    return view.having(visibility=share)


@pytest.mark.parametrize("levels", [1, 2, 3, 4])
def test_the_margin_of_a_u_net_is_that_of_its_receptive_field(levels: int) -> None:
    """Random inputs and gradients of a random block: what has a gradient is what is seen."""
    block, bound = 2 ** (levels - 1), unet_margin(levels)
    size = 2 * block * (-(-bound // block) + 2)
    start = size // 2 // block * block
    seen = torch.zeros(size, dtype=torch.bool)
    for seed in range(8):
        torch.manual_seed(seed)
        network = UNet(2, 4, levels)
        image = torch.randn(1, 2, size, size, requires_grad=True)
        network(image)[..., start : start + block, start : start + block].sum().backward()
        assert image.grad is not None
        seen |= (image.grad[0].abs().amax(dim=(0, 1))) > 0
    columns = seen.nonzero()[:, 0]
    found = (start - int(columns.min()), int(columns.max()) - (start + block - 1))
    assert max(found) <= bound
    assert max(found) >= bound - block  # ReLU and maximum hide a little


@pytest.mark.slow
@pytest.mark.parametrize("panorama", JOINS)
@pytest.mark.parametrize("method", ["pbrnet", "product", "unet", "plus"])
def test_tiles_give_the_whole_picture(
    method: str, panorama: Panorama, example: Example, tmp_path: Path
) -> None:
    names = ("shading", "composition", "unet", "plus")
    models = untrained_models(tmp_path / "models", names, panorama=panorama, levels=3)
    whole = load_networks(models, [method]).predict(method, example)
    cut = load_networks(models, [method], tile=32).predict(method, example)
    assert whole.color.std() > 0.015  # there is something to see
    assert np.abs(whole.color - cut.color).max() < 1e-4
    if whole.shading is not None and cut.shading is not None:
        assert np.abs(whole.shading - cut.shading).max() < 1e-4


def test_tiles_share_the_exposure_of_the_whole_picture(example: Example, tmp_path: Path) -> None:
    names = ("shading", "composition")
    models = untrained_models(tmp_path / "models", names, levels=3, exposure="own")
    whole, cut = (
        load_networks(models, ["pbrnet"], tile=tile).predict("pbrnet", example) for tile in (0, 32)
    )
    assert whole.color.std() > 0.015
    assert np.abs(whole.color - cut.color).max() < 1e-4


def test_too_little_overlap_would_show(example: Example, tmp_path: Path,
                                       monkeypatch: pytest.MonkeyPatch) -> None:  # fmt: skip
    """The test above can fail: with a tenth of the margin, tiles differ from the whole."""
    models = untrained_models(tmp_path / "models", ("unet",), levels=3)
    whole = load_networks(models, ["unet"]).predict("unet", example)
    monkeypatch.setattr(
        "pbrnet.model.networks.tiles.margin", lambda architecture: stride(architecture)
    )
    cut = load_networks(models, ["unet"], tile=32).predict("unet", example)
    assert np.abs(whole.color - cut.color).max() > 1e-4


def test_the_tile_size_bounds_the_window() -> None:
    architecture = Architecture("composition", 4, 3)
    sizes = []

    def network(inputs: dict[str, torch.Tensor]) -> torch.Tensor:
        sizes.append(tuple(inputs["shading"].shape[-2:]))
        return inputs["shading"]

    image = torch.rand(1, 3, 300, 500)
    assert torch.equal(tiled(network, architecture, {"shading": image}, 64), image)
    assert len(sizes) == 5 * 8
    assert max(max(size) for size in sizes) == 64 + 2 * margin(architecture)


@pytest.mark.parametrize("size", [(1, 1), (16, 16), (17, 100), (250, 33)])
def test_tiles_cover_every_pixel_once_from_aligned_windows(size: tuple[int, int]) -> None:
    architecture = Architecture("shading", 4, 3)
    covered = np.zeros(size, int)
    for region in tile_grid(*size, tile=18, architecture=architecture):
        covered[region.rows, region.columns] += 1
        assert region.rows.stop - region.rows.start <= 20  # 18, rounded up to whole strides
        for window in (region.window_rows, region.window_columns):
            assert window.start % stride(architecture) == 0
    assert (covered == 1).all()


@pytest.mark.parametrize("name", ["can", "pix2pix", "cyclegan"])
def test_networks_that_normalise_refuse_tiles(name: str, tmp_path: Path) -> None:
    models = untrained_models(tmp_path / "models", (name,))
    load_networks(models, [name])
    with pytest.raises(InputError, match=r"statistics of the whole picture.*leave out --tile"):
        load_networks(models, [name], tile=64)
