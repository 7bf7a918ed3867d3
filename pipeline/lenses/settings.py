"""Parameters of lens and shutter, and the lens of a view that is drawn from them."""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import product
from typing import TYPE_CHECKING, Literal

import numpy as np

from pbrnet.pipeline.lenses.calibration import Calibration
from pbrnet.pipeline.lenses.model import COEFFICIENTS, MAX_COEFFICIENT, Lens, Matrix
from pbrnet.scenes.checked import build, param, within
from pbrnet.scenes.errors import ParameterError

if TYPE_CHECKING:
    from pbrnet.pipeline.views import ImageParams

_ASPECT = 0.01  # relative difference of the aspects of a calibration and of images
STEEPEST = 1.4  # radians, half field of view of perspective images
Number = float | tuple[float, float]  # fixed, or [least, most]


@dataclass(frozen=True)
class LensParams:
    """Lens of every image; each number may be a range, [least, most], drawn evenly for each view.

    Pixels are those of the image, with the first pixel's centre at (0.5, 0.5).
    """

    distortion: tuple[Number, ...] = param(
        (),
        "k1, k2, p1, p2 [, k3 [, k4, k5, k6]]; fisheye: k1, k2, k3, k4",
        within(-MAX_COEFFICIENT, MAX_COEFFICIENT),
    )
    focal: tuple[Number, ...] = param(
        (), "pixels, [f] or [fx, fy]; []: from half_fov_x", within(1e-3, 1e7)
    )
    centre: tuple[Number, ...] = param((), "pixels, [cx, cy]; []: the middle", within(-1e7, 1e7))
    half_width: Number = param(
        2.0, "metres, of orthographic images without focal", within(1e-3, 1e4)
    )
    calibration: str = param(
        "", "file of OpenCV, Kalibr or nerfstudio with focal, centre and distortion"
    )
    camera: str = param("", "camera in that file, such as cam1; the first without")

    def verify(self, where: str) -> None:
        """Raise ValueError for wrong counts, ranges that descend, and a file beside numbers."""
        for name, counts in (("focal", (0, 1, 2)), ("centre", (0, 2))):
            if len(getattr(self, name)) not in counts:
                allowed = " or ".join(map(str, counts))
                raise ValueError(
                    f"{where}.{name}: {allowed} numbers, not {len(getattr(self, name))}"
                )
        ranged = {name: getattr(self, name) for name in ("distortion", "focal", "centre")}
        for name, numbers in {**ranged, "half_width": (self.half_width,)}.items():
            for number in numbers:
                if isinstance(number, tuple) and number[0] > number[1]:
                    raise ValueError(f"{where}.{name}: {list(number)}; a range is [least, most]")
            if self.calibration and numbers and name in ranged:
                raise ValueError(
                    f"{where}.{name}: lens.calibration gives it; leave one of them out"
                )
        if self.camera and not self.calibration:
            raise ValueError(f"{where}.camera: needs lens.calibration")


@dataclass(frozen=True)
class OpticsParams:
    """Thin lens and shutter of colour; all other images are sharp, those of a pinhole.

    Depth of field needs `f_number`, motion blur `exposure`, a rolling shutter `readout`.
    """

    f_number: float = param(0.0, "focal length over aperture; 0: pinhole", within(0, 128))
    sensor_width: float = param(
        36.0, "millimetres; with the field of view, the focal length", within(1, 100)
    )
    blades: int = param(0, "edges of the aperture; 0: a disc", within(0, 16))
    focus_distance: float = param(
        0.0, "metres along the optical axis; 0: by autofocus", within(0, 10_000)
    )
    autofocus: Literal["centre", "median", "subject"] = param(
        "centre",
        "median depth of the middle tenth of the image; median, of all; subject, of one object",
    )
    exposure: float = param(
        0.0, "share of the time between frames, for motion blur of trajectories", within(0, 1)
    )
    readout: float = param(
        0.0, "share of the time between frames from first to last row; 0: global", within(0, 1)
    )
    frame_rate: float = param(30.0, "frames per second, for times in rows", within(0.1, 10_000))

    @property
    def active(self) -> bool:
        """True if colour is not that of a pinhole that stands still."""
        return bool(self.f_number) or self.moves

    @property
    def moves(self) -> bool:
        """True if the camera moves while colour is exposed."""
        return bool(self.exposure or self.readout)

    def verify(self, where: str) -> None:
        """Raise ValueError for an aperture wider than lenses have, a focus in them, two blades."""
        for name, least in (("f_number", 0.5), ("focus_distance", 0.05), ("blades", 3)):
            if 0 < getattr(self, name) < least:
                value = getattr(self, name)
                raise ValueError(f"{where}.{name}: {value:g}; 0, or at least {least:g}")


