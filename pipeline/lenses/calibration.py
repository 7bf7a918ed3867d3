"""Calibration files of cameras: OpenCV and ROS (YAML, XML), Kalibr (YAML), nerfstudio (JSON).

OpenCV and Kalibr count pixels from the centre of the first one, so that half a pixel is added to
their centres; nerfstudio counts from its corner, as views here do.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from xml.etree.ElementTree import Element, ParseError

import defusedxml.ElementTree
import numpy as np
from defusedxml import DefusedXmlException
from yaml import SafeLoader

from pbrnet.pipeline.lenses.model import COEFFICIENTS, Lens, Projection
from pbrnet.scenes.checked import shown
from pbrnet.scenes.errors import InputError, ParameterError
from pbrnet.scenes.files import exists, parse_json, read_text
from pbrnet.scenes.yaml_files import BoundedLoader, parse_yaml

_MAX_BYTES = 2**24
_HALF = 0.5  # pixels
_KALIBR: dict[str, Projection] = {
    "radtan": "perspective",
    "none": "perspective",
    "equidistant": "fisheye",
}
_ROS: dict[str, Projection] = {
    "plumb_bob": "perspective",
    "rational_polynomial": "perspective",
    "equidistant": "fisheye",
    "fisheye": "fisheye",
}
_NERFSTUDIO: dict[str, Projection] = {
    "OPENCV": "perspective",
    "PINHOLE": "perspective",
    "SIMPLE_PINHOLE": "perspective",
    "OPENCV_FISHEYE": "fisheye",
}


@dataclass(frozen=True)
class Calibration:
    """A camera in a file: focal lengths and centre in pixels, centres of pixels at +0.5.

    `size` is (width, height) of the images, and `projection` that of the lens, None where the file
    does not say it.
    """

    path: Path
    focal: tuple[float, float]
    centre: tuple[float, float]
    distortion: tuple[float, ...]
    size: tuple[int, int] | None
    projection: Projection | None


class _OpenCvLoader(BoundedLoader):
    """Loader that knows OpenCV's matrices, which are mappings with a tag."""


_OpenCvLoader.add_constructor("tag:yaml.org,2002:opencv-matrix", SafeLoader.construct_yaml_map)


def read_calibration(path: Path, camera: str = "") -> Calibration:
    """Read a camera of a file: `camera` or the first; raises `ParameterError` that says what fails.

    The kind of file follows from its content. `camera` is a key of Kalibr, or the `file_path` of a
    frame of nerfstudio.
    """
    if not exists(path):
        raise ParameterError(f"{path}: no such file; image.lens.calibration names it")
    try:
        content = _content(path, read_text(path, _MAX_BYTES))
        if not isinstance(content, Mapping):
            raise InputError("not a mapping of names")
        if "camera_matrix" in content or "Camera_Matrix" in content:
            return _opencv(path, content)
        if "frames" in content or "fl_x" in content or "camera_model" in content:
            return _nerfstudio(path, content, camera)
        if any(str(name).startswith("cam") for name in content):
            return _kalibr(path, content, camera)
        raise InputError("neither camera_matrix (OpenCV), cam0 (Kalibr) nor fl_x (nerfstudio)")
    except InputError as error:
        text = str(error)
        raise ParameterError(text if text.startswith(str(path)) else f"{path}: {text}") from None


def opencv_text(lens: Lens) -> str:
    """Return a perspective or fisheye lens as OpenCV's YAML, pixels from the first one's centre."""
    shifted = np.array(lens.K) - [[0, 0, _HALF], [0, 0, _HALF], [0, 0, 0]]
    coefficients = np.array([lens.distortion or (0.0,) * 4])
    lines = ["%YAML:1.0", "---", f"image_width: {lens.width}", f"image_height: {lens.height}"]
    lines.append(f"fisheye_model: {int(lens.projection == 'fisheye')}")
    for name, matrix in (("camera_matrix", shifted), ("distortion_coefficients", coefficients)):
        rows, columns = matrix.shape
        values = ", ".join(repr(float(value)) for value in matrix.ravel())
        lines += [f"{name}: !!opencv-matrix", f"   rows: {rows}", f"   cols: {columns}"]
        lines += ["   dt: d", f"   data: [ {values} ]"]
    return "\n".join(lines) + "\n"


