"""Prediction for people: methods, many views, a camera of one's own, HDR, pretrained networks."""

import json
import re
import shutil
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import OpenEXR
import pytest
import torch
from click.testing import CliRunner, Result
from safetensors import SafetensorError
from safetensors.torch import load_file

from pbrnet.model.commands import predict as predict_command
from pbrnet.model.evaluation import predict as prediction
from pbrnet.model.evaluation.budget import Choice, Effort
from pbrnet.model.evaluation.inference import Prediction, load_networks
from pbrnet.model.evaluation.predict import from_frames
from pbrnet.model.release import pretrained
from pbrnet.model.training import weights as weights_module
from pbrnet.model.training.weights import write_weights
from pbrnet.pipeline.channels import TRANSPORT_DIRECT, TRANSPORT_INDIRECT
from pbrnet.pipeline.cli import cli
from pbrnet.pipeline.frames import pixels_digest, read_frame, read_meta
from pbrnet.pipeline.images import png_facts, read_picture
from pbrnet.pipeline.passes.registry import Trace
from pbrnet.pipeline.photograph import photograph
from pbrnet.pipeline.tonemap import Exposure, tonemap
from pbrnet.scenes.errors import InputError, MachineError, ParameterError
from pbrnet.scenes.files import digest_file
from tests.fixtures import command
from tests.fixtures.paths import ROOT
from tests.fixtures.predict import box_camera, box_frames, box_room
from tests.fixtures.predictor import untrained_models

FRAMES = ("--inputs", "data/inputs/box/v0.exr", "--illumination", "data/illumination/box/v0.exr")
FOLDERS = ("--inputs", "data/inputs", "--illumination", "data/illumination")
SIZE = {"width": 40, "height": 30, "panorama": 16}


