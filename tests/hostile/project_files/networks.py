"""Hostile weights and model cards."""

import json
from pathlib import Path
from typing import Any

import numpy as np

from tests.hostile.family import Family, Made, Victim
from tests.hostile.made import case, with_file, with_link, with_value
from tests.hostile.mutations import LONG, damaged_bytes, damaged_json, damaged_text, deep
from tests.hostile.project_files.base import PREDICT, write_frames

CARD, WEIGHTS = "models/shading.json", "models/shading.safetensors"

MODEL = (PREDICT, PREDICT, f"inspect {WEIGHTS} --out p.png", f"inspect {CARD} --json --text-only")


def _digests(folder: Path) -> None:
    """Let the cards hold the digests of the weights, so that damage is not seen by them."""
    from pbrnet.scenes.files import digest_file

    if not (folder / WEIGHTS).is_file() or (folder / WEIGHTS).stat().st_size > 2**28:
        return
    digest = digest_file(folder / WEIGHTS)
    for name in ("shading", "composition"):
        path = folder / f"models/{name}.json"
        content = json.loads(path.read_text())
        if name == "shading":
            content["sha256"] = digest
        else:
            content["needs"]["shading"] = digest
        path.write_text(json.dumps(content))


@case
def _weights(folder: Path, value: float, command: str = PREDICT, whole: bool = True) -> str:
    from safetensors.numpy import load_file, save_file

    state = load_file(folder / WEIGHTS)
    for name in state if whole else list(state)[:1]:
        state[name] = np.full_like(state[name], value)
    save_file(state, folder / WEIGHTS)
    _digests(folder)
    return command


def _card(*path: str, value: Any, command: int = 0) -> Made:
    return with_value(CARD, MODEL[command], path, value)


CARDS_MADE = (
    *(
        with_file(CARD, text, MODEL[command])
        for command in (0, 2, 3)
        for text in (
            "",
            "[]",
            "null",
            deep(),
            LONG,
            '{"a": ' + "1" * 400 + "}",
            '{"a": "\\ud800"}',
            '{"a":' * 5000 + "1" + "}" * 5000,
        )
    ),
    *(
        _card("architecture", name, value=value)
        for name in ("width", "levels")
        for value in (0, -1, 1_000_000, 10**9, 10**400, 64, 1.5, "8", None, True)
    ),
    *(_card("architecture", "kind", value=value) for value in ("x", [], "pix2pix", "plus")),
    *(_card("white", value=value) for value in (0, -1, 1e308, 10**400)),
    *(_card("tone", value=value) for value in ({}, {"key": 0, "burn": 0}, {"x": 1}, [], None)),
    *(_card("architecture", "revision", value=value) for value in (0, 2, "x", None)),
    _card("needs", value={"../../x": "y"}),
    _card("name", value="../../../x"),
    _card("training", value=[]),
    _card("training", value={"noisy_spp": 10**9}),
    _card("training", value={"materials": "x", "noisy_spp": "y"}),
    _card("data", value={}),
    _card("licence", value="\ud800"),
    _card("precision", value="x"),
)


FAMILIES = (
    Family(
        "weights",
        80,
        write_frames,
        (Victim(WEIGHTS, damaged_bytes, MODEL[:3]),),
        (
            _weights(float("nan")),
            _weights(float("inf")),
            _weights(1e30),
            _weights(float("nan"), whole=False),
            _weights(float("nan"), MODEL[2]),
            with_link(WEIGHTS, "/dev/zero", MODEL[2]),
            with_link(WEIGHTS, "x", PREDICT),
        ),
        _digests,
        seconds=1.0,
    ),
    Family(
        "model cards",
        140,
        write_frames,
        (Victim(CARD, damaged_json, MODEL), Victim(CARD, damaged_text, MODEL)),
        CARDS_MADE,
    ),
)