def _content(path: Path, text: str) -> Any:
    """Return the content of a file in plain mappings, lists, numbers and text."""
    if path.suffix.lower() == ".xml":
        return _xml_content(text)
    if path.suffix.lower() == ".json":
        return parse_json(text, str(path))
    if text.startswith("%YAML:"):  # OpenCV's spelling of the directive, which no parser reads
        text = "#" + text
    return parse_yaml(text, path, _OpenCvLoader)


def _xml_content(text: str) -> dict[str, Any]:
    try:
        root: Element = defusedxml.ElementTree.fromstring(text, forbid_dtd=True)
    except (ParseError, DefusedXmlException, ValueError) as error:
        raise InputError(f"not valid XML ({type(error).__name__}: {error})") from None
    return {node.tag: _xml_value(node) for node in root}


def _xml_value(node: Element) -> Any:
    if len(node):
        return {child.tag: _xml_value(child) for child in node}
    words = (node.text or "").split()
    return words[0] if len(words) == 1 else words


def _opencv(path: Path, content: Mapping[str, Any]) -> Calibration:
    """Read a file of OpenCV's samples, or a `camera_info` of ROS."""
    matrix = _matrix(content, ("camera_matrix", "Camera_Matrix"))
    if len(matrix) != 9:
        raise InputError(f"camera_matrix: {len(matrix)} numbers; 9 are needed")
    names = ("distortion_coefficients", "Distortion_Coefficients", "dist_coeffs")
    distortion = _matrix(content, names)
    if abs(matrix[1]) > 1e-9:
        raise InputError(f"camera_matrix: skew {matrix[1]:g}; lenses have none")
    projection: Projection | None = None
    if "distortion_model" in content:
        projection = _of(_ROS, content["distortion_model"], "distortion_model")
    elif "fisheye_model" in content:
        projection = "fisheye" if _numbers([content["fisheye_model"]], "fisheye_model")[0] else None
    size = _size(content.get("image_width"), content.get("image_height"))
    focal, centre = (matrix[0], matrix[4]), (matrix[2] + _HALF, matrix[5] + _HALF)
    return Calibration(path, focal, centre, _trimmed(distortion), size, projection)


def _kalibr(path: Path, content: Mapping[str, Any], camera: str) -> Calibration:
    names = [str(name) for name in content]
    name = camera or names[0]
    entry = content.get(name)
    if not isinstance(entry, Mapping):
        raise InputError(f"no camera {shown(name)}; cameras: {shown(names)}")
    model = entry.get("camera_model")
    if model != "pinhole":
        raise InputError(
            f"{name}: camera_model {shown(model)} projects through a second centre, which lenses "
            "here do not have; calibrate with pinhole-radtan or pinhole-equi"
        )
    projection = _of(_KALIBR, entry.get("distortion_model"), f"{name}.distortion_model")
    values = _numbers(entry.get("intrinsics"), f"{name}.intrinsics")
    if len(values) != 4:
        raise InputError(f"{name}.intrinsics: {len(values)} numbers; 4 are needed")
    distortion = _numbers(entry.get("distortion_coeffs", []), f"{name}.distortion_coeffs")
    resolution = _numbers(entry.get("resolution", []), f"{name}.resolution")
    size = _size(*resolution) if len(resolution) == 2 else None
    centre = (values[2] + _HALF, values[3] + _HALF)
    return Calibration(path, (values[0], values[1]), centre, _trimmed(distortion), size, projection)


