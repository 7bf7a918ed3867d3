"""Damaged and hostile homes: refused with a clear error, or imported with a note, in time."""

import io
import math
import struct
import time
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path

import pytest
from shapely.geometry import Polygon

from pbrnet.scenes.contract import Scene
from pbrnet.scenes.errors import InputError, ParameterError
from pbrnet.scenes.formats.archive import HomeArchive
from pbrnet.scenes.formats.model_parts import UnreadableModel
from pbrnet.scenes.formats.obj_model import read_obj_model
from pbrnet.scenes.registry import import_scene
from pbrnet.scenes.sweethome.building.cutouts import UnreadablePath, path_region
from tests.fixtures import sweethome as draw
from tests.fixtures.encoded import empty_png, zipped

SECONDS = 10.0


@pytest.fixture(autouse=True)
def quick() -> Iterator[None]:
    started = time.process_time()
    yield
    assert time.process_time() - started < SECONDS


def bring(folder: Path, xml: str | bytes, members: dict[str, str | bytes] | None = None) -> Scene:
    folder.mkdir(exist_ok=True)
    path = draw.pack(folder / "test.sh3d", xml, members)
    return import_scene(path, folder / "out", lamps="home")


USUAL = draw.packed(draw.usual())


def cut(share: float) -> bytes:
    return USUAL[: int(share * len(USUAL))]


def with_size(size: int) -> bytes:
    """A home whose archive states another size of `Home.xml`."""
    true, stated = (struct.pack("<I", one) for one in (len(draw.usual()), size))
    return USUAL.replace(true, stated)


def encrypted() -> bytes:
    data = bytearray(USUAL)
    data[6] |= 1  # the flag in the member's own header
    data[data.index(b"PK\x01\x02") + 8] |= 1
    return bytes(data)


def spaces(megabytes: int) -> bytes:
    return draw.packed(b"<home>" + b" " * (megabytes * 2**20) + b"</home>")


def with_body(body: str) -> Callable[[], bytes]:
    return lambda: draw.packed(draw.home(body))


def with_member(name: str) -> Callable[[], bytes]:
    return lambda: draw.packed(draw.usual(), {name: "x"})


MANY: dict[str, str | bytes] = {str(number): "" for number in range(20_001)}
LONG = "<home>" + "<a/>" * 1_100_000 + "</home>"
NO_HOME = "not a Sweet Home 3D file"
FILES: dict[str, tuple[Callable[[], bytes], str]] = {  # the home file, and what is said of it
    "not a zip": (lambda: b"GIF89a" + bytes(1000), NO_HOME),
    "empty": (lambda: b"", NO_HOME),
    "cut early": (lambda: cut(0.3), f"{NO_HOME}|damaged"),
    "cut late": (lambda: cut(0.7), f"{NO_HOME}|damaged"),
    "cut at its end": (lambda: cut(0.99), f"{NO_HOME}|damaged"),
    "a damaged member": (lambda: USUAL[:60] + bytes(30) + USUAL[90:], "damaged"),
    "a damaged old home": (lambda: zipped({"Home": b"\xac\xed\x00\x05"}),
                           "damaged Java objects.*save it again"),
    "some other zip": (lambda: zipped({"word/document.xml": "<a/>"}), "no Home.xml"),
    "a relative path": (with_member("../evil"), "leads out"),
    "an absolute path": (with_member("/etc/evil"), "leads out"),
    "a path by way of a folder": (with_member("a/../../evil"), "leads out"),
    "a path of Windows": (with_member("..\\evil"), "leads out"),
    "a drive": (with_member("C:evil"), "leads out"),
    "a zip bomb": (lambda: spaces(30), "zip bombs"),
    "a home that is too large": (lambda: spaces(40), "at most"),
    "a lie about its size": (lambda: with_size(100), "damaged|not of the size"),
    "too many members": (lambda: draw.packed(draw.usual(), MANY), "files inside"),
    "an encrypted member": (encrypted, "damaged or encrypted"),
    "too many elements": (lambda: zipped({"Home.xml": LONG}), "elements"),
}  # fmt: skip
XML = {
    "<!DOCTYPE a [<!ENTITY b 'c'><!ENTITY d '&b;&b;&b;'>]><home>&d;</home>": "refused",
    "<!DOCTYPE a [<!ENTITY b SYSTEM 'file:///etc/passwd'>]><home>&b;</home>": "refused",
    "<home><wall></home>": "damaged",
    "": "damaged",
    "<building/>": "root is <building>",
    "<home version='new'/>": "version='new'",
    "<?xml version='1.0' encoding='no-such'?><home/>": "damaged",
}
BODIES = {
    draw.wall("w", (0, 0), (100, 0), thickness="nan"): "thickness='nan'",
    draw.wall("w", (0, 0), (1e30, 0)): "xEnd",
    draw.wall("w", (0, 0), (100, 0), thickness=-5): "0 or more",
    draw.wall("w", (0, 0), (100, 0), leftSideColor="red"): "a colour",
    draw.wall("w", (0, 0), (100, 0), arcExtent=100): "arcExtent",
    "<wall id='w'/>": "xStart",
    draw.piece(model="m", width="inf"): "width",
    draw.piece(model="m", modelRotation="1 0 0"): "9 numbers",
    draw.piece(model="m", angle="1;2"): "angle",
    "<level id='a' name='a' elevation='x' floorThickness='1' height='1'/>": "elevation",
    "<room><point x='0'/></room>": "y=None",
    "<room>" + "<point x='0' y='0'/>" * 5001 + "</room>": "points",
    draw.room(0, 0, 400, 300) + draw.piece(model="m"): "drawn rooms but no walls",
    "<furnitureGroup name='g'>" * 40 + "</furnitureGroup>" * 40: "groups",
}


