"""Scores of pictures whose errors are known."""

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner, Result

from pbrnet.model.benchmark.metrics import angles, local_rmse, scale_invariant_rmse
from pbrnet.model.benchmark.score import Score, score_folder
from pbrnet.model.benchmark.views import load_views, pin_views, save_views
from pbrnet.model.commands.score import score
from pbrnet.pipeline.export.images import write_exr
from pbrnet.pipeline.export.rows import DatasetRows
from pbrnet.pipeline.frames import banded
from pbrnet.pipeline.images import normal_picture, png_bytes, reflectance_picture, tone_picture
from pbrnet.scenes.errors import InputError
from tests.fixtures.exports import HEIGHT, UNIT, WIDTH, make_dataset, truths

TRUTHS = truths()
EVERY = np.ones((HEIGHT, WIDTH), bool)


@pytest.fixture(scope="module")
def dataset(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return make_dataset(tmp_path_factory.mktemp("benchmark") / "dataset")


@pytest.fixture
def rows(dataset: Path) -> DatasetRows:
    return DatasetRows(dataset)


def submitted(
    folder: Path, column: str, change: Callable[[np.ndarray], np.ndarray] = lambda image: image
) -> Path:
    """EXR pictures of every view: an image of the truth, changed."""
    folder.mkdir(parents=True)
    for (scene, view), truth in TRUTHS.items():
        image = truth.images[column].astype(np.float32) * (UNIT if column == "color" else 1)
        write_exr(folder / f"{scene}--{view}.exr", banded(change(image).astype(np.float32)))
    return folder


def means(result: Score) -> dict[str, float]:
    return {name: value["mean"] for name, value in result.summary()["metrics"].items() if value}


def test_the_truth_has_no_error(rows: DatasetRows, tmp_path: Path) -> None:
    folder = submitted(tmp_path / "same", "color")
    found = means(score_folder(folder, rows, None, "color", "truth"))
    assert found == pytest.approx({"ssim": 1, "psnr": 100, "flip": 0, "stops": 0}, abs=1e-6)
    folder = submitted(tmp_path / "albedo", "reflectance", lambda image: 0.37 * image)
    found = means(score_folder(folder, rows, None, "albedo"))
    assert found == pytest.approx({"si_rmse": 0, "local_rmse": 0}, abs=1e-6)
    folder = submitted(tmp_path / "normals", "normal", lambda image: 5 * image)
    found = means(score_folder(folder, rows, None, "normal"))
    assert found["mean_angle"] < 1e-4 and found["within_11.25"] == 1


def test_exposed_by_itself_a_picture_s_level_is_said_apart(
    rows: DatasetRows, tmp_path: Path
) -> None:
    bright = submitted(tmp_path / "bright", "color", lambda image: 4 * image)
    same = submitted(tmp_path / "same", "color")
    own = [means(score_folder(folder, rows, None, "color")) for folder in (same, bright)]
    assert own[1]["stops"] == pytest.approx(2)
    for name in ("ssim", "psnr", "flip"):
        assert own[0][name] == pytest.approx(own[1][name], rel=1e-4)
    exposed = means(score_folder(bright, rows, None, "color", "truth"))
    assert exposed["flip"] > own[1]["flip"] + 0.1


def test_png_pictures_are_display_values(rows: DatasetRows, tmp_path: Path) -> None:
    for name in ("color", "albedo", "normal"):
        (tmp_path / name).mkdir()
    for row in rows.rows:
        truth = TRUTHS[row.scene_id, row.view_id].images
        pictures = {
            "color": tone_picture(truth["color"].astype(np.float32) * UNIT, row.exposure),
            "albedo": reflectance_picture(truth["reflectance"].astype(np.float32)),
            "normal": normal_picture(truth["normal"]),
        }
        for name, picture in pictures.items():
            path = tmp_path / name / row.scene_id / f"{row.view_id}.png"
            path.parent.mkdir(exist_ok=True)
            path.write_bytes(png_bytes(picture))
    color = means(score_folder(tmp_path / "color", rows, None, "color"))
    assert color["ssim"] > 0.999 and color["psnr"] > 50 and "stops" not in color
    assert means(score_folder(tmp_path / "albedo", rows, None, "albedo"))["si_rmse"] < 0.005
    assert means(score_folder(tmp_path / "normal", rows, None, "normal"))["mean_angle"] < 0.5


def test_normals_turned_by_20_degrees_are_20_degrees_off(rows: DatasetRows, tmp_path: Path) -> None:
    def turned(normal: np.ndarray) -> np.ndarray:
        normal = normal / np.linalg.norm(normal, axis=-1, keepdims=True)
        across = np.cross(normal, [0.36, 0.48, 0.8])
        across /= np.linalg.norm(across, axis=-1, keepdims=True)
        return np.cos(np.radians(20)) * normal + np.sin(np.radians(20)) * across

    folder = submitted(tmp_path / "turned", "normal", turned)
    found = means(score_folder(folder, rows, None, "normal"))
    assert found["mean_angle"] == pytest.approx(20, abs=1e-3)
    assert found["median_angle"] == pytest.approx(20, abs=1e-3)
    shares = [found[f"within_{limit}"] for limit in ("11.25", "22.5", "30")]
    assert shares == [0, 1, 1]
    nothing = np.zeros((1, 1, 3))
    assert angles(np.array([[[0.0, 0, -1]]]), nothing, np.ones((1, 1), bool)) == 90


def test_albedo_errors_are_those_of_their_definition() -> None:
    truth = np.zeros((40, 40, 3))
    truth[:, :20], truth[:, 20:] = 0.2, 0.6
    flat = np.full_like(truth, 0.9)
    mask = np.ones((40, 40), bool)
    assert scale_invariant_rmse(truth, flat, mask) == pytest.approx(0.2)  # best: 0.4 everywhere
    assert scale_invariant_rmse(truth, np.zeros_like(truth), mask) == pytest.approx(np.sqrt(0.2))
    # Slow shading left in the albedo weighs less in windows, an edge left out does not.
    slow = truth * np.linspace(0.5, 1.5, 40)[:, None, None]
    assert local_rmse(truth, slow, mask) < 0.6 * scale_invariant_rmse(truth, slow, mask)
    left = mask.copy()
    left[:, 20:] = False
    assert scale_invariant_rmse(truth, flat, left) == pytest.approx(0, abs=1e-12)


def run(*words: object) -> Result:
    return CliRunner().invoke(score, [str(word) for word in words])


def test_the_command_compares_submissions_and_writes_json(dataset: Path, tmp_path: Path) -> None:
    good = submitted(tmp_path / "good", "color")
    noise = np.random.default_rng(1)
    bad = submitted(
        tmp_path / "bad", "color", lambda image: image * noise.uniform(0.2, 1.8, image.shape)
    )
    (good / "seconds.json").write_text("0.25")
    (good / "about.json").write_text('{"samples": 4}')
    lines = [f"{scene},{view},{2 + n}" for n, (scene, view) in enumerate(TRUTHS)]
    (bad / "seconds.csv").write_text("scene_id,view_id,seconds\n" + "\n".join(lines))
    out = tmp_path / "scores.json"
    done = run(good, bad, "--dataset", dataset, "--split", "train", "--out", out)
    assert done.exit_code == 0, done.output
    assert "color: 5 views of 1 scene" in done.output
    first, second = json.loads(out.read_text())["scores"]
    assert (first["name"], first["about"], first["seconds"]) == ("good", {"samples": 4}, 0.25)
    assert second["seconds"] == pytest.approx(4)  # of the five views of this split
    assert first["metrics"]["flip"]["mean"] < second["metrics"]["flip"]["mean"]
    assert len(first["per_view"]) == 5
    rows = [line.split()[0] for line in done.output.splitlines() if line[:1].isalpha()]
    assert rows[-3:] == ["good", "bad", "Written:"]


def test_a_pinned_list_refuses_another_truth(
    dataset: Path, rows: DatasetRows, tmp_path: Path
) -> None:
    folder, path = submitted(tmp_path / "same", "color"), tmp_path / "views.json"
    done = run("--pin", path, "--dataset", dataset, "--split", "train", "--count", 2)
    assert done.exit_code == 0, done.output
    views = load_views(path)
    assert [view.view_id for view in views.views] == ["room-0-s0", "walk-0-0002"]
    assert len(score_folder(folder, rows, views, "color").views) == 2
    other = make_dataset(tmp_path / "other", unit=2 * UNIT)
    with pytest.raises(InputError, match="differs from the list"):
        score_folder(folder, DatasetRows(other), views, "color")
    with pytest.raises(InputError, match="is not in this dataset"):
        score_folder(folder, DatasetRows(dataset, ("test",)), views, "color")
    save_views(path, pin_views(DatasetRows(dataset), 0, "all", "1"))
    assert len(load_views(path).views) == 6


@pytest.mark.parametrize(
    ("spoil", "reason"),
    [
        (lambda folder: next(folder.glob("home-b*")).unlink(), "1 of 6 views have no image"),
        (
            lambda folder: write_exr(
                folder / "home-b--room-0-s0.exr", banded(np.zeros((5, 7, 3), np.float32))
            ),
            "7 x 5 pixels, the truth has 48 x 36",
        ),
        (
            lambda folder: write_exr(
                folder / "home-b--room-0-s0.exr",
                banded(np.full((HEIGHT, WIDTH, 3), np.nan, np.float32)),
            ),
            "holds NaN",
        ),
        (
            lambda folder: write_exr(
                folder / "home-b--room-0-s0.exr", {"Q": np.zeros((HEIGHT, WIDTH), np.float32)}
            ),
            "no channels R, G, B",
        ),
        (
            lambda folder: (folder / "home-b--room-0-s0.exr").write_bytes(b"\x76\x2f\x31\x01junk"),
            "not a readable EXR",
        ),
        (
            lambda folder: (folder / "seconds.json").write_text('{"a": "b"}'),
            "seconds must be numbers",
        ),
    ],
)
def test_faults_of_a_submission_end_in_one_line(
    spoil: Callable[[Path], object], reason: str, rows: DatasetRows, tmp_path: Path
) -> None:
    folder = submitted(tmp_path / "same", "color")
    spoil(folder)
    with pytest.raises(InputError, match=reason) as caught:
        score_folder(folder, rows, None, "color")
    assert "\n" not in str(caught.value)