def lens_of(
    image: ImageParams, half_fov_x: float | None = None, rng: np.random.Generator | None = None
) -> Lens:
    """Return the lens of images, or of one view.

    `half_fov_x`, radians, counts where the parameters give no focal length. Ranges are drawn by
    `rng`; without it their middle is taken.
    """
    options, size = image.lens, (image.width, image.height)
    if image.projection == "equirectangular":
        return Lens(image.projection, *size, ())
    distortion = tuple(_drawn(number, rng) for number in options.distortion)
    focal = [_drawn(number, rng) for number in options.focal]
    centre = [_drawn(number, rng) for number in options.centre]
    if not focal:
        plain = Lens(image.projection, *size, (), distortion)
        half_width = _drawn(options.half_width, rng)
        focal = [_focal(plain, half_fov_x or image.half_fov_x, half_width)]
    matrix = _matrix(focal, centre or [0.5 * side for side in size])
    return Lens(image.projection, *size, matrix, distortion)


def calibrated(image: ImageParams, found: Calibration) -> LensParams:
    """Return the lens of a calibration file for images of another size of the same aspect.

    Raises `ParameterError` for another projection or aspect than those of the images, and for
    impossible numbers.
    """
    if found.projection not in (None, image.projection):
        raise ParameterError(
            f"{found.path}: the lens is {found.projection}, and image.projection is "
            f"{image.projection}; set image.projection: {found.projection}"
        )
    width, height = found.size or (image.width, image.height)
    across, down = image.width / width, image.height / height
    if abs(across / down - 1) > _ASPECT:
        raise ParameterError(
            f"{found.path}: its images have {width} x {height} pixels, another aspect than "
            f"image.width {image.width} and image.height {image.height}"
        )
    focal = (found.focal[0] * across, found.focal[1] * down)
    numbers = {
        "distortion": found.distortion,
        "focal": focal[:1] if focal[0] == focal[1] else focal,
        "centre": (found.centre[0] * across, found.centre[1] * down),
    }
    return build(LensParams, numbers, f"{found.path}: lens")


def check_lens(image: ImageParams, where: str) -> None:
    """Raise ValueError for parameters from which impossible lenses may be drawn."""
    options, projection = image.lens, image.projection
    allowed = COEFFICIENTS[projection]
    if len(options.distortion) not in allowed:
        counts = ", ".join(map(str, allowed))
        raise ValueError(
            f"{where}.lens.distortion: {len(options.distortion)} numbers; "
            f"{projection} images have one of {counts}"
        )
    if projection == "equirectangular" and (options.focal or options.centre):
        raise ValueError(f"{where}.lens: equirectangular images have no focal length and centre")
    if projection == "perspective" and image.half_fov_x > STEEPEST:
        raise ValueError(
            f"{where}.half_fov_x: {image.half_fov_x:g}; from 0.05 to {STEEPEST:g} with "
            "image.projection: perspective"
        )
    # Slopes are linear in the coefficients of polynomials: the worst are at the ends of the ranges.
    ends = [number if isinstance(number, tuple) else (number,) for number in options.distortion]
    for distortion in product(*ends) if any(options.distortion) and not options.focal else ():
        _focal(Lens(projection, image.width, image.height, (), distortion), image.half_fov_x, 1.0)


def _focal(lens: Lens, half_fov_x: float, half_width: float) -> float:
    """Return the focal length with which the middle of an image's edge is `half_fov_x` off axis.

    Raises ValueError where the distortion folds the image back before.
    """
    half = 0.5 * lens.width
    if lens.projection == "orthographic":
        return half / half_width
    radius = half_fov_x if lens.projection == "fisheye" else math.tan(half_fov_x)
    if not any(lens.distortion):
        return half / radius
    if radius > lens.plane.limit:
        limit = lens.plane.limit
        widest = limit if lens.projection == "fisheye" else math.atan(limit)
        raise ValueError(
            f"image.lens.distortion: {list(lens.distortion)} folds the image back {widest:.4g} "
            f"radians from the axis, and half_fov_x is {half_fov_x:.4g}; make that smaller"
        )
    return half / float(lens.plane.radial(np.array([radius]))[0][0])


def _matrix(focal: list[float], centre: list[float]) -> Matrix:
    return ((focal[0], 0.0, centre[0]), (0.0, focal[-1], centre[1]), (0.0, 0.0, 1.0))


def _drawn(number: Number, rng: np.random.Generator | None) -> float:
    """Return a fixed number, or one drawn evenly from its range."""
    if not isinstance(number, tuple):
        return number
    return 0.5 * sum(number) if rng is None else float(rng.uniform(*number))
