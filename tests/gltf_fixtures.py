"""Small glTF files for the import tests, built by hand from arrays."""

from __future__ import annotations

import base64
import json
import struct
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from PIL import Image

_TYPES = {1: "SCALAR", 2: "VEC2", 3: "VEC3", 4: "VEC4"}
_COMPONENTS = {"f": 5126, "u2": 5123, "u4": 5125, "u1": 5121, "i2": 5122}
# A square of 1 m in the plane y = 0, facing +Y, its v = 0 edge at z = 0 (away from the viewer).
SQUARE = np.array([[0.0, 0, 0], [0, 0, 1], [1, 0, 1], [1, 0, 0]])
SQUARE_FACES = np.array([0, 1, 2, 0, 2, 3])
SQUARE_UV = np.array([[0.0, 0], [0, 1], [1, 1], [1, 0]])


class Builder:
    """Gathers JSON and one buffer; `save` writes `.gltf` (with a data URI) or `.glb`."""

    def __init__(self) -> None:
        self.json: dict[str, Any] = {
            "asset": {"version": "2.0"},
            "scene": 0,
            "scenes": [{"nodes": []}],
        }
        self.data = b""

    def add(self, name: str, item: dict[str, Any]) -> int:
        """Append to a top-level list; returns the index."""
        self.json.setdefault(name, []).append(item)
        return len(self.json[name]) - 1

    def view(self, data: bytes) -> int:
        """A buffer view of these bytes."""
        self.data += b"\0" * (-len(self.data) % 4)
        index = self.add(
            "bufferViews", {"buffer": 0, "byteOffset": len(self.data), "byteLength": len(data)}
        )
        self.data += data
        return index

    def accessor(self, values: npt.ArrayLike, kind: str = "f", **more: Any) -> int:
        """An accessor of (N,) or (N, width) values."""
        array = np.asarray(values)
        packed = array.astype({"f": "<f4"}.get(kind, f"<{kind}"))
        width = 1 if array.ndim == 1 else array.shape[1]
        item = {
            "bufferView": self.view(packed.tobytes()),
            "componentType": _COMPONENTS[kind],
            "count": len(array),
            "type": _TYPES[width],
        }
        return self.add("accessors", {**item, **more})

    def mesh(
        self,
        points: npt.ArrayLike = SQUARE,
        faces: npt.ArrayLike = SQUARE_FACES,
        uv: npt.ArrayLike | None = None,
        **primitive: Any,
    ) -> int:
        """A mesh of one primitive."""
        attributes = {"POSITION": self.accessor(points)}
        if uv is not None:
            attributes["TEXCOORD_0"] = self.accessor(uv)
        item = {"attributes": attributes, "indices": self.accessor(faces, "u2"), **primitive}
        return self.add("meshes", {"primitives": [item]})

    def node(self, root: bool = True, **item: Any) -> int:
        """A node, by default one of the scene's."""
        index = self.add("nodes", item)
        if root:
            self.json["scenes"][0]["nodes"].append(index)
        return index

    def texture(self, pixels: npt.NDArray[np.uint8], **sampler: Any) -> int:
        """A texture stored as PNG in the buffer."""
        stream = BytesIO()
        Image.fromarray(pixels).save(stream, "PNG")
        image = self.add("images", {"bufferView": self.view(stream.getvalue()),
                                    "mimeType": "image/png"})  # fmt: skip
        return self.add("textures", {"source": image, "sampler": self.add("samplers", sampler)})

    def save(self, path: Path) -> Path:
        """Write the file; `.glb` by its suffix."""
        path.parent.mkdir(parents=True, exist_ok=True)
        buffer: dict[str, Any] = {"byteLength": len(self.data)}
        if self.data and "buffers" not in self.json:
            if path.suffix == ".gltf":
                text = base64.b64encode(self.data).decode()
                buffer["uri"] = f"data:application/octet-stream;base64,{text}"
            self.json["buffers"] = [buffer]
        text = json.dumps(self.json).encode()
        if path.suffix == ".gltf":
            path.write_bytes(text)
            return path
        text += b" " * (-len(text) % 4)
        binary = self.data + b"\0" * (-len(self.data) % 4)
        chunks = struct.pack("<II", len(text), 0x4E4F534A) + text
        chunks += struct.pack("<II", len(binary), 0x004E4942) + binary
        path.write_bytes(b"glTF" + struct.pack("<II", 2, 12 + len(chunks)) + chunks)
        return path


def square(**material: Any) -> Builder:
    """A ground of 8 m with uv, of the material given."""
    made = Builder()
    index = made.add("materials", {"name": "paint", **material})
    made.node(mesh=made.mesh(8 * SQUARE, uv=SQUARE_UV, material=index), name="ground")
    return made
