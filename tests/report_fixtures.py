"""Models, metrics, plots and a ledger as the other stages leave them, with made-up figures."""

from __future__ import annotations

import csv
import json
import math
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import numpy as np

from pipeline.costs.ledger import Ledger
from pipeline.images import error_picture, png_bytes


def make_results(root: Path, keys: list[tuple[str, str]], size: tuple[int, int]) -> None:
    """Fill `root/models`, `metrics` and `plots` as if `keys` had been evaluated."""
    random = np.random.default_rng(0)
    for name in ("models", "metrics/examples", "plots"):
        (root / name).mkdir(parents=True, exist_ok=True)
    write(
        root / "models" / "backbone.json",
        {"network": "efficientnet_lite0", "source": "package", "licence": "Apache-2.0"},
    )
    for name, epochs in (("shading", 14), ("composition", 12)):
        write(root / "models" / f"{name}.json", {"name": name, "training": {"epochs": epochs}})
    for name in ("shading", "composition", "unet"):
        with (root / "plots" / f"train_{name}.csv").open("w", newline="") as stream:
            writer = csv.writer(stream)
            writer.writerow(("step", "epoch", "train_loss", "validation_loss"))
            for step in range(0, 1001, 50):
                loss = 8 * math.exp(-step / 250) + 0.4 + 0.1 * random.random()
                valid = f"{loss + 0.2:.4f}" if step % 200 == 0 else ""
                writer.writerow((step, step // 100, f"{loss:.4f}", valid))
    methods = ("pbrnet", "product", "unet", "ceiling")
    with (root / "metrics" / "evaluation.csv").open("w", newline="") as stream:
        writer = csv.writer(stream)
        writer.writerow(("scene_id", "view_id", "method", "ssim", "psnr", "flip", "lpips"))
        for scene_id, view_id in keys:
            for index, method in enumerate(methods):
                flip = random.normal(0.35 - 0.04 * index, 0.05)
                writer.writerow((scene_id, view_id, method, 1 - flip, 18 + 10 * flip, flip, ""))
    figures = {
        method: {
            "ssim": {"mean": 0.74 + 0.03 * index, "low": 0.7, "high": 0.8 + 0.03 * index},
            "psnr": {"mean": 17.5 + index, "low": None, "high": None},
            "flip": {"mean": 0.4 - 0.05 * index, "low": 0.3, "high": 0.42},
            "lpips": None,
            "seconds": None if method == "ceiling" else 0.013 * (index + 1),
        }
        for index, method in enumerate(methods)
    }
    write(
        root / "metrics" / "evaluation.json",
        {
            "split": "test",
            "views": len(keys),
            "scenes": len({scene for scene, _ in keys}),
            "backbone": "efficientnet_lite0",
            "exposure": "shared",
            "methods": figures,
            "timing": {"shading": 0.013, "composition": 0.012, "renderer_color": 2.5},
            "examples": {"best": keys[:2], "worst": keys[-2:]},
        },
    )
    for scene_id, view_id in (*keys[:2], *keys[-2:]):
        for part in ("prediction", "shading", "error", "unet", "product"):
            ramp = np.linspace(0, 1, size[0])[None].repeat(size[1], axis=0)
            picture = error_picture(ramp * random.random())
            path = root / "metrics" / "examples" / f"{scene_id}--{view_id}--{part}.png"
            path.write_bytes(png_bytes(picture))


def make_ledger(data: Path, keys: list[tuple[str, str]]) -> None:
    """Costs of two stages; the first view was made twice."""
    ledger = Ledger(data)
    random = np.random.default_rng(1)
    began = datetime(2026, 1, 1, tzinfo=UTC)
    for stage, seconds in (("inputs", 0.1), ("color", 3.0)):
        for key in (keys[0], *keys):
            cost = seconds * random.uniform(0.8, 1.6)
            began += timedelta(seconds=cost)
            known = {"ended": began, "memory_mb": 400.0, "peak_mb": 450.0}
            ledger.add((stage, *key), seconds=cost, worker="w0", attempt=1, spp=64, **known)
    ledger.save()


def write(path: Path, value: Any) -> None:
    """Plain JSON."""
    path.write_text(json.dumps(value))
