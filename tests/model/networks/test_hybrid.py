"""The hybrid: a mixture at first, it keeps the light's unit, and learns to correct it."""

import itertools
import json
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from PIL import Image

from pbrnet.model.data.display import tonemap_exposed
from pbrnet.model.data.encoding import INPUTS, encode, radiances, targets
from pbrnet.model.data.reader import Dataset, Example, mirrored
from pbrnet.model.evaluation.evaluate import evaluate
from pbrnet.model.evaluation.inference import load_networks
from pbrnet.model.methods import METHODS
from pbrnet.model.networks.flip import Flip
from pbrnet.model.networks.hybrid import (
    EQUAL_PIXELS,
    EQUAL_POWER,
    EQUAL_SAMPLES,
    MAX_LOG_FACTOR,
    HybridNet,
    start_logit,
)
from pbrnet.model.networks.objective import Batch, ExposedLoss, Setting
from pbrnet.model.networks.pbrnet import Architecture
from pbrnet.model.settings import StageTrainParams, TrainParams
from pbrnet.model.training.train import Folders, train_network
from pbrnet.pipeline.channels import Kind
from pbrnet.pipeline.costs.ledger import Ledger
from pbrnet.pipeline.frames import read_frame, write_frame
from pbrnet.pipeline.params import Params
from pbrnet.pipeline.passes.settings import NoisyParams
from pbrnet.pipeline.render.scene import open_scene, set_variant
from pbrnet.pipeline.tonemap import Exposure, tonemap
from pbrnet.pipeline.views import CameraFile, View, as_matrix, intrinsics_of, look, save_cameras
from pbrnet.scenes.arrays import AnyArray
from pbrnet.scenes.contract import load_scene
from pbrnet.scenes.errors import InputError
from tests.fixtures.backbone import copy_backbone
from tests.fixtures.command import exit_code
from tests.fixtures.model import box_dataset, box_rows, made_example, write_shard
from tests.fixtures.stages import write_room
from tests.fixtures.traces import render
from tests.fixtures.trial import folders_in

NOISY = INPUTS["noisy"].columns
LIGHT = (*NOISY, *INPUTS["transport"].columns)
COLUMNS = (*LIGHT, "noisy_spp")
SIZE = {"width": 24, "height": 18, "panorama": 16}
SMALL = StageTrainParams(epochs=1, width=4, levels=2)
PARAMS = Params(
    train=TrainParams(baselines=("hybrid",), shading=SMALL, composition=SMALL, hybrid=SMALL)
)


@pytest.fixture(scope="module")
def view(tmp_path_factory: pytest.TempPathFactory) -> Example:
    """A box room with noisy samples."""
    folder = box_dataset(tmp_path_factory.mktemp("view"), 2, 0, 0, noisy=True)
    return next(Dataset(folder / "dataset", "train", COLUMNS).ordered())


def untrained(width: int = 8, levels: int = 3, spread: float = 0.0) -> HybridNet:
    """A network whose last layer says as much as `spread`."""
    torch.manual_seed(0)
    network = HybridNet(Architecture("hybrid", width, levels))
    torch.nn.init.normal_(network.bands.unet.out.weight, std=spread)
    return network


def encoded(example: Example) -> dict[str, torch.Tensor]:
    return encode([example], METHODS["hybrid"].inputs)


def color_of(network: HybridNet, example: Example) -> np.ndarray:
    with torch.no_grad():
        found = network(encoded(example))
    return found[0].permute(1, 2, 0).numpy()


@pytest.mark.parametrize("levels", [1, 2, 4])
@pytest.mark.parametrize("size", [(40, 30), (37, 23), (5, 3)])
def test_it_starts_from_a_mixture_of_transport_and_denoiser(
    levels: int, size: tuple[int, int]
) -> None:
    example = example_of(np.random.default_rng(0), *size)
    np.testing.assert_allclose(
        color_of(untrained(levels=levels), example), mixture_of(example), rtol=3e-6
    )


def mixture_of(example: Example) -> AnyArray:
    share = start_of(float(example["noisy_spp"]), example["depth"].size)
    return share * example["transport_color"] + (1 - share) * example["denoised_color"]


