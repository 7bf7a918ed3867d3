"""Reader of USD files: `export.py` reads the stage in a child process, this makes it a `Model`.

OpenUSD is large, written in C++ and reads files of strangers: it never runs in our own process.
"""

from __future__ import annotations

import json
import math
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from pbrnet.scenes.arrays import Float64Array, Int64Array
from pbrnet.scenes.child_process import require_extra, run_child
from pbrnet.scenes.color import Color
from pbrnet.scenes.errors import InputError
from pbrnet.scenes.files import parse_json
from pbrnet.scenes.formats.archive import HomeArchive
from pbrnet.scenes.geometry.mesh import Mesh, cleaned, smooth_normals
from pbrnet.scenes.importing.camera import Camera
from pbrnet.scenes.importing.changes import Changes
from pbrnet.scenes.importing.materials.surface import Surface
from pbrnet.scenes.importing.materials.textures import TextureStore
from pbrnet.scenes.importing.names import Names
from pbrnet.scenes.importing.sandbox import Sandbox
from pbrnet.scenes.importing.shape import Shape
from pbrnet.scenes.importing.xml_elements import plugin
from pbrnet.scenes.models.model import Emission, Model, PunctualLight
from pbrnet.scenes.models.usd.materials import UsdMaterials
from pbrnet.scenes.opened_files import OpenedFiles

if TYPE_CHECKING:  # the child's code: what an import gives depends on it, but it is loaded there
    from pbrnet.scenes.models.usd import export as _export  # noqa: F401

_SECONDS = 240  # of a processor, for OpenUSD
_MEMORY = 8 * 2**30  # bytes of address space, for OpenUSD
_PACKAGE = (".usd", ".usda", ".usdc")  # suffixes of a package's first file
_NAMED = 5  # missing files that an error lists
_ZIP = b"PK\3\4"


def read_model(
    path: Path, sandbox: Sandbox, textures: TextureStore, unpacked: Path, changes: Changes
) -> Model:
    """Read a `.usd`, `.usda`, `.usdc` or `.usdz` file; see `importer.ModelReader`."""
    require_extra("pxr", "usd", path)
    images = _Images(path, sandbox, unpacked, changes)
    stage_file, root = path.resolve(), sandbox.root
    with path.open("rb") as stream:
        is_package = stream.read(4) == _ZIP
    if is_package:
        stage_file, root = images.unpack_stage()
    out = unpacked / "stage"
    out.mkdir()
    arguments = (str(stage_file), str(root), str(out))
    try:
        run_child("pbrnet.scenes.models.usd.export:export", arguments, path, _SECONDS, _MEMORY)
    except InputError as error:
        # Names inside a package are unpacked to a place that means nothing to the user.
        text = str(error).replace(f"{root}/", "") if is_package else str(error)
        raise InputError(text if path.name in text else f"{path}: {text}") from None
    data = json.loads((out / "stage.json").read_text())
    for layer in data["layers"] + data["missing"]:
        if not is_package:
            sandbox.opened.is_file(Path(layer))
    for layer in data["missing"]:
        changes.note(
            "layers that are missing or of an unknown format were left out: {}", Path(layer).name
        )
    if data["missing"] and not data["shapes"]:
        raise InputError(f"{path}: {_missing(data['missing'], root)}")
    for sentence, details in data["notes"].items():
        if data["described"] and "dome light" in sentence:
            continue  # the description says which sky it stands for
        for detail in details:
            changes.note(sentence, detail)
    arrays = {
        name: np.load(out / f"{name}.npy", allow_pickle=False)
        for name in ("points", "normals", "uvs")
    }
    materials = UsdMaterials(data["materials"], images.find, textures, changes)
    model = _Builder(path, data, arrays, materials, changes).build()
    model.package = root if is_package else None
    return model


def _missing(layers: list[str], root: Path) -> str:
    """Say that a stage is empty because files that it references, `layers`, cannot be opened."""
    names = sorted(
        path.relative_to(root).as_posix() if path.is_relative_to(root) else path.name
        for path in map(Path, layers)
    )
    count = f"{len(names):,} of the files that it references are"
    if len(names) == 1:
        count = "a file that it references is"
    more = f" and {len(names) - _NAMED:,} more" if len(names) > _NAMED else ""
    return (
        f"the file itself has no surfaces, and {count} missing or of an unknown format: "
        f"{', '.join(name[-120:] for name in names[:_NAMED])}{more}; put them in their places "
        f"below {root.name}, or save the scene as one file with: usdcat --flatten"
    )


@dataclass
class _Images:
    """Finds images and unpacks packages into the folder `unpacked`."""

    path: Path
    sandbox: Sandbox
    unpacked: Path
    changes: Changes
    _package: Sandbox | None = None
    _found: dict[str, Path | None] = field(default_factory=dict)

    def unpack_stage(self) -> tuple[Path, Path]:
        """Unpack the USDZ at `path`; returns its first file, which is the stage, and its folder."""
        folder = self.unpacked / "package"
        folder.mkdir()
        with HomeArchive(self.path, "USDZ package") as archive:
            names = archive.stored()
            for name in names:
                target = folder / name
                try:
                    target.parent.mkdir(parents=True, exist_ok=True)
                    target.write_bytes(archive.read(name))
                except OSError as error:
                    raise InputError(f"{self.path}: {name!r}: {error.strerror}") from None
        if not names or Path(names[0]).suffix.lower() not in _PACKAGE:
            raise InputError(f"{self.path}: the first file of a USDZ package has to be its stage")
        self._package = Sandbox(OpenedFiles(folder))
        return (folder / names[0]).resolve(), folder.resolve()

    def find(self, name: str) -> Path | None:
        """Return the path of an image; None, with a note, if it is missing."""
        if name not in self._found:
            self._found[name] = self._find(name)
        return self._found[name]

    def _find(self, name: str) -> Path | None:
        sandbox = self._package or self.sandbox
        if "<UDIM>" in name:
            self.changes.note("of textures in tiles (UDIM) the first tile was read")
            name = name.replace("<UDIM>", "1001")
        if name.endswith("]"):
            self.changes.note("textures of packages inside the file were left out: {}", name[-80:])
            return None
        absolute = Path(name)
        if absolute.is_absolute() and absolute.is_relative_to(sandbox.folder):
            name = absolute.relative_to(sandbox.folder).as_posix()
        elif absolute.is_absolute() and absolute.is_relative_to(sandbox.root):
            sandbox.opened.is_file(absolute)
            return absolute.resolve() if absolute.resolve().is_relative_to(sandbox.root) else None
        found = sandbox.find(name, str(self.path), is_image=True)
        if found is None:
            self.changes.note(
                "missing texture, replaced by the plain colour: {}", repr(Path(name).name)[:120]
            )
        return found


