"""Export of a USD stage to plain arrays and JSON, in the child process that holds OpenUSD.

`export` writes `stage.json` and `points.npy`, `normals.npy`, `uvs.npy`, which `reader.py` reads.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from pxr import Tf, Usd, UsdGeom, UsdShade

from pbrnet.scenes.arrays import Float64Array
from pbrnet.scenes.errors import InputError
from pbrnet.scenes.importing.shape import MAX_SCENE_TRIANGLES, MAX_SHAPES
from pbrnet.scenes.models.usd.geometry import (
    UNREAD,
    Geometry,
    implicit_geometry,
    mesh_geometry,
    subset_faces,
)
from pbrnet.scenes.models.usd.layers import Layers, reason
from pbrnet.scenes.models.usd.lights import KINDS, OUTDOORS, light_data
from pbrnet.scenes.models.usd.shading import material_data

_DEPTH = 8  # of point instancers in each other
_MOST_INSTANCES = 20_000  # of all point instancers, those of instances included
_PURPOSES = ("default", "render")


@dataclass(frozen=True)
class _Part:
    """Triangles of one material: a range of the arrays."""

    start: int
    stop: int
    has_normals: bool
    has_uvs: bool
    is_smooth: bool
    material: int  # -1 for none
    color: tuple[float, ...] | None  # displayColor


def export(path: str, root: str, out: str) -> None:
    """Write the stage at `path`, whose layers lie in the folder `root`, to the folder `out`."""
    layers = Layers(Path(root))
    stage = layers.open_stage(Path(path))
    made = _Exporter(path, stage)
    try:
        made.walk(stage.GetPseudoRoot(), np.eye(4), (), 0)
    except Tf.ErrorException as error:
        raise InputError(f"{path}: damaged USD file ({reason(error, Path(path))})") from None
    result = {
        "up": str(UsdGeom.GetStageUpAxis(stage)).lower(),
        "metres": float(UsdGeom.GetStageMetersPerUnit(stage)),
        "metres_stated": bool(UsdGeom.StageHasAuthoredMetersPerUnit(stage)),
        "materials": made.materials,
        "shapes": made.shapes,
        "lights": made.lights,
        "cameras": made.cameras,
        "notes": made.notes,
        "outdoors": made.outdoors,
        "layers": layers.found,
        "missing": layers.missing,
        "described": stage.GetRootLayer().customLayerData.get("pbrnet"),
    }
    folder = Path(out)
    for name, pieces, width in (
        ("points", made.points, 3),
        ("normals", made.normals, 3),
        ("uvs", made.uvs, 2),
    ):
        joined = np.concatenate(pieces) if pieces else np.zeros((0, 3, width), np.float32)
        np.save(folder / f"{name}.npy", joined)
    (folder / "stage.json").write_text(json.dumps(result, allow_nan=False))


@dataclass
class _Exporter:
    path: str
    stage: Any
    time: Any = field(default_factory=Usd.TimeCode.EarliestTime)
    points: list[Any] = field(default_factory=list)
    normals: list[Any] = field(default_factory=list)
    uvs: list[Any] = field(default_factory=list)
    materials: list[dict[str, Any]] = field(default_factory=list)
    shapes: list[dict[str, Any]] = field(default_factory=list)
    lights: list[dict[str, Any]] = field(default_factory=list)
    cameras: list[dict[str, Any]] = field(default_factory=list)
    notes: dict[str, list[str]] = field(default_factory=dict)
    outdoors: bool = False
    triangles: int = 0
    _stored: int = 0
    _nodes: int = 0
    _instances: int = 0  # of point instancers
    _parts: dict[Any, list[_Part]] = field(default_factory=dict)
    _material_numbers: dict[str, int] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self._transforms = UsdGeom.XformCache(self.time)
        self._metres = float(UsdGeom.GetStageMetersPerUnit(self.stage))

    def walk(self, top: Any, place: Float64Array, names: tuple[str, ...], depth: int) -> None:
        """Export what is below `top`; `place` (4, 4) takes its axes to the world.

        `names` are the nodes above; `depth` counts the point instancers above.
        """
        if depth > _DEPTH:
            raise InputError(f"{self.path}: point instancers stand in each other {_DEPTH} times")
        base = place @ np.linalg.inv(self._world(top))
        paths: dict[Any, tuple[str, ...]] = {top.GetPath().GetParentPath(): names}
        iterator = iter(
            Usd.PrimRange(top, Usd.TraverseInstanceProxies(_SHOWN if not depth else _PROTOTYPE))
        )
        for prim in iterator:
            if prim.IsPseudoRoot():
                paths[prim.GetPath()] = ()
                continue
            if prim.HasAuthoredMetadata("clips"):
                raise InputError(
                    f"{self.path}: {prim.GetPath()} has value clips, which are not read; "
                    "save the stage with: usdcat --flatten"
                )
            self._nodes += 1
            here = (*paths.get(prim.GetPath().GetParentPath(), names),
                    f"{self._nodes}:{_label(prim, self.time)}")  # fmt: skip
            paths[prim.GetPath()] = here
            if not self._is_shown(prim):
                iterator.PruneChildren()
                continue
            matrix = base @ self._world(prim)
            if not np.isfinite(matrix).all():
                raise InputError(f"{self.path}: {prim.GetPath()}: its transform is not finite")
            if prim.IsA(UsdGeom.PointInstancer):
                iterator.PruneChildren()
                self._instancer(prim, matrix, here, depth)
                continue
            self._prim(prim, matrix, here)

    def _world(self, prim: Any) -> Float64Array:
        if prim.IsPseudoRoot():
            return np.eye(4)
        return np.array(self._transforms.GetLocalToWorldTransform(prim)).T

    def _is_shown(self, prim: Any) -> bool:
        """Return whether the prim and what is below it can be visible."""
        imageable = UsdGeom.Imageable(prim)
        if not imageable:
            return True
        if imageable.GetVisibilityAttr().Get(self.time) == UsdGeom.Tokens.invisible:
            self._note("invisible prims were left out: {}", prim.GetName())
            return False
        return True

    def _prim(self, prim: Any, matrix: Float64Array, names: tuple[str, ...]) -> None:
        kind = str(prim.GetTypeName())
        if kind in KINDS:
            self._light(prim, kind, matrix)
        elif prim.IsA(UsdGeom.Camera):
            self._camera(prim, matrix)
        elif kind in UNREAD:
            self._note("prims of types that are no surfaces of polygons were left out: {}", kind)
        elif kind == "SkelRoot":
            self._note("skinned meshes are in their rest pose")
        elif prim.IsA(UsdGeom.Gprim):
            purpose = str(UsdGeom.Imageable(prim).ComputePurpose())
            if purpose not in _PURPOSES:
                self._note(f"geometry of purpose {purpose!r} was left out")
                return
            self._shapes(prim, matrix, names)

    def _shapes(self, prim: Any, matrix: Float64Array, names: tuple[str, ...]) -> None:
        if abs(np.linalg.det(matrix[:3, :3])) < 1e-18:
            self._note("prims scaled to zero size were left out: {}", prim.GetName())
            return
        for part in self._prim_parts(prim):
            self.triangles += part.stop - part.start
            if self.triangles > MAX_SCENE_TRIANGLES or len(self.shapes) >= MAX_SHAPES:
                raise InputError(
                    f"{self.path}: the file has more than the limit of "
                    f"{MAX_SCENE_TRIANGLES:,} triangles or {MAX_SHAPES:,} shapes"
                )
            self.shapes.append(
                {
                    "name": names[-1].partition(":")[2],
                    "nodes": names,
                    "range": (part.start, part.stop),
                    "normals": part.has_normals,
                    "uvs": part.has_uvs,
                    "smooth": part.is_smooth,
                    "material": part.material,
                    "color": part.color,
                    "matrix": matrix.tolist(),
                }
            )

    def _prim_parts(self, prim: Any) -> list[_Part]:
        """The parts of a prim, made once for all its instances with the same materials."""
        binding = UsdShade.MaterialBindingAPI(prim)
        subsets = binding.GetMaterialBindSubsets() if prim.IsA(UsdGeom.Mesh) else []
        numbers = [self._material(UsdShade.MaterialBindingAPI(one.GetPrim())) for one in subsets]
        whole = self._material(binding)
        shared = prim.GetPrimInPrototype() if prim.IsInstanceProxy() else prim
        key = (shared.GetPath(), whole, *numbers)
        if key not in self._parts:
            self._parts[key] = list(self._new_parts(prim, whole, subsets, numbers))
        return self._parts[key]

    def _new_parts(
        self, prim: Any, whole: int, subsets: list[Any], numbers: list[int]
    ) -> Iterator[_Part]:
        textured = [number for number in (whole, *numbers) if number >= 0]
        coordinates = next(
            (name for number in textured if (name := _coordinates(self.materials[number]))), ""
        )
        if prim.IsA(UsdGeom.Mesh):
            geometry: Geometry | None = mesh_geometry(prim, coordinates, self.time)
        else:
            geometry = implicit_geometry(prim, self.time)
        if geometry is None:
            self._note(
                "prims of types that are no surfaces of polygons were left out: {}",
                str(prim.GetTypeName()),
            )
            return
        if geometry.is_smooth:
            self._note("subdivision surfaces keep their control mesh, with smooth normals")
        color = self._display_color(prim)
        rest = np.ones(len(geometry.points), dtype=bool)
        for subset, number in zip(subsets, numbers, strict=True):
            chosen = np.isin(geometry.polygon, subset_faces(subset, self.time)) & rest
            rest &= ~chosen
            yield from self._store(geometry, chosen, number if number >= 0 else whole, color)
        yield from self._store(geometry, rest, whole, color)

    def _store(
        self, geometry: Geometry, chosen: Any, material: int, color: tuple[float, ...] | None
    ) -> Iterator[_Part]:
        count = int(chosen.sum())
        if not count:
            return
        if self._stored + count > MAX_SCENE_TRIANGLES:
            raise InputError(f"{self.path}: more than {MAX_SCENE_TRIANGLES:,} triangles")
        for pieces, values, width in (
            (self.points, geometry.points, 3),
            (self.normals, geometry.normals, 3),
            (self.uvs, geometry.uvs, 2),
        ):
            if values is None:
                pieces.append(np.zeros((count, 3, width), np.float32))
            else:
                pieces.append(values[chosen].astype(np.float32))
        start, self._stored = self._stored, self._stored + count
        yield _Part(
            start,
            self._stored,
            geometry.normals is not None,
            geometry.uvs is not None,
            geometry.is_smooth,
            material,
            color,
        )

    def _material(self, binding: Any) -> int:
        """The number of the bound material in `materials`, -1 for none."""
        bound, _ = binding.ComputeBoundMaterial("full")
        if not bound:
            return -1
        key = str(bound.GetPath())
        if key not in self._material_numbers:
            self._material_numbers[key] = len(self.materials)
            self.materials.append(material_data(bound, self.time))
        return self._material_numbers[key]

    def _display_color(self, prim: Any) -> tuple[float, ...] | None:
        primvar = UsdGeom.PrimvarsAPI(prim).FindPrimvarWithInheritance("displayColor")
        values = primvar.Get(self.time) if primvar and primvar.HasValue() else None
        if values is None or not len(values):
            return None
        table = np.asarray(values, dtype=np.float64).reshape(-1, 3)
        if len(table) > 1 and np.ptp(table, axis=0).max() > 1e-3:
            self._note("colours by vertex or face were replaced by their mean: {}", prim.GetName())
        mean = np.clip(np.nan_to_num(table.mean(axis=0)), 0, 1)
        return tuple(round(float(value), 6) for value in mean)

    def _instancer(
        self, prim: Any, matrix: Float64Array, names: tuple[str, ...], depth: int
    ) -> None:
        instancer = UsdGeom.PointInstancer(prim)
        targets = instancer.GetPrototypesRel().GetTargets()
        prototypes = [self.stage.GetPrimAtPath(path) for path in targets]
        numbers = instancer.GetProtoIndicesAttr().Get(self.time)
        numbers = np.asarray(numbers if numbers is not None else [], dtype=np.int64)
        self._instances += len(numbers)
        if self._instances > _MOST_INSTANCES:
            raise InputError(
                f"{self.path}: {prim.GetPath()}: more than {_MOST_INSTANCES:,} instances of "
                "point instancers in the file"
            )
        places = instancer.ComputeInstanceTransformsAtTime(
            self.time, self.time, UsdGeom.PointInstancer.IncludeProtoXform,
            UsdGeom.PointInstancer.IgnoreMask,
        )  # fmt: skip
        mask = instancer.ComputeMaskAtTime(self.time)
        for index, number in enumerate(numbers.tolist()):
            if index >= len(places) or (len(mask) and not mask[index]):
                continue
            if not 0 <= number < len(prototypes) or not prototypes[number]:
                self._note("instances without a prototype were left out: {}", prim.GetName())
                continue
            self._nodes += 1
            place = matrix @ np.array(places[index]).T
            # The name of the instancer would make all instances one object.
            above = (*names[:-1], f"{self._nodes}:")
            self.walk(prototypes[number], place, above, depth + 1)

    def _light(self, prim: Any, kind: str, matrix: Float64Array) -> None:
        if kind in OUTDOORS:
            self.outdoors = True
            self._note("sun and sky took the place of a dome light: {}", prim.GetName())
            return
        made = light_data(prim, matrix, self._metres, self.time)
        if made is None:
            self._note("lights without any power were left out: {}", prim.GetName())
            return
        points = made.pop("points", None)
        if points is not None:
            count = len(points)
            self.points.append(points.astype(np.float32))
            self.normals.append(np.zeros((count, 3, 3), np.float32))
            self.uvs.append(np.zeros((count, 3, 2), np.float32))
            made["range"] = (self._stored, self._stored + count)
            self._stored += count
        self.lights.append({**made, "matrix": matrix.tolist()})

    def _camera(self, prim: Any, matrix: Float64Array) -> None:
        camera = UsdGeom.Camera(prim)
        values = [
            attribute.Get(self.time)
            for attribute in (
                camera.GetHorizontalApertureAttr(),
                camera.GetVerticalApertureAttr(),
                camera.GetFocalLengthAttr(),
            )
        ]
        if camera.GetProjectionAttr().Get(self.time) != "perspective" or not all(
            value is not None and 1e-6 < value < 1e6 for value in values
        ):
            self._note("a camera without perspective projection was left out")
            return
        width, height, focal = (float(value) for value in values)
        self.cameras.append(
            {
                "name": prim.GetName(),
                "matrix": matrix.tolist(),
                "half_width": 0.5 * width / focal,
                "half_height": 0.5 * height / focal,
            }
        )

    def _note(self, sentence: str, detail: str = "") -> None:
        self.notes.setdefault(sentence, []).append(detail)


_PROTOTYPE = Usd.PrimIsActive & Usd.PrimIsLoaded & Usd.PrimIsDefined  # which may be a class
_SHOWN = _PROTOTYPE & ~Usd.PrimIsAbstract


def _label(prim: Any, time: Any) -> str:
    """Name of a prim, with its semantic label if it has one."""
    label = str(prim.GetDisplayName() or prim.GetName())
    for attribute in prim.GetAuthoredAttributes():
        name = attribute.GetName()
        if name.startswith("semantics:labels:") or name.endswith(":params:semanticData"):
            value = attribute.Get(time)
            words = [value] if isinstance(value, str) else list(value or [])
            label = " ".join([*(str(word) for word in words), label])
    return label[:200]


def _coordinates(material: dict[str, Any]) -> str:
    """Name of the texture coordinates that the first texture of a material uses."""
    for value in material["inputs"].values():
        if value.get("coordinates"):
            return str(value["coordinates"])
    return ""