def _nerfstudio(path: Path, content: Mapping[str, Any], camera: str) -> Calibration:
    entry = dict(content)
    frames = content.get("frames", [])
    frames = [frame for frame in frames if isinstance(frame, Mapping)] if frames else []
    named = [frame for frame in frames if not camera or frame.get("file_path") == camera]
    if camera and not named:
        raise InputError(f"no frame {shown(camera)} as its file_path")
    if named:
        entry |= {key: value for key, value in named[0].items() if key != "transform_matrix"}
    usual = "OPENCV_FISHEYE" if entry.get("is_fisheye") is True else "OPENCV"  # instant-ngp's key
    projection = _of(_NERFSTUDIO, entry.get("camera_model", usual), "camera_model")
    numbers = {name: entry.get(name) for name in ("fl_x", "cx", "cy")}
    if None in numbers.values():
        raise InputError("fl_x, cx and cy are needed, at the top or in a frame")
    across, x, y = _numbers(list(numbers.values()), "fl_x, cx, cy")
    down = _numbers([entry.get("fl_y", across)], "fl_y")[0]
    order = ("k1", "k2", "k3", "k4") if projection == "fisheye" else ("k1", "k2", "p1", "p2", "k3")
    distortion = _numbers([entry.get(name, 0.0) for name in order], ", ".join(order))
    if projection == "perspective" and _numbers([entry.get("k4", 0.0)], "k4")[0]:
        raise InputError("k4 of a perspective camera is nerfstudio's own; at most k1, k2, k3")
    size = _size(entry.get("w"), entry.get("h"))
    return Calibration(path, (across, down), (x, y), _trimmed(distortion), size, projection)


def _trimmed(distortion: list[float]) -> tuple[float, ...]:
    """Return coefficients in a number that lenses have: () if all are 0, 4, 5 or 8.

    Those of thin prisms and tilted sensors, from the ninth on, must be 0.
    """
    if any(distortion[8:]):
        raise InputError(
            f"{len(distortion)} coefficients of distortion; those from the ninth on (thin prism, "
            "tilted sensor) are not supported; calibrate without"
        )
    used = [index + 1 for index, value in enumerate(distortion) if value]
    if not used:
        return ()
    count = next(count for count in COEFFICIENTS["perspective"] if count >= used[-1])
    return tuple((distortion + [0.0] * 8)[:count])


def _of(known: Mapping[str, Projection], name: Any, where: str) -> Projection:
    if not isinstance(name, str) or name not in known:
        raise InputError(f"{where}: {shown(name)} is not one of {', '.join(known)}")
    return known[name]


def _size(width: Any, height: Any) -> tuple[int, int] | None:
    """Return the size of the images, None where the file does not say it."""
    if width is None or height is None:
        return None
    across, down = _numbers([width, height], "image size")
    if not (1 <= across <= 1e5 and 1 <= down <= 1e5):
        raise InputError(f"images of {across:g} x {down:g} pixels")
    return int(across), int(down)


def _matrix(content: Mapping[str, Any], names: tuple[str, ...]) -> list[float]:
    """Return the numbers of a matrix of OpenCV, row by row, or of nested lists."""
    name = next((name for name in names if name in content), None)
    if name is None:
        raise InputError(f"no {names[0]}")
    value = content[name]
    data = value.get("data") if isinstance(value, Mapping) else value
    if isinstance(data, list) and all(isinstance(row, list) for row in data):
        data = [number for row in data for number in row]
    return _numbers(data, name)


def _numbers(values: Any, where: str) -> list[float]:
    """Return finite numbers of a list, also those written as text."""
    values = [values] if isinstance(values, str) else values
    if not isinstance(values, list) or len(values) > 64:
        raise InputError(f"{where}: {shown(values)} is no list of numbers")
    try:
        numbers = [float(value) for value in values if not isinstance(value, bool)]
    except (TypeError, ValueError, OverflowError):
        raise InputError(f"{where}: {shown(values)} holds something else than numbers") from None
    if len(numbers) < len(values) or not all(np.isfinite(numbers)):
        raise InputError(f"{where}: {shown(values)} holds something else than finite numbers")
    return numbers
