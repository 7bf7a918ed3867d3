"""JSON and buffers of `.gltf` and `.glb` files, with checked access.

Khronos, *glTF 2.0 Specification*. Files are not trusted: sizes, counts and references are
bounded, nothing outside the file's own folder is opened, and nothing is downloaded.
"""

from __future__ import annotations

import base64
import binascii
import math
import struct
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any
from urllib.parse import unquote

from pbrnet.scenes.checked import shown
from pbrnet.scenes.errors import InputError
from pbrnet.scenes.files import parse_json
from pbrnet.scenes.importing.sandbox import Sandbox
from pbrnet.scenes.models.gltf.compression import decode_meshopt

MAX_BYTES = 512 * 2**20  # of a file, and of all buffers together
MAX_JSON = 64 * 2**20  # bytes
MAX_ITEMS = 100_000  # of any list in the JSON
_JSON_CHUNK, _BINARY_CHUNK = 0x4E4F534A, 0x004E4942

# Properties of glTF's objects that are text, and those that are numbers, wherever they stand.
_TEXTS = frozenset(
    (
        "alphaMode", "copyright", "generator", "interpolation", "mimeType", "minVersion", "name",
        "type", "uri", "version",
    )
)  # fmt: skip
_NUMBERS = frozenset(
    (
        "buffer", "bufferView", "byteLength", "byteOffset", "byteStride", "camera",
        "componentType", "count", "index", "light", "magFilter", "material", "mesh", "minFilter",
        "sampler", "source", "texCoord", "wrapS", "wrapT",
    )
)  # fmt: skip
# Extensions that a file may require.
UNDERSTOOD = frozenset(
    (
        "KHR_draco_mesh_compression",
        "KHR_lights_punctual",
        "KHR_materials_clearcoat",
        "KHR_materials_diffuse_transmission",
        "KHR_materials_emissive_strength",
        "KHR_materials_ior",
        "KHR_materials_pbrSpecularGlossiness",
        "KHR_materials_sheen",
        "KHR_materials_specular",
        "KHR_materials_transmission",
        "KHR_materials_unlit",
        "KHR_materials_volume",
        "KHR_mesh_quantization",
        "KHR_meshopt_compression",
        "KHR_node_visibility",
        "KHR_texture_basisu",
        "KHR_texture_transform",
        "EXT_mesh_gpu_instancing",
        "EXT_meshopt_compression",
        "EXT_texture_webp",
    )
)
# Extensions that a file may require and that are ignored, with little effect on the image.
IGNORED = frozenset(
    (
        "KHR_animation_pointer",
        "KHR_materials_anisotropy",
        "KHR_materials_dispersion",
        "KHR_materials_iridescence",
        "KHR_materials_variants",
        "KHR_xmp_json_ld",
    )
)
_MESHOPT = ("EXT_meshopt_compression", "KHR_meshopt_compression")


