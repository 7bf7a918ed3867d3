"""A small workplace for the studies that train: box rooms, a backbone, tiny networks."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import yaml
from model_fixtures import box_rows, write_shard

from model.training.backbone import make_backbone
from model.training.train import Folders
from pipeline.params import BackboneParams, Params, StageTrainParams, TrainParams
from scenes.checked import plain

SIZE = {"width": 40, "height": 32, "panorama": 16}
SMALL = StageTrainParams(epochs=1, width=4, levels=3)
PARAMS = Params(
    train=TrainParams(
        learning_rate=1e-3,
        checkpoint_steps=2,
        precision="float32",
        shading=SMALL,
        composition=StageTrainParams(epochs=1, width=4, levels=1),
        unet=SMALL,
        end_to_end=SMALL,
    )
)
# Scene -> floor plan: two of the plans have two scenes.
TRAIN = {"a-0": "a", "a-1": "a", "b-0": "b", "b-1": "b", "c-0": "c", "d-0": "d"}
TEST = {"t-0": "t", "u-0": "u"}


def trial_workplace(root: Path, params: Params = PARAMS, noisy: bool = False) -> Folders:
    """Two views of each scene of `TRAIN` and `TEST`, as `pbrnet` expects them in `root`."""
    folders = folders_in(root)
    shards(folders.data, "train", list(TRAIN), noisy)
    shards(folders.data, "test", list(TEST), noisy)
    lines = [f"{scene},{plan}" for scene, plan in (TRAIN | TEST).items()]
    (folders.data / "dataset" / "scenes.csv").write_text("\n".join(["scene_id,plan", *lines]))
    make_backbone(BackboneParams(network="efficientnet_lite0"), folders.models)
    (root / "params.yaml").write_text(yaml.safe_dump(plain(params)))
    return folders


def folders_in(root: Path) -> Folders:
    """Where everything is in a workplace."""
    return Folders(*(root / part for part in ("data", "models", "metrics", "plots", "models")))


def shards(data: Path, split: str, scenes: Sequence[str], noisy: bool = False) -> None:
    """The split's rows over two shards."""
    half = (len(scenes) + 1) // 2
    for index, part in enumerate((scenes[:half], scenes[half:])):
        path = data / "dataset" / f"{split}-{index:05d}-of-00002.parquet"
        write_shard(path, box_rows(part, 2, split, noisy, **SIZE), row_group=3)
