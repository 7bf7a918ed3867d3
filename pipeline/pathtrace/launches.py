"""Frozen launches of the joint path tracer: recorded once per scene, then replayed.

Before the first sample, Python and Dr.Jit need half a second of one core to trace the path tracer
of a furnished scene through every material. In a small view that is more than its samples need.
`dr.freeze` records the launches and replays them with new inputs. It does not detect that a virtual
call meets another instance than at recording, so no instance is created between views: the sensor
is moved instead.
"""

from __future__ import annotations

from collections.abc import Hashable
from typing import Any

import drjit as dr
import mitsuba as mi

from pbrnet.pipeline.pathtrace.integrator import JointPath
from pbrnet.pipeline.render.sensors import make_sensor, move_sensor
from pbrnet.pipeline.views import View

_MAX_RECORDINGS = 32  # film sizes; per size: sample counts and kinds of light plans


class FrozenTracer:
    """Sensors and recorded launches of one open scene, kept between its views.

    There is one sensor and one frozen function per film size and intrinsics: a recording holds the
    film that it was made with.
    """

    def __init__(self) -> None:
        self._version: int | None = None
        self._sensors: dict[Hashable, mi.Sensor] = {}
        self._launches: dict[Hashable, Any] = {}

    @property
    def recordings(self) -> int:
        """Number of launches recorded for the current materials."""
        return sum(int(launch.n_recordings) for launch in self._launches.values())

    def launch(
        self,
        scene: mi.Scene,
        version: int,
        view: View,
        copies: int,
        path: JointPath,
        spp: int,
        seed: int,
    ) -> mi.TensorXf:
        """Render `copies` independent images of a view, side by side, by `path.integrator()`.

        `version` is that of the scene's `MaterialSets`: when it changes, some materials are other
        instances, and recordings are discarded.
        """
        if version != self._version:
            self._version = version
            self._launches.clear()
        names = path.integrator().aov_names()
        key = (view.width, view.height, copies, view.intrinsics.tobytes(), *names)
        if key not in self._sensors:
            sensor = make_sensor(view, copies)
            # In the state after a launch: otherwise the second launch would be recorded again.
            sensor.film().prepare(names)
            dr.eval(sensor.film().develop())
            self._sensors[key] = sensor
            if len(self._sensors) > _MAX_RECORDINGS:
                oldest = next(iter(self._sensors))
                del self._sensors[oldest]
                self._launches.pop(oldest, None)
        sensor = self._sensors[key]
        move_sensor(sensor, view)
        # Without emitters of its own, calls to those of other open scenes could not be recorded.
        if not scene.emitters():
            return _launch(scene, sensor, path, spp, dr.opaque(mi.UInt32, seed))
        if key not in self._launches:
            self._launches[key] = dr.freeze(
                _launch, limit=_MAX_RECORDINGS, warn_after=_MAX_RECORDINGS
            )
        launch = self._launches[key]
        return launch(scene, sensor, path, spp, dr.opaque(mi.UInt32, seed))


def _launch(
    scene: mi.Scene, sensor: mi.Sensor, path: JointPath, spp: int, seed: mi.UInt32
) -> mi.TensorXf:
    integrator = path.integrator()
    return mi.render(scene, sensor=sensor, integrator=integrator, spp=spp, seed=seed)
