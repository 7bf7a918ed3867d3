"""Blind pairs: a balanced plan, a page that does not reveal the solution, correct scores."""

import base64
import json
import os
import re
import struct
from collections import Counter
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pbrnet.model.data.reader import Dataset
from pbrnet.model.evaluation.evaluate import true_color
from pbrnet.model.evaluation.inference import load_networks
from pbrnet.model.studies.pairs.answers import (
    MAX_BYTES,
    Answers,
    Key,
    read_all,
    read_answers,
    read_key,
    score,
)
from pbrnet.model.studies.pairs.study import (
    PRACTICE_PAIRS,
    PairsConfig,
    equal_length_pngs,
    plan_pairs,
    write_pairs_page,
)
from pbrnet.model.training.train import Folders
from pbrnet.pipeline.images import read_picture
from pbrnet.pipeline.params import Params
from pbrnet.pipeline.tonemap import to_bytes
from pbrnet.scenes.checked import plain
from pbrnet.scenes.errors import InputError, ParameterError
from pbrnet.scenes.seeds import generator
from tests.fixtures.changed import REMOVED, changed
from tests.fixtures.command import Run
from tests.fixtures.predictor import untrained_models
from tests.fixtures.study import (
    NETWORKS,
    answers_to,
    key_of,
    report_in,
    section_of,
    without,
    workplace,
    write,
)

METHODS = ("pbrnet", "product", "unet")


def rng(seed: int = 0) -> np.random.Generator:
    return generator(seed, "a test of deals")


@pytest.fixture(scope="module")
def folders(tmp_path_factory: pytest.TempPathFactory) -> Folders:
    """Untrained networks and 14 test views."""
    return workplace(tmp_path_factory.mktemp("study"))


