"""Parameters are refused with key, value and what is allowed, before any work starts."""

import re
from pathlib import Path

import pytest
import yaml

from pbrnet.pipeline.params import Params, build_params, load_params
from pbrnet.pipeline.release.presets import find_preset, parameters
from pbrnet.scenes.checked import build, plain
from pbrnet.scenes.errors import ParameterError
from tests.fixtures.paths import ROOT

NO_VALUES = ("!!int ''", "!!timestamp x", "!!int '+'", "!!float ''", "!!bool x", "9999-99-99")


def doubling(inside: str) -> str:
    """Lines of YAML that hold the one before twice."""
    lines = [f"k{n}: &k{n} {{{inside.format(f'k{n - 1}' if n else 'a')}}}\n" for n in range(28)]
    return "".join(lines)


PRESETS = sorted((ROOT / "params").glob("*.yaml"))


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("sed: 1", ["sed", "unknown key", "'seed'"]),
        ("seed: -1", ["seed", "-1", "from 0 to"]),
        ("seed: true", ["seed", "True", "whole number"]),
        ("seed: 1.5", ["seed", "1.5"]),
        ("channels: [depths]", ["channels[0]", "'depths'", "'materials'"]),
        ("channels: []", ["channels", "one or more"]),
        ("channels: [paper, paper]", ["channels", "each once"]),
        ("channels: paper", ["channels", "'paper'", "list"]),
        ("cameras: {walks: 1, walk_frames: 1}", ["cameras.walk_frames", "1", "2 to 240"]),
        ("cameras: {trajectories: [{file: a.json}]}", ["cameras.trajectories[0].scene", "missing"]),
        ("image: 3", ["image", "3", "mapping"]),
        ("image: {width: 1}", ["image.width", "1", "16"]),
        ("image: {width: wide}", ["image.width", "'wide'", "whole number"]),
        ("scenes: {lighting: [noon]}", ["scenes.lighting[0]", "'noon'", "'night'"]),
        ("scenes: {lighting: []}", ["scenes.lighting", "mixed, pbrs"]),
        ("scenes: {outdoors: nothing}", ["scenes.outdoors", "'nothing'", "'none'"]),
        ("scenes: {variants: 2, vary: [outdoors], outdoors: none}", ["furniture, light"]),
        (
            "scenes: {variants: 2, vary: [light, outdoors], lighting: [pbrs]}",
            ["scenes.vary", "finishes, furniture"],
        ),
        ("scenes: {rooms_min: 5, rooms_max: 2}", ["rooms_min", "5", "2"]),
        ("scenes: {homes: -1}", ["homes"]),
        ("groundtruth: {spp: 33}", ["groundtruth.spp", "33"]),
        ("noisy: {spp: 4, train: [8, 1]}", ["noisy.train", "[8, 1]", "from 1 to 16"]),
        ("noisy: {train: [1, 8]}", ["noisy.train", "needs spp"]),
        ("groundtruth: {spp: .nan}", ["groundtruth.spp"]),
        ("cameras: {grid: .inf}", ["cameras.grid", "inf"]),
        ("illumination: {width: 161}", ["illumination.width", "161", "odd"]),
        ("train: {learning_rate: 0}", ["train.learning_rate", "above 0"]),
        ("train: {loss: {part: [1, 2]}}", ["train.loss.part", "2"]),
        ("train: {exposure: mine}", ["train.exposure", "'mine'", "'own'", "'shared'"]),
        ("farm: {cache_mb: 0}", ["farm.cache_mb", "from 1 to 1073741824"]),
        ("farm: {transfer: on}", ["farm.transfer", "True", "'send'", "quote it"]),
        ("farm: {variant: fast}", ["farm.variant", "'fast'"]),
        ("seed: [", ["not valid YAML"]),
        *((f"seed: {text}", ["params.yaml"]) for text in ("[" * 3000, "7" * 5000)),
        ("a: &a {b: *a}", ["not valid YAML", "inside"]),
        ("a: &a {x: 1}\n" + doubling("<<: [*{0}, *{0}]"), ["not valid YAML", "aliases"]),
        ("a: &a {x: 1}\n" + doubling("x: *{0}, y: *{0}"), ["not valid YAML", "aliases"]),
        ("seed: " + "1:" * 100_000 + "1", ["not valid YAML", "line 1"]),
        ("seed: " + "1:" * 400 + "1.5", ["not valid YAML", "line 1"]),
        *((f"farm: {{}}\nseed: {tag}", ["line 2", tag.split()[0][2:]]) for tag in NO_VALUES),
        ("- 1", ["mapping"]),
    ],
)
def test_bad_parameters_name_key_value_and_what_is_allowed(
    tmp_path: Path, text: str, words: list[str]
) -> None:
    path = tmp_path / "params.yaml"
    path.write_text(text)
    with pytest.raises(ParameterError) as caught:
        load_params(path)
    for word in [str(path), *words]:
        assert word in str(caught.value)
    assert len(str(caught.value)) < 1000