@pytest.mark.parametrize(
    ("make", "words"),
    [
        *(pytest.param(*case, id=name) for name, case in FILES.items()),
        *(pytest.param(partial(draw.packed, text), words) for text, words in XML.items()),
        *(pytest.param(with_body(body), words) for body, words in BODIES.items()),
        (with_body(""), "empty"),
    ],
)
def test_hostile_homes_are_refused_and_leave_nothing(
    tmp_path: Path, make: Callable[[], bytes], words: str
) -> None:
    path = tmp_path / "test.sh3d"
    path.write_bytes(make())
    with pytest.raises(InputError, match=words):
        import_scene(path, tmp_path / "out")
    assert sorted(tmp_path.iterdir()) == [path]


def said(scene: Scene) -> str:
    return " ".join(scene.changes)


NO_MODEL = "CAME IN AS OPEN HOLES (1): window"


@pytest.fixture(scope="module")
def usual(tmp_path_factory: pytest.TempPathFactory) -> Scene:
    """The home without odd elements."""
    return bring(tmp_path_factory.mktemp("usual") / "in", draw.usual(), {"m": draw.BOX})


@pytest.mark.slow
@pytest.mark.parametrize(
    ("body", "added", "note"),
    [
        (draw.wall("w", (0, 0), (0, 0)), 0, "walls without length were left out: w"),
        (draw.wall("w", (0, 0), (100, 0), thickness=0), 1, "became sheets of 5 mm: w"),
        (draw.wall("w", (0, 0), (100, 0), wallAtStart="w", wallAtEnd="w"), 1, ""),
        (draw.wall("w", (0, 0), (100, 0), wallAtEnd="nowhere", level="nowhere"), 1, ""),
        (draw.wall("a", (0, 0), (100, 0), wallAtEnd="a", wallAtStart="a") * 2, 1,
         "exact copies of walls were left out: a"),
        (draw.wall("w", (0, 0), (100, 0), arcExtent=2 * math.pi), 1, ""),
        (draw.wall("w", (0, 0), (100, 0), arcExtent=6.28), 1, ""),
        (draw.wall("w", (0, 0), (100, 0), height=-100), 0, "walls without height were left out: w"),
        ("<room><point x='0' y='0'/><point x='9' y='9'/></room>", 0, "rooms without area"),
        (draw.window(x=100, y=0, cutOutShape="M0,0 lots of nonsense"), 0, "became rectangles"),
        (draw.window(x=100, y=0, cutOutShape="M0,0 L9,9 Z"), 0, "became rectangles: window"),
        (draw.window(x=100, y=0), 0, NO_MODEL),
        (draw.window(x=100, y=0, wallWidth=0), 0, "an empty cut-out cut no wall: window"),
        (draw.window(x=100, y=0, wallHeight=0), 0, "an empty cut-out cut no wall: window"),
        (draw.window(x=100, y=0, width=0), 0, "pieces without size were left out: window"),
        (draw.piece(model="m", x=100, y=100, width=0), 0, "pieces without size were left out"),
        (draw.piece(model="m", x=100, y=100, modelRotation="0 0 0 0 0 0 0 0 0"), 1, ""),
        (draw.piece(model="m", x=100, y=100, staircaseCutOutShape="no shape"), 1,
         "stairwell shapes that cannot be read became rectangles"),
        (draw.piece("pieceOfFurniture",
                    "<transformation name='sweethome3d_hinge_1' "
                    "matrix='0 0 0 0 0 0 0 0 0 0 0 0'/>",
                    model="m", x=100, y=100), 1, ""),
        (draw.lamp(x=100, y=100, power=7), 1, "CAME IN AS BARE BULBS (1): bulb"),
        ("<compass x='0' y='0' diameter='1' latitude='1.57' longitude='0' "
         "timeZone='../../etc'/>", 0, "the time zone '../../etc' is not known"),
        ("<observerCamera attribute='observerCamera' x='0' y='0' z='0' yaw='0' pitch='1.5708' "
         "fieldOfView='99' time='9007199254740000'/>", 0, "the home's time cannot be read"),
    ],
)  # fmt: skip
def test_an_odd_element_leaves_the_home_as_it_is(
    usual: Scene, tmp_path: Path, body: str, added: int, note: str
) -> None:
    scene = bring(tmp_path / "odd", draw.usual(body), {"m": draw.BOX})
    assert scene.rooms[0].floor == usual.rooms[0].floor
    assert len(scene.rooms) == len(usual.rooms) == 1
    ids = {one.id for one in scene.objects}
    assert ids >= {one.id for one in usual.objects}
    assert len(ids) == len(usual.objects) + added
    new = [one for one in scene.changes if one not in usual.changes]
    assert any(note in one for one in new) if note else not new


