"""Homes are made again when what determines them changes."""

from dataclasses import replace
from pathlib import Path

from pbrnet.pipeline.params import Params
from pbrnet.pipeline.stages import scenes
from pbrnet.scenes.assets.index import AssetIndex, IndexEntry, save_index


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
        (job,) = scenes.home_jobs(tmp_path / "scenes", params.scenes, params.seed)
        found.append(job.fingerprint)
    assert found[0] != found[1]
