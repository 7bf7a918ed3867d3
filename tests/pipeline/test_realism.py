"""Figures that compare pictures with photographs, on pictures and scenes of known answers."""

from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from pbrnet.pipeline.commands.inspect import inspect
from pbrnet.pipeline.inspection.realism import (
    FIGURES,
    class_pixels,
    counts,
    picture_figures,
    repeats,
    spectrum_slope,
)
from pbrnet.scenes.contract import Room, Scene, SceneObject

BOX = ((0.0, 0.0, 0.0), (0.3, 0.3, 0.3))


@pytest.mark.parametrize("exponent", [-1.0, -2.0, -3.0])
def test_the_slope_of_noise_is_that_of_its_making(exponent: float) -> None:
    frequency = np.hypot(np.fft.fftfreq(256)[:, None], np.fft.fftfreq(256))
    frequency[0, 0] = 1
    found = []
    for seed in range(12):
        noise = np.random.default_rng(seed).normal(size=(256, 256))
        waves = np.fft.fft2(noise) * frequency ** (exponent / 2)
        found.append(spectrum_slope(np.fft.ifft2(waves).real))
    assert np.mean(found) == pytest.approx(exponent, abs=0.1)
    assert np.std(found) < 0.2


def test_figures_of_pictures_of_known_colours() -> None:
    grey = np.full((64, 64, 3), 2e-4)
    grey[:, 32:] *= 2  # one stop
    plain = picture_figures(grey)
    assert plain["stops"] == pytest.approx(0.5)
    assert (plain["chroma"], plain["clipped"]) == (pytest.approx(0, abs=0.5), 0)
    assert plain["kurtosis"] == pytest.approx(
        63**2 / 62 - 3, rel=0.01
    )  # one step in 63 differences
    lit = grey.copy()
    lit[:16] = 1.0
    assert picture_figures(lit)["clipped"] == pytest.approx(0.25)
    lit[16:24] = 0.0
    assert picture_figures(lit)["black"] == pytest.approx(0.125)
    assert picture_figures(lit)["darkest"] == 0
    hues = np.full((64, 64, 3), 2e-4)
    hues[::2] *= [1.5, 1, 0.5]
    one = hues[::2].repeat(2, axis=0)
    assert picture_figures(hues)["chroma"] > 5
    assert picture_figures(one)["hues"] < 10 < picture_figures(hues)["hues"]


def home(number: int, *things: tuple[str, str]) -> Scene:
    objects = [SceneObject("wall", "wall", "wall", (), *BOX, True, "r")]
    objects += [
        SceneObject(f"o{k}", name, category, (), *BOX, False, "r")
        for k, (name, category) in enumerate(things)
    ]
    square = ((0.0, 0.0), (3.0, 0.0), (3.0, 3.0), (0.0, 3.0))
    room = Room("r", "kitchen", "kitchen", square, 0.0, 2.5, True)
    return Scene(f"home-{number}", {}, (room,), tuple(objects), (), (), ())


def test_counts_and_classes_are_those_of_the_scene() -> None:
    scene = home(0, ("pot", "pot"), ("mug", "cup"), ("cup", "cup"))
    assert counts(["wall", "o0", "o1", "o2"], scene) == {"instances": 3.0, "categories": 2.0}
    classes = class_pixels({"wall": 70, "o0": 20, "outside": 10}, scene)
    assert classes["wall"] == 70
    assert sum(classes.values()) == 100


def test_repeats_are_shares_of_the_rooms_of_a_type() -> None:
    mug, pot, lamp = ("mug", "cup"), ("pot", "pot"), ("lamp", "lamp")
    homes = [home(k, mug, mug, lamp, *([pot] if k < 2 else [])) for k in range(8)]
    found = {row["thing"]: row["share"] for row in repeats(homes)}
    assert found == {"mug": 1.0, "pot": 0.25}, "lamps are fixtures, and a room counts once"
    assert repeats(homes[:3]) == [], "three rooms say nothing"


def test_every_figure_is_measured() -> None:
    made = picture_figures(np.random.default_rng(0).random((32, 48, 3)))
    assert {figure.name for figure in FIGURES} == made.keys() | {"instances", "categories"}


def test_a_folder_without_colour_is_refused_in_one_line(tmp_path: Path) -> None:
    done = CliRunner().invoke(inspect, [str(tmp_path), "--realism"])
    assert "no colour frames" in str(done.exception)
