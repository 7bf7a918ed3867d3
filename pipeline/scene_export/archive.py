"""A scene folder as one zip archive: `scene.xml`, `scene.json`, meshes, textures.

All paths in it are relative, so that the unpacked folder opens with the `mitsuba` command, and
`pbrnet import` reads archive and folder. Equal scenes give equal bytes.
"""

from __future__ import annotations

import zipfile
from pathlib import Path

from pbrnet.scenes.contract import load_scene
from pbrnet.scenes.errors import InputError
from pbrnet.scenes.files import MAX_FILES, open_regular, resolved
from pbrnet.scenes.formats.scene_xml import check_scene_xml

_EPOCH = (1980, 1, 1, 0, 0, 0)
_STORED = (".png", ".jpg", ".jpeg", ".exr")  # compressed already


def write_archive(folder: Path, target: Path) -> int:
    """Write the scene `folder` to the zip `target`; returns the number of files in it.

    Raises `InputError` for a scene that reads files from elsewhere, and for links out of it.
    """
    scene = load_scene(folder)
    check_scene_xml(scene.xml)
    files = sorted(path for path in folder.rglob("*") if not path.is_dir())
    if len(files) > MAX_FILES:
        raise InputError(f"{folder}: more than {MAX_FILES:,} files")
    with zipfile.ZipFile(target, "w") as archive:
        for path in files:
            if not resolved(path).is_relative_to(resolved(folder)):
                raise InputError(f"{path}: is a link out of the scene's folder; refused")
            name = f"{scene.scene_id}/{path.relative_to(folder).as_posix()}"
            entry = zipfile.ZipInfo(name, _EPOCH)
            entry.external_attr = 0o644 << 16
            stored = path.suffix.lower() in _STORED
            entry.compress_type = zipfile.ZIP_STORED if stored else zipfile.ZIP_DEFLATED
            with open_regular(path) as source, archive.open(entry, "w") as member:
                while block := source.read(1 << 20):
                    member.write(block)
    return len(files)
