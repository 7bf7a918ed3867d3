"""Sampling of scene emitters by their own methods, with the probabilities of a light plan."""

from __future__ import annotations

from dataclasses import dataclass

import drjit as dr
import mitsuba as mi
import numpy as np

from pbrnet.pipeline.pathtrace.light_plan import LightPlan
from pbrnet.pipeline.pathtrace.portals import below_one, geometry_factor, opaque_floats
from pbrnet.pipeline.render.drjit_arrays import column

MAX_WEIGHTED = 12  # emitters with a weight of their own at each vertex


@dataclass(init=False, eq=False)
class EmitterSampler:
    """Emitters of a scene, among them the environment with its own sampling.

    The most likely ones have a slot, hence a weight of their own at every vertex. The others share
    one more entry and are chosen among themselves by the view's probabilities.
    """

    slots: int
    numbers: list[mi.Float]  # 7 per slot: centre, spread, strengths in- and outdoors, share
    slot_of: mi.UInt32  #  by an emitter's registry id; `slots` for the others
    share_of: mi.Float  #  by registry id: an emitter's share among the others
    rest: mi.Float  # probability of all others together in the whole view
    emitters: mi.EmitterPtr  # those in slots, then the others
    choice: mi.DiscreteDistribution  #  over the others; None if there are none

    def __init__(self, scene: mi.Scene, plan: LightPlan) -> None:
        emitters = scene.emitters()
        sampled = np.flatnonzero(plan.emitters)
        strengths = plan.strengths
        order = (
            sampled
            if strengths is None
            else sampled[np.argsort(-plan.emitters[sampled], kind="stable")]
        )
        self.slots = min(MAX_WEIGHTED, len(sampled)) if strengths is not None else 0
        weighted, others = order[: self.slots], np.sort(order[self.slots :])
        numbers = np.zeros((self.slots, 7))
        if plan.extents is not None and strengths is not None:
            numbers[:, :3] = plan.extents.centre[weighted]
            numbers[:, 3] = plan.extents.spread[weighted]
            numbers[:, 4:6] = strengths.emitters[:, weighted].T
            numbers[:, 6] = plan.emitters[weighted]
        self.numbers = opaque_floats(numbers)
        registry = np.array(dr.reinterpret_array(mi.UInt32, mi.EmitterPtr(list(emitters))))
        slot_of = np.full(registry.max() + 1, self.slots, dtype=np.uint32)
        slot_of[registry[weighted]] = np.arange(self.slots)
        rest = float(plan.emitters[others].sum())
        share_of = np.zeros(registry.max() + 1)
        if len(others):
            share_of[registry[others]] = plan.emitters[others] / rest
        self.slot_of, self.share_of = column(mi.UInt32, slot_of), column(mi.Float, share_of)
        self.rest = dr.opaque(mi.Float, rest)
        # From memory: a single id would be compiled in.
        numbers = column(mi.UInt32, registry[[*weighted, *others]])
        self.emitters = dr.reinterpret_array(mi.EmitterPtr, numbers)
        self.choice = None
        if len(others):
            self.choice = mi.DiscreteDistribution(column(mi.Float, plan.emitters[others]))

    def weights(
        self, position: mi.Point3f, normal: mi.Normal3f, outdoors: mi.Bool
    ) -> list[mi.Float]:
        """Return the approximate irradiance by each slot's emitter at a vertex, then 0."""
        weights = []
        for slot in range(self.slots):
            x, y, z, spread, indoor_strength, outdoor_strength, _ = self._slot(slot)
            strength = dr.select(outdoors, outdoor_strength, indoor_strength)
            offset = mi.Vector3f(x, y, z) - position
            squared = dr.squared_norm(offset)
            cosine = dr.abs(dr.dot(offset, normal)) * dr.rsqrt(squared + 1e-12)
            weights.append(strength * geometry_factor(cosine, squared, spread))
        return [*weights, mi.Float(0)]

    def view_probabilities(self) -> list[mi.Float]:
        """Return the view's probability of each slot and of the others together."""
        return [*(self._slot(slot)[6] for slot in range(self.slots)), self.rest]

    def probability(self, emitter: mi.EmitterPtr, probabilities: list[mi.Float]) -> mi.Float:
        """Return the probability that an emitter is sampled, given those at the vertex."""
        number = dr.reinterpret_array(mi.UInt32, emitter)
        known = number < dr.opaque(mi.UInt32, dr.width(self.slot_of))
        slot = dr.gather(mi.UInt32, self.slot_of, number, known)
        share = dr.gather(mi.Float, self.share_of, number, known)
        found = share * probabilities[self.slots]
        for index in range(self.slots):
            found = dr.select(slot == index, probabilities[index], found)
        return dr.select(known, found, 0)

    def emitter(self, index: mi.UInt32, sample: mi.Point2f) -> tuple[mi.EmitterPtr, mi.Point2f]:
        """Return the emitter of a slot, or one of the others, and the random numbers left.

        `sample` in [0, 1)^2 chooses among the others; its used component is stretched anew.
        """
        if self.choice is None:
            slot = dr.minimum(index, self.slots - 1)
            return dr.gather(mi.EmitterPtr, self.emitters, slot), sample
        other, stretched, _ = self.choice.sample_reuse_pmf(sample.x)
        is_other = index >= self.slots
        row = dr.select(is_other, self.slots + other, index)
        x = dr.select(is_other, below_one(stretched), sample.x)
        return dr.gather(mi.EmitterPtr, self.emitters, row), mi.Point2f(x, sample.y)

    def _slot(self, slot: int) -> list[mi.Float]:
        return self.numbers[7 * slot : 7 * slot + 7]