@dataclass
class Asset:
    """One glTF file: its JSON and access to its buffers."""

    path: Path
    data: dict[str, Any]
    sandbox: Sandbox
    binary: bytes | None = None  # the second chunk of a GLB
    _buffers: dict[int, bytes] = field(default_factory=dict)
    _lists: dict[str, list[dict[str, Any]]] = field(default_factory=dict)
    _decoded: dict[int, bytes] = field(default_factory=dict)  # compressed buffer views

    def items(self, name: str) -> list[dict[str, Any]]:
        """Return a top-level list of objects, such as "nodes"; empty if absent."""
        if name not in self._lists:
            self._lists[name] = objects(self.data, name, str(self.path))
        return self._lists[name]

    def item(self, name: str, index: Any, where: str) -> dict[str, Any]:
        """Return element `index` of a top-level list; `InputError` if there is none."""
        found = self.items(name)
        return found[whole(index, f"{self.path}: {where}", 0, len(found) - 1)]

    def buffer(self, index: int) -> bytes:
        """Return the bytes of a buffer, at least as many as it declares."""
        if index not in self._buffers:
            self._buffers[index] = self._load(index)
            if sum(map(len, self._buffers.values())) > MAX_BYTES:
                raise InputError(
                    f"{self.path}: buffers are larger than the limit of {MAX_BYTES >> 20} MiB"
                )
        return self._buffers[index]

    def view(self, index: Any, where: str) -> tuple[bytes, int]:
        """Return the bytes of a buffer view, decompressed, and its stride (0: packed)."""
        view = self.item("bufferViews", index, where)
        label = f"{self.path}: bufferViews[{index}]"
        stride = whole(view.get("byteStride", 0), f"{label}.byteStride", 0, 252)
        compressed = next((e for name, e in extensions(view).items() if name in _MESHOPT), None)
        if compressed is None:
            return self._slice(view, label), stride
        if index not in self._decoded:
            self._decoded[index] = self._decompress(compressed, f"{label}.meshopt_compression")
            if sum(map(len, self._decoded.values())) > MAX_BYTES:
                raise InputError(
                    f"{self.path}: decompressed data exceeds the limit of {MAX_BYTES >> 20} MiB"
                )
        return self._decoded[index], stride

    def _decompress(self, compressed: dict[str, Any], label: str) -> bytes:
        count = whole(compressed.get("count"), f"{label}.count", 1, MAX_BYTES)
        stride = whole(compressed.get("byteStride"), f"{label}.byteStride", 1, 256)
        if count * stride > MAX_BYTES:
            raise InputError(f"{label}: exceeds the limit of {MAX_BYTES >> 20} MiB")
        data = self._slice(compressed, label)
        mode, filtered = compressed.get("mode"), compressed.get("filter", "NONE")
        return decode_meshopt(data, count, stride, mode, filtered, label)

    def _slice(self, view: dict[str, Any], label: str) -> bytes:
        """The bytes of a buffer from `byteOffset` on, `byteLength` of them."""
        number = whole(view.get("buffer"), f"{label}.buffer", 0, len(self.items("buffers")) - 1)
        data = self.buffer(number)
        start = whole(view.get("byteOffset", 0), f"{label}.byteOffset", 0, MAX_BYTES)
        length = whole(view.get("byteLength"), f"{label}.byteLength", 1, MAX_BYTES)
        if start + length > len(data):
            raise InputError(
                f"{label}: needs bytes {start} to {start + length} of a buffer of {len(data)} "
                "bytes; the file is truncated or damaged"
            )
        return data[start : start + length]

    def _load(self, index: int) -> bytes:
        buffer = self.items("buffers")[index]
        label = f"{self.path}: buffers[{index}]"
        length = whole(buffer.get("byteLength"), f"{label}.byteLength", 1, MAX_BYTES)
        uri = buffer.get("uri")
        if uri is None:
            if index != 0 or self.binary is None:
                raise InputError(
                    f"{label}: has no data; a .glb file must have it in its second chunk"
                )
            data = self.binary
        else:
            data = self.fetch(uri, label)
        if len(data) < length:
            raise InputError(f"{label}: declares {length} bytes but has {len(data)}")
        return data

    def fetch(self, uri: Any, label: str) -> bytes:
        """Return the bytes of a URI: embedded data, or a file in the asset's folder."""
        if isinstance(uri, str) and uri.startswith("data:"):
            return decode_data_uri(uri, label)
        path = self.find(uri, label)
        if path is None:
            raise InputError(
                f"{label}: the file {uri[:200]!r} is missing; put it into the folder of {self.path}"
            )
        if path.stat().st_size > MAX_BYTES:
            raise InputError(f"{label}: {path} is larger than the limit of {MAX_BYTES >> 20} MiB")
        return path.read_bytes()

    def find(self, uri: Any, label: str, is_image: bool = False) -> Path | None:
        """Return the path of the file that a relative URI names, or None if it is missing."""
        if not isinstance(uri, str):
            raise InputError(f"{label}: a URI must be a string, got {uri!r:.60}")
        if uri.split(":")[0].lower() in ("http", "https", "ftp", "file"):
            raise InputError(
                f"{label}: {uri[:120]!r} is not downloaded; put that file into the folder of "
                f"{self.path} and name it by a relative path"
            )
        return self.sandbox.find(unquote(uri), label, is_image)


def open_asset(path: Path, sandbox: Sandbox) -> Asset:
    """Open a `.gltf` or `.glb` file; `InputError` names what is damaged or not supported."""
    size = path.stat().st_size
    if size > MAX_BYTES:
        raise InputError(
            f"{path}: the file has {size / 2**20:.0f} MiB; the limit is {MAX_BYTES >> 20} MiB"
        )
    data = path.read_bytes()
    binary = None
    if data[:4] == b"glTF":
        text, binary = _chunks(path, data)
    else:
        text = data
    if len(text) > MAX_JSON:
        raise InputError(
            f"{path}: the JSON has {len(text) >> 20} MiB; the limit is {MAX_JSON >> 20} MiB"
        )
    try:
        decoded = text.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise InputError(f"{path}: not a glTF file; its JSON is damaged ({error})") from None
    parsed = parse_json(decoded, f"{path}: not a glTF file; its JSON is damaged")
    if not isinstance(parsed, dict) or not isinstance(parsed.get("asset"), dict):
        raise InputError(f"{path}: not a glTF file; it has no 'asset'")
    _check_types(parsed, path)
    version = str(parsed["asset"].get("version", ""))
    if version.split(".")[0] != "2":
        raise InputError(f"{path}: glTF version {version[:20]!r} is not supported, only version 2")
    required = parsed.get("extensionsRequired", [])
    if not isinstance(required, list):
        raise InputError(f"{path}: extensionsRequired must be a list")
    for name in required:
        if not isinstance(name, str) or name not in UNDERSTOOD | IGNORED:
            raise InputError(
                f"{path}: requires the extension {name!r:.80}, which is not supported; export the "
                "file again without it"
            )
    return Asset(path, parsed, sandbox, binary)