def start_of(samples: float, pixels: int) -> float:
    """The share of light transport at first."""
    logs = (torch.tensor(float(number)).log() for number in (samples, pixels))
    return float(torch.sigmoid(start_logit(*logs)))


def test_the_more_samples_the_less_light_transport() -> None:
    """Half of each where they err alike, at any size; four times the pixels are more samples."""
    size = EQUAL_PIXELS
    assert start_of(EQUAL_SAMPLES, size) == pytest.approx(0.5)
    shares = [start_of(samples, size) for samples in (1, 2, 4, 8, 64, 4096)]
    assert shares == sorted(shares, reverse=True) and shares[0] > 0.9 and shares[-1] < 0.01
    assert start_of(EQUAL_SAMPLES * 4**-EQUAL_POWER, 4 * size) == pytest.approx(0.5)


def example_of(rng: np.random.Generator, width: int, height: int) -> Example:
    """A view of nothing in particular."""
    color = rng.random((height, width, 3), dtype=np.float32)
    normal = rng.normal(size=color.shape).astype(np.float32)
    panorama = np.zeros((8, 16), np.float32)
    return made_example(
        depth=1 + color[..., 0],
        normal=normal / np.linalg.norm(normal, axis=-1, keepdims=True),
        reflectance=rng.random(color.shape, dtype=np.float32),
        valid=np.ones(color.shape[:2], bool),
        intensity=panorama,
        distance=panorama,
        color=color,
        **{name: rng.exponential(1, color.shape).astype(np.float32) for name in LIGHT},
        noisy_spp=np.array(3),
    )


def test_it_changes_light_by_a_bounded_factor(view: Example) -> None:
    """The factor shows alone if samples and transport agree with the denoised image."""
    same = view.having(noisy_color=view["denoised_color"], transport_color=view["denoised_color"])
    found = color_of(untrained(spread=500.0), same)
    lit = same["denoised_color"] > 0.01
    factor = found[lit] / same["denoised_color"][lit]
    bound = np.exp(MAX_LOG_FACTOR) * 1.001
    assert 1 / bound < factor.min() < 0.1 and 10 < factor.max() < bound


@pytest.mark.parametrize(
    ("share", "back", "wanted"),
    [(20, 0, "transport_color"), (-20, 0, "denoised_color"), (-20, 20, "noisy_color")],
)
def test_it_may_turn_to_any_of_its_pictures(
    view: Example, share: float, back: float, wanted: str
) -> None:
    network = untrained()
    with torch.no_grad():
        network.bands.unet.out.bias[4:8] = share
        network.bands.unet.out.bias[8:12] = back
    np.testing.assert_allclose(color_of(network, view), view[wanted], rtol=1e-4, atol=1e-5)


def test_one_set_of_weights_knows_how_many_samples_it_has(view: Example) -> None:
    network = untrained(spread=1.0)
    pictures = [color_of(network, view.having(noisy_spp=np.array(spp))) for spp in range(1, 9)]
    for few, more in itertools.pairwise(pictures):
        assert np.abs(few - more).max() > 1e-4


def with_light(view: Example, change: Callable[[AnyArray], AnyArray]) -> Example:
    """The view with its samples changed, raw and denoised."""
    return view.having(**{name: change(view[name]) for name in LIGHT})


def test_brighter_lamps_make_the_same_picture_brighter(view: Example) -> None:
    network = untrained(spread=1.0)
    brighter = with_light(view, lambda image: 500 * image)
    found = color_of(network, brighter)
    np.testing.assert_allclose(found, 500 * color_of(network, view), rtol=2e-3, atol=1e-3)


@pytest.mark.parametrize("spoil", ["dark", "firefly"])
def test_no_light_and_far_too_much_of_it(view: Example, spoil: str) -> None:
    def change(image: AnyArray) -> AnyArray:
        samples = 0 * image
        if spoil == "firefly":
            samples[3, 4] = 65504
        return samples

    spoiled = with_light(view, change)
    network = untrained(spread=1.0)
    image = color_of(network, spoiled)
    assert np.isfinite(image).all() and image.min() >= 0
    exposed_loss(network, spoiled, encoded(spoiled)).backward()  # type: ignore[no-untyped-call]
    assert all(p.grad is not None and p.grad.isfinite().all() for p in network.parameters())


