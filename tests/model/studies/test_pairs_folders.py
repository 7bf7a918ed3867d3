"""Blind pairs of pictures from folders: balanced, equal in size, not revealed, correct scores."""

import json
import re
from collections import Counter
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from pbrnet.model.studies.pairs.answers import (
    FolderKey,
    FolderPair,
    PictureFile,
    read_answers,
    read_key,
    score_folders,
)
from pbrnet.model.studies.pairs.folders import LONGEST, plan_folders, read_pair
from pbrnet.model.studies.pairs.study import QUESTION
from pbrnet.pipeline.images import read_picture
from pbrnet.pipeline.params import Params
from pbrnet.scenes.checked import plain
from pbrnet.scenes.errors import InputError
from pbrnet.scenes.seeds import generator
from tests.fixtures.command import Run
from tests.fixtures.study import report_in, section_of, write
from tests.model.studies.test_pairs import content_of, png_of

ORIENTATION = 0x0112  # EXIF


def noise(seed: int, width: int = 80, height: int = 64) -> Image.Image:
    draw = np.random.default_rng(seed)
    return Image.fromarray(draw.integers(0, 256, (height, width, 3), dtype=np.uint8))


def folder_of(folder: Path, count: int, seed: int = 0) -> Path:
    folder.mkdir()
    for index in range(count):
        noise(100 * seed + index).save(folder / f"room-{index}.png")
    return folder


@pytest.fixture()
def run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, pbrnet_run: Run) -> Run:
    """`pbrnet study pairs` beside two folders of six pictures: exit code, output, errors."""
    monkeypatch.chdir(tmp_path)
    Path("params.yaml").write_text("seed: 0\n")
    for seed, name in enumerate(("old", "new")):
        folder_of(tmp_path / name, 6, seed)
    return partial(pbrnet_run, "study", "pairs")


TWO = ("--folder", "old=old", "--folder", "new=new")


def names(start: int, stop: int) -> dict[str, Path]:
    return {f"v{index}": Path(f"v{index}.png") for index in range(start, stop)}


