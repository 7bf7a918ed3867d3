"""RenderFormer's files: triangles of a known room, by the conventions that its loader documents."""

from pathlib import Path

import h5py
import numpy as np
import pytest

from pbrnet.pipeline.export.parts import ExportOptions, Job, run_export
from pbrnet.pipeline.export.registry import FORMATS
from pbrnet.pipeline.export.room_mesh import Soup, clustered, split_longest, within_budget
from pbrnet.pipeline.export.rows import DatasetRows
from pbrnet.scenes.contract import SceneObject, save_scene, writing_scene
from pbrnet.scenes.errors import InputError
from pbrnet.scenes.files import digest_file
from tests.fixtures.dataset import ROOM, box_scene
from tests.fixtures.exports import BOX, HEIGHT, make_dataset, truths
from tests.fixtures.render import ball, diffuse, glow

LAMP, SKY = 6.0, 0.5  # radiance
TRIANGLES = 400


def write_room(folder: Path) -> None:
    """The scene of the dataset's room, with a lamp and a sky."""
    x, y, z = np.array(ROOM) / 2
    low, high = BOX
    middle, half = (low + high) / 2, (high - low) / 2
    xml = f"""<scene version="3.0.0">
    <shape type="cube" id="room"><boolean name="flip_normals" value="true"/>
      <transform name="to_world"><scale x="{x}" y="{y}" z="{z}"/>
      <translate x="{x}" y="{y}" z="{z}"/></transform>{diffuse("0.6 0.4 0.2")}</shape>
    <shape type="cube" id="table"><transform name="to_world">
      <scale x="{half[0]}" y="{half[1]}" z="{half[2]}"/>
      <translate x="{middle[0]}" y="{middle[1]}" z="{middle[2]}"/></transform>
      <bsdf type="roughplastic"><rgb name="diffuse_reflectance" value="0.1 0.3 0.5"/>
      <float name="alpha" value="0.09"/></bsdf></shape>
    {ball("bulb", (3.4, 0.5, 2.2), 0.15, glow(LAMP))}
    <emitter type="constant"><rgb name="radiance" value="{SKY}"/></emitter></scene>"""
    things = tuple(
        SceneObject(name, name, name, (name,), (0, 0, 0), (1, 1, 1), False)
        for name in ("room", "table", "bulb")
    )
    with writing_scene(folder) as partial:
        (partial / "scene.xml").write_text(xml)
        save_scene(partial, box_scene(folder.name, objects=things))


@pytest.fixture(scope="module")
def exported(tmp_path_factory: pytest.TempPathFactory, variant: str) -> Path:
    data = tmp_path_factory.mktemp("renderformer")
    dataset = make_dataset(data / "dataset")
    for scene in ("home-a", "home-b"):
        write_room(data / "scenes" / scene)
    options = ExportOptions(triangles=TRIANGLES)
    for name in ("out", "again"):
        job = Job(DatasetRows(dataset), data / "scenes", options, data / name)
        run_export(FORMATS["renderformer"], job)
    return data


