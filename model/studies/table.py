"""Method table: all methods trained alike (Table I of the paper)."""

from __future__ import annotations

from collections.abc import Sequence

from pbrnet.model.methods import BASELINES, METHODS
from pbrnet.model.options import methods_option
from pbrnet.model.studies.trials.command import (
    TrialRequest,
    trial_command,
    views_option,
)
from pbrnet.model.studies.trials.plan import STAGES, TrialStudy, Variant


def table_study(methods: Sequence[str]) -> TrialStudy:
    """Return the study: both networks beside these methods, each with its own loss if it has one.

    Every method gets as many steps as both networks together. A method that takes noisy samples is
    compared with the denoised samples, too.
    """
    both = Variant("pbrnet", STAGES, {"pbrnet": "pbrnet", "product": "product"})
    others = []
    for name in dict.fromkeys(methods):
        denoised = {"denoised": "denoised"} if METHODS[name].takes_samples else {}
        others.append(Variant(name, (name,), {name: name, **denoised}))
    return TrialStudy("table", (both, *others), reference="pbrnet")


@trial_command(
    "table",
    """
  pbrnet study table --dry-run
  pbrnet study table --steps 2000 --views 200       train.baselines, three trainings of each
  pbrnet study table --method unet --method can_own --method plus
""",
    methods_option(BASELINES, "Method to compare with (repeatable).  [default: train.baselines]"),
    views_option,
    seeds=3,
)
def command(request: TrialRequest, methods: tuple[str, ...]) -> None:
    """Train all methods under equal conditions and compare them (Table I).

    All methods get the same views and steps, and are trained several times. Intervals tell how much
    other test scenes would change a mean, the spread how much another training would.
    """
    request.run(table_study(methods or request.params.train.baselines))
