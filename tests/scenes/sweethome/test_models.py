"""Models of homes as COLLADA, KMZ and 3DS: shapes, axes, materials, hostile files."""

import re
from pathlib import Path

import numpy as np
import pytest

from pbrnet.scenes.formats.archive import HomeArchive
from pbrnet.scenes.formats.collada import read_dae
from pbrnet.scenes.formats.max3ds import read_3ds
from pbrnet.scenes.formats.model_parts import Model, UnreadableModel
from pbrnet.scenes.geometry.mesh import face_areas
from pbrnet.scenes.importing.changes import Changes
from pbrnet.scenes.registry import import_scene
from pbrnet.scenes.sweethome.furnishing.models import read_model
from tests.fixtures import model_file as files
from tests.fixtures import sweethome as draw

UP = {
    "Y_UP": files.POINTS,
    "Z_UP": files.POINTS[:, [0, 2, 1]] * [1, -1, 1],
    "X_UP": files.POINTS[:, [1, 0, 2]] * [1, -1, 1],
}


def dae(text: str, lost: list[str] | None = None) -> Model:
    said = [] if lost is None else lost
    return read_dae(text.encode(), lambda name: f"found {name}", said.append)


def max3ds(data: bytes) -> Model:
    return read_3ds(data, lambda name: f"found {name}")


def volume(model: Model) -> float:
    """Signed volume: positive where faces look outwards."""
    corners = np.concatenate([part.mesh.corners for part in model.parts])
    a, b, c = (corners[:, k] for k in range(3))
    return float(np.einsum("fi,fi->f", a, np.cross(b, c)).sum() / 6)


def member(path: Path, data: str | bytes, name: str = "1/model", **more: bytes) -> Model:
    """The model as a member of a home."""
    members = {name: data, **more}
    with HomeArchive(draw.pack(path / "test.sh3d", draw.usual(), members)) as archive:
        return read_model(archive, name, Changes())


