"""Reader of .blend and .fbx files: `export.py` has Blender write glTF, which is then read.

Blender runs in a process of its own, limited in time and memory, without the scripts of the file.
It is found in this order: the program or the Python with `bpy` that `PBRNET_BLENDER` names, `bpy`
in this Python (the extra pbrnet[blender]), `blender` on the PATH.
"""

from __future__ import annotations

import os
import shutil
import sys
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pbrnet.scenes.child_process import run_program
from pbrnet.scenes.errors import InputError, MachineError
from pbrnet.scenes.files import read_json
from pbrnet.scenes.importing.changes import Changes
from pbrnet.scenes.importing.materials.textures import TextureStore
from pbrnet.scenes.importing.sandbox import Sandbox
from pbrnet.scenes.models.gltf.container import open_asset
from pbrnet.scenes.models.gltf.images import Images
from pbrnet.scenes.models.gltf.reader import read_gltf
from pbrnet.scenes.models.model import Model
from pbrnet.scenes.opened_files import OpenedFiles

if TYPE_CHECKING:  # Blender's code: what an import gives depends on it, but it is loaded there
    from pbrnet.scenes.models.blender import export as _export  # noqa: F401

VARIABLE = "PBRNET_BLENDER"
_SCRIPT = Path(__file__).with_name("export.py")
_SECONDS = 300  # of a processor, for Blender
_MEMORY = 12 * 2**30  # bytes of address space, for Blender


def read_model(
    path: Path, sandbox: Sandbox, textures: TextureStore, unpacked: Path, changes: Changes
) -> Model:
    """Read a `.blend` or `.fbx` file; see `importer.ModelReader`."""
    out = unpacked / "blender"
    out.mkdir()
    arguments = [str(path.resolve()), str(sandbox.root), str(out), str(_SECONDS), str(_MEMORY)]
    command = [*blender_command(path), *arguments]
    run_program(command, _environment(out), path, _SECONDS, _MEMORY, out / "message")
    exported, notes = out / "scene.glb", _notes(path, out / "notes.json")
    if not exported.is_file():
        raise InputError(f"{path}: Blender wrote nothing; the file is damaged or has no surfaces")
    for name in notes["files"]:
        sandbox.opened.is_file(Path(name))
    for sentence, details in notes["notes"].items():
        for detail in details:
            changes.note(sentence, detail)
    asset = open_asset(exported, Sandbox(OpenedFiles(out)))
    try:
        model = read_gltf(asset, Images(asset, unpacked, changes), textures, changes)
    except InputError as error:
        raise InputError(str(error).replace(str(exported), f"{path}, exported")) from None
    model.kind = path.suffix[1:].lower()
    model.version = ""
    model.unit = notes["unit"]
    model.outdoors = bool(notes["outdoors"])
    return model


def blender_command(path: Path) -> list[str]:
    """Return the command that runs `export.py` in Blender; `MachineError` if there is none."""
    named = os.environ.get(VARIABLE, "")
    program = named or ("" if find_spec("bpy") else shutil.which("blender") or "")
    if named and shutil.which(named) is None:
        raise MachineError(f"{VARIABLE}={named}: there is no such program")
    if named and Path(named).name.startswith("python"):
        return [named, "-I", str(_SCRIPT)]
    if program:
        return [program, "--background", "--factory-startup", "--disable-autoexec",
                "--python-exit-code", "4", "--python", str(_SCRIPT), "--"]  # fmt: skip
    if find_spec("bpy"):
        return [sys.executable, "-I", str(_SCRIPT)]
    raise MachineError(
        f"{path}: {path.suffix.lower()} files are read by Blender; install it so that `blender` is "
        f"on the PATH, or name a Python that has its module bpy in {VARIABLE} (with Python 3.13: "
        "pip install 'pbrnet[blender]'); or export the file to glTF in Blender"
    )


def _environment(home: Path) -> dict[str, str]:
    """Variables of a process that finds no settings, add-ons or modules of the user."""
    kept = {name: os.environ[name] for name in ("PATH", "LANG", "LD_LIBRARY_PATH", "SYSTEMROOT")
            if name in os.environ}  # fmt: skip
    return {**kept, "HOME": str(home), "TMPDIR": str(home), "PYTHONNOUSERSITE": "1"}


def _notes(path: Path, file: Path) -> dict[str, Any]:
    """Notes that `export.py` left beside the scene, checked: the file may be a stranger's."""
    try:
        notes = read_json(file)
        return {
            "notes": {
                str(sentence): [str(detail) for detail in details]
                for sentence, details in dict(notes["notes"]).items()
            },
            "files": [str(name) for name in notes["files"]],
            "unit": float(notes["unit"]),
            "outdoors": bool(notes["outdoors"]),
        }
    except (InputError, OSError, ValueError, KeyError, TypeError, OverflowError):
        raise InputError(f"{path}: Blender did not finish; the file is damaged") from None
