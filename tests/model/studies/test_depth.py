"""`pbrnet depth`: cameras of photographs, files that agree, packing and export."""

import json
import math
from pathlib import Path

import numpy as np
import OpenEXR
import pytest
import torch
from PIL import Image
from safetensors.torch import save_file

from pbrnet.model.commands.depth import read_photo
from pbrnet.model.release import pretrained
from pbrnet.model.studies.photographs import release as depth
from pbrnet.model.studies.photographs.network import new_network
from pbrnet.model.studies.photographs.release import export_depth, load_depth, pack_depth
from pbrnet.model.studies.photographs.rows import parse_row
from pbrnet.scenes.errors import InputError
from tests.fixtures.command import exit_code, printed, refused
from tests.model.release.conftest import run_example


def picture(path: Path, width: int = 160, height: int = 120, focal: int = 0, turn: int = 1) -> Path:
    """A photograph of bands, with EXIF's focal length and orientation where they are given."""
    exif = Image.Exif()
    exif[0x0112] = turn
    if focal:
        exif.get_ifd(0x8769)[0xA405] = focal
    y, x = np.mgrid[:height, :width]
    image = np.stack([255 * x / width, 255 * y / height, 128 + 0 * x], -1).astype(np.uint8)
    Image.fromarray(image).save(path, exif=exif, quality=95)
    return path


