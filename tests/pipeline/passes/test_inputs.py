"""Input images: analytic depth, normals, reflectance and object indices."""

from pathlib import Path

import numpy as np
import pytest

from pbrnet.pipeline.frames import Channels
from pbrnet.pipeline.passes.groundtruth import render_truth
from pbrnet.pipeline.passes.inputs import facing_normals, render_inputs
from pbrnet.pipeline.render import raycast
from pbrnet.pipeline.render.scene import cast, open_scene
from pbrnet.pipeline.render.scene_geometry import Hits
from pbrnet.pipeline.views import View
from pbrnet.scenes.errors import InputError
from tests.fixtures.encoded import exr, picture
from tests.fixtures.params import plain_truth
from tests.fixtures.render import (
    WINDOW,
    ball,
    diffuse,
    glow,
    make_view,
    quad,
    room_walls,
    write_scene,
)
from tests.fixtures.xml import bitmap, bsdf

pytestmark = pytest.mark.usefixtures("variant")


def inputs(folder: Path, body: str, view: View, **more: object) -> Channels:
    return render_inputs(open_scene(write_scene(folder / "scene", body, **more)), view)  # type: ignore[arg-type]


def pixel_rays(view: View) -> np.ndarray:
    x, y = np.meshgrid(np.arange(view.width) + 0.5, np.arange(view.height) + 0.5)
    return np.stack([x, y, np.ones_like(x)], -1) @ np.linalg.inv(view.intrinsics).T


def test_depth_of_an_oblique_plane_is_z_depth(tmp_path: Path) -> None:
    normal = np.array([0.4, -0.8, 0.3]) / np.linalg.norm([0.4, -0.8, 0.3])
    view = make_view((0.1, -0.2, 1.5), (0.2, 1, -0.1), centre=(11.0, 15.0))
    got = inputs(tmp_path, quad("p", (0, 3, 1.5), tuple(normal), (20, 20), diffuse()), view)
    local = pixel_rays(view)
    world = local @ view.pose[:3, :3].T
    # With z = 1 in the camera frame the ray parameter is the depth along the optical axis.
    expected = (np.array([0, 3, 1.5]) - view.eye) @ normal / (world @ normal)
    assert got["valid"].all()
    np.testing.assert_allclose(got["Z"], expected, rtol=1e-4)
    camera_normal = normal @ view.pose[:3, :3]
    for axis, name in enumerate("XYZ"):
        np.testing.assert_allclose(got[f"N.{name}"], camera_normal[axis], atol=1e-4)


def test_normals_face_the_camera_whatever_the_winding(tmp_path: Path) -> None:
    view = make_view()
    for number, towards in enumerate([(0.0, -1.0, 0.0), (0.0, 1.0, 0.0)]):
        body = quad("p", (0, 3, 1.5), towards, (20, 20), diffuse())
        got = inputs(tmp_path / str(number), body, view)
        np.testing.assert_allclose(got["N.Z"], -1, atol=1e-5)
    sphere = inputs(tmp_path / "sphere", ball("s", (0, 2, 1.5), 0.5, diffuse()), view)
    along = sum(sphere[f"N.{n}"] * pixel_rays(view)[..., i] for i, n in enumerate("XYZ"))
    assert (along[sphere["valid"] > 0] <= 1e-6).all()


def test_interpolated_normals_at_a_silhouette_become_perpendicular_to_the_ray() -> None:
    """The surface faces the ray, the interpolated normal does not: it is bent, not flipped."""
    directions = np.tile([0.0, 1.0, 0.0], (3, 1))
    geometric = np.array([[-1, -0.1, 0], [1, 0.1, 0], [0, -1, 0]], dtype=np.float32)
    shading = np.array([[-1, 0.1, 0], [-1, 0.1, 0], [0.6, -0.8, 0]], dtype=np.float32)
    none = np.zeros(3, dtype=np.float32)
    hits = Hits(np.zeros(3, np.int32), none, geometric, geometric, shading, geometric)
    expected = [[-1, 0, 0], [-1, 0, 0], [0.6, -0.8, 0]]
    np.testing.assert_allclose(facing_normals(hits, directions), expected, atol=1e-6)


