"""Images of a glTF file as files on disk, whether external, in a buffer or in a data URI."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from pbrnet.scenes.arrays import Float64Array
from pbrnet.scenes.errors import InputError
from pbrnet.scenes.importing.changes import Changes
from pbrnet.scenes.models.gltf.container import Asset, extensions, number, numbers, whole

_WRAPS = {10497: "repeat", 33071: "clamp", 33648: "mirror"}
_NEAREST = 9728
_MAGIC = {b"\x89PNG": ".png", b"\xff\xd8\xff": ".jpg", b"RIFF": ".webp", b"\xabKTX": ".ktx2"}


@dataclass(frozen=True)
class ImageTexture:
    """A texture of a material: image file, sampling and texture coordinates."""

    path: Path
    wrap: str = "repeat"  # "repeat", "clamp" or "mirror"
    nearest: bool = False  # nearest-neighbour filtering
    texcoord: int = 0  # number of the set of texture coordinates
    to_uv: Float64Array | None = None  # (4, 4), Mitsuba's `to_uv`


@dataclass
class Images:
    """Finds the images of `asset`; embedded ones are unpacked into `folder`."""

    asset: Asset
    folder: Path
    changes: Changes
    _paths: dict[int, Path | None] = field(default_factory=dict)

    def texture(self, info: Any, where: str) -> ImageTexture | None:
        """Return the texture of a textureInfo object; None, with a note, if it is missing."""
        if not isinstance(info, dict):
            return None
        texture = self.asset.item("textures", info.get("index"), where)
        more = extensions(texture)
        # PNG and JPEG are decoded more exactly than the image that they are a fallback for.
        source = texture.get("source", more.get("KHR_texture_basisu", {}).get("source"))
        source = more.get("EXT_texture_webp", {}).get("source", source)
        if source is None:
            self.changes.note("a texture without a readable image was left out: {}", where)
            return None
        count = len(self.asset.items("images"))
        path = self._path(whole(source, f"{self.asset.path}: {where}", 0, count - 1))
        if path is None:
            return None
        sampler = {}
        if "sampler" in texture:
            sampler = self.asset.item("samplers", texture["sampler"], where)
        wraps = [_WRAPS.get(sampler.get(key, 10497), "repeat") for key in ("wrapS", "wrapT")]
        if wraps[0] != wraps[1]:
            self.changes.note(
                "a texture has two wrap modes; the mode in u was used for both directions: {}",
                path.name,
            )
        texcoord = whole(info.get("texCoord", 0), f"{self.asset.path}: {where}.texCoord", 0, 15)
        transform = extensions(info).get("KHR_texture_transform")
        to_uv = None
        if transform is not None:
            to_uv = texture_matrix(transform, f"{self.asset.path}: {where}")
            if "texCoord" in transform:
                texcoord = whole(
                    transform["texCoord"], f"{self.asset.path}: {where}.texCoord", 0, 15
                )
        return ImageTexture(path, wraps[0], sampler.get("magFilter") == _NEAREST, texcoord, to_uv)

    def _path(self, index: int) -> Path | None:
        if index not in self._paths:
            self._paths[index] = self._unpack(index)
        return self._paths[index]

    def _unpack(self, index: int) -> Path | None:
        image = self.asset.items("images")[index]
        label = f"{self.asset.path}: images[{index}]"
        uri = image.get("uri")
        if isinstance(uri, str) and not uri.startswith("data:"):
            try:
                path = self.asset.find(uri, label, is_image=True)
            except InputError:
                if "://" not in uri:
                    raise
                path = None
            if path is None:
                self.changes.note("missing texture, replaced by the plain colour: {}", uri[:120])
            return path
        if uri is not None:
            data = self.asset.fetch(uri, label)
        else:
            data, _ = self.asset.view(image.get("bufferView"), f"images[{index}].bufferView")
        suffix = next((s for magic, s in _MAGIC.items() if data.startswith(magic)), None)
        if suffix is None:
            self.changes.note("an image of unknown format was left out: {}", f"images[{index}]")
            return None
        stem = "".join(
            c if c.isascii() and c.isalnum() else "_" for c in str(image.get("name", ""))
        )
        path = self.folder / f"{stem[:40] or 'image'}_{index}{suffix}"
        path.write_bytes(data)
        return path


def texture_matrix(transform: dict[str, Any], where: str) -> Float64Array:
    """The matrix (4, 4) of KHR_texture_transform: scale, rotate counter-clockwise, translate.

    v points down in an image, so the rotation has the signs of a left-handed plane.
    """
    offset = numbers(transform.get("offset", [0, 0]), 2, f"{where}.offset")
    scale = numbers(transform.get("scale", [1, 1]), 2, f"{where}.scale")
    angle = number(transform.get("rotation", 0), f"{where}.rotation")
    cos, sin = np.cos(angle), np.sin(angle)
    matrix = np.eye(4)
    matrix[:2, :2] = np.array([[cos, sin], [-sin, cos]]) @ np.diag(scale)
    matrix[:2, 3] = offset
    return matrix