@pytest.fixture(autouse=True)
def project(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Untrained networks and two views' frames in the working folder."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(pretrained, "PACKED", tmp_path / "weights")
    torch.set_num_threads(1)
    Path("params.yaml").write_text("illumination: {width: 32}\n")
    untrained_models(Path("models"), ("shading", "composition", "unet", "plus", "can"), levels=3)
    for name in ("v0", "v1"):
        box_frames(Path("data"), name, **SIZE)
    return tmp_path


@pytest.fixture()
def room() -> Path:
    """A scene folder with a camera file of two views."""
    views = {"east": (1, 0.2, -0.2), "north": (0.2, 1, -0.2)}
    cameras = [box_camera(name, (24, 18), (0.5, 0.5, 1.5), to) for name, to in views.items()]
    return box_room(Path("data"), *cameras)


def predict(*words: object) -> Result:
    return CliRunner().invoke(cli, ["predict", *map(str, words)])


predicted = partial(command.printed, "predict")
refused = partial(command.refused, "predict")


@pytest.mark.parametrize("method", ["pbrnet", "product", "product_linear", "plus", "unet", "can"])
def test_every_method_that_is_trained_draws(method: str) -> None:
    output = predicted(*FRAMES, "--method", method, "--compare", "--out", "p.png")
    assert f"{method}, networks from models" in output and "SSIM" in output
    facts = png_facts(Path("p.png").read_bytes())
    assert facts and facts["models"] == f"{method} of models"


def test_a_method_without_networks_says_which_there_are() -> None:
    error = refused(*FRAMES, "--method", "pix2pix")
    assert "pix2pix.safetensors: no such model" in error
    assert "--method can, pbrnet, plus, product" in error


def test_all_views_of_a_folder(project: Path) -> None:
    predicted(*FOLDERS, "--out", "pictures")
    assert sorted(path.name for path in Path("pictures").iterdir()) == [
        "box--v0.png", "box--v1.png",
    ]  # fmt: skip
    assert predict(*FRAMES, "--out", "single.png").exit_code == 0
    one, of_many = (Path(name).read_bytes() for name in ("single.png", "pictures/box--v0.png"))
    assert np.array_equal(read_picture(one), read_picture(of_many))
    done = predict(*FOLDERS, "--out", "one.png")
    assert done.exit_code == 2 and "2 views need a folder" in done.output


def test_a_view_that_fails_is_named_and_the_others_are_made() -> None:
    path = Path("data/illumination/box/v1.exr")
    content = bytearray(path.read_bytes())
    content[-200:] = bytes(200)
    path.write_bytes(content)
    done = CliRunner().invoke(cli, ["predict", *FOLDERS], standalone_mode=False)
    assert done.return_value == 1
    assert "Error: box/v1" in done.output and Path("predictions/box--v0.png").is_file()
    path.unlink()
    error = refused(*FOLDERS)
    assert "data/illumination/box/v1.exr: missing, but" in error


def test_all_views_of_a_scene_and_a_camera_of_ones_own(room: Path) -> None:
    predicted(room, "--all-views", "--size", "36x20", "--method", "pbrnet", "--out", "out")
    shapes = {path.name: read_picture(path.read_bytes()).shape for path in Path("out").iterdir()}
    assert shapes == {"box--east.png": (20, 36, 3), "box--north.png": (20, 36, 3)}
    words = ("--eye", "0.5,0.5,1.5", "--towards", "1,0.2,-0.2", "--size", "36x20")
    assert predict(room, *words, "--method", "pbrnet", "--out", "own.png").exit_code == 0
    same = [read_picture(Path(name).read_bytes()) for name in ("own.png", "out/box--east.png")]
    assert np.abs(same[0].astype(int) - same[1]).max() <= 1  # the very same camera


@pytest.mark.parametrize(
    ("networks", "words", "chosen"),
    [
        (("plus", "hybrid"), (), "hybrid"),
        (("plus", "hybrid"), ("--tile", "32"), "plus"),
        (("plus", "hybrid"), ("--denoiser", "fast"), "radiosity"),
        (("plus", "hybrid"), ("--models", "models"), "pbrnet"),  # all that this folder has
        (("plus",), (), "plus"),
        (("plus",), ("--spp", "4"), "radiosity"),
        ((), (), "radiosity"),
    ],
)
def test_without_a_method_the_best_one_there_is_draws(
    networks: tuple[str, ...], words: tuple[str, ...], chosen: str, room: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:  # fmt: skip
    shutil.rmtree("models")
    untrained_models(Path("models"), ("shading", "composition"), levels=2)
    untrained_models(pretrained.PACKED, networks, levels=2)
    drawn: list[str | None] = []

    def draws(*given: object) -> list[object]:
        drawn.extend(one.method for one in given if isinstance(one, predict_command.Way))
        return []

    monkeypatch.setattr(predict_command, "_previews", draws)
    monkeypatch.setattr(predict_command, "_predictions", draws)
    output = predicted(room, "--all-views", *words)
    told = f"method: {chosen}, " in output
    assert (drawn, told) == (([chosen], True) if chosen != "pbrnet" else ([None], False))
    predicted(room, "--all-views", "--method", "unet")
    assert drawn[1:] == ["unet"]  # one that is asked for is taken


@pytest.fixture()
def rooms(room: Path) -> Path:
    """A folder of scenes: `box` and `den` with two views each, `bare` without cameras."""
    for name in ("den", "bare"):
        shutil.copytree(room, room.with_name(name))
        for path in (room.with_name(name) / "scene.json", Path("data/cameras/box.json")):
            content = path.read_text().replace('"scene_id": "box"', f'"scene_id": "{name}"')
            written = path if path.name == "scene.json" else path.with_name("den.json")
            if name == "den" or written == path:
                written.write_text(content)
    return room.parent


def names_in(folder: str) -> list[str]:
    return sorted(path.stem for path in Path(folder).iterdir())


def test_scenes_are_opened_once_each_and_one_that_fails_is_named(
    rooms: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    opened, open_scene = [], prediction.open_scene
    monkeypatch.setattr(
        prediction,
        "open_scene",
        lambda scene: (opened.append(scene.scene_id), open_scene(scene))[1],
    )
    words = ["predict", str(rooms), "--all-views", "--method", "unet", "--out", "out"]
    done = CliRunner().invoke(cli, words, standalone_mode=False)
    assert done.return_value == 1
    assert names_in("out") == ["box--east", "box--north", "den--east", "den--north"]
    assert opened == ["box", "den"]
    assert "Error: bare: data/cameras/bare.json" in done.output
    assert done.output.splitlines()[-1] == "Error: 1 of 5 failed: bare"
    single = ("--view", "north", "--method", "unet", "--out", "one.png")
    predicted(rooms / "den", *single)
    assert Path("one.png").read_bytes() == Path("out/den--north.png").read_bytes()


def test_views_of_one_scene_and_of_every_scene(rooms: Path) -> None:
    both, other = (rooms / "box", rooms / "den"), ("--cameras", "data/cameras", "--method", "unet")
    predicted(*both, "--view", "north", "--view", "den/east", *other, "--out", "out")
    assert names_in("out") == ["box--north", "den--east", "den--north"]
    predicted(*both, "--view", "box/east", *other, "--out", "single")
    assert names_in("single") == ["box--east"]
    for words, said in (
        (("--eye", "1,1,1", "--towards", "1,0,0"), "single SCENE"),
        (("--all-views", "--cameras", "data/cameras/box.json"), "a folder of files SCENE.json"),
        (("--view", "hall/east"), "no SCENE of this name"),
    ):
        done = predict(*both, *words)
        assert done.exit_code == 2 and said in done.output
    shutil.copytree(rooms / "box", "other/box")
    assert "the same scene id" in refused(*both, "other/box", "--all-views", *other)


@pytest.mark.usefixtures("wavefront")
def test_radiosity_needs_no_network(room: Path) -> None:
    words = ("--view", "east", "--size", "36x20", "--method", "radiosity", "--exr")
    predicted(room, *words, "--out", "out.png")
    assert read_picture(Path("out.png").read_bytes()).shape == (20, 36, 3)
    frame = read_frame(Path("out.exr"))
    light = [frame.stack(*bands) for bands in (TRANSPORT_DIRECT, TRANSPORT_INDIRECT)]
    assert min(image.max() for image in light) > 0
    assert frame.rgb.shape == (20, 36, 3)
    done = predict("--method", "radiosity", *FRAMES)
    assert done.exit_code == 2 and "requires a SCENE" in done.output


@pytest.mark.usefixtures("wavefront")
def test_pictures_without_a_network_take_any_number_of_samples(room: Path) -> None:
    view = (room, "--view", "east", "--size", "36x20", "--exr")
    errors = {}
    for method, few, many in (("radiosity", 1, 16), ("denoised", 2, 64)):
        for spp in (few, many):
            asked = (*view, "--method", method, "--spp", spp, "--out", f"{method}-{spp}.png")
            predicted(*asked)
    best = read_frame(Path("denoised-64.exr")).rgb
    for method, few, many in (("radiosity", 1, 16), ("denoised", 2, 64)):
        pictures = [read_frame(Path(f"{method}-{spp}.exr")).rgb for spp in (few, many)]
        errors[method] = [
            float(np.abs(picture - best).mean() / best.mean()) for picture in pictures
        ]
    assert errors["radiosity"][1] < errors["radiosity"][0] < 0.5
    assert 0 < errors["denoised"][0] < 0.5
    done = predict(*view, "--method", "radiosity", "--spp", "3")
    assert done.exit_code != 0 and "takes 1, 2, 4, 8, 16, 64" in str(done.exception)
    assert predict(*view, "--method", "hybrid", "--spp", "9").exit_code == 2
    for method in ("radiosity", "denoised"):
        made = []
        for quality in ("high", "fast"):
            asked = ("--method", method, "--spp", "1", "--denoiser", quality)
            assert predict(*view, *asked, "--out", f"{quality}.png").exit_code == 0
            made.append(read_picture(Path(f"{quality}.png").read_bytes()).astype(float))
        assert 0 < np.abs(made[0] - made[1]).mean() < 40, "the same picture, otherwise denoised"
    done = predict(*view, "--method", "plus", "--denoiser", "fast")
    assert done.exit_code == 2 and "only to --method radiosity and denoised" in done.output


@pytest.mark.usefixtures("wavefront")
def test_a_time_budget_chooses_method_and_samples(
    room: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    view = (room, "--view", "east", "--size", "36x20")
    output = predicted(*view, "--seconds", "0.2", "--out", "out.png")
    said = re.search(r"(--method \w+ --spp \d+.*): (\d+\.\d+) s per view", output)
    assert said and (float(said[2]) <= 0.2 or "this is the fastest" in output)
    predicted(*view, *said[1].split(), "--out", "again.png")
    same = [read_picture(Path(name).read_bytes()) for name in ("out.png", "again.png")]
    assert np.array_equal(*same), "the words printed give the same picture"
    done = predict(*view, "--seconds", "1e-6", "--out", "out.png")
    assert done.exit_code == 0 and "this is the fastest" in done.output
    assert re.search(r"--method \w+ --spp \d+.*: ", done.output)  # which one is a matter of load
    for wrong, words in ((("--method", "plus"), "do not combine"), ((), "requires a SCENE")):
        asked = (*view, *wrong) if wrong else FRAMES
        done = predict(*asked, "--seconds", "1")
        assert done.exit_code == 2 and words in done.output


@pytest.mark.usefixtures("wavefront")
@pytest.mark.parametrize("method", ["hybrid", "radiosity", "denoised"])
def test_every_method_that_a_time_budget_may_choose_is_predicted(
    room: Path, monkeypatch: pytest.MonkeyPatch, method: str
) -> None:
    shutil.copytree(ROOT / "weights", "weights")
    monkeypatch.setattr(
        "pbrnet.model.evaluation.budget.choose", lambda *_: Choice(Effort(method, 1), 0.1, True, {})
    )
    view = (room, "--view", "east", "--size", "36x20")
    output = predicted(*view, "--seconds", "2", "--out", "chosen.png")
    assert f"--method {method} --spp 1: 0.10 s" in output
    predicted(*view, "--method", method, "--spp", "1", "--out", "asked.png")
    same = [read_picture(Path(name).read_bytes()) for name in ("chosen.png", "asked.png")]
    assert np.array_equal(*same)


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("--eye", "1,2,3"), "--eye and --towards"),
        (("--all-views", "--view", "east"), "or --all-views"),
        (("--eye", "1,2", "--towards", "1,0,0"), "write it like 1,2,1.6"),
        (("--view", "east", "--tile", "3"), "--tile"),
        (("--view", "east", "--method", "radiosity", "--tile", "64"), "--tile applies to networks"),
        (("--view", "east", "--seconds", "1", "--tile", "64"), "or --tile"),
        (("--view", "east", "--method", "unet", "--spp", "2"), "unet takes no samples"),
        (("--view", "east", "--method", "pbrnet", "--spp", "2"), "pbrnet takes no samples"),
        (("--view", "east", "--out", "picture.jpg"), "end in .png"),
        (("--view", "east", *FRAMES), "not both"),
    ],
)
def test_what_does_not_fit_together_is_said(room: Path, words: tuple[str, ...], said: str) -> None:
    done = predict(room, *words)
    assert done.exit_code == 2 and said in done.output


def test_weights_and_frames_of_nan_end_a_prediction(project: Path) -> None:
    pixels = dict(read_frame(Path(FRAMES[1])).channels)
    pixels["Z"][0, 0] = np.nan
    meta = json.dumps({**read_meta(Path(FRAMES[1])), "digest": pixels_digest(pixels)})
    with OpenEXR.File({"pbrnet": meta}, pixels) as file:
        file.write("nan.exr")
    error = refused("--inputs", "nan.exr", *FRAMES[2:])
    assert "NaN" in error
    weights = Path("models/unet.safetensors")
    write_weights(weights, {name: value * np.nan for name, value in load_file(weights).items()})
    card = weights.with_suffix(".json")
    content = json.loads(card.read_text())
    card.write_text(json.dumps({**content, "sha256": digest_file(weights)}))
    error = refused(*FRAMES, "--method", "unet")
    assert "NaN or infinity" in error


@pytest.mark.parametrize("value", [0, 10**9, 64, "8"])
def test_an_absurd_card_is_refused_before_memory_is_taken(project: Path, value: object) -> None:
    card = Path("models/unet.json")
    content = json.loads(card.read_text())
    content["architecture"]["width"] = value
    card.write_text(json.dumps(content))
    error = refused(*FRAMES, "--method", "unet")
    assert "unet" in error


def test_a_full_disk_ends_the_writing_of_weights(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(state: object, path: Path) -> None:
        raise SafetensorError("I/O error: No space left on device (os error 28)")

    monkeypatch.setattr(weights_module, "save_file", full)
    with pytest.raises(MachineError, match="disk is full"):
        write_weights(tmp_path / "a.safetensors", {})
    assert not list(tmp_path.glob("*a.safetensors"))


def test_a_camera_that_looks_straight_down_is_refused(room: Path) -> None:
    error = refused(room, "--eye", "1,1,1", "--towards", "0,0,-1")
    assert "no up vector" in error


@pytest.mark.parametrize("method", ["pbrnet", "unet", "product"])
def test_linear_radiance_shows_as_the_prediction(method: str) -> None:
    """The EXR, photographed, is the picture, and tone-mapped what the network predicted."""
    output = predicted(*FRAMES, "--method", method, "--exr", "--out", "p.png")
    frame = read_frame(Path("p.exr"))
    assert frame.meta["unit"] == "shading's log-average luminance is 0.8"
    assert "are white: their values are lower bounds" in output
    exposure = Exposure(**frame.meta["exposure"])
    assert (exposure.scale, exposure.white) == (1.0, 4.0)
    assert np.array_equal(read_picture(Path("p.png").read_bytes()), photograph(frame.rgb))
    inside = frame.channels["clipped"] == 0
    assert inside.mean() > 0.02
    assert (tonemap(frame.rgb, exposure)[inside].max(axis=-1) < 1).all()
    assert ("shading.R" in frame.channels) == (method != "unet")


def test_light_transport_is_found_beside_the_panorama_or_named() -> None:
    untrained_models(Path("models"), ("plus",), levels=3, materials=True)
    shutil.copy(FRAMES[3], "panorama.exr")
    elsewhere = (*FRAMES[:3], "panorama.exr")
    named = [FRAMES[3].replace("illumination", kind) for kind in ("transport", "materials")]
    options = ("--transport", named[0], "--materials", named[1])
    for name, given in (("beside.png", FRAMES), ("named.png", (*elsewhere, *options))):
        output = predicted(*given, "--method", "plus", "--exr", "--out", name)
        assert "unit: the scene's; 0.00% of the pixels are white" in output
    assert Path("beside.png").read_bytes() == Path("named.png").read_bytes()
    for given, words in (
        (elsewhere, "plus also takes frames of materials and transport: give their"),
        ((*elsewhere, *options[:2]), "plus also takes frames of materials: give their"),
        ((*elsewhere, "--transport", FRAMES[1], *options[2:]), "without the channel 'direct.R'"),
    ):
        wrong = predict(*given, "--method", "plus", "--out", "wrong.png")
        assert isinstance(wrong.exception, InputError | ParameterError)
        assert re.search(words, str(wrong.exception))


def test_shadows_are_found_beside_the_panorama_or_asked_for() -> None:
    untrained_models(Path("models"), levels=3, panorama="shadows")
    predicted(*FRAMES, "--method", "pbrnet", "--out", "shadows.png")
    shutil.copy(FRAMES[3], "panorama.exr")
    wrong = predict(*FRAMES[:3], "panorama.exr", "--method", "pbrnet", "--out", "wrong.png")
    assert isinstance(wrong.exception, ParameterError)
    assert "shadow_rays above 0, renders visibility beside it" in str(wrong.exception)


def test_from_a_scene_only_what_the_network_takes_is_rendered(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    made: list[str] = []

    def counted(trace: Trace[Any]) -> Trace[Any]:
        return replace(trace, render=lambda *of: made.extend(of[2]) or trace.render(*of))

    monkeypatch.setattr(prediction, "QUICK", [counted(trace) for trace in prediction.QUICK])
    view = box_camera("v", (40, 30), (1.0, 1.0, 1.4), (1, 1, -0.2))
    box_room(Path("data"), view)
    for materials in (False, True):
        untrained_models(Path("models"), ("plus",), levels=3, materials=materials)
        predicted("data/scenes/box", "--view", "v", "--method", "plus", "--out", "s.png")
    assert made == ["inputs", "transport", "inputs", "materials", "transport"], "no panorama"
    made.clear()
    untrained_models(Path("models"), levels=3, panorama="shadows")
    predicted("data/scenes/box", "--view", "v", "--method", "pbrnet", "--out", "s.png")
    assert made == ["inputs", "illumination", "visibility"]


def test_with_the_truth_the_unit_is_the_scenes() -> None:
    networks = load_networks(Path("models"))
    wanted = from_frames({"inputs": Path(FRAMES[1]), "illumination": Path(FRAMES[3])}, Path("data"))
    example = wanted.load(networks.card)
    perfect = Prediction(
        "pbrnet",
        tonemap(example["shading"], example.exposure_shading),
        tonemap(example["color"], example.exposure_shading),
    )
    linear = networks.radiance(example, perfect)
    inside = ~linear.clipped
    assert linear.known
    assert linear.color[inside] == pytest.approx(example["color"][inside], rel=2e-2, abs=1e-4)
    # What is at white is less than the truth, or equal: a lower bound in that band.
    bright = replace(example, exposure_shading=Exposure(example.exposure_shading.scale, 0.9))
    display = tonemap(example["color"], bright.exposure_shading)
    bound = networks.radiance(bright, Prediction("pbrnet", None, display))
    at_white = display >= 1 - 1e-6
    assert at_white.any() and (bound.clipped == at_white.any(axis=-1)).all()


def test_tiles_draw_the_same_picture_from_the_command() -> None:
    box_frames(Path("data"), "large", width=150, height=110, panorama=16)
    words = [word.replace("v0", "large") for word in FRAMES]
    for name, more in (("whole.png", ()), ("cut.png", ("--tile", "32"))):
        predicted(*words, *more, "--out", name)
    whole, cut = (read_picture(Path(name).read_bytes()) for name in ("whole.png", "cut.png"))
    assert np.abs(whole.astype(int) - cut).max() <= 1
    error = refused(*words, "--method", "can", "--tile", "32")
    assert "leave out --tile" in error


def test_pretrained_networks_serve_where_none_are_trained(project: Path) -> None:
    Path("models").rename("weights")
    output = predicted(*FRAMES)
    assert "pbrnet, networks from" in output and "weights (pretrained" in output
    card = json.loads(Path("weights/shading.json").read_text())
    assert card["precision"] == "float32" and card["packed_from"] == ""
