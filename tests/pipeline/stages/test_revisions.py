"""Scenes and catalogue pieces are made again when code or assets that determine them change."""

from __future__ import annotations

import shutil
from dataclasses import replace
from pathlib import Path

import pytest

from pbrnet.pipeline.params import Params
from pbrnet.pipeline.stages import scene_jobs
from pbrnet.pipeline.stages.assets import _CONVERTER
from pbrnet.pipeline.versions import source_revision
from pbrnet.scenes.assets.index import AssetIndex, IndexEntry, save_index
from tests.fixtures.paths import ROOT

HOME, IMPORT, PIECE = scene_jobs._HOME_CODE, scene_jobs._IMPORT_CODE, (_CONVERTER,)


@pytest.fixture(scope="module")
def sources(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A copy of the sources that a test may edit."""
    root = tmp_path_factory.mktemp("sources")
    for package in ("scenes", "pipeline"):
        shutil.copytree(ROOT / package, root / package, ignore=shutil.ignore_patterns("*.pyc"))
    return root


def _changed(sources: Path, file: str, code: tuple[str, ...]) -> bool:
    """Return whether one more line in `file` changes the revision of `code`."""
    source_revision.cache_clear()
    before = source_revision(*code, root=sources)
    path = sources / file
    text = path.read_text()
    path.write_text(text + "\nONE_MORE_LINE = 1\n")
    source_revision.cache_clear()
    after = source_revision(*code, root=sources)
    path.write_text(text)
    return before != after


@pytest.mark.slow
@pytest.mark.parametrize(
    "file",
    [
        "scenes/photometry.py",
        "scenes/seeds.py",
        "scenes/contract.py",
        "scenes/color.py",
        "scenes/assets/index.py",
        "scenes/formats/ply.py",
        "scenes/procedural/home.py",
        "scenes/params.py",
    ],
)
def test_homes_depend_on_the_code_of_their_generator(sources: Path, file: str) -> None:
    assert _changed(sources, file, HOME)


@pytest.mark.slow
@pytest.mark.parametrize("code", [HOME, IMPORT, PIECE])
def test_nothing_depends_on_code_that_is_never_imported(
    sources: Path, code: tuple[str, ...]
) -> None:
    assert not _changed(sources, "pipeline/dataset/description/card.py", code)


@pytest.mark.parametrize("code", [IMPORT, PIECE])
def test_imports_and_pieces_depend_on_the_readers_of_models(
    sources: Path, code: tuple[str, ...]
) -> None:
    assert _changed(sources, "scenes/formats/obj.py", code)


@pytest.mark.slow
def test_homes_do_not_depend_on_importers(sources: Path) -> None:
    assert not _changed(sources, "scenes/mitsuba/importer.py", HOME)
    assert _changed(sources, "scenes/mitsuba/importer.py", IMPORT)


def test_a_furnished_home_depends_on_the_content_of_its_catalogue(tmp_path: Path) -> None:
    piece = IndexEntry(
        key="library/chair",
        name="Chair",
        category="chair",
        group="seat",
        words="chair",
        size=(0.5, 0.5, 1.0),
        elevation=0.0,
        triangles=100,
        lumens=0.0,
        opening=False,
        movable=True,
        levels=0,
        creator="nobody",
        licence="CC0-1.0",
        fingerprint="of the first conversion",
    )
    params = Params()
    params = replace(params, scenes=replace(params.scenes, homes=1, catalogue_share=0.5))
    found = []
    for fingerprint in ("of the first conversion", "of another conversion"):
        (tmp_path / "assets").mkdir(exist_ok=True)
        save_index(
            tmp_path / "assets", AssetIndex((), (replace(piece, fingerprint=fingerprint),), ())
        )
        (job,) = scene_jobs.home_jobs(tmp_path / "scenes", params)
        found.append(job.fingerprint)
    assert found[0] != found[1]