def test_a_missing_file_says_how_to_get_one(tmp_path: Path) -> None:
    with pytest.raises(ParameterError, match="pbrnet preset quick"):
        load_params(tmp_path / "params.yaml")


def test_seed_zero_is_a_seed(tmp_path: Path) -> None:
    path = tmp_path / "params.yaml"
    path.write_text("seed: 7")
    assert load_params(path).seed == 7
    assert load_params(path, seed=0).seed == 0


@pytest.mark.parametrize("path", PRESETS, ids=lambda path: path.stem)
def test_presets_hold_what_differs_and_are_written_whole(path: Path) -> None:
    """DVC tracks parameters by key, so the file that is put in place names every key."""
    assert len(path.read_text().splitlines()) <= 40
    usual, given = flat(plain(Params())), flat(yaml.safe_load(path.read_text()))
    assert [key for key, value in given.items() if usual[key] == value] == []
    whole = find_preset(path.stem).text()
    assert flat(yaml.safe_load(whole)).keys() == usual.keys()
    assert build_params(yaml.safe_load(whole)) == load_params(path)
    line = next(line for line in whole.splitlines() if "eye_height" in line)
    assert line.split("#")[0].strip() == "eye_height: 1.55" and line.endswith("quick start: 1.45")
    assert max(len(line) for line in whole.splitlines()) <= 100


def flat(tree: object, prefix: str = "") -> dict[str, object]:
    """Values of nested mappings by dotted key."""
    if not isinstance(tree, dict):
        return {prefix: tree}
    return {
        key: value
        for name, item in tree.items()
        for key, value in flat(item, f"{prefix}.{name}".lstrip(".")).items()
    }


def test_a_key_that_is_left_out_has_the_value_of_params_yaml(tmp_path: Path) -> None:
    path = tmp_path / "params.yaml"
    for text in ("", "train: {composition: {width: 32}}", "scenes: {homes: 12}", "cameras: {}"):
        path.write_text(text)
        assert load_params(path) == Params() == load_params(ROOT / "params.yaml")


def test_params_yaml_is_the_quick_start_as_written() -> None:
    """`pbrnet preset` takes another text for edited, and refuses to overwrite it."""
    assert (ROOT / "params.yaml").read_text() == find_preset("quick").text()


def test_every_parameter_says_what_it_means() -> None:
    said = {one.key: one.meaning for one in parameters(Params()) if not one.is_section}
    shares = {"dataset.splits.validation", "dataset.splits.test"}
    assert {key for key, text in said.items() if not text and "train." not in key} == shares


def test_plain_and_build_are_inverse() -> None:
    params = Params(seed=3)
    assert build(Params, plain(params)) == params


def test_paper_preset_holds_the_papers_figures() -> None:
    params = load_params(next(path for path in PRESETS if path.stem == "paper"))
    assert (params.image.width, params.image.height) == (480, 360)
    assert (params.train.shading.epochs, params.train.composition.epochs) == (14, 12)
    assert params.train.shading.steps_per_epoch == params.train.composition.steps_per_epoch == 20000
    assert (params.train.batch, params.train.learning_rate) == (1, 1e-4)


def test_no_preset_claims_how_long_it_takes() -> None:
    """The README states the measured duration of the quick start; the other places do not."""
    help_text = (ROOT / "pipeline" / "commands" / "project.py").read_text()
    for text in [help_text, *(path.read_text() for path in (ROOT / "params.yaml", *PRESETS))]:
        assert not re.search(r"\bminutes?\b", text)


@pytest.mark.parametrize(("width", "side"), [(160, 256), (480, 1024), (640, 1024), (16, 64)])
def test_textures_follow_the_size_of_the_images(tmp_path: Path, width: int, side: int) -> None:
    path = tmp_path / "params.yaml"
    path.write_text(f"image: {{width: {width}}}\nscenes: {{texture_size: auto}}\n")
    assert load_params(path).scenes.texture_size == side
    path.write_text(f"image: {{width: {width}}}\nscenes: {{texture_size: 300}}\n")
    assert load_params(path).scenes.texture_size == 300
    path.write_text("image: {width: wide}\nscenes: {texture_size: auto}\n")
    with pytest.raises(ParameterError, match=r"image\.width"):
        load_params(path)
    path.write_text("scenes: {texture_size: large}\n")
    with pytest.raises(ParameterError, match=r"scenes\.texture_size"):
        load_params(path)
