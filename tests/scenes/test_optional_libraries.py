"""A library of an extra that is missing ends in one line that says how to install it."""

import subprocess
import sys
from pathlib import Path

import pytest

from pbrnet.scenes.errors import MachineError
from pbrnet.scenes.image_files import open_image
from pbrnet.scenes.installation import optional
from pbrnet.scenes.models.gltf.compression import decode_draco, decode_meshopt
from tests.fixtures.paths import ROOT

LIBRARIES = ("DracoPy", "collada", "dvc", "javaobj", "meshopt", "opengl_basisu")


def test_every_command_and_source_is_imported_without_them() -> None:
    code = f"""
import importlib, sys
for name in {LIBRARIES}: sys.modules[name] = None
from pbrnet.pipeline.cli import COMMANDS
for place, _ in COMMANDS.values(): importlib.import_module(place.split(":")[0])
import pbrnet.scenes.image_files, pbrnet.scenes.models.importer, pbrnet.scenes.sweethome.importer
"""
    subprocess.run([sys.executable, "-c", code], check=True, cwd=ROOT)


def test_what_needs_one_names_the_extra(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    for name in LIBRARIES:
        monkeypatch.setitem(sys.modules, name, None)
    texture = tmp_path / "a.ktx2"
    texture.write_bytes(b"\xabKTX 20\xbb\r\n\x1a\n")
    with pytest.raises(MachineError, match=r"DracoPy is missing; install pbrnet\[formats\]"):
        decode_draco(b"", "a.glb")
    with pytest.raises(MachineError, match="meshopt"):
        decode_meshopt(b"", 1, 4, "TRIANGLES", "NONE", "a.glb")
    with pytest.raises(MachineError, match="opengl_basisu"):
        open_image(texture)
    with pytest.raises(MachineError, match="collada is missing"):
        monkeypatch.delitem(sys.modules, "pbrnet.scenes.formats.collada", raising=False)
        optional("pbrnet.scenes.formats.collada")
    with pytest.raises(ModuleNotFoundError):
        optional("pbrnet.scenes.no_such_module")