class TestCollada:
    @pytest.mark.parametrize("up", sorted(UP))
    @pytest.mark.parametrize("polygons", [False, True])
    def test_up_axis_and_unit(self, up: str, polygons: bool) -> None:
        model = dae(files.dae(geometries=files.box(UP[up], polygons=polygons), up=up, meter=0.01))
        assert model.bounds == pytest.approx(np.array([[0, 0, 0], [2, 1, 4]]))
        assert volume(model) == pytest.approx(8)

    def test_units_are_centimetres(self) -> None:
        assert dae(files.dae(meter=0.0254)).bounds[1] == pytest.approx([5.08, 2.54, 10.16])

    def test_nodes_stand_in_each_other(self) -> None:
        nodes = (
            "<node name='outer'><translate>10 0 0</translate><rotate>0 1 0 90</rotate>"
            f"<node name='inner'><scale>2 1 1</scale>{files.instance()}</node></node>"
        )
        (part,) = dae(files.dae(nodes, meter=0.01)).parts
        # Twice as wide, then x turns to -z and z to x.
        assert part.mesh.bounds == pytest.approx(np.array([[10, 0, -4], [14, 1, 0]]))
        assert part.group == "inner"

    def test_mirrored_nodes_face_outwards(self) -> None:
        nodes = f"<node><matrix>-1 0 0 0 0 1 0 0 0 0 1 0 0 0 0 1</matrix>{files.instance()}</node>"
        assert volume(dae(files.dae(nodes, meter=0.01))) == pytest.approx(8)

    def test_instanced_nodes_come_every_time(self) -> None:
        library = (
            f"<library_nodes><node id='n' name='leg'>{files.instance()}</node></library_nodes>"
        )
        text = files.dae(
            "<node><translate>5 0 0</translate><instance_node url='#n'/></node>"
            "<node><instance_node url='#n'/></node>",
            meter=0.01,
        ).replace("<library_visual_scenes>", library + "<library_visual_scenes>")
        model = dae(text)
        assert sorted(part.mesh.bounds[0, 0] for part in model.parts) == pytest.approx([0, 5])

    def test_colour_gloss_and_name(self) -> None:
        shading = files.PLAIN + (
            "<specular><color>0.5 0.5 0.5 1</color></specular>"
            "<shininess><float>64</float></shininess>"
        )
        (part,) = dae(files.dae(materials=files.effect("red", shading))).parts
        assert part.material_name == "red"
        assert part.material.color == (1.0, 0.5, 0.25)
        assert (part.material.highlight, part.material.exponent) == (0.5, 64.0)

    @pytest.mark.parametrize(
        ("transparent", "opacity"),
        [
            ("<transparent opaque='A_ONE'><color>1 1 1 0.5</color></transparent>"
             "<transparency><float>0.5</float></transparency>", 0.25),
            ("<transparent><color>1 1 1 0.25</color></transparent>", 0.25),
            ("<transparent opaque='RGB_ZERO'><color>0.5 0.5 0.5 1</color></transparent>"
             "<transparency><float>0.5</float></transparency>", 0.75),
            ("<transparent opaque='RGB_ZERO'><color>0 1 0 1</color></transparent>", 1 - 0.71516),
            ("<transparency><float>0.2</float></transparency>", 1.0),
        ],
    )  # fmt: skip
    def test_transparency(self, transparent: str, opacity: float) -> None:
        made = dae(files.dae(materials=files.effect("red", files.PLAIN + transparent)))
        assert made.parts[0].material.opacity == pytest.approx(opacity)

    def test_faces_may_name_their_material_themselves(self) -> None:
        geometry = files.box().replace("material='m'", "material='red-id'")
        text = files.dae("<node><instance_geometry url='#box'/></node>", geometry)
        assert dae(text).parts[0].material.color == (1.0, 0.5, 0.25)

    def test_old_sketchup_wrote_it_the_other_way_round(self) -> None:
        shading = files.PLAIN + "<transparent><color>1 1 1 1</color></transparent>"
        shading += "<transparency><float>0.3</float></transparency>"
        made = {}
        for version in ("7.0.10247", "7.1.4871"):
            tool = f"<authoring_tool>Google SketchUp {version}</authoring_tool>"
            made[version] = dae(
                files.dae(
                    materials=files.effect("red", shading),
                    asset=f"<contributor>{tool}</contributor>",
                )
            )
        assert made["7.0.10247"].parts[0].material.opacity == pytest.approx(0.7)
        assert made["7.1.4871"].parts[0].material.opacity == pytest.approx(0.3)

    def test_what_nobody_could_see_is_opaque(self) -> None:
        shading = files.PLAIN + "<transparent><color>1 1 1 0</color></transparent>"
        made = dae(files.dae(materials=files.effect("red", shading)))
        assert made.parts[0].material.opacity == 1

    def test_images_and_uvs(self) -> None:
        image = "<library_images><image id='img'><init_from>../images/my%20wood.png</init_from>"
        model = dae(
            files.dae(
                geometries=files.box(uv=True),
                materials=files.effect("red", files.TEXTURED, files.SAMPLER),
                libraries=image + "</image></library_images>",
            )
        )
        (part,) = model.parts
        assert part.material.image == "found ../images/my wood.png"
        assert part.mesh.uvs is not None
        assert part.mesh.uvs.max() == 1

    def test_faults_in_unused_parts_do_no_harm(self) -> None:
        text = files.dae().replace(
            "</profile_COMMON>",
            "<extra><technique profile='X'><bump><texture texture='no'/></bump></technique>"
            "</extra></profile_COMMON>",
        )
        text = text.replace("</mesh>", "<linestrips count='1'><p>0 1</p></linestrips></mesh>")
        assert volume(dae(text)) > 0

    def test_authors_are_kept(self) -> None:
        who = "<contributor><author>Ann</author><copyright>CC-BY 4.0</copyright></contributor>"
        assert dae(files.dae(asset=who)).header == "Ann\nCC-BY 4.0"

    @pytest.mark.parametrize(
        ("text", "words"),
        [
            ("<COLLADA", "damaged"),
            ("<html/>", "no COLLADA"),
            ("<COLLADA/>", "no faces"),
            (files.dae(head="<!DOCTYPE x [<!ENTITY a 'b'>]>"), "refused"),
            (files.dae().replace("<p>0", "<p>99"), "no faces|damaged|does not exist"),
            (files.dae().replace("<p>0", "<p>-3"), "does not exist"),
            (files.dae(geometries=files.box(files.POINTS * 1e30)), "finite"),
            (files.dae(geometries=files.box(files.POINTS * np.nan)), "no faces|finite|damaged"),
            (files.dae("<node>" * 200 + files.instance() + "</node>" * 200), "deeper"),
            (files.dae(geometries="<geometry id='box'><mesh/></geometry>"), "no faces|damaged"),
        ],
    )
    def test_damaged(self, text: str, words: str) -> None:
        with pytest.raises(UnreadableModel, match=words):
            dae(text)

    def test_every_truncation_is_said(self) -> None:
        whole = files.dae(geometries=files.box(polygons=True, uv=True))
        for length in range(10, len(whole) - 1, 97):
            with pytest.raises(UnreadableModel):
                dae(whole[:length])

    def test_missing_elements_are_never_a_crash(self) -> None:
        """Each element in turn taken out: the model or `UnreadableModel`."""
        whole = files.dae(geometries=files.box(polygons=True, uv=True))
        spans = [match.span() for match in re.finditer(r"<(\w+)\b[^>]*?(/>|>[^<]*</\1>)", whole)]
        assert len(spans) > 15
        read = 0
        for start, end in spans:
            try:
                read += bool(dae(whole[:start] + whole[end:]).parts)
            except UnreadableModel:
                continue
        assert 0 < read < len(spans)

    @pytest.mark.slow
    def test_node_bombs_end(self) -> None:
        """Nodes that hold two of the next each: a billion boxes."""
        made = [f"<node id='n0'>{files.instance()}</node>"]
        for level in range(1, 31):
            inner = f"<node><instance_node url='#n{level - 1}'/></node>" * 2
            made.append(f"<node id='n{level}'>{inner}</node>")
        library = "<library_nodes>" + "".join(made) + "</library_nodes>"
        text = files.dae("<node><instance_node url='#n30'/></node>").replace(
            "<library_visual_scenes>", library + "<library_visual_scenes>"
        )
        with pytest.raises(UnreadableModel, match="nodes"):
            dae(text)


