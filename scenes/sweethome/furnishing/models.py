"""Reader of the 3D models inside a home: OBJ, COLLADA, 3DS, also zipped.

A model is read into parts by group and material, in its own axes (x right, y up, z to the
front) and units.
"""

from __future__ import annotations

from pbrnet.scenes.errors import InputError
from pbrnet.scenes.formats.archive import HomeArchive
from pbrnet.scenes.formats.max3ds import read_3ds
from pbrnet.scenes.formats.model_parts import Model, ModelMaterial, UnreadableModel
from pbrnet.scenes.formats.mtl import MAX_MTL
from pbrnet.scenes.formats.obj_model import read_model_materials, read_obj_model
from pbrnet.scenes.importing.changes import Changes
from pbrnet.scenes.installation import optional
from pbrnet.scenes.sweethome.furnishing.missing import ABSENT

_SUFFIXES = (".obj", ".dae", ".3ds")  # of models in a zip; the first is preferred


class Models:
    """Models of an archive; each is read once."""

    def __init__(self, archive: HomeArchive, changes: Changes) -> None:
        self._archive, self._changes = archive, changes
        self._read: dict[str, Model | UnreadableModel] = {}

    def get(self, member: str) -> Model:
        """Return the model in a member of the archive; raises `UnreadableModel`."""
        if member not in self._read:
            try:
                self._read[member] = read_model(self._archive, member, self._changes)
            except UnreadableModel as error:
                self._read[member] = error
        found = self._read[member]
        if isinstance(found, UnreadableModel):
            raise found
        return found


def read_model(archive: HomeArchive, member: str, changes: Changes) -> Model:
    """Return the model in a member of the archive; raises `UnreadableModel`."""
    if member not in archive:
        raise UnreadableModel(ABSENT)
    try:
        data = archive.read(member)
        kind = _kind(data)
        if kind == "zipped":
            member = _inside(archive, member)
            data = archive.read(member)
            kind = _kind(data)
    except InputError as error:
        raise UnreadableModel(str(error)) from None

    def library(name: str) -> dict[str, ModelMaterial]:
        found = archive.beside(member, name)
        if found is None:
            changes.note("material files of models are missing: {}", f"{name} of {member}")
            return {}
        try:
            data = archive.read(found, MAX_MTL)
            return read_model_materials(data, found, lambda image: archive.beside(found, image))
        except InputError as error:
            changes.note("material files of models cannot be read: {}", str(error))
            return {}

    def image(name: str) -> str | None:
        found = archive.beside(member, name)
        if found is None:
            changes.note("images of models are missing: {}", f"{name} of {member}")
        return found

    if kind == "OBJ":
        return read_obj_model(data, member, library)
    if kind == "COLLADA":
        collada = optional("pbrnet.scenes.formats.collada")
        parts: Model = collada.read_dae(
            data, image, lambda lost: changes.note(f"{lost}: {{}}", member)
        )
        return parts
    if kind == "3DS":
        return read_3ds(data, image)
    raise UnreadableModel(f"{kind} models are not read")


def _inside(archive: HomeArchive, member: str) -> str:
    """Return the model in a zip, such as KMZ; raises `UnreadableModel` and `InputError`."""
    names = [name for name in archive.open_inside(member) if "__MACOSX/" not in name]
    for suffix in _SUFFIXES:
        found = [name for name in names if name.lower().endswith(suffix)]
        if found:
            return found[0]
    raise UnreadableModel(f"no model ({', '.join(_SUFFIXES)}) in the zip that it is")


def _kind(data: bytes) -> str:
    head = data[:2048].lstrip(b"\xef\xbb\xbf \t\r\n")
    if data[:2] == b"MM":
        return "3DS"
    if head.startswith(b"<") or data[:2] in (b"\xff\xfe", b"\xfe\xff"):
        return "COLLADA"
    if data[:4] == b"FORM":
        return "LightWave"
    if data[:2] == b"PK":
        return "zipped"
    if b"\0" in head:
        return "binary"
    return "OBJ"
