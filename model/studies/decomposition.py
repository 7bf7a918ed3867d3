"""Decomposition study: supervised shading against one stage (Figure 8 of the paper)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import click

from pbrnet.model.baselines.end_to_end import composition_of
from pbrnet.model.methods import BASELINES
from pbrnet.model.networks.pbrnet import Architecture
from pbrnet.model.options import methods_option
from pbrnet.model.settings import StageTrainParams
from pbrnet.model.studies.trials.command import TrialRequest, trial_command
from pbrnet.model.studies.trials.plan import STAGES, TrialStudy, Variant


def decomposition_study(first: StageTrainParams, methods: Sequence[str] = ()) -> TrialStudy:
    """Return the study: the same layers with and without supervised shading, and one U-Net.

    The number of training views varies. All three have the width and depth of the parameters'
    shading network; `methods`, further methods of the registry, have their own.
    """
    second = composition_of(Architecture("shading", first.width, first.levels))
    changes: dict[str, Any] = {}
    for name, size in (("composition", second), ("end_to_end", first), ("unet", first)):
        changes[f"train.{name}.width"] = size.width
        changes[f"train.{name}.levels"] = size.levels
    more = [name for name in dict.fromkeys(methods) if name not in ("end_to_end", "unet")]
    return TrialStudy(
        name="decomposition",
        variants=(
            Variant("two_stage", STAGES, {"pbrnet": "two_stage"}, changes),
            *(Variant(name, (name,), {name: name}, changes) for name in ("end_to_end", "unet")),
            *(Variant(name, (name,), {name: name}) for name in more),
        ),
        reference="two_stage",
        varies_views=True,
    )


@trial_command(
    "decomposition",
    """
  pbrnet study decomposition --dry-run
  pbrnet study decomposition --steps 2000                 a quarter, half, and all of the views
  pbrnet study decomposition --views 20 --views 80 --seeds 3
  pbrnet study decomposition --method plus                also the learning curve of PBR-Net plus
""",
    methods_option(BASELINES, "Additional method to train (repeatable)."),
    click.option(
        "--views",
        type=click.IntRange(1),
        multiple=True,
        help="Number of training views (repeatable).  [default: a quarter, half, all]",
    ),
    notes="Training views are taken by whole floor plans, in random order, until there are at "
    "least as many as requested.",
)
def command(request: TrialRequest, methods: tuple[str, ...]) -> None:
    """Compare two stages with one (Figure 8).

    Supervised shading, the same layers trained on colour only, and one U-Net, by the number of
    training views; with an extrapolation to ten times as many views.
    """
    request.run(decomposition_study(request.params.train.shading, methods))