class TestKmz:
    def test_model_and_image_in_a_zip(self, tmp_path: Path) -> None:
        text = files.dae(
            geometries=files.box(uv=True),
            materials=files.effect("red", files.TEXTURED, files.SAMPLER),
            libraries="<library_images><image id='img'><init_from>../images/wood.png</init_from>"
            "</image></library_images>",
        )
        inside = files.kmz(text, {"images/Wood.png": draw.quadrants()})
        box = draw.piece(name="box", x=200, y=150, model="1/sofa.kmz", width=200, depth=100)
        home = draw.pack(tmp_path / "a.sh3d", draw.usual(box), {"1/sofa.kmz": inside})
        scene = import_scene(home, tmp_path / "out")
        (item,) = [item for item in scene.objects if item.name == "box"]
        size = np.subtract(item.bbox_max, item.bbox_min)
        assert size == pytest.approx([2, 1, 0.8], abs=1e-3)
        assert "textures/" in (scene.folder / "scene.xml").read_text()
        assert not [change for change in scene.changes if "image" in change.lower()]

    def test_no_model_inside(self, tmp_path: Path) -> None:
        with pytest.raises(UnreadableModel, match="no model"):
            member(tmp_path, files.kmz("x", name="readme.txt"))

    def test_damaged_zip(self, tmp_path: Path) -> None:
        with pytest.raises(UnreadableModel, match="damaged"):
            member(tmp_path, files.kmz(files.dae())[:300])

    def test_paths_that_lead_out(self, tmp_path: Path) -> None:
        with pytest.raises(UnreadableModel, match="leads out"):
            member(tmp_path, files.kmz(files.dae(), {"../evil": b""}))

    def test_bomb(self, tmp_path: Path) -> None:
        with pytest.raises(UnreadableModel, match="zip bombs"):
            member(tmp_path, files.kmz(" " * (30 * 2**20)))