@pytest.fixture(scope="module")
def made(folders: Folders, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A page of 12 pairs, its key beside it."""
    page = tmp_path_factory.mktemp("page") / "pairs.html"
    write_pairs_page(Params(seed=5), folders, PairsConfig(), page)
    return page


def content_of(page: Path) -> dict[str, Any]:
    """Return the data embedded in the page."""
    found = re.search(
        r'<script type="application/json"[^>]*>(.*?)</script>', page.read_text(), re.S
    )
    assert found
    content: dict[str, Any] = json.loads(found[1])
    return content


def png_of(uri: str) -> bytes:
    assert uri.startswith("data:image/png;base64,")
    return base64.b64decode(uri.split(",")[1])


def chunks(png: bytes) -> list[tuple[bytes, int]]:
    """Return names and sizes of a PNG's chunks, in order."""
    found, place = [], 8
    while place < len(png):
        (size,) = struct.unpack(">I", png[place : place + 4])
        found.append((png[place + 4 : place + 8], size))
        place += size + 12
    return found


@pytest.mark.parametrize(
    ("methods", "views", "wanted", "pairs", "practice"),
    [
        (3, 1000, 50, 48, 2),
        (2, 1000, 50, 48, 2),
        (5, 1000, 50, 50, 2),
        (3, 14, 50, 12, 2),
        (3, 13, 50, 6, 2),  # 12 pairs would leave no two views for practice
        (3, 7, 50, 6, 1),
        (3, 6, 6, 6, 0),
        (1, 2, 50, 2, 0),
        (9, 60, 50, 36, 2),
    ],
)
def test_pairs_are_dealt_fairly(
    methods: int, views: int, wanted: int, pairs: int, practice: int
) -> None:
    names = [f"m{index}" for index in range(methods)]
    for seed in range(20):
        plan = plan_pairs(names, views, wanted, rng(seed))
        assert (len(plan.pairs), len(plan.practice)) == (pairs, practice)
        each = Counter(card.method for card in plan.pairs)
        assert dict(each) == dict.fromkeys(names, plan.each)
        left = Counter(card.method for card in plan.pairs if card.truth == "left")
        assert dict(left) == dict.fromkeys(names, plan.each // 2)
        numbers = [card.number for card in (*plan.pairs, *plan.practice)]
        assert len(set(numbers)) == len(numbers) and set(numbers) <= set(range(views))


def test_the_seed_decides_the_order_the_sides_and_the_views() -> None:
    assert plan_pairs(METHODS, 99, 48, rng(1)) == plan_pairs(METHODS, 99, 48, rng(1))
    deals = [plan_pairs(METHODS, 99, 48, rng(seed)) for seed in range(400)]
    assert len({plan_pairs.pairs for plan_pairs in deals}) == 400
    for place in (0, 1, 30, 47):
        # 400 throws of a fair coin: beyond 5 standard deviations once in two millions.
        lefts = sum(plan_pairs.pairs[place].truth == "left" for plan_pairs in deals)
        assert abs(lefts - 200) < 50
        ours = sum(plan_pairs.pairs[place].method == "pbrnet" for plan_pairs in deals)
        assert abs(ours - 400 / 3) < 48
        assert len({plan_pairs.pairs[place].number for plan_pairs in deals}) > 80
    alternating = sum(
        first.truth != second.truth
        for plan_pairs in deals
        for first, second in zip(plan_pairs.pairs, plan_pairs.pairs[1:], strict=False)
    )
    assert 0.48 < alternating / (400 * 47) < 0.54, "half of 48 sides: 24/47 on average"


def test_too_few_pairs_or_views_are_refused() -> None:
    with pytest.raises(ParameterError, match=r"--pairs: 5 is not allowed; 3 methods need .* 6"):
        plan_pairs(METHODS, 99, 5, rng())
    with pytest.raises(InputError, match=r"has 5 views.*3 methods need at least 6.*--method"):
        plan_pairs(METHODS, 5, 50, rng())


def test_the_page_shows_what_the_key_says(folders: Folders, made: Path) -> None:
    key, content = read_key(made.with_name("pairs-key.json")), content_of(made)
    assert content["page"] == key.page and content["seed"] == key.seed == 5
    assert [pair["pair"] for pair in content["pairs"]] == [pair.pair for pair in key.pairs]
    assert (len(content["pairs"]), len(content["practice"])) == (12, PRACTICE_PAIRS)
    networks = load_networks(folders.models)
    truths = {
        (example.scene_id, example.view_id): to_bytes(true_color(example, networks))
        for example in Dataset(folders.data / "dataset", "test").ordered()
    }
    for shown, pair in zip(content["pairs"], key.pairs, strict=True):
        truth = truths.pop((pair.scene_id, pair.view_id))
        other = "left" if pair.truth == "right" else "right"
        assert np.array_equal(read_picture(png_of(shown[pair.truth])), truth)
        assert not np.array_equal(read_picture(png_of(shown[other])), truth)


def test_the_page_does_not_tell_which_picture_is_the_truth(made: Path) -> None:
    content = content_of(made)
    text = re.sub(r"[A-Za-z0-9+/=]{200,}", "", made.read_text())  # images may spell any word
    key = read_key(made.with_name("pairs-key.json"))
    words = {word for pair in key.pairs for word in (pair.scene_id, pair.view_id)}
    for word in (*words, *key.models.values(), "truth", "product", "unet", "-key"):
        assert word not in text, word
    for shown in (*content["pairs"], *content["practice"]):
        assert set(shown) == {"pair", "left", "right"}
        left, right = png_of(shown["left"]), png_of(shown["right"])
        assert len(left) == len(right)
        assert left[:33] == right[:33], "size and kind of the picture"
        assert [name for name, _ in chunks(left)] == [name for name, _ in chunks(right)]
        assert min(size for name, size in chunks(left) + chunks(right) if name == b"paDd") > 0
        for png in (left, right):
            assert not re.search(rb"(.)\1{40}", png), "runs would show how much was filled up"


def test_the_seed_on_the_page_is_not_enough_to_draw_the_sides_again(
    folders: Folders, made: Path, tmp_path: Path
) -> None:
    """With other weights, the same seed draws another plan."""
    untrained_models(tmp_path / "models", NETWORKS, levels=2, width=4, seed=1)
    other = write_pairs_page(
        Params(seed=5),
        replace(folders, models=tmp_path / "models"),
        PairsConfig(),
        tmp_path / "b.html",
    ).key
    key = read_key(made.with_name("pairs-key.json"))
    assert [pair.truth for pair in other.pairs] != [pair.truth for pair in key.pairs]
    assert [pair.method for pair in other.pairs] != [pair.method for pair in key.pairs]


def test_the_page_needs_nothing_from_outside(made: Path) -> None:
    text = made.read_text()
    assert (
        "http:" not in text
        and "https:" not in text
        and "//" not in re.sub(r"data:image/png;base64,[A-Za-z0-9+/=]+|// .*", "", text)
    )
    assert "default-src 'none'" in text
    assert not re.search(r"<link|<iframe|<object|@import|url\(", text)
    assert "prefers-color-scheme: dark" in text and 'name="viewport"' in text


def test_pictures_of_one_length_are_still_the_pictures() -> None:
    draw = rng()
    flat = np.full((30, 40, 3), 90, np.uint8)
    noisy = draw.integers(0, 256, (30, 40, 3)).astype(np.uint8)
    pair = equal_length_pngs([flat, noisy], draw)
    assert len(pair[0]) == len(pair[1]) and len(pair[0]) % 1024 == 0
    for png, picture in zip(pair, (flat, noisy), strict=True):
        assert np.array_equal(read_picture(png), picture)


def test_made_twice_it_is_the_same_to_the_byte(
    folders: Folders, made: Path, tmp_path: Path
) -> None:
    write_pairs_page(Params(seed=5), folders, PairsConfig(), tmp_path / "pairs.html")
    for name in ("pairs.html", "pairs-key.json"):
        assert (tmp_path / name).read_bytes() == made.with_name(name).read_bytes()
    write_pairs_page(Params(seed=5), folders, PairsConfig(), tmp_path / "pairs.html")


def test_a_network_needs_no_others(folders: Folders, tmp_path: Path) -> None:
    untrained_models(tmp_path / "models", ("unet",), levels=2)
    alone = replace(folders, models=tmp_path / "models")
    config = PairsConfig(methods=("unet",), pairs=2)
    made = write_pairs_page(Params(), alone, config, tmp_path / "pairs.html")
    assert [*made.key.models] == ["unet"]


def test_the_key_of_another_page_is_kept_unless_it_may_go(folders: Folders, tmp_path: Path) -> None:
    page, key = tmp_path / "p.html", tmp_path / "p-key.json"
    config = PairsConfig(methods=("pbrnet",), pairs=2)
    first = write_pairs_page(Params(), folders, config, page).key
    before = {path: path.read_bytes() for path in (page, key)}
    with pytest.raises(ParameterError, match=rf"p-key\.json: .*\({first.page}\).*--replace"):
        write_pairs_page(Params(seed=1), folders, config, page)
    assert {path: path.read_bytes() for path in (page, key)} == before
    second = write_pairs_page(Params(seed=1), folders, config, page, replace=True).key
    assert second.page != first.page and read_key(key) == second
    key.write_text("{")
    with pytest.raises(ParameterError, match="unreadable"):
        write_pairs_page(Params(), folders, config, page)


# Wilson's interval for x of n with z = 1.959964, z^2 = 3.841459:
# ((x + z^2 / 2) +- z sqrt(x (n - x) / n + z^2 / 4)) / (n + z^2)
#  5 of 10: (6.920729 +- 1.959964 sqrt(2.5 + 0.960365)) / 13.841459 = 0.5 +- 0.263407
#  0 of 10: (1.920729 +- 1.920729) / 13.841459
#  2 of  8: (3.920729 +- 1.959964 sqrt(1.5 + 0.960365)) / 11.841459 = 0.331102 +- 0.259622
BY_HAND = {
    "pbrnet": (5, 10, 0, 0.5 - 0.263407, 0.5 + 0.263407),
    "product": (0, 10, 0, 0.0, 0.277533),
    "unet": (2, 8, 2, 0.331102 - 0.259622, 0.331102 + 0.259622),
}


def test_scores_are_those_worked_out_by_hand(tmp_path: Path) -> None:
    key = key_of(dict.fromkeys(BY_HAND, 10))

    def choose(index: int, pair: Any) -> str | None:
        mistaken, answers = BY_HAND[pair.method][:2]
        place = index % 10
        return None if place >= answers else "method" if place < mistaken else "truth"

    person = read_of(tmp_path, key, answers_to(key, choose))
    result = score(key, [person])
    assert (result.people, result.pairs, result.page) == (1, 30, key.page)
    for method, (mistaken, answers, timeouts, low, high) in BY_HAND.items():
        figure = result.methods[method]
        assert (figure.mistaken, figure.answers, figure.timeouts) == (mistaken, answers, timeouts)
        assert figure.rate == mistaken / answers
        assert (figure.low, figure.high) == pytest.approx((low, high), abs=2e-6)


def read_of(folder: Path, key: Key, content: Any) -> Answers:
    """Write an answer file and read it."""
    return read_answers(write(folder / "answers.json", content), key)


def test_people_add_up_and_nobodys_answers_make_no_rate(tmp_path: Path) -> None:
    key = key_of({"pbrnet": 4, "unet": 2})
    people = [
        read_of(
            tmp_path, key, answers_to(key, lambda i, p: None if p.method == "unet" else "method", 1)
        ),
        read_of(
            tmp_path, key, answers_to(key, lambda i, p: None if p.method == "unet" else "truth", 2)
        ),
    ]
    result = score(key, people)
    ours, other = result.methods["pbrnet"], result.methods["unet"]
    assert (ours.answers, ours.mistaken, ours.rate) == (8, 4, 0.5)
    assert (other.answers, other.timeouts, other.rate, other.low) == (0, 4, None, None)


KEY = key_of({"pbrnet": 4})
GOOD = answers_to(KEY, lambda index, pair: "truth")


def spoilt(path: list[str | int], value: Any) -> str:
    """Return a valid file with one value exchanged, or removed."""
    return json.dumps(changed(GOOD, path, value))


HOSTILE: dict[str, tuple[str, str]] = {
    "nothing": ("", "not valid JSON"),
    "half a file": (json.dumps(GOOD)[:-30], "not valid JSON"),
    "a list": ("[1, 2]", "expected a mapping"),
    "too deep": ("[" * 200_000, "nested too deeply"),
    "too large": (json.dumps(GOOD) + " " * MAX_BYTES, "more than 1024 KiB"),
    "a number of 9000 digits": ('{"seed": ' + "9" * 9000 + "}", "not valid JSON"),
    "a key twice": ('{"page": "a", "page": "b"}', "'page' comes twice"),
    "NaN": (json.dumps(GOOD).replace("1200", "NaN"), "NaN is not a number"),
    "infinite time": (json.dumps(GOOD).replace("1200", "1e999"), r"answers\[0\]\.ms"),
    "another study": (spoilt(["study"], "colours"), r"json\.study: 'colours' is not one of"),
    "another version": (spoilt(["version"], 2), r"json\.version: 2"),
    "another page": (spoilt(["page"], "f" * 16), r"json\.page: 'ffffffffffffffff', but the key"),
    "a page in markup": (spoilt(["page"], "\x1b[31m<b>" * 99), r"json\.page: '\\x1b\[31m"),
    "another seed": (spoilt(["seed"], 4), r"json\.seed: 4, but the key's is 3"),
    "no session": (spoilt(["session"], REMOVED), r"json\.session: missing"),
    "a made-up session": (spoilt(["session"], "me"), r"session: 'me' is not 32 hex digits"),
    "one field more": (spoilt(["note\x1b"], "x"), r"json\.note\?: unknown key"),
    "no answers": (spoilt(["answers"], []), "4 of 4 pairs are missing, 'p0000' first"),
    "answers that are none": (spoilt(["answers"], "all left"), r"json\.answers: expected a list"),
    "a pair less": (spoilt(["answers", 3], REMOVED), "1 of 4 pairs are missing, 'p0003'"),
    "an unknown pair": (spoilt(["answers", 0, "pair"], "p9"), r"\[0\]\.pair: .* no pair 'p9'"),
    "a pair twice": (spoilt(["answers", 1, "pair"], "p0000"), r"\[1\]\.pair: 'p0000' is answ.*tw"),
    "no such side": (spoilt(["answers", 2, "side"], "up"), r"answers\[2\]\.side: 'up' is not"),
    "a side as a list": (spoilt(["answers", 2, "side"], ["left"]), r"answers\[2\]\.side"),
    "a side out of time": (spoilt(["answers", 1, "timed_out"], True), r"answers\[1\]\.timed_out"),
    "no side in time": (spoilt(["answers", 1, "side"], None), r"answers\[1\]\.timed_out"),
    "time before the start": (spoilt(["answers", 0, "ms"], -1), r"answers\[0\]\.ms: -1 is not"),
    "time as text": (spoilt(["answers", 0, "ms"], "9"), r"answers\[0\]\.ms: expected a whole"),
    "truth as time": (spoilt(["answers", 0, "ms"], True), r"answers\[0\]\.ms: expected a whole"),
}


@pytest.mark.parametrize("name", HOSTILE)
def test_an_answer_file_that_does_not_fit_is_refused(name: str, tmp_path: Path) -> None:
    content, words = HOSTILE[name]
    path = tmp_path / "bad.json"
    path.write_text(content)
    with pytest.raises(InputError, match=words) as refused:
        read_answers(path, KEY)
    assert str(refused.value).startswith(str(path))
    assert len(str(refused.value)) < 500 and str(refused.value).isprintable()


def test_what_is_no_text_or_no_file_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "bad.json"
    path.write_bytes(b"\xff\xfe" + json.dumps(GOOD).encode("utf-16-le"))
    with pytest.raises(InputError, match="not valid JSON"):
        read_answers(path, KEY)
    with pytest.raises(InputError, match=r"gone\.json: no such file"):
        read_answers(tmp_path / "gone.json", KEY)
    os.mkfifo(tmp_path / "pipe.json")
    with pytest.raises(InputError, match="not a plain file"):
        read_answers(tmp_path / "pipe.json", KEY)


def test_the_same_person_counts_once(tmp_path: Path) -> None:
    first = write(tmp_path / "a.json", GOOD)
    again = write(tmp_path / "b.json", GOOD)
    other = write(tmp_path / "c.json", {**GOOD, "session": "f" * 32})
    assert len(read_all([first, other], KEY)) == 2
    for paths in ([first, other, again], [first, first]):
        with pytest.raises(InputError, match=r"session: the same person's answers as .*a\.json"):
            read_all(paths, KEY)


def test_a_key_that_cannot_be_one_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"no such key.*pbrnet study pairs"):
        read_key(tmp_path / "none-key.json")
    with pytest.raises(InputError, match="no pairs, or two with the same id"):
        read_key(write(tmp_path / "k.json", plain(without(KEY, 4))))
    twice = replace(KEY, pairs=(*KEY.pairs, KEY.pairs[0]))
    with pytest.raises(InputError, match="two with the same id"):
        read_key(write(tmp_path / "k.json", plain(twice)))
    assert read_key(write(tmp_path / "k.json", plain(KEY))) == KEY


@pytest.fixture()
def run(folders: Folders, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, pbrnet_run: Run) -> Run:
    """`pbrnet study pairs` in an empty folder with data and models: exit code, output, errors."""
    monkeypatch.chdir(tmp_path)
    for name in ("data", "models"):
        (tmp_path / name).symlink_to(folders.data.parent / name)
    (tmp_path / "params.yaml").write_text("seed: 0\n")
    return partial(pbrnet_run, "study", "pairs")


def test_the_command_makes_scores_and_the_report_shows(run: Run, tmp_path: Path) -> None:
    studies = tmp_path / "metrics" / "studies"
    code, words, errors = run("--seconds", 2)
    assert code == 0, errors
    assert "12 pairs, 4 each of pbrnet, product, unet; 2 more for practice" in words
    assert "12 pairs, not 50: no view is shown twice (the test split has 14)" in words
    key = read_key(studies / "pairs-key.json")
    assert key.seconds == 2

    def choose(_index: int, pair: Any) -> str:
        return "method" if pair.method == "product" else "truth"

    files = [write(tmp_path / f"{i}.json", answers_to(key, choose, i)) for i in (1, 2)]
    code, words, errors = run("--score", *files)
    assert code == 0, errors
    assert "2 people, 12 pairs each, shown 2 s" in words
    # 8 of 8 and 0 of 8 by Wilson: n / (n + z^2) = 0.6756 and z^2 / (n + z^2) = 0.3244
    assert "product: 100.0 % (67.6 % to 100.0 %) taken for the rendering, 8 answers" in words
    assert "pbrnet: 0.0 % (0.0 % to 32.4 %) taken for the rendering, 8 answers" in words
    assert json.loads((studies / "pairs.json").read_text())["methods"]["product"]["mistaken"] == 8

    page, _ = report_in(tmp_path, Params())
    section = section_of(page, "pairs")
    assert section.index("32.4 %") < section.index("67.6 %")
    assert "2 people saw 12 pairs each" in section and 'href="#study-pairs"' in page


@pytest.mark.parametrize(
    ("place", "value"),
    [
        (["methods", "pbrnet", "mistaken"], 99),
        (["methods", "pbrnet", "rate"], 0.9),
        (["methods", "pbrnet", "low"], None),
        (["methods"], [1]),
        (["people"], "many"),
    ],
)
def test_the_report_notes_a_damaged_result(tmp_path: Path, place: list[str], value: Any) -> None:
    content = plain(score(KEY, [read_of(tmp_path, KEY, GOOD)]))
    path = tmp_path / "metrics" / "studies" / "pairs.json"
    write(path, changed(content, place, value))
    page, notes = report_in(tmp_path, Params())
    assert any(str(path) in note and "pbrnet study pairs --score" in note for note in notes)
    assert 'id="study-pairs"' not in page


@pytest.mark.parametrize(
    ("arguments", "code", "words"),
    [
        (("--score",), 2, "--score requires the answer files"),
        (("a.json",), 2, "they require --score"),
        (("--score", "a.json"), 3, "no such key"),
        (("--pairs", 4), 2, "--pairs: 4 is not allowed; 3 methods need at least 6"),
        (("--seconds", 0), 2, "--seconds"),
        (("--method", "magic"), 2, "--method"),
        (("--method", "can"), 3, "can.safetensors: no such model"),
        (("--out", "page.txt"), 2, ".html"),
        (("--seed", -1), 2, "--seed"),
    ],
)
def test_what_cannot_be_done_is_said(
    run: Run, tmp_path: Path, arguments: tuple[object, ...], code: int, words: str
) -> None:
    ended, _, errors = run(*arguments)
    assert ended == code and words in errors, errors
    assert not (tmp_path / "metrics").exists()
