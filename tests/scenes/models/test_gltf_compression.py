"""Compressed glTF: Draco and meshopt geometry, Basis Universal and WebP images, instances."""

from pathlib import Path
from typing import Any

import DracoPy
import meshopt
import numpy as np
import pytest
from PIL import Image

from pbrnet.scenes.errors import InputError
from pbrnet.scenes.image_files import UnreadableImage, open_image
from pbrnet.scenes.importing.changes import Changes
from pbrnet.scenes.importing.materials.textures import TextureStore
from pbrnet.scenes.importing.sandbox import Sandbox
from pbrnet.scenes.models.gltf.container import open_asset
from pbrnet.scenes.models.gltf.images import Images
from pbrnet.scenes.models.gltf.reader import read_gltf
from pbrnet.scenes.models.model import Model
from pbrnet.scenes.opened_files import OpenedFiles
from tests.fixtures import ktx
from tests.fixtures.encoded import picture
from tests.fixtures.gltf import SQUARE, SQUARE_FACES, SQUARE_UV, Builder, square


def read(builder: Builder, folder: Path) -> tuple[Model, tuple[str, ...]]:
    """The model of a GLB file, in the axes of the file, and the changes."""
    path = builder.save(folder / "model.glb")
    for name in ("textures", "unpacked"):
        (folder / name).mkdir(exist_ok=True)
    changes = Changes()
    asset = open_asset(path, Sandbox(OpenedFiles(folder)))
    images = Images(asset, folder / "unpacked", changes)
    model = read_gltf(asset, images, TextureStore(folder / "textures", changes), changes)
    return model, changes.sentences()


def draco_square(**ids: int) -> Builder:
    """A square whose triangles are Draco data; `ids` replace ids of its attributes."""
    made = Builder()
    made.json["extensionsUsed"] = made.json["extensionsRequired"] = ["KHR_draco_mesh_compression"]
    data = DracoPy.encode(
        SQUARE,
        SQUARE_FACES.reshape(-1, 3).astype(np.uint32),
        quantization_bits=14,
        tex_coord=SQUARE_UV,
        normals=np.tile([0.0, 1, 0], (4, 1)),
    )
    decoded = {one["attribute_type"]: one["unique_id"] for one in DracoPy.decode(data).attributes}
    attributes = {"POSITION": decoded[0], "NORMAL": decoded[1], "TEXCOORD_0": decoded[3], **ids}
    accessors = {
        name: made.add(
            "accessors",
            {"componentType": 5126, "count": 4, "type": "VEC2" if "TEX" in name else "VEC3"},
        )
        for name in attributes
    }
    indices = made.add("accessors", {"componentType": 5123, "count": 6, "type": "SCALAR"})
    extension = {"bufferView": made.view(data), "attributes": attributes}
    primitive = {
        "attributes": accessors,
        "indices": indices,
        "mode": 5,  # of an encoder's source; the decoded triangles are a list all the same
        "extensions": {"KHR_draco_mesh_compression": extension},
    }
    made.node(mesh=made.add("meshes", {"primitives": [primitive]}), name="ground")
    return made


def meshopt_view(
    made: Builder, rows: np.ndarray[Any, Any], mode: str, name: str, stride: int | None = None
) -> int:
    """A buffer view whose data is compressed, with an empty fallback buffer."""
    data = meshopt.encode_gltf_buffer(rows, mode)  # type: ignore[arg-type]
    size = rows.itemsize * (rows.shape[1] if rows.ndim == 2 else 1)
    index = made.view(data)
    inner = dict(made.json["bufferViews"][index])
    extension = {**inner, "byteStride": size, "count": len(rows), "mode": mode}
    view: dict[str, Any] = {"buffer": 0, "byteLength": size * len(rows), "extensions": {}}
    view["extensions"][name] = extension
    if mode == "ATTRIBUTES":
        view["byteStride"] = stride or size
    return made.add("bufferViews", view)


