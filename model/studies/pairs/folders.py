"""Page of blind pairs of pictures from folders: versions of renders, or renders and photographs.

Like the page of methods: sides are balanced, and no picture is shown twice. Pictures of the same
file name are paired as far as there are any, the others at random.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import combinations
from pathlib import Path

import numpy as np
from PIL import Image, ImageOps

from pbrnet.model.studies.pairs.answers import FolderKey, FolderPair, PictureFile
from pbrnet.model.studies.pairs.study import (
    PairPlan,
    PairsConfig,
    PlannedPair,
    WrittenPage,
    equal_length_pngs,
    key_path_of,
    pair_id,
    plan_pairs,
    write_page_and_key,
)
from pbrnet.pipeline.images import Picture
from pbrnet.pipeline.progress import Progress
from pbrnet.scenes.checked import check_name, shown
from pbrnet.scenes.errors import InputError, ParameterError
from pbrnet.scenes.files import digest_bytes, resolved
from pbrnet.scenes.image_files import UnreadableImage, open_image
from pbrnet.scenes.seeds import generator

SUFFIXES = (".png", ".jpg", ".jpeg")
SHORTEST, LONGEST = 64, 960  # pixels: least side of a picture, greatest side on the page
_MAX_QUESTION = 90  # characters; a line of a phone held sideways

Files = Mapping[str, Mapping[str, Path]]  # folder -> file name without suffix -> file


def parse_folders(texts: Sequence[str]) -> tuple[tuple[str, Path], ...]:
    """Return names and places of folders given as `NAME=FOLDER`; raises `ParameterError`."""
    folders: dict[str, Path] = {}
    for text in texts:
        name, equals, place = text.partition("=")
        if not equals or not place:
            raise ParameterError(f"--folder: {shown(text)} is not of the form NAME=FOLDER")
        check_name(name, "the name of a folder of pictures", "--folder")
        if name in folders:
            raise ParameterError(f"--folder: the name {name} is given twice")
        if resolved(Path(place)) in map(resolved, folders.values()):
            raise ParameterError(f"--folder: {shown(place)} is given twice")
        folders[name] = Path(place)
    if len(folders) < 2:
        raise ParameterError("--folder: give at least two folders, NAME=FOLDER each")
    return tuple(folders.items())


def find_pictures(folder: Path) -> dict[str, Path]:
    """Return the PNG and JPEG files of a folder by name without suffix, sorted.

    Hidden files and what is not a regular file are left out. Raises `InputError` if there are no
    pictures, two of the same name, or an unprintable name.
    """
    try:
        paths = sorted(folder.iterdir())
    except OSError as error:
        raise InputError(f"{folder}: {error.strerror}") from None
    found: dict[str, Path] = {}
    for path in paths:
        if path.suffix.lower() not in SUFFIXES or path.name.startswith(".") or not path.is_file():
            continue
        if not path.name.isprintable():
            raise InputError(f"{folder}: a file name with unprintable signs, {shown(path.name)}")
        if path.stem in found:
            raise InputError(
                f"{path}: the same name as {found[path.stem].name}, but pictures are paired by "
                "name; rename or remove one"
            )
        found[path.stem] = path
    if not found:
        raise InputError(f"{folder}: no pictures ({', '.join(SUFFIXES)})")
    return found


def plan_folders(
    files: Files, wanted: int, rng: np.random.Generator
) -> tuple[PairPlan, dict[PlannedPair, tuple[PictureFile, PictureFile]]]:
    """Draw pairs, sides and order at random; return the plan, and both pictures of each pair.

    Every two folders have the same even number of pairs, with either on the left in half of them.
    Raises as `plan_pairs` for too few pairs or pictures.
    """
    both = {f"{one} and {two}": (one, two) for one, two in combinations(files, 2)}
    block = 2 * len(both)
    if wanted < block:
        raise ParameterError(
            f"--pairs: {wanted} is not allowed; {len(files)} folders need at least {block}, for "
            "every two of them one with each on the left"
        )
    smallest = min(files, key=lambda name: len(files[name]))
    most = len(files[smallest]) // (len(files) - 1)
    if most < 2:
        raise InputError(
            f"--folder {smallest}: pictures: {len(files[smallest])}; {len(files)} folders need "
            f"at least {2 * len(files) - 2} of each, because none is shown twice"
        )
    plan = plan_pairs(list(both), len(both) * most, wanted, rng)
    unused = {}
    for folder, found in files.items():
        stems = list(found)
        unused[folder] = {stems[i]: found[stems[i]] for i in rng.permutation(len(stems))}
    alike = {name: len(files[one].keys() & files[two].keys()) for name, (one, two) in both.items()}
    drawn = {}
    # Folders that share names come first, so that no others use up these pictures.
    for pair in sorted((*plan.pairs, *plan.practice), key=lambda pair: -alike[pair.method]):
        one, two = both[pair.method]
        stem = next((stem for stem in unused[one] if stem in unused[two]), None)
        pictures = [
            PictureFile(folder, unused[folder].pop(stem or next(iter(unused[folder]))).name)
            for folder in (one, two)
        ]
        if pair.truth == "right":
            pictures.reverse()
        drawn[pair] = (pictures[0], pictures[1])
    return plan, drawn


def read_pair(paths: Sequence[Path]) -> list[Picture]:
    """Read two pictures, upright, cropped in the middle and shrunk to the same size.

    Raises `InputError` for what is not a picture of 8 bits and at least `SHORTEST` pixels a side.
    """
    images = [_read(path) for path in paths]
    width, height = (min(sides) for sides in zip(*(image.size for image in images), strict=True))
    scale = min(1.0, LONGEST / max(width, height))
    size = (max(1, round(scale * width)), max(1, round(scale * height)))
    return [np.asarray(ImageOps.fit(image, size, Image.Resampling.LANCZOS)) for image in images]


def write_folders_page(
    seed: int, config: PairsConfig, out: Path, replace: bool = False
) -> WrittenPage:
    """Write the page `out` about `config.folders`, and its key `NAME-key.json` beside it.

    Raises as `write_pairs_page`, `find_pictures`, `plan_folders` and `read_pair`.
    """
    question = config.question
    if not question.strip() or len(question) > _MAX_QUESTION or not question.isprintable():
        raise ParameterError(
            f"--question: {shown(question)} is not allowed; 1 to {_MAX_QUESTION} characters"
        )
    places = dict(config.folders)
    files = {name: find_pictures(place) for name, place in config.folders}
    # As for methods: the sides do not follow from the page alone.
    known = [
        (name, file.name, file.stat().st_size) for name in files for file in files[name].values()
    ]
    secret = digest_bytes(repr(known).encode())
    rng = generator(seed, "study", "pairs", "folders", secret)
    plan, drawn = plan_folders(files, config.pairs, rng)
    shown_pairs = {}
    with Progress(len(drawn), "study pairs", "pairs") as progress:
        for pair in (*plan.practice, *plan.pairs):
            pictures = read_pair([places[one.folder] / one.file for one in drawn[pair]])
            shown_pairs[pair] = equal_length_pngs(pictures, rng)
            progress.advance()

    def key_of(page: str) -> FolderKey:
        return FolderKey(
            study="pairs",
            version=2,
            page=page,
            seed=seed,
            question=question,
            seconds=config.seconds,
            answer_seconds=config.answer_seconds,
            folders=tuple(files),
            pairs=tuple(
                FolderPair(pair_id(index), *drawn[pair]) for index, pair in enumerate(plan.pairs)
            ),
        )

    key = write_page_and_key(out, seed, config, plan, shown_pairs, key_of, replace)
    smallest = min(map(len, files.values()))
    return WrittenPage(key, key_path_of(out), smallest, plan.each, len(plan.practice))


def _read(path: Path) -> Image.Image:
    try:
        image = open_image(path, upright=True)
    except UnreadableImage as error:
        raise InputError(f"{path}: {error}") from None
    if image.mode.startswith(("I", "F")):
        raise InputError(f"{path}: more than 8 bits a channel; save it with 8")
    if min(image.size) < SHORTEST:
        raise InputError(
            f"{path}: {image.width} x {image.height} pixels; at least {SHORTEST} a side are needed"
        )
    return image.convert("RGB")
