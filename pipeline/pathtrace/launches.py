"""Launches of the joint path tracer that are recorded once for a scene and then repeated.

Before the first sample, Python and Dr.Jit take half a second of one core to trace a furnished
scene's path tracer through every material; in a small view that is more than its samples take.
`dr.freeze` keeps the launches and repeats them with new inputs. It does not notice when a virtual
call meets another object than it saw, so none is made anew between views: the sensor is moved.
"""

from __future__ import annotations

from typing import Any

import drjit as dr
import mitsuba as mi

from pipeline.pathtrace.integrator import JointPath
from pipeline.render.sensors import make_sensor, move_sensor
from pipeline.views import View

_LAYOUTS = 32  # launches kept: sizes, numbers of samples, and kinds of light plans


class FrozenTracer:
    """What is kept between the views of one open scene."""

    def __init__(self) -> None:
        self._suit: int | None = None
        self._sensors: dict[Any, Any] = {}
        self._launch: Any = None

    def launch(
        self, scene: Any, suit: int, view: View, copies: int, path: JointPath, spp: int, seed: int
    ) -> Any:
        """`copies` independent images of a view, side by side, by `path.integrator()`.

        `suit` is the number of the wardrobe's present twins: others are other objects.
        """
        if suit != self._suit:
            self._suit, self._launch = suit, dr.freeze(_launch, limit=_LAYOUTS, warn_after=_LAYOUTS)
        key = (view.width, view.height, copies, view.intrinsics.tobytes())
        if key not in self._sensors:
            sensor = make_sensor(view, copies)
            # As every launch leaves it: else the second one, which meets another film, is recorded.
            sensor.film().prepare(path.integrator().aov_names())
            dr.eval(sensor.film().develop())
            self._sensors[key] = sensor
        sensor = self._sensors[key]
        move_sensor(sensor, view)
        # Without any light of its own, the calls to those of other scenes could not be recorded.
        launch = self._launch if scene.emitters() else _launch
        return launch(scene, sensor, path, spp, dr.opaque(mi.UInt32, seed))


def _launch(scene: Any, sensor: Any, path: JointPath, spp: int, seed: Any) -> Any:
    integrator = path.integrator()
    return mi.render(scene, sensor=sensor, integrator=integrator, spp=spp, seed=seed)