def meshopt_square(name: str = "EXT_meshopt_compression") -> Builder:
    """A square of 16-bit integer positions (KHR_mesh_quantization), compressed."""
    made = Builder()
    made.json["extensionsRequired"] = [name, "KHR_mesh_quantization"]
    rows = np.zeros((4, 4), np.uint16)
    rows[:, :3] = SQUARE * 1000
    points = {"bufferView": meshopt_view(made, rows, "ATTRIBUTES", name), "componentType": 5123}
    faces = SQUARE_FACES.astype(np.uint32)
    corners = {"bufferView": meshopt_view(made, faces, "TRIANGLES", name), "componentType": 5125}
    primitive = {
        "attributes": {"POSITION": made.add("accessors", {**points, "count": 4, "type": "VEC3"})},
        "indices": made.add("accessors", {**corners, "count": 6, "type": "SCALAR"}),
    }
    mesh = made.add("meshes", {"primitives": [primitive]})
    made.node(mesh=mesh, scale=[0.001] * 3, name="ground")
    return made


def test_draco_geometry_is_that_of_the_plain_file(tmp_path: Path) -> None:
    mesh = read(draco_square(), tmp_path)[0].shapes[0].mesh
    assert mesh.normals is not None and mesh.uvs is not None
    assert len(mesh.vertices) == 4 and len(mesh.faces) == 2
    order = [int(np.argmin(np.linalg.norm(mesh.vertices - point, axis=1))) for point in SQUARE]
    assert sorted(order) == [0, 1, 2, 3]
    assert np.abs(mesh.vertices[order] - SQUARE).max() < 1e-4
    assert np.abs(mesh.uvs[order] - SQUARE_UV).max() < 1e-6
    assert np.abs(mesh.normals - [0, 1, 0]).max() < 1e-3
    first, second, third = (mesh.vertices[mesh.faces[:, corner]] for corner in range(3))
    assert np.allclose(np.cross(second - first, third - first)[:, 1], 1, atol=1e-3)


def test_damaged_draco_is_refused(tmp_path: Path) -> None:
    made = draco_square()
    made.data = made.data[:40] + bytes(len(made.data) - 40)
    with pytest.raises(InputError, match=r"primitives\[0\].*Draco data is damaged"):
        read(made, tmp_path)
    with pytest.raises(InputError, match=r"NORMAL.*no attribute number 9"):
        read(draco_square(NORMAL=9), tmp_path)


@pytest.mark.parametrize("name", ["EXT_meshopt_compression", "KHR_meshopt_compression"])
def test_meshopt_views_are_decompressed(tmp_path: Path, name: str) -> None:
    mesh = read(meshopt_square(name), tmp_path)[0].shapes[0].mesh
    assert np.allclose(mesh.vertices[mesh.faces[0]].min(axis=0), 0)
    assert np.allclose(np.unique(mesh.vertices, axis=0), np.unique(SQUARE, axis=0))
    assert len(mesh.faces) == 2


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"mode": "TABLES"}, "mode: expected one of"),
        ({"filter": "BLUR"}, "filter: expected one of"),
        ({"count": 2**28, "byteStride": 256}, "limit"),
        ({"count": 4000}, "damaged"),
        ({"byteOffset": 10**6}, "truncated or damaged"),
    ],
)
def test_damaged_meshopt_is_refused(tmp_path: Path, change: dict[str, Any], message: str) -> None:
    made = meshopt_square()
    view = made.json["bufferViews"][made.json["accessors"][0]["bufferView"]]
    view["extensions"]["EXT_meshopt_compression"].update(change)
    with pytest.raises(InputError, match=message):
        read(made, tmp_path)


@pytest.mark.parametrize("data", [ktx.ETC1S, ktx.UASTC], ids=["etc1s", "uastc"])
def test_basis_universal_images_have_their_colours(data: bytes) -> None:
    image = open_image(data)
    assert (image.size, image.mode) == ((8, 8), "RGB")
    pixels = np.asarray(image).astype(int)
    assert np.abs(pixels[:4] - ktx.UPPER).max() <= 4
    assert np.abs(pixels[4:] - ktx.LOWER).max() <= 4