@pytest.fixture(scope="module")
def weights(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Weights of a network that was not trained."""
    torch.set_num_threads(1)
    path = tmp_path_factory.mktemp("weights") / "depth.safetensors"
    state = new_network(5).state_dict()
    save_file({name: value.contiguous() for name, value in state.items()}, path)
    return path


def test_camera_comes_from_the_option_then_from_exif_then_from_an_assumption(tmp_path):
    file = picture(tmp_path / "a.jpg", focal=24)
    assert read_photo(file, 90.0).focal == pytest.approx(80)  # half of 160 pixels at 45 degrees
    found = read_photo(file, None)
    assert found.focal == pytest.approx(24 / math.hypot(36, 24) * 200) and "EXIF" in found.stated
    guessed = read_photo(picture(tmp_path / "b.jpg"), None)
    assert guessed.focal == pytest.approx(28 / math.hypot(36, 24) * 200)
    assert "--fov" in guessed.stated
    large = read_photo(picture(tmp_path / "large.jpg", 3200, 2400), 90.0)
    assert large.image.shape == (768, 1024, 3) and large.focal == pytest.approx(512)
    turned = read_photo(picture(tmp_path / "c.jpg", focal=24, turn=6), None)
    assert turned.image.shape == (160, 120, 3) and turned.focal == pytest.approx(found.focal)


def test_files_of_a_photograph_agree(tmp_path, weights):
    file, out = picture(tmp_path / "room.jpg", 320, 200), tmp_path / "out"
    said = printed("depth", file, "--fov", 60, "--out", out, "--weights", weights)
    assert "320x200" in said and "60 degrees" in said
    with OpenEXR.File(str(out / "room.exr"), separate_channels=True) as exr:
        planes = {name: channel.pixels for name, channel in exr.channels().items()}
    assert planes["Z"].shape == (200, 320) and planes["Z"].min() > 0
    normal = np.stack([planes[f"N.{axis}"] for axis in "XYZ"], -1)
    assert np.linalg.norm(normal, axis=-1) == pytest.approx(1, abs=1e-3)
    assert planes["class"].min() >= 1 and planes["class"].max() <= 40
    stored = np.asarray(Image.open(out / "room-depth.png"))
    assert stored == pytest.approx(1000 * planes["Z"], abs=0.51)
    camera = json.loads((out / "room.json").read_text())
    assert camera["fx"] == pytest.approx(160 / math.tan(math.radians(30))) and camera["cx"] == 160
    assert Image.open(out / "room.png").width > 640


def test_twice_the_pixels_are_the_same_room(tmp_path, weights):
    for name, factor in {"small": 1, "large": 2}.items():
        picture(tmp_path / f"{name}.png", 160 * factor, 120 * factor)
    words = ("--fov", 60, "--out", tmp_path / "out", "--weights", weights)
    printed("depth", tmp_path / "small.png", tmp_path / "large.png", *words)
    small, large = (
        np.asarray(Image.open(tmp_path / "out" / f"{name}-depth.png"), np.float64)
        for name in ("small", "large")
    )
    ratio = large[::2, ::2] / small
    assert np.mean(ratio) == pytest.approx(1, abs=0.01) and np.median(abs(ratio - 1)) < 0.03


def test_damaged_photographs_are_named_and_the_others_kept(tmp_path, weights, capsys):
    photos = tmp_path / "photos"
    photos.mkdir()
    picture(photos / "a.jpg")
    (photos / "b.jpg").write_bytes(b"%!PS-Adobe")
    (photos / "notes.txt").write_text("not a photograph")
    out = tmp_path / "out"
    assert exit_code("depth", photos, "--out", out, "--weights", weights) == 1
    errors = capsys.readouterr().err
    assert "b.jpg" in errors and "1 of 2 photographs failed" in errors
    assert sorted(file.name for file in out.iterdir()) == [
        "a-depth.png", "a.exr", "a.json", "a.png",
    ]  # fmt: skip


def test_wrong_use_is_one_line(tmp_path, weights):
    (tmp_path / "empty").mkdir()
    assert "no photographs" in refused("depth", tmp_path / "empty", "--weights", weights)
    weighted = ("--weights", weights)
    one = picture(tmp_path / "a.jpg")
    again = picture(tmp_path / "a.png")
    assert "two photographs are named a" in refused("depth", one, again, "--weights", weights)
    before = again.read_bytes()
    assert "would be replaced" in refused("depth", again, "--out", tmp_path, "--weights", weights)
    assert again.read_bytes() == before
    taken = picture(tmp_path / "a-depth.png")
    assert "would be replaced" in refused("depth", one, taken, "--out", tmp_path, *weighted)
    assert "one file for both" in refused("depth", one, taken, *weighted)
    missing = tmp_path / "none.safetensors"
    assert "no such file" in refused("depth", one, "--weights", missing)
    missing.write_bytes(b"\xff" * 64)
    assert "not weights" in refused("depth", one, "--weights", missing)
    save_file({"head.bias": torch.zeros(44)}, missing)
    assert "not weights" in refused("depth", one, "--weights", missing)
    narrow = ("depth", one, "--fov", 5, "--weights", weights, "--out", tmp_path / "out")
    assert exit_code(*narrow) == 1


def test_packed_network_predicts_the_same_and_has_a_card(tmp_path, weights, monkeypatch):
    row = parse_row("homes=data")
    folder = tmp_path / "work" / row.folder / "0"
    folder.mkdir(parents=True)
    (folder / "weights.safetensors").write_bytes(weights.read_bytes())
    figure = {"mean": 0.25}
    result = {
        "test": "photos", "pictures": 3, "runs": 2, "normal_coverage": 0.2, "steps": 7, "batch": 8,
        "focal": 129.3, "seed": 0, "reference": "homes", "order": ["homes"],
        "rows": {"homes": {
            "stages": [["data"]], "views": 5, "seeds": 1, "varied": True, "seconds_per_step": 0.1,
            "absrel": figure,
        }},
    }  # fmt: skip
    (tmp_path / "photographs.json").write_text(json.dumps(result))
    out = tmp_path / "packed"
    out.mkdir()
    printed("pretrained", "--depth", folder, "--metrics", tmp_path, "--out", out)
    card = json.loads((out / "depth.json").read_text())
    assert (card["row"], card["pictures"], card["results"]) == ("homes", 5, {"absrel": 0.25})
    size = (out / "depth.safetensors").stat().st_size
    assert size < 8e6 < weights.stat().st_size
    image, rays = torch.rand(1, 3, 96, 128), torch.rand(1, 2, 96, 128) - 0.5
    with torch.no_grad():
        whole, half = (
            load_depth(path)(image, rays) for path in (weights, out / depth.DEPTH_FILES[0])
        )
    assert torch.allclose(whole.log_depth, half.log_depth, atol=0.01)
    monkeypatch.setattr(depth, "PACKED", out)
    assert load_depth(None) is not None
    with pytest.raises(InputError, match="not a training"):
        pack_depth(folder.parent, tmp_path, out)
    pretrained._check_target(tmp_path, out)  # packing other networks there is allowed


def test_exported_network_predicts_the_same(tmp_path, weights):
    runtime = pytest.importorskip("onnxruntime", reason="the extra pbrnet[onnx] is not installed")
    pytest.importorskip("onnxscript", reason="the extra pbrnet[onnx] is not installed")
    network, path = load_depth(weights), tmp_path / "depth.onnx"
    export_depth(network, path)
    session = runtime.InferenceSession(str(path), providers=["CPUExecutionProvider"])
    image, rays = torch.rand(1, 3, *depth.SIDES), torch.rand(1, 2, *depth.SIDES) - 0.5
    found = session.run(None, {"image": image.numpy(), "rays": rays.numpy()})
    with torch.no_grad():
        output = network(image, rays)
    assert found[0] == pytest.approx(output.log_depth[0].exp().numpy(), rel=1e-3)
    assert found[1] == pytest.approx(output.normal[0].permute(1, 2, 0).numpy(), abs=1e-3)
    assert found[2] == pytest.approx(output.classes[0].numpy(), abs=1e-3)
    photo = picture(tmp_path / "room.png")
    run_example("depth_onnx.py", tmp_path, path, photo, "70", "example.png")
    printed("depth", photo, "--fov", 70, "--out", tmp_path / "out", "--weights", weights)
    own, command = (
        np.asarray(Image.open(tmp_path / name).resize((40, 30)), np.float64)
        for name in ("example.png", "out/room-depth.png")
    )
    assert np.mean(own / command) == pytest.approx(1, abs=0.05)