def test_what_the_loss_sees_is_what_is_displayed() -> None:
    rng = np.random.default_rng(0)
    image = rng.exponential(1, (20, 30, 3)).astype(np.float32)
    exposure = Exposure(1.7, 6.0)
    scaled = torch.from_numpy(exposure.scale * image.transpose(2, 0, 1).copy())[None]
    found = tonemap_exposed(scaled, torch.full((1, 1, 1, 1), exposure.white))
    np.testing.assert_allclose(
        found[0].permute(1, 2, 0).numpy(), tonemap(image, exposure), atol=1e-4
    )


def exposed_loss(network: HybridNet, example: Example, inputs: dict[str, Any]) -> torch.Tensor:
    objective = ExposedLoss(
        Setting(network, Flip(), None, 8, lambda: torch.autocast("cpu", enabled=False))
    )
    truth = targets([example], "shared")["color"]
    return objective.loss(Batch(inputs, truth, radiances([example], "shared")))


def test_it_learns_what_the_mixture_does_wrong(view: Example) -> None:
    network = untrained(width=12, levels=3, spread=0.01)
    inputs = encoded(view)
    optimiser = torch.optim.Adam(network.parameters(), 3e-3)
    truth = tonemap(view["color"], view.exposure_shading)

    def error() -> float:
        found = tonemap(color_of(network, view), view.exposure_shading)
        return float(np.abs(found - truth).mean())

    first = float(np.abs(tonemap(mixture_of(view), view.exposure_shading) - truth).mean())
    assert error() == pytest.approx(first, rel=0.2)
    for _ in range(120):
        optimiser.zero_grad()
        exposed_loss(network, view, inputs).backward()  # type: ignore[no-untyped-call]
        optimiser.step()
    assert error() < 0.3 * first


def test_samples_are_read_where_asked_for_and_turn_with_the_view(tmp_path: Path) -> None:
    rows = box_rows(["a"], 1, "train", noisy=True, **SIZE)
    write_shard(tmp_path / "train-00000-of-00001.parquet", rows)
    (plain,) = Dataset(tmp_path, "train").ordered()
    assert "noisy_color" not in plain and "denoised_color" not in mirrored(plain)
    with pytest.raises(InputError, match=r"a/v000: no noisy_color; set noisy\.spp"):
        encode([plain], ("noisy",))
    (example,) = Dataset(tmp_path, "train", COLUMNS).ordered()
    assert example["noisy_spp"] == 2
    for name in NOISY:
        assert np.array_equal(example[name], rows[0][name].astype(np.float32))
        turned = mirrored(example)[name]
        assert np.array_equal(turned, example[name][:, ::-1])


def test_without_the_samples_it_says_what_to_do(tmp_path: Path) -> None:
    box_dataset(tmp_path, 2, 0, 0, transport=True, **SIZE)
    with pytest.raises(InputError, match=r"no noisy_color, .*set noisy\.spp.*dvc repro"):
        train_network("hybrid", PARAMS, Folders(tmp_path, tmp_path))


@pytest.fixture(scope="module")
def trained(tmp_path_factory: pytest.TempPathFactory) -> Folders:
    """The pair and the hybrid, barely trained, beside their dataset."""
    folders = folders_in(tmp_path_factory.mktemp("trained"))
    box_dataset(folders.data, 4, 2, 4, noisy=True, **SIZE)
    copy_backbone(folders.models)
    for name in ("shading", "composition", "hybrid"):
        train_network(name, PARAMS, folders)
    return folders


