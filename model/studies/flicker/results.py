"""The flicker study: its file's contract, and its part of the report."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, Literal

from model.figures.records import Records
from model.figures.results import METHODS, known_first
from scenes.checked import within

Move = Literal["dolly", "truck", "pan", "still"]
MOVES: dict[Move, str] = {
    "dolly": "{:g} m ahead",
    "truck": "{:g} m to the right",
    "pan": "a turn of {:g}° to the right",
    "still": "no move",
}
RENDERER = {
    "renderer": "The renderer, each frame by its own exposure",
    "renderer_one_exposure": "The renderer, all frames by the first one's exposure",
}


@dataclass(frozen=True)
class Flicker:
    """One method's: mean absolute difference of display values, of each pair of frames and all."""

    mean: float = field(metadata=within(0, 1))
    pairs: tuple[float, ...]

    def verify(self, where: str) -> None:
        """Raises ValueError if no frames were compared."""
        if not self.pairs:
            raise ValueError(f"{where}.pairs: there are none")


@dataclass(frozen=True)
class FlickerResult:
    """`metrics/studies/flicker.json`."""

    scene_id: str
    view_id: str  # that the move begins at
    width: int = field(metadata=within(1))
    height: int = field(metadata=within(1))
    seed: int
    move: Move
    frames: int = field(metadata=within(2))
    step: float = field(metadata=within(0))  # metres or degrees a frame
    spp: int = field(metadata=within(1))  # of the renderer's frames
    denoise: str
    visible: float = field(metadata=within(0, 1))  # share of pixels that both of a pair see
    methods: dict[str, Flicker]
    weights: dict[str, dict[str, str]]  # method -> network -> SHA-256


def flicker_study(records: Records) -> dict[str, Any] | None:
    """What the report shows of the study; None, and a note if damaged, without a result."""
    result = records.study("flicker", FlickerResult)
    if result is None:
        return None
    truth = result.methods.get("renderer")
    return {
        "result": result,
        "move": MOVES[result.move].format(result.step),
        "rows": [
            {
                "name": name,
                "words": {**METHODS, **RENDERER}.get(name, name),
                "flicker": result.methods[name],
                "times": result.methods[name].mean / truth.mean if truth and truth.mean else None,
            }
            for name in known_first(result.methods, [*RENDERER, *METHODS])
        ],
        "picture": records.study_picture("flicker"),
    }
