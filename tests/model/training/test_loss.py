"""The part-perceptual loss against hand-worked values, and the backbones behind it."""

from pathlib import Path

import numpy as np
import pytest
import torch
from skimage import data, transform
from torch import nn

from pbrnet.model.settings import BackboneParams, LossParams
from pbrnet.model.training.backbone import (
    BALANCE,
    EfficientNetLite0,
    Vgg19,
    calibrate,
    load_backbone,
    make_backbone,
)
from pbrnet.model.training.loss import PerceptualLoss, layer_weights
from pbrnet.scenes.errors import InputError, MachineError


class Multiples(nn.Module):
    """A backbone one can do in one's head: layer l is l + 1 times the image."""

    def __init__(self) -> None:
        super().__init__()
        self.depths: list[int] = []

    def forward(self, display: torch.Tensor, depth: int) -> list[torch.Tensor]:
        self.depths.append(depth)
        return [(layer + 1) * display for layer in range(depth)]


def test_the_part_perceptual_loss_by_hand() -> None:
    # Two pixels, off by 0.1 and 0.3: mean 0.2. Terms: 255 x 0.2 x 1.0,
    # then 0.2 x 1/2.6 x 1.5, 0.2 x 2/4.8 x 1.5, 0.2 x 3/3.7 x 0.5, and no deeper ones.
    truth = torch.full((1, 3, 1, 2), 0.5)
    prediction = truth + torch.tensor([0.1, -0.3])
    loss = PerceptualLoss(Multiples(), LossParams())(prediction, truth)
    by_hand = 51.0 + 0.2 * 1.5 / 2.6 + 0.2 * 2 * 1.5 / 4.8 + 0.2 * 3 * 0.5 / 3.7
    assert loss.item() == pytest.approx(by_hand, rel=1e-6)


@pytest.mark.parametrize(
    ("kind", "weights", "depth"),
    [
        ("part", (1.0, 1.5 / 2.6, 1.5 / 4.8, 0.5 / 3.7, 0, 0), 3),
        ("full", (1.0, 1 / 2.6, 1 / 4.8, 1 / 3.7, 1 / 5.6, 10 / 1.5), 5),
        ("fifth", (0, 0, 0, 0, 0, 10 / 1.5), 5),
        ("l1", (1.0, 0, 0, 0, 0, 0), 0),
    ],
)
def test_each_variant_has_its_weights_and_computes_no_deeper(
    kind: str, weights: tuple[float, ...], depth: int
) -> None:
    params = LossParams(kind=kind)  # type: ignore[arg-type]
    assert layer_weights(params) == pytest.approx(weights)
    backbone = Multiples()
    PerceptualLoss(backbone, params)(torch.zeros(1, 3, 2, 2), torch.ones(1, 3, 2, 2))
    assert backbone.depths == ([depth] * 2 if depth else [])


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["part", "full", "fifth", "l1"])
def test_equal_images_lose_nothing(kind: str, tmp_path: Path) -> None:
    make_backbone(BackboneParams(network="efficientnet_lite0"), tmp_path)
    loss = PerceptualLoss(load_backbone(tmp_path), LossParams(kind=kind))  # type: ignore[arg-type]
    image = torch.rand(1, 3, 32, 40, generator=torch.Generator().manual_seed(0))
    assert loss(image, image.clone()).item() == 0
    assert loss(image, image * 0.9).item() > 0


def test_the_packaged_weights_recognise_a_cat_and_a_cup(tmp_path: Path) -> None:
    """Every layer, stride and padding is right, or ImageNet's classes would not come out."""
    make_backbone(BackboneParams(network="efficientnet_lite0"), tmp_path)
    backbone = load_backbone(tmp_path)
    network = backbone.network
    assert isinstance(network, EfficientNetLite0)
    for photo, corner, names in (
        (data.chelsea(), (0, 75), {281, 282, 285}),  # tabby, tiger cat, Egyptian cat
        (data.coffee(), (0, 100), {967}),  # espresso
    ):
        side = photo.shape[0]
        square = photo[:, corner[1] : corner[1] + side]
        small = transform.resize(square, (224, 224), anti_aliasing=True).astype(np.float32)
        batch = torch.from_numpy(small).permute(2, 0, 1)[None]
        with torch.no_grad():
            logits = network.classify((batch - backbone.mean) / backbone.std)
        assert int(logits.argmax()) in names