def test_known_points_land_on_their_pixels_of_surfaces_and_light(tmp_path: Path) -> None:
    view = make_view((0.3, -1, 1.2), (0.2, 1, -0.3), (64, 48), 50.0, centre=(20.25, 31.5))
    spots = [(5, 7), (40, 30), (60, 45), (20, 31)]
    body, objects = "", {}
    for number, (column, row) in enumerate(spots):
        local = np.linalg.inv(view.intrinsics) @ [column + 0.5, row + 0.5, 1.0]
        centre = (view.pose @ [*(local * 2.5), 1.0])[:3]
        body += ball(f"s{number}", tuple(centre), 0.015, glow())
        objects[f"s{number}"] = (f"s{number}",)
    scene = open_scene(write_scene(tmp_path / "scene", body, objects))
    got = render_inputs(scene, view)["object"]
    for number, (column, row) in enumerate(spots):
        assert np.argwhere(got == number + 1).tolist() == [[row, column]]
    lit, _ = render_truth(scene, view, plain_truth(spp=16, max_depth=1), 0)
    np.testing.assert_array_equal(lit["R"] > 0, got > 0)


def png(pixels: list[list[tuple[int, int, int]]]) -> bytes:
    return picture(np.array(pixels, dtype=np.uint8))


def test_reflectance_is_the_texel_the_right_way_up(tmp_path: Path) -> None:
    texels = [[(255, 0, 0), (0, 255, 0)], [(0, 0, 255), (188, 188, 188)]]
    shown = bitmap("reflectance", "textures/t.png", filter_type="nearest")
    material = bsdf("twosided", bsdf("diffuse", shown))
    view = make_view(size=(32, 32), focal=32)
    # Seen from the front, u runs to the right and v up; Mitsuba puts an image's first row at v = 0.
    body = quad("p", (0, 2, 1.5), (0, -1, 0), (0.5, 0.5), material)
    got = inputs(tmp_path, body, view, files={"textures/t.png": png(texels)})
    linear = {188: 0.502886, 255: 1.0, 0: 0.0}
    for row, column, texel in [
        (12, 12, (0, 0)),
        (12, 20, (0, 1)),
        (20, 12, (1, 0)),
        (20, 20, (1, 1)),
    ]:
        value = [got[f"albedo.{band}"][row, column] for band in "RGB"]
        expected = [linear[c] for c in texels[1 - texel[0]][texel[1]]]
        np.testing.assert_allclose(value, expected, atol=2e-3)


@pytest.mark.parametrize(
    ("material", "expected"),
    [
        (diffuse("0.2,0.4,0.6"), (0.2, 0.4, 0.6)),
        (bsdf("roughplastic", diffuse_reflectance=(0.1, 0.2, 0.3)), (0.1, 0.2, 0.3)),
        (bsdf("principled", base_color=(0.9, 0.5, 0.1), metallic=1.0), (0.9, 0.5, 0.1)),
        (bsdf("conductor"), (1, 1, 1)),  # a perfect mirror
        (bsdf("roughconductor", material="none", specular_reflectance=0.7), (0.7, 0.7, 0.7)),
        # eta 1.5, k 2: ((0.5)^2 + 4) / ((2.5)^2 + 4)
        (bsdf("conductor", eta=1.5, k=2.0), (4.25 / 10.25,) * 3),
        (bsdf("blendbsdf", bsdf("diffuse", reflectance=(0.8,)), bsdf("diffuse", reflectance=(0.4,)),
              weight=0.25), (0.7,) * 3),
        (bsdf("roughdielectric"), (1, 1, 1)),
        (glow(5), (0, 0, 0)),
    ],
)  # fmt: skip
def test_reflectance_of_materials(
    tmp_path: Path, material: str, expected: tuple[float, float, float]
) -> None:
    got = inputs(tmp_path, quad("p", (0, 2, 1.5), (0, -1, 0), (5, 5), material), make_view())
    for band, value in zip("RGB", expected, strict=True):
        np.testing.assert_allclose(got[f"albedo.{band}"], value, atol=2e-3)


