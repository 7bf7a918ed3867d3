"""Preparation of a view: light plan and guides that transport and path-traced samples share."""

from __future__ import annotations

from dataclasses import dataclass

from pbrnet.pipeline.passes.denoise import Guides, guides
from pbrnet.pipeline.passes.groundtruth import planned_lights
from pbrnet.pipeline.pathtrace import integrator
from pbrnet.pipeline.pathtrace.light_sampling import PlannedLights
from pbrnet.pipeline.render.scene import RenderScene
from pbrnet.pipeline.transport.guides import fast_guides
from pbrnet.pipeline.views import View


@dataclass(frozen=True)
class Preparation:
    """Guides for the denoiser, and emitter sampling and path guiding of a view.

    `lights` is None where nothing is planned: in a scene without lights, in a scalar variant, and
    for a panorama.
    """

    guides: Guides
    lights: PlannedLights | None


def prepare(scene: RenderScene, view: View, seed: int) -> Preparation:
    """Prepare a view in the scene's own colours; `seed` is that of the light plan."""
    form = scene.neutral(None).mitsuba
    planned = integrator.available() and not view.is_panorama and form.emitters()
    lights = planned_lights(scene, form, view, seed) if planned else None
    return Preparation(sample_guides(scene, view), lights)


def sample_guides(scene: RenderScene, view: View) -> Guides:
    """Return guides that cost less than the samples they guide, where the variant has them."""
    if integrator.available() and not view.is_panorama:
        return fast_guides(scene, view)
    return guides(scene, view)