def test_damaged_and_huge_basis_universal_images_are_refused(tmp_path: Path) -> None:
    huge = bytearray(ktx.UASTC)
    huge[20:28] = (15_000).to_bytes(4, "little") * 2
    plain = bytearray(ktx.UASTC)
    plain[12] = 37  # vkFormat R8G8B8A8_UNORM
    path = tmp_path / "cut.ktx2"
    path.write_bytes(ktx.ETC1S[:200])
    for source, message in ((path, "KTX2"), (bytes(huge), "KTX2|pixels"), (bytes(plain), "vkForm")):
        with pytest.raises(UnreadableImage, match=message):
            open_image(source)


def _textured(data: bytes, extension: str, fallback: bool = False) -> Builder:
    made = square(pbrMetallicRoughness={"baseColorTexture": {"index": 0}})
    image = made.add("images", {"bufferView": made.view(data)})
    texture: dict[str, Any] = {"extensions": {extension: {"source": image}}}
    if fallback:
        green = picture(Image.new("RGB", (2, 2), (0, 200, 0)))
        texture["source"] = made.add("images", {"bufferView": made.view(green)})
    else:
        made.json["extensionsRequired"] = [extension]
    made.add("textures", texture)
    return made


def _stored(folder: Path) -> tuple[int, ...]:
    """The first pixel of the one image that the material uses."""
    images = sorted(path for path in (folder / "textures").iterdir() if path.suffix == ".png")
    pixel = open_image(images[-1]).convert("RGB").getpixel((0, 0))
    assert isinstance(pixel, tuple)
    return pixel


def test_basis_universal_textures_are_stored_as_png(tmp_path: Path) -> None:
    assert not read(_textured(ktx.ETC1S, "KHR_texture_basisu"), tmp_path)[1]
    assert np.abs(np.subtract(_stored(tmp_path), ktx.UPPER)).max() <= 4


def test_a_png_beside_a_basis_universal_texture_is_preferred(tmp_path: Path) -> None:
    read(_textured(ktx.ETC1S, "KHR_texture_basisu", fallback=True), tmp_path)
    assert _stored(tmp_path) == (0, 200, 0)


def test_a_damaged_texture_is_replaced_by_the_plain_colour(tmp_path: Path) -> None:
    _, changes = read(_textured(ktx.ETC1S[:200], "KHR_texture_basisu"), tmp_path)
    assert any("damaged texture" in change and "gltf-transform" in change for change in changes)


def test_webp_textures_are_read(tmp_path: Path) -> None:
    webp = picture(Image.new("RGB", (4, 4), (10, 20, 200)), "WEBP", lossless=True)
    assert not read(_textured(webp, "EXT_texture_webp"), tmp_path)[1]
    assert _stored(tmp_path) == (10, 20, 200)


def test_instances_are_shapes_of_their_own(tmp_path: Path) -> None:
    made = square()
    made.json["extensionsRequired"] = ["EXT_mesh_gpu_instancing"]
    places = [[0.0, 0, 0], [0, 3, 0], [0, 5, 0]]
    attributes = {
        "TRANSLATION": made.accessor(places),
        "SCALE": made.accessor([[1.0, 1, 1], [1, 1, 1], [0.5, 0.5, 0.5]]),
    }
    node = made.json["nodes"][0]
    node["extensions"] = {"EXT_mesh_gpu_instancing": {"attributes": attributes}}
    node["scale"] = [2, 2, 2]
    shapes = read(made, tmp_path)[0].shapes
    assert [shape.mesh.vertices[:, 1].mean() for shape in shapes] == pytest.approx([0, 6, 10])
    assert np.ptp(shapes[2].mesh.vertices[:, 0]) == pytest.approx(8)
    assert len({shape.id for shape in shapes}) == 3


def test_hidden_nodes_are_left_out(tmp_path: Path) -> None:
    made = square()
    hidden = made.node(root=False, mesh=0, name="inner")
    made.node(children=[hidden], extensions={"KHR_node_visibility": {"visible": False}})
    model, changes = read(made, tmp_path)
    assert len(model.shapes) == 1
    assert any("hidden" in change for change in changes)
