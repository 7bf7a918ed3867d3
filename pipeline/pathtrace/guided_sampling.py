"""Path guiding at a vertex: mixture of BSDF sampling and directions to guiding targets."""

from __future__ import annotations

from dataclasses import dataclass

import drjit as dr
import mitsuba as mi
import numpy as np

from pbrnet.pipeline.pathtrace.guiding import MAX_TARGETS, GuidingPlan
from pbrnet.pipeline.pathtrace.rectangle_sampling import RectangleSampler, below_one, choose

_MAX_GUIDED = 0.4  # probability of a guided direction where all indirect light is from targets


@dataclass(init=False, eq=False)
class PathGuide:
    """Guiding distribution of a view, from a `GuidingPlan`."""

    targets: RectangleSampler
    indirect: mi.Float  # mean irradiance by indirect light, W/m^2

    def __init__(self, plan: GuidingPlan, indirect: float) -> None:
        self.targets = RectangleSampler(plan.targets, plan.strengths, np.zeros(0), MAX_TARGETS)
        self.indirect = dr.opaque(mi.Float, indirect)

    def at(self, si: mi.SurfaceInteraction3f, active: mi.Bool) -> Guidance:
        """Return the guiding distribution at a vertex."""
        facing = dr.mulsign(si.n, mi.Frame3f.cos_theta(si.wi))
        weights = self.targets.weights(si.p, facing, one_sided=True)
        total = sum(weights, mi.Float(0))
        share = dr.select(active & (total > 0), _MAX_GUIDED * total / (total + self.indirect), 0)
        probabilities = [dr.select(total > 0, weight / total, 0) for weight in weights]
        return Guidance(share, probabilities, self.targets, si.p)


@dataclass(eq=False)
class Guidance:
    """Guiding distribution at a vertex: a direction is guided with the probability `share`."""

    share: mi.Float
    probabilities: list[mi.Float]  # of each target; they sum to 1
    targets: RectangleSampler
    position: mi.Point3f

    def split(self, random: mi.Float) -> tuple[mi.Bool, mi.Float]:
        """Decide with a random number whether to guide; also return the number, stretched anew."""
        guided = random < self.share
        return guided, below_one(
            dr.select(guided, random / self.share, (random - self.share) / (1 - self.share))
        )

    def direction(self, first: mi.Float, second: mi.Point2f) -> mi.Vector3f:
        """Sample a direction to a target with a random number and a random point in [0, 1)^2."""
        target, _ = choose(self.probabilities, first)
        return dr.normalize(self.targets.point(target, second) - self.position)

    def mixed_density(self, pdf: mi.Float, direction: mi.Vector3f) -> mi.Float:
        """Return the mixture's density of a direction with density `pdf` by the BSDF."""
        guided = self.targets.density(self.position, direction, self.probabilities)
        return (1 - self.share) * pdf + self.share * guided