def test_the_stem_without_stride_contains_the_stem(tmp_path: Path) -> None:
    network = EfficientNetLite0().eval()
    image = torch.rand(1, 3, 33, 33, generator=torch.Generator().manual_seed(0))
    captured: list[torch.Tensor] = []
    network._blocks[0].register_forward_pre_hook(lambda _, given: captured.append(given[0]))
    with torch.no_grad():
        full = network(image, 2)[0]
    assert torch.allclose(full[..., ::2, ::2], captured[0], atol=1e-6)


def test_scaled_layers_change_in_chen_and_koltuns_balance(tmp_path: Path) -> None:
    card = make_backbone(BackboneParams(network="efficientnet_lite0"), tmp_path)
    backbone = load_backbone(tmp_path)
    gains = calibrate(backbone, (0.0,) * 3, (1.0,) * 3)  # the scaled backbone normalises by itself
    assert gains == pytest.approx(BALANCE, rel=1e-3)
    assert card.network == "efficientnet_lite0" and len(card.sha256) == 64


def test_making_the_backbone_twice_gives_the_same_bytes(tmp_path: Path) -> None:
    for name in ("a", "b"):
        make_backbone(BackboneParams(network="efficientnet_lite0"), tmp_path / name)
    for file in ("backbone.safetensors", "backbone.json"):
        assert (tmp_path / "a" / file).read_bytes() == (tmp_path / "b" / file).read_bytes()


def test_the_backbone_is_frozen_and_stays_in_evaluation_mode(tmp_path: Path) -> None:
    make_backbone(BackboneParams(network="efficientnet_lite0"), tmp_path)
    backbone = load_backbone(tmp_path).train()
    assert not any(module.training for module in backbone.modules())
    assert not any(value.requires_grad for value in backbone.parameters())


@pytest.fixture()
def vgg_file(tmp_path: Path) -> Path:
    """A file as torchvision ships it, with a classifier too; random weights."""
    torch.manual_seed(0)
    state = dict(Vgg19().state_dict())
    state["classifier.0.weight"] = torch.zeros(2, 2)
    path = tmp_path / "vgg.pth"
    torch.save(state, path)
    return path


@pytest.mark.slow
def test_vgg19_is_read_from_a_named_file(vgg_file: Path, tmp_path: Path) -> None:
    card = make_backbone(BackboneParams(weights=str(vgg_file)), tmp_path / "models")
    assert card.network == "vgg19" and card.source == "file vgg.pth"
    backbone = load_backbone(tmp_path / "models")
    with torch.no_grad():
        maps = backbone(torch.rand(1, 3, 32, 32), 3)
    assert [tuple(m.shape[1:]) for m in maps] == [(64, 32, 32), (128, 16, 16), (256, 8, 8)]


@pytest.mark.check
def test_vgg19_is_found_in_torchs_cache(
    vgg_file: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    cache = tmp_path / "home" / "hub" / "checkpoints"
    cache.mkdir(parents=True)
    vgg_file.rename(cache / "vgg19-dcbb9e9d.pth")
    monkeypatch.setenv("TORCH_HOME", str(tmp_path / "home"))
    assert make_backbone(BackboneParams(), tmp_path / "models").network == "vgg19"


def test_auto_without_vgg_takes_the_packaged_network(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("TORCH_HOME", str(tmp_path / "empty"))
    assert make_backbone(BackboneParams(), tmp_path).network == "efficientnet_lite0"
    with pytest.raises(MachineError, match=r"backbone\.weights"):
        make_backbone(BackboneParams(network="vgg19"), tmp_path)


@pytest.mark.parametrize("content", [b"", b"not weights", None])
def test_weights_that_do_not_fit_are_refused(tmp_path: Path, content: bytes | None) -> None:
    path = tmp_path / "vgg.pth"
    if content is None:
        torch.save({"features.0.weight": torch.zeros(1)}, path)
    else:
        path.write_bytes(content)
    with pytest.raises(InputError, match="not the weights of Vgg19"):
        make_backbone(BackboneParams(weights=str(path)), tmp_path / "models")
    assert not (tmp_path / "models" / "backbone.safetensors").exists()


def test_a_pickle_that_would_run_code_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "vgg.pth"
    torch.save({"features.0.weight": Path("/")}, path)  # any class but a tensor needs unpickling
    with pytest.raises(InputError, match="not the weights of Vgg19"):
        make_backbone(BackboneParams(weights=str(path)), tmp_path / "models")


def test_missing_and_damaged_backbones(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="pbrnet backbone"):
        load_backbone(tmp_path)
    make_backbone(BackboneParams(network="efficientnet_lite0"), tmp_path)
    weights = tmp_path / "backbone.safetensors"
    weights.write_bytes(weights.read_bytes()[:1000])
    with pytest.raises(InputError, match="not the weights of efficientnet_lite0"):
        load_backbone(tmp_path)