def test_sight_passes_clear_glass_and_stops_at_frosted(tmp_path: Path) -> None:
    wall = quad("wall", (0, 4, 1.5), (0, -1, 0), (9, 9), diffuse(0.3))
    pane = quad("pane", (0, 1, 1.5), (0, -1, 0), (9, 9), '<bsdf type="thindielectric"/>')
    block = ball("block", (0, 2.2, 1.5), 0.8, '<bsdf type="dielectric"/>')
    objects = {"wall": ("wall",), "pane": ("pane",), "block": ("block",)}
    got = inputs(tmp_path / "clear", wall + pane + block, make_view(), objects=objects)
    np.testing.assert_allclose(got["Z"], 4, rtol=1e-5)
    assert (got["object"] == 1).all()
    np.testing.assert_allclose(got["albedo.G"], 0.3, atol=1e-3)
    frosted = pane.replace("thindielectric", "roughdielectric")
    got = inputs(tmp_path / "frosted", wall + frosted, make_view(), objects={"pane": ("pane",)})
    np.testing.assert_allclose(got["Z"], 1, rtol=1e-5)


def test_masks_cut_out_below_half_opacity(tmp_path: Path) -> None:
    wall = quad("wall", (0, 4, 1.5), (0, -1, 0), (9, 9), diffuse(0.3))
    for opacity, depth in ((0.4, 4), (0.6, 2)):
        leaf = f'<bsdf type="mask"><float name="opacity" value="{opacity}"/>{diffuse(0.8)}</bsdf>'
        body = wall + quad("leaf", (0, 2, 1.5), (0, -1, 0), (9, 9), leaf)
        got = inputs(tmp_path / str(opacity), body, make_view())
        np.testing.assert_allclose(got["Z"], depth, rtol=1e-5)


def test_sky_through_a_window_is_no_surface(tmp_path: Path) -> None:
    walls, shapes = room_walls(diffuse(0.4), window=True)
    body = walls + '<emitter type="constant"/>'
    view = make_view(size=(40, 40), focal=40)
    got = inputs(tmp_path, body, view, objects={"room": shapes}, portals=[WINDOW])
    hole = got["valid"] == 0
    rows, columns = np.nonzero(hole)
    # 1 m wide and high, 2 m away, focal 40: 20 pixels.
    assert (columns.min(), columns.max(), rows.min(), rows.max()) == (10, 29, 10, 29)
    for name, values in got.items():
        assert (values[hole] == 0).all(), name
    assert (got["object"][~hole] == 1).all()


def test_ids_of_many_cameras_are_those_of_the_inputs(tmp_path: Path) -> None:
    walls, shapes = room_walls(diffuse(), window=True)
    body = walls + ball("a", (0.5, 1, 1.5), 0.4, diffuse()) + ball("b", (-1, 0, 1), 0.3, diffuse())
    objects = {"room": shapes, "a": ("a",), "b": ("b",)}
    scene = open_scene(write_scene(tmp_path / "s", body, objects))
    views = [make_view((0, -1, 1.4), (x, 1, -0.2)) for x in (-1.0, -0.3, 0.2, 0.8)]
    poses = np.stack([view.pose for view in views])
    ids = raycast.object_ids(scene.geometry, poses, views[0].rays())
    assert ids.shape == (4, 24, 32) and ids.dtype == np.uint32
    assert set(np.unique(ids)) == {0, 1, 2, 3}
    for view, image in zip(views, ids, strict=True):
        np.testing.assert_array_equal(image, render_inputs(scene, view)["object"])


