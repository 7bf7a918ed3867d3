"""Hostile glTF with compressed content: Draco, meshopt and Basis Universal."""

import json
from pathlib import Path

import numpy as np

from tests.fixtures import ktx
from tests.fixtures.gltf import square
from tests.hostile.family import Family, Made, Victim
from tests.hostile.made import case, with_file, with_link
from tests.hostile.mutations import damaged_bytes, damaged_json
from tests.scenes.models.test_gltf_compression import draco_square, meshopt_square

DRACO, MESHOPT, BASIS = (f"import {name}.gltf --out out --scale 1" for name in "dmk")
_BUILDERS = {"d": draco_square, "m": meshopt_square}


def _compressed(folder: Path) -> None:
    """Geometry of both kinds with its data in a file of its own, and a texture of each format."""
    for name, builder in _BUILDERS.items():
        made = builder()
        made.save(folder / f"{name}.gltf")
        (folder / f"{name}.bin").write_bytes(made.data)
        _change(folder / f"{name}.gltf", {"buffers": {0: {"uri": f"{name}.bin"}}})
    made = square(pbrMetallicRoughness={"baseColorTexture": {"index": 0}})
    made.texture(np.full((8, 8, 3), 120, np.uint8))
    made.json["images"] = [{"uri": "t.ktx2", "mimeType": "image/ktx2"}]
    made.json["textures"] = [{"extensions": {"KHR_texture_basisu": {"source": 0}}}]
    made.json["extensionsUsed"] = ["KHR_texture_basisu"]
    made.save(folder / "k.gltf")
    (folder / "u.gltf").write_text((folder / "k.gltf").read_text().replace("t.ktx2", "u.ktx2"))
    (folder / "t.ktx2").write_bytes(ktx.ETC1S)
    (folder / "u.ktx2").write_bytes(ktx.UASTC)


def _change(path: Path, changes: dict[str, dict[int, dict[str, object]]]) -> None:
    content = json.loads(path.read_text())
    for section, items in changes.items():
        for number, values in items.items():
            content[section][number].update(values)
    path.write_text(json.dumps(content))


@case
def _view(folder: Path, **changes: object) -> str:
    """The extension of the first compressed buffer view is another."""
    path = folder / "m.gltf"
    content = json.loads(path.read_text())
    view = next(one for one in content["bufferViews"] if "extensions" in one)
    view["extensions"]["EXT_meshopt_compression"].update(changes)
    path.write_text(json.dumps(content))
    return MESHOPT


def _image(size: int, depth: int = 0, levels: int = 1, data: bytes = ktx.UASTC) -> Made:
    """A KTX2 header that states another size, depth and number of levels."""
    header = bytearray(data)
    header[20:28] = size.to_bytes(4, "little") * 2
    header[28:32] = depth.to_bytes(4, "little")
    header[40:44] = levels.to_bytes(4, "little")
    return with_file("t.ktx2", bytes(header), BASIS)


MADE = (
    *(_view(count=value) for value in (0, -1, 2**31, 2**62, 10**400, 1.5, "4", None)),
    *(_view(byteStride=value) for value in (0, -1, 3, 257, 2**31, None)),
    *(_view(byteLength=value) for value in (0, -1, 2**62, "x")),
    *(_view(byteOffset=value) for value in (-1, 2**62, [])),
    *(_view(mode=value) for value in ("TRIANGLES", "INDICES", "", 5, None, [])),
    *(_view(filter=value) for value in ("OCTAHEDRAL", "QUATERNION", "EXPONENTIAL", {}, 1)),
    *(_image(size) for size in (0, 1, 7, 4096, 15_000, 2**31, 2**32 - 1)),
    *(_image(size, data=ktx.ETC1S) for size in (0, 4096, 2**32 - 1)),
    *(_image(8, depth) for depth in (1, 2**32 - 1)),
    *(_image(8, 0, levels) for levels in (0, 2, 2**32 - 1)),
    with_file("t.ktx2", ktx.ETC1S[:12] + b"\xff" * 600, BASIS),
    with_file("d.bin", b"DRACO" + b"\xff" * 400, DRACO),
    with_file("d.bin", b"DRACO\x02\x02\x01\x01\0\0" + b"\xff" * 400, DRACO),
    with_link("t.ktx2", "/dev/zero", BASIS),
    with_link("d.bin", "/dev/zero", DRACO),
    with_link("m.bin", "m.bin", MESHOPT),
)

FAMILIES = (
    Family(
        "compressed gltf",
        200,
        _compressed,
        (
            Victim("d.bin", damaged_bytes, (DRACO,)),
            Victim("d.bin", damaged_bytes, (DRACO,)),
            Victim("m.bin", damaged_bytes, (MESHOPT,)),
            Victim("t.ktx2", damaged_bytes, (BASIS,)),
            Victim("u.ktx2", damaged_bytes, (BASIS.replace("k.", "u."),)),
            Victim("d.gltf", damaged_json, (DRACO,)),
            Victim("m.gltf", damaged_json, (MESHOPT,)),
        ),
        MADE,
    ),
)