class Test3ds:
    def test_z_is_up(self) -> None:
        model = max3ds(files.file_3ds())
        assert model.bounds == pytest.approx(np.array([[0, 0, 0], [2, 1, 4]]))
        assert volume(model) == pytest.approx(8)

    def test_the_meshs_own_frame_is_undone(self) -> None:
        # The mesh's own frame stands at (5, 6, 7) and is turned a quarter about the file's z.
        frame = np.array([[0.0, -1, 0, 5], [1, 0, 0, 6], [0, 0, 1, 7]])
        model = max3ds(files.file_3ds(files.mesh_3ds(frame=frame)))
        # A file's (x, y, z) comes out as (y - 6, z - 7, x - 5) of it: y up, z to the front.
        assert model.bounds == pytest.approx(np.array([[-10, -7, -5], [-6, -6, -3]]), abs=1e-5)
        assert volume(model) == pytest.approx(8)

    def test_keyframer(self) -> None:
        """Twice the same mesh: once below a turned node, once doubled about its pivot."""
        quarter = np.pi / 2
        nodes = (
            files.node_3ds("$$$DUMMY", position=(10, 0, 0), turn=(quarter, 0, 0, 1)),
            files.node_3ds("box", parent=0),
            files.node_3ds("box", pivot=(2, 0, 0), size=(2, 1, 1)),
        )
        model = max3ds(files.file_3ds(files.mesh_3ds(), nodes=nodes))
        bounds = [part.mesh.bounds for part in model.parts]
        # In the file the box is x 0..2, y -4..0; the turn, clockwise, takes y to x, x to -y.
        assert bounds[0] == pytest.approx(np.array([[6, 0, 0], [10, 1, 2]]), abs=1e-5)
        assert bounds[1] == pytest.approx(np.array([[-4, 0, 0], [0, 1, 4]]), abs=1e-5)

    def test_material(self) -> None:
        made = files.material_3ds(
            "red",
            files.chunk(0xA030, files.chunk(0x0011, bytes([255, 255, 255]))),
            files.percent(0xA040, 50),
            files.percent(0xA050, 75),
            files.chunk(0xA200, files.percent(0xA351, 100), files.chunk(0xA300, b"WOOD.JPG\0")),
        )
        (part,) = max3ds(files.file_3ds(made, files.mesh_3ds(uv=True))).parts
        assert part.material.color == pytest.approx((1, 128 / 255, 64 / 255))
        assert part.material.opacity == pytest.approx(0.25)
        assert part.material.highlight == pytest.approx(0.5)
        assert part.material.exponent == pytest.approx(0.5 * 0.6 * 128)
        assert part.material.image == "found WOOD.JPG"
        assert part.mesh.uvs is not None
        assert (part.group, part.material_name) == ("box", "red")

    def test_smoothing_groups(self) -> None:
        """A box of one group is rounded off; of one group a side it has its facets."""
        facets = [1 << (face // 2) for face in range(12)]
        for groups, sharp in (([1] * 12, False), (facets, True), ([0] * 12, True)):
            (part,) = max3ds(files.file_3ds(files.mesh_3ds(smoothing=groups))).parts
            _, flat = face_areas(part.mesh.corners)
            assert part.mesh.normals is not None
            along = np.einsum("fci,fi->fc", part.mesh.normals[part.mesh.faces], flat)
            assert (along > 0.999).all() == sharp

    def test_every_truncation_is_said(self) -> None:
        whole = files.file_3ds(nodes=(files.node_3ds("box"),))
        for length in range(0, len(whole) - 1, 13):
            with pytest.raises(UnreadableModel):
                max3ds(whole[:length])

    @pytest.mark.parametrize(
        ("mesh", "words"),
        [
            (files.mesh_3ds(faces=[[0, 1, 99]]), "does not exist"),
            (files.mesh_3ds(faces=[[0, 1, 99]], smoothing=[1]), "does not exist"),
            (files.mesh_3ds(points=np.full((8, 3), np.inf)), "finite"),
            (files.mesh_3ds(faces=[]), "no faces"),
            (files.chunk(0x4000, b"endless"), "without a terminating zero"),
        ],
    )
    def test_damaged(self, mesh: bytes, words: str) -> None:
        with np.errstate(invalid="ignore"), pytest.raises(UnreadableModel, match=words):
            max3ds(files.file_3ds(mesh))

    def test_any_byte_may_be_wrong(self) -> None:
        """Chunk lengths, counts and kinds that lie: the model or `UnreadableModel`, quickly."""
        whole = files.file_3ds(nodes=(files.node_3ds("box"),))
        for place in range(0, len(whole), 3):
            for value in (0, 127, 255):
                broken = bytearray(whole)
                broken[place] = value
                try:
                    max3ds(bytes(broken))
                except UnreadableModel:
                    continue


def test_damaged_models_are_missing_pieces(tmp_path: Path) -> None:
    """Each is named with its reason, and the home comes in."""
    broken = {
        "1/a.dae": files.dae().encode()[:400],
        "2/b.3ds": files.file_3ds()[:100],
        "3/c.kmz": files.kmz(files.dae())[:200],
        "4/d.dae": files.dae().encode(),
        "5/e": files.file_3ds(),
    }
    pieces = "".join(
        draw.piece(name=f"piece {name[0]}", x=60 * int(name[0]), y=150, model=name)
        for name in broken
    )
    home = draw.pack(tmp_path / "a.sh3d", draw.usual(pieces), dict(broken))
    scene = import_scene(home, tmp_path / "out")
    missing = {one["name"]: one["reason"] for one in scene.source["missing"]}
    assert sorted(missing) == ["piece 1", "piece 2", "piece 3"]
    assert "damaged" in missing["piece 1"] and "damaged" in missing["piece 2"]
    assert {item.name for item in scene.objects} >= {"piece 4", "piece 5"}