@pytest.mark.parametrize(
    ("ranges", "each", "practice", "alike"),
    [
        ([(0, 12), (0, 12)], 10, 2, 12),
        ([(0, 12), (4, 18)], 10, 2, 8),  # names first, then others at random
        ([(0, 9), (50, 90)], 6, 2, 0),
        ([(0, 2), (0, 2)], 2, 0, 2),
        ([(0, 12), (0, 12), (70, 99)], 4, 2, 5),  # photographs beside two versions
    ],
)
def test_pictures_are_dealt_fairly_and_once(
    ranges: list[tuple[int, int]], each: int, practice: int, alike: int
) -> None:
    files = {f"f{index}": names(*ends) for index, ends in enumerate(ranges)}
    orders = set()
    for seed in range(20):
        plan, drawn = plan_folders(files, 50, generator(seed, "test"))
        shown = [drawn[pair] for pair in plan.pairs]
        sides = Counter((left.folder, right.folder) for left, right in shown)
        both = {ends for one in combinations(files, 2) for ends in (one, one[::-1])}
        assert sides == dict.fromkeys(both, each // 2)
        assert (plan.each, len(plan.practice)) == (each, practice)
        used = Counter(picture for pair in drawn.values() for picture in pair)
        assert set(used.values()) == {1}
        assert all(one.file in map(str, files[one.folder].values()) for one in used)
        assert sum(left.file == right.file for left, right in drawn.values()) == alike
        orders.add(tuple(shown))
    assert len(orders) == 20 or len(plan.pairs) < 4


def test_pictures_of_a_pair_are_upright_and_of_one_size(tmp_path: Path) -> None:
    exact = noise(1)
    exact.save(tmp_path / "a.png")
    lying = Image.new("RGB", (90, 300))
    lying.paste((255, 255, 255), (0, 0, 45, 300))  # upright: the upper half
    exif = Image.Exif()
    exif[ORIENTATION] = 6
    lying.save(tmp_path / "b.jpg", exif=exif)
    first, second = read_pair([tmp_path / "a.png", tmp_path / "b.jpg"])
    assert np.array_equal(first, exact) and second.shape == first.shape
    assert second[:25].mean() > 240 and second[-25:].mean() < 15

    Image.new("RGB", (1600, 1200), (9, 80, 200)).save(tmp_path / "c.png")
    pair = read_pair([tmp_path / "c.png"] * 2)
    assert {one.shape for one in pair} == {(720, LONGEST, 3)}
    assert (pair[0] == (9, 80, 200)).all()


def test_the_page_shows_the_pictures_of_its_key_and_reveals_none(run: Run, tmp_path: Path) -> None:
    code, words, errors = run(*TWO, "--question", "Which <room> is tidier?", "--out", "p.html")
    assert code == 0, errors
    assert "4 pairs, 4 each of old and new, 4 in all of the same file name; 2 more for" in words
    assert "4 pairs, not 50: no image is shown twice (the smallest folder has 6)" in words
    key, content = read_key(tmp_path / "p-key.json"), content_of(tmp_path / "p.html")
    assert isinstance(key, FolderKey) and key.folders == ("old", "new")
    for shown, pair in zip(content["pairs"], key.pairs, strict=True):
        assert pair.left.file == pair.right.file
        pngs = [png_of(shown[side]) for side in ("left", "right")]
        assert len(pngs[0]) == len(pngs[1])
        for png, one in zip(pngs, (pair.left, pair.right), strict=True):
            assert np.array_equal(read_picture(png), Image.open(Path(one.folder, one.file)))
    text = (tmp_path / "p.html").read_text()
    assert text.count("Which &lt;room&gt; is tidier?") == 3 and "<room>" not in text
    shell = re.sub(r"base64,[A-Za-z0-9+/=]*", "", text)
    assert not re.search(r"\b(room-\d|old|new/|p-key|rendering)\b", shell)

    before = text, (tmp_path / "p-key.json").read_text()
    assert run(*TWO, "--question", "Which <room> is tidier?", "--out", "p.html")[0] == 0
    assert before == ((tmp_path / "p.html").read_text(), (tmp_path / "p-key.json").read_text())
    code, _, errors = run(*TWO, "--out", "p.html")  # another question
    assert code == 2 and "the key of another page" in errors


def three_folders() -> FolderKey:
    """Two pairs of each two of three folders, either once on the left."""
    pairs = [
        FolderPair(f"p{index}{turn}", *(PictureFile(name, "a.png") for name in both[::turn]))
        for index, both in enumerate(combinations(("old", "new", "photo"), 2))
        for turn in (1, -1)
    ]
    return FolderKey(
        "pairs", 2, "0" * 16, 0, QUESTION, 3.0, 5.0, ("old", "new", "photo"), tuple(pairs)
    )


def answers_of(key: FolderKey, choose: Callable[[FolderPair], str | None]) -> Any:
    """Return the content of an answer file; `choose` returns the name of a folder or None."""
    answers = []
    for pair in key.pairs:
        folder = choose(pair)
        side = next((s for s in ("left", "right") if getattr(pair, s).folder == folder), None)
        answers.append({"pair": pair.pair, "side": side, "ms": 9, "timed_out": side is None})
    about = {"study": "pairs", "version": 1, "page": key.page, "seed": key.seed}
    return {**about, "session": "0" * 32, "answers": answers}


def test_scores_of_three_folders_by_hand(tmp_path: Path) -> None:
    key = three_folders()
    assert read_key(write(tmp_path / "k.json", plain(key))) == key

    def choose(pair: FolderPair) -> str | None:
        folders = {pair.left.folder, pair.right.folder}
        if folders == {"old", "new"}:
            return pair.left.folder  # either once
        return None if pair.left.folder == "photo" and "old" in folders else "photo"

    path = write(tmp_path / "a.json", answers_of(key, choose))
    result = score_folders(key, [read_answers(path, key)])
    counts = {name: (one.chosen, one.answers, one.timeouts) for name, one in result.folders.items()}
    assert counts == {"old": (1, 3, 1), "new": (1, 4, 0), "photo": (3, 3, 1)}
    assert result.against["photo"]["new"].rate == 1 and result.against["old"]["new"].rate == 0.5
    # Wilson for 1 of 4, z^2 = 3.841459: (2.920729 +- 1.959964 sqrt(0.75 + 0.960365)) / 7.841459
    new = result.folders["new"]
    assert (new.low, new.high) == pytest.approx((0.045587, 0.699358), abs=2e-6)


def test_a_key_of_other_folders_is_refused(tmp_path: Path) -> None:
    key = three_folders()
    for bad in (
        replace(key, folders=("old", "new")),
        replace(key, pairs=(FolderPair("p", *(PictureFile("old", "a.png"),) * 2),)),
    ):
        with pytest.raises(InputError, match=r"k\.json\.pairs\[\d\]: not of two of the folders"):
            read_key(write(tmp_path / "k.json", plain(bad)))
    with pytest.raises(InputError, match="two with the same id"):
        read_key(write(tmp_path / "k.json", plain(replace(key, pairs=key.pairs[:1] * 2))))


def test_answers_are_scored_and_reported(run: Run, tmp_path: Path) -> None:
    assert run(*TWO)[0] == 0
    studies = tmp_path / "metrics" / "studies"
    key = read_key(studies / "pairs-key.json")
    assert isinstance(key, FolderKey)
    code, words, errors = run(
        "--score", write(tmp_path / "a.json", answers_of(key, lambda _: "new"))
    )
    assert code == 0, errors
    # 4 of 4 by Wilson: 4 / (4 + z^2) = 0.5101
    assert QUESTION in words and "new: 100.0 % (51.0 % to 100.0 %) chosen, 4 answers" in words
    assert "old: 0.0 % (0.0 % to 49.0 %) chosen" in words
    result = json.loads((studies / "pairs.json").read_text())
    assert result["folders"]["new"]["chosen"] == 4 and result["question"] == QUESTION

    section = section_of(report_in(tmp_path, Params())[0], "pairs")
    assert QUESTION in section and section.index("51.0 %") < section.index("49.0 %")
    result["folders"]["new"]["chosen"] = 5
    write(studies / "pairs.json", result)
    _, notes = report_in(tmp_path, Params())
    assert any("new.chosen: 5 of 4 answers; make it again with: pbrnet study" in n for n in notes)


def spoil(name: str, tmp_path: Path) -> None:
    """Spoil the folder `new`."""
    first = tmp_path / "new" / "room-0.png"
    match name:
        case "empty":
            for path in (tmp_path / "new").iterdir():
                path.unlink()
        case "few":
            for index in range(1, 6):
                (tmp_path / "new" / f"room-{index}.png").unlink()
        case "one name twice":
            noise(3).save(first.with_suffix(".JPG"), "JPEG")
        case "name of two lines":
            first.rename(tmp_path / "new" / "a\nb.png")
        case "gone":
            (tmp_path / "new").rename(tmp_path / "elsewhere")
        case _:
            for path in (tmp_path / "new").iterdir():
                match name:
                    case "cut":
                        path.write_bytes(path.read_bytes()[:-4000])
                    case "text":
                        path.write_text("%!PS-Adobe-3.0 EPSF-3.0\n")
                    case "deep":
                        Image.fromarray(np.zeros((64, 80), np.uint16)).save(path)
                    case "small":
                        noise(3, 80, 63).save(path)


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("empty", "new: no pictures (.png, .jpg, .jpeg)"),
        ("few", "--folder new: pictures: 1; 2 folders need at least 2 of each"),
        ("one name twice", "new/room-0.png: the same name as room-0.JPG"),
        ("name of two lines", r"new: a file name with unprintable signs, 'a\nb.png'"),
        ("gone", "new: No such file or directory"),
        ("cut", ".png: "),
        ("text", ".png: not an image of a known format"),
        ("deep", ".png: more than 8 bits a channel"),
        ("small", ".png: 80 x 63 pixels; at least 64 a side"),
    ],
)
def test_folders_that_cannot_be_shown_end_in_one_line(
    run: Run, tmp_path: Path, name: str, words: str
) -> None:
    spoil(name, tmp_path)
    code, _, errors = run(*TWO)
    progress, _, error = errors.rpartition("Error: ")
    assert code == 3 and words in error and error.count("\n") == 1, errors
    assert progress in ("", "study pairs: 0/6 pairs\n")
    assert not (tmp_path / "metrics").exists()


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("--folder", "old=old"), "at least two folders"),
        (("--folder", "old", "--folder", "new=new"), "'old' is not of the form NAME=FOLDER"),
        ((*TWO, "--folder", "old=other"), "the name old is given twice"),
        ((*TWO, "--folder", "again=./old"), "'./old' is given twice"),
        (("--folder", "a/b=old", *TWO), "'a/b' cannot be the name of a folder of pictures"),
        ((*TWO, "--folder", "photos=.", "--pairs", 5), "3 folders need at least 6"),
        ((*TWO, "--method", "pbrnet"), "--folder and --method exclude each other"),
        (("--question", "Which?"), "--question requires --folder"),
        ((*TWO, "--question", " "), "--question: ' ' is not allowed"),
        ((*TWO, "--question", "a\nb"), "--question: 'a\\nb' is not allowed"),
    ],
)
def test_wrong_use_of_folders_is_said(
    run: Run, tmp_path: Path, arguments: tuple[object, ...], words: str
) -> None:
    noise(1).save(tmp_path / "photo.png")
    code, _, errors = run(*arguments)
    assert code == 2 and words in errors, errors
    assert not (tmp_path / "metrics").exists()
