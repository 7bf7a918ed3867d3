"""Frozen launches of the joint path tracer: recorded once per scene, then replayed.

Before the first sample, Python and Dr.Jit need half a second of one core to trace the path tracer
of a furnished scene through every material. In a small view that is more than its samples need.
`dr.freeze` records the launches and replays them with new inputs. It does not detect that a virtual
call meets another instance than at recording, so no instance is created between views: the sensor
is moved instead.
"""

from __future__ import annotations

from collections.abc import Callable, Hashable
from typing import Any

import drjit as dr
import mitsuba as mi

from pbrnet.pipeline.pathtrace.integrator import JointPath
from pbrnet.pipeline.render.sensors import make_sensor, move_sensor
from pbrnet.pipeline.views import View

_MAX_RECORDINGS = 32  # per kernel and size: sample counts and kinds of light plans


class Recordings:
    """Recorded launches of the kernels of one open scene, by kernel and a key such as its size."""

    def __init__(self) -> None:
        self._launches: dict[tuple[Hashable, ...], Any] = {}
        self._version: int | None = None

    def __len__(self) -> int:
        return sum(int(launch.n_recordings) for launch in self._launches.values())

    def of(self, kernel: Callable[..., Any], key: Hashable) -> Any:
        """Return the recorded form of a kernel."""
        if (kernel, key) not in self._launches:
            self._launches[kernel, key] = dr.freeze(
                kernel, limit=_MAX_RECORDINGS, warn_after=_MAX_RECORDINGS
            )
        return self._launches[kernel, key]

    def discard(self, kernel: Callable[..., Any], key: Hashable) -> None:
        """Forget the recordings of a kernel."""
        self._launches.pop((kernel, key), None)

    def renew(self, version: int) -> None:
        """Forget all unless `version`, that of the scene's `MaterialSets`, is the one before.

        With another one some materials are other instances.
        """
        if version != self._version:
            self._launches.clear()
        self._version = version


class FrozenTracer:
    """Sensors and recorded launches of one open scene, kept between its views.

    There is one sensor and one frozen function per film size and intrinsics: a recording holds the
    film that it was made with.
    """

    def __init__(self) -> None:
        self.recordings = Recordings()
        self._sensors: dict[Hashable, mi.Sensor] = {}

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

        `version` is that of the scene's `MaterialSets`.
        """
        self.recordings.renew(version)
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
                self.recordings.discard(_launch, oldest)
        sensor = self._sensors[key]
        move_sensor(sensor, view)
        # Without emitters of its own, calls to those of other open scenes could not be recorded.
        launch = self.recordings.of(_launch, key) if scene.emitters() else _launch
        return launch(scene, sensor, path, spp, dr.opaque(mi.UInt32, seed))


def _launch(
    scene: mi.Scene, sensor: mi.Sensor, path: JointPath, spp: int, seed: mi.UInt32
) -> mi.TensorXf:
    integrator = path.integrator()
    return mi.render(scene, sensor=sensor, integrator=integrator, spp=spp, seed=seed)
