"""Results of the flicker study: the JSON contract and the report section."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

from pbrnet.model.figures.records import Records
from pbrnet.model.figures.results import known_first
from pbrnet.model.figures.section import Section
from pbrnet.model.studies.files import study_section
from pbrnet.model.titles import METHOD_TITLES
from pbrnet.scenes.checked import within

Move = Literal["dolly", "truck", "pan", "still"]
MOVES: dict[Move, str] = {
    "dolly": "{:g} m forward",
    "truck": "{:g} m to the right",
    "pan": "a turn of {:g}° to the right",
    "still": "no move",
}
RENDERER = {
    "renderer": "Renderer, every frame under its own exposure",
    "renderer_one_exposure": "Renderer, all frames under the exposure of the first",
}


@dataclass(frozen=True)
class MethodFlicker:
    """Mean absolute difference of display values, for all neighbouring frames and each pair."""

    mean: float = field(metadata=within(0, 1))
    pairs: tuple[float, ...]

    def verify(self, where: str) -> None:
        """Raise ValueError if no frames were compared."""
        if not self.pairs:
            raise ValueError(f"{where}.pairs: empty")


@dataclass(frozen=True)
class FlickerResult:
    """Contract of `metrics/studies/flicker.json`."""

    scene_id: str
    view_id: str  # start of the move
    width: int = field(metadata=within(1))
    height: int = field(metadata=within(1))
    seed: int
    move: Move
    frames: int = field(metadata=within(2))
    step: float = field(metadata=within(0))  # metres or degrees per frame
    spp: int = field(metadata=within(1))  # of the rendered frames
    denoise: str
    visible: float = field(
        metadata=within(0, 1)
    )  # share of pixels visible in both frames of a pair
    methods: dict[str, MethodFlicker]
    weights: dict[str, dict[str, str]]  # method -> network -> SHA-256


def report_section(records: Records) -> Section | None:
    """Return the report section; None, and a note if damaged, without a result."""
    result = records.study("flicker", FlickerResult)
    if result is None:
        return None
    truth = result.methods.get("renderer")
    titles = {**RENDERER, **METHOD_TITLES}
    return study_section(
        "flicker",
        "Temporal stability",
        result=result,
        move=MOVES[result.move].format(result.step),
        rows=[
            {
                "name": name,
                "title": titles.get(name, name),
                "flicker": result.methods[name],
                "ratio": result.methods[name].mean / truth.mean if truth and truth.mean else None,
            }
            for name in known_first(result.methods, titles)
        ],
        picture=records.study_picture("flicker"),
    )
