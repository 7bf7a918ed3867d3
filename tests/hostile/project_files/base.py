"""Sound files of the project on which several families build."""

from pathlib import Path
from typing import Any

import yaml

from tests.fixtures.paths import ROOT

FRAME = "data/inputs/box/v0.exr"

PREDICT = (
    "predict --inputs data/inputs/box/v0.exr --illumination data/illumination/box/v0.exr "
    "--models models --data data"
)


def write_params(folder: Path, **sections: Any) -> None:
    content = yaml.safe_load((ROOT / "params.yaml").read_text(encoding="utf-8"))
    for name, section in sections.items():
        content[name] = {**content[name], **section}
    (folder / "params.yaml").write_text(yaml.safe_dump(content), encoding="utf-8")


def small_params(folder: Path) -> None:
    tiny = {"width": 2, "levels": 1, "epochs": 1}
    write_params(
        folder,
        image={"width": 32, "height": 24},
        illumination={"width": 32},
        scenes={"homes": 1},
        farm={"workers": 1},
        train={"unet": tiny},
    )


def write_frames(folder: Path) -> None:
    """Frames, cameras and a scene of a box room, and networks that nobody trained."""
    from pbrnet.pipeline.params import load_params
    from pbrnet.pipeline.views import CameraFile, save_cameras
    from tests.fixtures.predict import box_frames, box_room
    from tests.fixtures.predictor import untrained_models

    small_params(folder)
    load_params(folder / "params.yaml")
    view = box_frames(folder / "data", width=32, height=24, panorama=32)
    box_frames(folder / "data", name="v1", width=32, height=24, panorama=32)
    box_room(folder / "data", view)
    save_cameras(folder / "data" / "cameras" / "box.json", CameraFile("box", (view,)))
    untrained_models(folder / "models", width=2, levels=2)


def write_ledger(folder: Path) -> None:
    from pbrnet.pipeline.costs.ledger import Ledger

    small_params(folder)
    (folder / "data").mkdir()
    ledger = Ledger(folder / "data")
    for stage in ("scenes", "cameras", "inputs", "illumination", "color", "shading"):
        for scene in "abc":
            view = "" if stage in ("scenes", "cameras") else "000"
            ledger.add(
                (stage, scene, view),
                seconds=1.5,
                opening=0.1,
                first=True,
                threads=1,
                width=32,
                height=24,
                spp=16,
                noise=0.1,
                bytes=100,
                peak_mb=100.0,
                memory_mb=90.0,
                worker="w",
                attempt=1,
                renderer="r",
            )
    ledger.save()