def test_a_room_that_crosses_itself_is_two_triangles(tmp_path: Path) -> None:
    crossed = (
        "<room><point x='0' y='0'/><point x='300' y='300'/><point x='300' y='0'/>"
        "<point x='0' y='300'/></room>"
    )
    scene = bring(tmp_path, draw.usual(crossed))
    assert len(scene.rooms) == 2
    assert Polygon(scene.rooms[1].floor).area == pytest.approx(2.25, abs=0.1)


@pytest.mark.parametrize(
    "data, words",
    [
        ("v 0 0 0\nf 1 2 3\n", "does not exist"),
        ("v 0 0 0\nv 1 0 0\nv nan 0 1\nf 1 2 3\n", "finite"),
        ("v 0 0 0\nv 1 0 0\nv 0 x 1\nf 1 2 3\n", "not a number"),
        ("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1/a 2 3\n", "corner"),
        ("# nothing\n", "no faces"),
        (b"MM\0\0" + bytes(64), "damaged 3DS"),
        (b"<?xml version='1.0'?><COLLADA/>", "no faces"),
        (b"PK\x03\x04", "damaged zip"),
        (bytes(100), "binary"),
    ],
)
def test_bad_models_are_left_out_and_named(tmp_path: Path, data: str | bytes, words: str) -> None:
    scene = bring(tmp_path, draw.usual(draw.piece(model="m", x=100, y=100)), {"m": data})
    assert words in said(scene)
    assert "thing" not in {one.name for one in scene.objects}


def test_endless_polygons() -> None:
    text = "v 0 0 0\nv 1 0 0\nv 0 1 0\nf " + "1 2 3 " * 3000
    with pytest.raises(UnreadableModel, match="triangles"):
        read_obj_model(text.encode(), "ring.obj", lambda name: {})


@pytest.mark.parametrize(
    "data", [empty_png(40_000, 25_000), b"GIF89a", b"", b"\x89PNG\r\n\x1a\n" + bytes(50)]
)
def test_bad_images_give_way_to_colour(tmp_path: Path, data: bytes) -> None:
    texture = "<texture attribute='floorTexture' name='t' width='10' height='10' image='t'/>"
    xml = draw.home(draw.box_walls(0, 0, 420, 320) + draw.room(10, 10, 400, 300, texture))
    scene = bring(tmp_path, xml, {"t": data})
    assert "plain colour" in said(scene)
    assert not list((scene.folder / "textures").iterdir())


def test_missing_image(tmp_path: Path) -> None:
    texture = ("<texture attribute='floorTexture' name='t' width='10' height='10' "
               "image='../../../etc/hostname'/>")  # fmt: skip
    xml = draw.home(draw.box_walls(0, 0, 420, 320) + draw.room(10, 10, 400, 300, texture))
    assert "missing" in said(bring(tmp_path, xml))


def test_material_files_stay_inside(tmp_path: Path) -> None:
    model = "mtllib ../../../etc/passwd\n" + draw.BOX
    scene = bring(tmp_path, draw.usual(draw.piece(model="3/box.obj", x=100, y=100)),
                  {"3/box.obj": model})  # fmt: skip
    assert "material files of models are missing" in said(scene)


@pytest.mark.parametrize("text", ["", "1 2 3", "M0,0", "M0,0 L", "M0,0 A1,1 0", "M" + "0 " * 30000])
def test_bad_paths(text: str) -> None:
    with pytest.raises(UnreadablePath):
        path_region(text)


@pytest.mark.parametrize(
    "options, error",
    [
        ({"level": ("Attic",)}, InputError),
        ({"time": "noon"}, ParameterError),
        ({"time": "25:00"}, ParameterError),
    ],
)
def test_bad_options(tmp_path: Path, options: dict, error: type[Exception]) -> None:
    path = draw.pack(tmp_path / "test.sh3d", draw.usual())
    with pytest.raises(error):
        import_scene(path, tmp_path / "out", **options)
    assert not (tmp_path / "out").exists()


def test_members_are_found_only_beside_their_model(tmp_path: Path) -> None:
    members: dict[str, str | bytes] = {"1/Oak.JPG": "a", "2/oak.jpg": "b", "3/deep/x.png": "c"}
    with HomeArchive(draw.pack(tmp_path / "t.sh3d", "<home/>", members)) as archive:
        find: Callable[[str, str], str | None] = archive.beside
        assert find("1/model.mtl", "C:\\textures\\oak.jpg") == "1/Oak.JPG"
        assert find("2/model.mtl", "oak.jpg") == "2/oak.jpg"
        assert find("3/model.mtl", "x.png") == "3/deep/x.png"
        assert find("3/model.mtl", "../1/Oak.JPG") is None
        assert io.BytesIO(archive.read("1/Oak.JPG")).read() == b"a"