def test_it_is_measured_and_its_time_is_that_of_the_samples_too(
    trained: Folders, tmp_path: Path
) -> None:
    folders = replace(trained, metrics=tmp_path)
    result = evaluate(PARAMS, folders)
    assert result["methods"]["hybrid"]["seconds"] is None, "nobody knows what the samples took"
    ledger = Ledger(trained.data)
    ledger.add(("transport", "test-room-0", "v000"), seconds=1.0, opening=0.0, threads=1)
    times = {("test-room-0", "v000"): 9.0, ("test-room-0", "v001"): 2.5, ("other", "v000"): 70.0}
    for (scene, name), seconds in times.items():
        ledger.add(("noisy", scene, name), seconds=seconds, opening=0.5, threads=3)
    ledger.save()
    result = evaluate(PARAMS, folders)
    # On one processor: (9 - 0.5) * 3 and (2.5 - 0.5) * 3.
    assert result["timing"]["sampling"] == pytest.approx((25.5 + 6) / 2)
    assert result["methods"]["denoised"]["seconds"] == result["timing"]["sampling"]
    assert 0 < result["methods"]["denoised"]["ssim"]["mean"] < 1
    seconds = result["methods"]["hybrid"]["seconds"]
    timing = result["timing"]
    assert timing["radiosity"] == 1.0
    assert seconds == pytest.approx(timing["hybrid"] + timing["sampling"] + timing["radiosity"])
    assert json.loads((trained.models / "hybrid.json").read_text())["training"]["noisy_spp"] == 2
    (trained.data / "ledger.parquet").unlink()


def test_evaluation_without_samples_says_what_is_missing(trained: Folders, tmp_path: Path) -> None:
    rows = box_rows(["fresh"], 2, "test", **SIZE)
    write_shard(tmp_path / "data" / "dataset" / "test-00000-of-00001.parquet", rows)
    result = evaluate(PARAMS, replace(trained, data=tmp_path / "data", metrics=tmp_path))
    assert "hybrid" not in result["methods"]
    assert "no transport_direct, " in result["left_out"]["hybrid"]


@pytest.fixture
def predict(
    trained: Folders, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> Callable[..., int]:
    """`pbrnet predict --method hybrid` in `tmp_path`; its exit code."""
    monkeypatch.chdir(tmp_path)
    Path("params.yaml").write_text("groundtruth: {spp: 4, block_spp: 4, max_depth: 3}\n")
    chosen = ("predict", "--models", trained.models, "--method", "hybrid")
    return partial(exit_code, *chosen)


def test_it_predicts_from_a_scene_whose_samples_it_traces(
    predict: Callable[..., int], tmp_path: Path, trained: Folders
) -> None:
    scene = tmp_path / "data" / "scenes" / "room"
    write_room(scene)
    pose = look((0.6, 0.6, 1.5), (1, 0.8, -0.2))
    size = replace(PARAMS.image, width=32, height=24)
    camera = View("room", "v0", 32, 24, as_matrix(intrinsics_of(size)), as_matrix(pose))
    save_cameras(tmp_path / "data" / "cameras" / "room.json", CameraFile("room", (camera,)))
    params = replace(PARAMS, noisy=NoisyParams(2))
    set_variant("auto")
    opened = open_scene(load_scene(scene))
    kinds: tuple[Kind, ...] = ("inputs", "illumination", "transport", "noisy")
    frames = {kind: tmp_path / f"{kind}.exr" for kind in kinds}
    for kind, path in frames.items():
        channels, stats = render([kind], opened, camera, params, 1)[kind]
        write_frame(path, kind, channels, camera, **stats, fingerprint="")
    given = [word for kind, path in frames.items() for word in (f"--{kind}", path)]
    for arguments in (
        (scene, "--view", "v0"),
        (scene, "--view", "v0", "--compare"),
        (scene, "--view", "v0", "--exr", "--spp", "3"),
        given,
    ):
        assert predict(*arguments, "--out", "p.png") == 0
        with Image.open("p.png") as image:
            lit = np.asarray(image.convert("L"))
            assert image.size == (32, 24) or "--compare" in arguments
        assert lit.mean() > 20
    linear = read_frame(tmp_path / "p.exr", verify=False)
    assert linear.rgb.max() > 0 and linear.meta["unit"] == "the scene's"
    assert linear.meta["clipped_share"] == 0
    assert predict(*given[:4], "--out", "p.png") == 2, "without the samples that it takes"
    assert "hybrid" not in load_networks(trained.models).baselines