def decode_data_uri(uri: str, label: str) -> bytes:
    """Decode a base64 `data:` URI."""
    head, comma, body = uri.partition(",")
    if not comma or not head.endswith(";base64"):
        raise InputError(f"{label}: the data URI is not base64: {uri[:60]!r}")
    try:
        return base64.b64decode(body, validate=True)
    except (binascii.Error, ValueError) as error:
        raise InputError(f"{label}: the data URI is damaged ({error})") from None


def extensions(item: dict[str, Any]) -> dict[str, dict[str, Any]]:
    """Return the extensions of a JSON object that are objects themselves, by name."""
    found = item.get("extensions")
    if not isinstance(found, dict):
        return {}
    return {name: value for name, value in found.items() if isinstance(value, dict)}


def objects(data: dict[str, Any], name: str, where: str) -> list[dict[str, Any]]:
    """Return the list of JSON objects called `name`; empty if absent."""
    found = data.get(name, [])
    if not isinstance(found, list) or not all(isinstance(item, dict) for item in found):
        raise InputError(f"{where}: {name} must be a list of objects")
    if len(found) > MAX_ITEMS:
        raise InputError(f"{where}: has {len(found):,} {name}; the limit is {MAX_ITEMS:,}")
    return found


def whole(value: Any, where: str, low: int, high: int) -> int:
    """Check an integer in [low, high] and return it."""
    if isinstance(value, float) and value.is_integer():
        value = int(value)
    if not isinstance(value, int) or isinstance(value, bool) or not low <= value <= high:
        raise InputError(f"{where}: expected an integer from {low} to {high}, got {value!r:.60}")
    return value


def _check_types(parsed: dict[str, Any], path: Path) -> None:
    """Raise `InputError` where a property that is text, or a number, holds anything else.

    What applications keep for themselves (`extras`, extensions that are not read) is passed over.
    """
    waiting: list[Any] = [parsed]
    while waiting:
        item = waiting.pop()
        if isinstance(item, list):
            waiting += item
        if not isinstance(item, dict):
            continue
        for key, value in item.items():
            if key in _TEXTS and not isinstance(value, str):
                raise InputError(f"{path}: {key!r} must be text, got {shown(value)}")
            if key in _NUMBERS and (isinstance(value, bool) or not isinstance(value, int | float)):
                raise InputError(f"{path}: {key!r} must be a number, got {shown(value)}")
            if key == "extensions" and isinstance(value, dict):
                waiting += [one for name, one in value.items() if name in UNDERSTOOD]
            elif key != "extras":
                waiting.append(value)


def number(value: Any, where: str, low: float = -math.inf, high: float = math.inf) -> float:
    """Check a finite number and return it, clipped to [low, high]."""
    if not isinstance(value, int | float) or isinstance(value, bool) or not math.isfinite(value):
        raise InputError(f"{where}: expected a finite number, got {value!r:.60}")
    return float(min(max(value, low), high))


def numbers(value: Any, count: int, where: str) -> list[float]:
    """Check a list of `count` finite numbers and return it."""
    if not isinstance(value, list) or len(value) != count:
        raise InputError(f"{where}: expected {count} numbers, got {value!r:.60}")
    return [number(item, where) for item in value]


def _chunks(path: Path, data: bytes) -> tuple[bytes, bytes | None]:
    """The JSON chunk and, if there is one, the binary chunk of a GLB file."""
    if len(data) < 20:
        raise InputError(f"{path}: the GLB file is truncated")
    version, length = struct.unpack_from("<II", data, 4)
    if version != 2:
        raise InputError(f"{path}: GLB version {version} is not supported, only version 2")
    if length > len(data):
        raise InputError(
            f"{path}: the file is truncated; it declares {length} bytes but has {len(data)}"
        )
    at, found = 12, []
    while at + 8 <= length:
        size, kind = struct.unpack_from("<II", data, at)
        at += 8
        if at + size > length:
            raise InputError(f"{path}: a chunk of {size} bytes reaches beyond the end of the file")
        found.append((kind, data[at : at + size]))
        at += size
    if not found or found[0][0] != _JSON_CHUNK:
        raise InputError(f"{path}: the first chunk of the GLB file is not JSON")
    return found[0][1], next((body for kind, body in found[1:] if kind == _BINARY_CHUNK), None)