def nearest(origin: np.ndarray, rays: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """Distance along each ray to the first triangle (Moeller and Trumbore 1997)."""
    a, b, c = (triangles[:, i] for i in range(3))
    across = np.cross(rays[:, None], (c - a)[None])
    scale = (across * (b - a)).sum(-1)
    with np.errstate(divide="ignore", invalid="ignore"):
        u = (across * (origin - a)).sum(-1) / scale
        turned = np.cross(origin - a, b - a)
        v = (turned * rays[:, None]).sum(-1) / scale
        away = (turned * (c - a)).sum(-1) / scale
    hit = (u >= -1e-6) & (v >= -1e-6) & (u + v <= 1 + 1e-6) & (away > 1e-6)
    return np.where(hit, away, np.inf).min(axis=1)


def test_rays_meet_the_triangles_where_the_room_is(exported: Path) -> None:
    with h5py.File(exported / "out" / "home-a" / "room-0.h5") as file:
        triangles, c2w, fov = (np.array(file[name]) for name in ("triangles", "c2w", "fov"))
        centre, metres = file.attrs["centre"], file.attrs["metres"]
        names = list(file.attrs["views"])
    assert triangles.shape == (TRIANGLES, 3, 3) and np.abs(triangles).max() <= 0.5 + 1e-6
    known = truths()
    for number, name in enumerate(names):
        true = known["home-a", name]
        assert np.tan(np.radians(fov[number]) / 2) == pytest.approx(
            HEIGHT / 2 / true.intrinsics[1, 1], rel=1e-5
        )
        # As the loader's ray generator: x right, y up, looking along -z.
        pixels = np.linspace(-0.9, 0.9, 9) * np.tan(np.radians(fov[number]) / 2)
        x, y = np.meshgrid(pixels, -pixels)
        local = np.stack([x, y, -np.ones_like(x)], -1).reshape(-1, 3)
        rays = local @ c2w[number, :3, :3].T.astype(np.float64)
        away = nearest(c2w[number, :3, 3].astype(np.float64), rays, triangles.astype(np.float64))
        eye = true.pose[:3, 3]
        np.testing.assert_allclose(c2w[number, :3, 3] * metres + centre, eye, atol=1e-5)
        walls = np.where(rays > 0, (np.array(ROOM) - eye) / rays, -eye / rays).min(-1)
        slabs = np.sort((BOX[:, None] - eye) / rays, axis=0)
        entry, leave = slabs[0].max(-1), slabs[1].min(-1)
        expected = np.where((entry < leave) & (entry > 0), entry, walls)
        seen = np.abs(away * metres - expected) < 0.01
        assert seen.mean() > 0.95, "but for the bulb and rays along edges"


def test_materials_and_lights_are_the_scene_s(exported: Path) -> None:
    with h5py.File(exported / "out" / "home-a" / "room-0.h5") as file:
        triangles, vn, texture = (np.array(file[name]) for name in ("triangles", "vn", "texture"))
        centre, metres = file.attrs["centre"], file.attrs["metres"]
        scale = file.attrs["emission_scale"]
    assert texture.shape == (TRIANGLES, 13, 32, 32) and texture.dtype == np.float16
    assert (texture[:, :, 31, 31] == 0).all(), "outside of the triangle"
    middles = (triangles.mean(axis=1) * metres + centre).astype(np.float64)
    edges = triangles[:, 1:] - triangles[:, :1]
    flat = np.cross(edges[:, 0], edges[:, 1])
    flat /= np.linalg.norm(flat, axis=1, keepdims=True)
    np.testing.assert_allclose((vn[:, 0] * flat).sum(1), 1, atol=1e-3)
    values = texture[:, :, 0, 0].astype(np.float64)
    on_floor = middles[:, 2] < 1e-3
    on_floor &= ((middles < BOX[0]) | (middles > BOX[1]))[:, :2].any(axis=1)
    assert on_floor.any()
    np.testing.assert_allclose(values[on_floor, :3], [[0.6, 0.4, 0.2]] * on_floor.sum(), atol=2e-3)
    table = np.abs(middles[:, 2] - BOX[1, 2]) < 1e-3
    table &= ((middles > BOX[0]) & (middles < BOX[1]))[:, :2].all(axis=1)
    np.testing.assert_allclose(values[table, 3:6], 0.04, atol=2e-3)  # index 1.49
    np.testing.assert_allclose(values[table, 6], 0.3, atol=2e-3)  # root of alpha
    np.testing.assert_allclose(values[table, 7:10], [[0.5, 0.5, 1]] * table.sum())
    emission = values[:, 10:].mean(axis=1) / scale
    bulb = np.linalg.norm(middles - [3.4, 0.5, 2.2], axis=1) < 0.2
    np.testing.assert_allclose(emission[bulb], LAMP, rtol=2e-3)
    outward = middles[bulb] - [3.4, 0.5, 2.2]
    assert ((outward * vn[bulb, 0]).sum(axis=1) > 0).all()
    window = np.abs(middles[:, 1] - ROOM[1]) < 1e-3
    window &= emission > 0
    assert window.sum() == 2 and (vn[window, 0, 1] < -0.99).all()
    np.testing.assert_allclose(emission[window], SKY, rtol=2e-3)
    assert (emission[~bulb & ~window] == 0).all()


def test_files_are_repeatable_and_need_the_scene(exported: Path, tmp_path: Path) -> None:
    digests = {digest_file(exported / name / "home-a" / "room-0.h5") for name in ("out", "again")}
    assert len(digests) == 1
    job = Job(DatasetRows(exported / "dataset"), tmp_path, ExportOptions(), tmp_path / "out")
    with pytest.raises(InputError, match="needs the scene's geometry"):
        run_export(FORMATS["renderformer"], job)


def test_a_budget_is_kept_and_filled() -> None:
    """A fine sphere and many separate boxes, which edge collapse cannot simplify."""
    import trimesh

    sphere = trimesh.creation.icosphere(subdivisions=4, radius=2.0)
    boxes = [
        trimesh.creation.box((0.1, 0.1, 0.1)).apply_translation((3 + 0.2 * n, 0, 0))
        for n in range(60)
    ]
    parts = [sphere.triangles, *(box.triangles for box in boxes)]
    shape = np.repeat([0, 1], [len(parts[0]), 60 * 12])
    soup = Soup(np.concatenate(parts).astype(np.float64), shape)
    found = within_budget(soup, 600)
    assert len(found) == 600
    radii = np.linalg.norm(found.corners[found.shape == 0].reshape(-1, 3), axis=1)
    assert np.abs(radii - 2).max() < 0.15
    assert found.areas[found.shape == 0].sum() == pytest.approx(16 * np.pi, rel=0.05)
    assert 0 < (found.shape == 1).sum() < 240
    vertices, faces = clustered(sphere.vertices, sphere.faces, 100)
    assert 20 < len(faces) <= 100
    assert np.abs(np.linalg.norm(vertices, axis=1) - 2).max() < 0.6
    halved = split_longest(
        Soup(np.array([[[0.0, 0, 0], [4, 0, 0], [0, 1, 0]]]), np.zeros(1, int)), 8
    )
    assert halved.areas.sum() == pytest.approx(2) and halved.areas.max() <= 1
    np.testing.assert_allclose(halved.normals, [[0, 0, 1]] * 8)