@dataclass
class _Builder:
    path: Path
    data: dict[str, Any]
    arrays: dict[str, Any]
    materials: UsdMaterials
    changes: Changes
    names: Names = field(default_factory=Names)
    _meshes: dict[tuple[int, int], Mesh] = field(default_factory=dict)

    def build(self) -> Model:
        data = self.data
        metres = data["metres"] if 1e-9 < data["metres"] < 1e9 else 1.0
        model = Model(kind="usd", up="z" if data["up"] == "z" else "y", unit=metres)
        if not data["metres_stated"]:
            self.changes.note("the file states no unit: USD's default of 1 cm was tried first")
        for shape in data["shapes"]:
            self._shape(shape, model)
        for light in data["lights"]:
            self._light(light, model)
        for camera in data["cameras"]:
            self._camera(camera, model)
        model.outdoors = data["outdoors"]
        if isinstance(data["described"], str):
            found = parse_json(data["described"], f"{self.path}: customLayerData.pbrnet")
            model.described = found if isinstance(found, dict) else None
        return model

    def _shape(self, given: dict[str, Any], model: Model) -> None:
        mesh = self._mesh(given)
        if not len(mesh.faces):
            self.changes.note("prims without area were left out: {}", given["name"])
            return
        color: Color | None = None if given["color"] is None else tuple(given["color"])
        material = self.materials.material(given["material"], color)
        matrix = np.array(given["matrix"])
        shape = Shape(
            self.names.unique(given["name"]),
            given["name"],
            mesh.transformed(matrix),
            material.surface,
        )
        model.shapes.append(shape)
        model.node_paths[shape.id] = tuple(given["nodes"])
        if material.emission is not None:
            model.emissions[shape.id] = material.emission

    def _mesh(self, given: dict[str, Any]) -> Mesh:
        start, stop = given["range"]
        if (start, stop) not in self._meshes:
            points = self._corners("points", start, stop)
            columns = [points]
            if given["normals"]:
                columns.append(self._corners("normals", start, stop))
            if given["uvs"]:
                columns.append(self._corners("uvs", start, stop))
            rows, inverse = np.unique(np.hstack(columns), axis=0, return_inverse=True)
            faces = inverse.reshape(-1, 3)
            normals = rows[:, 3:6] if given["normals"] else None
            uvs = rows[:, -2:] * [1, -1] + [0, 1] if given["uvs"] else None
            if given["smooth"]:
                normals = _smooth(rows[:, :3], faces)
            mesh = Mesh(rows[:, :3], faces, normals, uvs)
            self._meshes[start, stop], _ = cleaned(mesh, f"{self.path}: {given['name']}")
        return self._meshes[start, stop]

    def _corners(self, name: str, start: int, stop: int) -> Float64Array:
        table = self.arrays[name][start:stop]
        return table.reshape(-1, table.shape[-1]).astype(np.float64)

    def _light(self, given: dict[str, Any], model: Model) -> None:
        matrix, color = np.array(given["matrix"]), tuple(given["color"])
        if given["kind"] == "area":
            points = self._corners("points", *given["range"])
            mesh = Mesh(points, np.arange(len(points)).reshape(-1, 3)).transformed(matrix)
            black = plugin("bsdf", "diffuse", reflectance=(0.0, 0.0, 0.0))
            name = f"lamp {given['name']}"
            shape = Shape(self.names.unique(name), name, mesh, Surface(black, name="lamp"))
            model.shapes.append(shape)
            model.node_paths[shape.id] = (f"light:{name}",)
            model.emissions[shape.id] = Emission(color)
            return
        model.lights.append(
            PunctualLight(
                given["kind"],
                color,
                given["intensity"],
                matrix,
                given.get("inner", 0.0),
                given.get("outer", 0.25 * math.pi),
                given["name"],
            )
        )

    def _camera(self, given: dict[str, Any], model: Model) -> None:
        # USD's cameras look along -Z with +X to the right, Mitsuba's along +Z with +X to the left.
        pose = np.array(given["matrix"]) @ np.diag([-1.0, 1, -1, 1])
        aspect = min(max(given["half_width"] / given["half_height"], 0.1), 10.0)
        half = min(math.atan(given["half_width"]), 1.5)
        model.cameras.append(Camera(given["name"], pose, half, round(480 * aspect), 480))


def _smooth(rows: Float64Array, faces: Int64Array) -> Float64Array:
    """Normals (V, 3) of vertices `rows`, smooth across all edges, also where coordinates split."""
    places, inverse = np.unique(rows, axis=0, return_inverse=True)
    return smooth_normals(places, inverse.reshape(-1)[faces])[inverse.reshape(-1)]
