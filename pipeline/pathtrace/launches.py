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
        self._launches: dict[Any, Any] = {}

    @property
    def recordings(self) -> int:
        """Number of launches recorded for the present materials."""
        return sum(int(launch.n_recordings) for launch in self._launches.values())

    def launch(
        self, scene: Any, suit: int, view: View, copies: int, path: JointPath, spp: int, seed: int
    ) -> Any:
        """`copies` independent images of a view, side by side, by `path.integrator()`.

        `suit` is the number of the wardrobe's present twins: others are other objects.
        """
        if suit != self._suit:
            self._suit = suit
            self._launches.clear()
        key = (view.width, view.height, copies, view.intrinsics.tobytes())
        if key not in self._sensors:
            sensor = make_sensor(view, copies)
            # As every launch leaves it: else the second one, which meets another film, is recorded.
            sensor.film().prepare(path.integrator().aov_names())
            dr.eval(sensor.film().develop())
            self._sensors[key] = sensor
            if len(self._sensors) > _LAYOUTS:
                oldest = next(iter(self._sensors))
                del self._sensors[oldest]
                self._launches.pop(oldest, None)
        sensor = self._sensors[key]
        move_sensor(sensor, view)
        # Without any light of its own, the calls to those of other scenes could not be recorded.
        if not scene.emitters():
            return _launch(scene, sensor, path, spp, dr.opaque(mi.UInt32, seed))
        # A recording keeps the sensor's film: another size or field of view has its own.
        if key not in self._launches:
            self._launches[key] = dr.freeze(_launch, limit=_LAYOUTS, warn_after=_LAYOUTS)
        launch = self._launches[key]
        return launch(scene, sensor, path, spp, dr.opaque(mi.UInt32, seed))


def _launch(scene: Any, sensor: Any, path: JointPath, spp: int, seed: Any) -> Any:
    integrator = path.integrator()
    return mi.render(scene, sensor=sensor, integrator=integrator, spp=spp, seed=seed)
