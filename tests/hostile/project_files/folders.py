"""Hostile scene folders."""

from collections.abc import Sequence
from pathlib import Path

from pbrnet.scenes.contract import Portal
from tests.hostile.family import Family, Made, Victim
from tests.hostile.made import with_link, with_text
from tests.hostile.mutations import damaged_json, damaged_text
from tests.hostile.project_files.base import small_params
from tests.hostile.scene_files.models import write_obj

RENDER = (
    "predict scenes/room --eye 0,0,1.5 --towards 1,0.2,-0.2 --size 32x24 --models models "
    "--data data"
)


def _folder(folder: Path) -> None:
    """A scene folder and networks."""
    from tests.fixtures.predictor import untrained_models

    write_room(folder)
    untrained_models(folder / "models", width=2, levels=2)


def write_room(folder: Path, portals: Sequence[Portal] = ()) -> None:
    """A scene folder with a mesh, a texture and a lamp, as `pbrnet import` leaves them."""
    from tests.fixtures.model_file import POINTS, TRIANGLES
    from tests.fixtures.render import ball, diffuse, glow, write_scene

    small_params(folder)
    write_obj(folder)
    vertices = "\n".join(" ".join(map(str, row)) for row in POINTS.tolist())
    faces = "\n".join("3 " + " ".join(map(str, row)) for row in TRIANGLES)
    ply = (
        f"ply\nformat ascii 1.0\nelement vertex {len(POINTS)}\nproperty float x\nproperty float y\n"
        f"property float z\nelement face {len(TRIANGLES)}\nproperty list uchar int vertex_indices\n"
        f"end_header\n{vertices}\n{faces}\n"
    )
    (folder / "outside.ply").write_text(ply)
    picture = (folder / "t.png").read_bytes()
    body = (
        '<shape type="ply" id="box"><string name="filename" value="meshes/box.ply"/>'
        '<bsdf type="twosided"><bsdf type="diffuse"><texture type="bitmap" name="reflectance">'
        '<string name="filename" value="textures/t.png"/></texture></bsdf></bsdf></shape>'
        + ball("bulb", (0, 0, 2.5), 0.1, glow(5))
        + ball("sofa", (1.5, 0, 0.4), 0.4, diffuse())
    )
    write_scene(
        folder / "scenes" / "room",
        body,
        {"box": ("box",), "sofa": ("sofa",)},
        portals,
        files={"meshes/box.ply": ply.encode(), "textures/t.png": picture},
    )


LOOK, COPY = "inspect scenes/room --plan-only --out p.png", "import scenes/room --out out"


def _linked(name: str, target: str, command: str) -> Made:
    return with_link(f"scenes/room/{name}", target, command)


PARTS = {
    "include": ("<shape", "<include filename='/etc/passwd'/><shape"),
    "own": ("<shape", "<include filename='scene.xml'/><shape"),
    "include out": ("<shape", "<include filename='../../a.obj'/><shape"),
    "mesh out": ("meshes/box.ply", "../../outside.ply"),
    "mesh absolute": ("meshes/box.ply", "/dev/zero"),
    "texture out": ("textures/t.png", "../../t.png"),
    "texture device": ("textures/t.png", "/dev/zero"),
    "path": ("<shape", "<path value='/'/><shape"),
    "plugin": ('type="ply"', 'type="nothing"'),
    "entity": ("<scene", "<!DOCTYPE x [<!ENTITY i SYSTEM '/etc/passwd'>]><scene"),
    "default": ("<shape", "<default name='a' value='meshes'/><shape"),
    "variable": ("meshes/box.ply", "$a/../../../outside.ply"),
    "cut": ("</scene>", ""),
    "deep": ("<shape", "<bsdf type='twosided'>" * 500 + "<shape"),
}

FOLDERS_MADE = (
    *(
        with_text("scenes/room/scene.xml", *part, command)
        for part in PARTS.values()
        for command in (RENDER, LOOK, COPY)
    ),
    *(
        _linked(name, target, command)
        for name, target in (
            ("meshes/box.ply", "/dev/zero"),
            ("meshes/box.ply", "box.ply"),
            ("meshes/box.ply", "../../../outside.ply"),
            ("scene.xml", "/dev/zero"),
            ("scene.json", "/dev/zero"),
            ("scene.json", "scene.json"),
            ("textures/t.png", "/etc/passwd"),
        )
        for command in (RENDER, LOOK, COPY)
    ),
)


FAMILIES = (
    Family(
        "scene folders",
        160,
        _folder,
        (
            Victim("scenes/room/scene.xml", damaged_text, (LOOK, COPY, RENDER)),
            Victim("scenes/room/scene.json", damaged_json, (LOOK, COPY)),
            Victim("scenes/room/meshes/box.ply", damaged_text, (LOOK, COPY)),
        ),
        FOLDERS_MADE,
        seconds=2.0,
    ),
)