def test_cast_measures_distance_and_stops_at_glass(tmp_path: Path) -> None:
    walls, shapes = room_walls(diffuse())
    pane = quad("pane", (0, 1, 1.5), (0, -1, 0), (1, 1), '<bsdf type="thindielectric"/>')
    objects = {"room": shapes, "pane": ("pane",)}
    scene = open_scene(write_scene(tmp_path / "s", walls + pane, objects))
    rays = np.array([[0, 2.0, 0], [1, 0, 0], [0, 0, -1]])  # any length
    distance, thing = cast(scene, (0, 0, 1.2), rays)
    np.testing.assert_allclose(distance, [1, 2, 1.2], rtol=1e-5)
    assert list(thing) == [1, 0, 0]
    distance, thing = cast(scene, (0, 0, 1.2), rays, through_glass=True)
    np.testing.assert_allclose(distance, [2, 2, 1.2], rtol=1e-5)
    assert list(thing) == [0, 0, 0]
    nothing, _ = cast(scene, (0, 0, 9.0), np.array([[0, 0, 1.0]]))
    assert np.isinf(nothing).all()


def test_textures_may_be_exr(tmp_path: Path) -> None:
    pixels = np.full((4, 4, 3), (0.1, 0.25, 0.5), dtype=np.float32)
    material = bsdf("diffuse", bitmap("reflectance", "textures/t.exr", raw=True))
    body = quad("p", (0, 2, 1.5), (0, -1, 0), (5, 5), material)
    got = inputs(tmp_path, body, make_view(), files={"textures/t.exr": exr(pixels)})
    np.testing.assert_allclose(got["albedo.G"], 0.25, atol=1e-3)


PLANE = quad("p", (0, 2, 1.5), (0, -1, 0), (5, 5), diffuse())
NAN_PLY = (
    b"ply\nformat binary_little_endian 1.0\nelement vertex 3\nproperty float x\n"
    b"property float y\nproperty float z\nelement face 1\n"
    b"property list uchar int vertex_indices\nend_header\n"
    + np.array([[0, 0, 0], [np.nan, 0, 0], [0, 1, 0]], dtype="<f4").tobytes()
    + b"\x03"
    + np.array([0, 1, 2], dtype="<i4").tobytes()
)


@pytest.mark.parametrize(
    ("body", "words"),
    [
        ("<shape type='sphere'>", "XML"),
        ('<shape type="sphericon" id="s"/>', "sphericon"),
        ('<shape type="ply" id="s"><string name="filename" value="meshes/x.ply"/></shape>',
         "meshes/x.ply"),
        ('<shape type="ply" id="s"><string name="filename" value="meshes/nan.ply"/></shape>',
         "vertex"),
        ('<shape type="ply" id="s"><string name="filename" value="meshes/cut.ply"/></shape>',
         "cut.ply"),
        (PLANE.replace("diffuse", "difuse"), "difuse"),
        (PLANE.replace("reflectance", "reflektance"), "reflektance"),
        ('<shape type="sphere" id="s"><ref id="nobody"/></shape>', "nobody"),
        ("", "geometry"),
    ],
)  # fmt: skip
def test_a_broken_scene_is_refused_with_the_cause(tmp_path: Path, body: str, words: str) -> None:
    files = {"meshes/nan.ply": NAN_PLY, "meshes/cut.ply": NAN_PLY[:190]}
    scene = write_scene(tmp_path / "s", body, files=files)
    with pytest.raises(InputError, match=words) as caught:
        open_scene(scene)
    assert "scene.xml" in str(caught.value)


def test_scene_json_must_name_shapes_that_exist(tmp_path: Path) -> None:
    scene = write_scene(tmp_path / "s", PLANE, {"thing": ("p", "ghost")})
    with pytest.raises(InputError, match="ghost"):
        open_scene(scene)
