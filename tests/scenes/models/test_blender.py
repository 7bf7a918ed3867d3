""".blend and .fbx by way of Blender: found, limited, without the file's scripts, or asked for."""

import json
import os
import subprocess
from pathlib import Path

import numpy as np
import pytest

from pbrnet.scenes.contract import Scene
from pbrnet.scenes.errors import InputError, MachineError
from pbrnet.scenes.models.blender import reader
from pbrnet.scenes.models.blender.reader import VARIABLE, blender_command
from pbrnet.scenes.registry import import_scene
from tests.fixtures.gltf import SQUARE, Builder
from tests.fixtures.paths import ROOT

REAL = os.environ.get(VARIABLE, "")
NOTES = {"notes": {"hair and particles were left out: {}": ["cat"]}, "files": [], "unit": 0.01,
         "outdoors": False}  # fmt: skip


@pytest.fixture
def _no_blender(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """Neither bpy nor a program: `tmp_path/bin` is the whole PATH but for the shell."""
    monkeypatch.delenv(VARIABLE, raising=False)
    monkeypatch.setattr(reader, "find_spec", lambda name: None)
    (tmp_path / "bin").mkdir()
    monkeypatch.setenv("PATH", f"{tmp_path / 'bin'}:/usr/bin:/bin")
    monkeypatch.setattr(reader.shutil, "which", _only_in(tmp_path / "bin"))


def _only_in(folder: Path) -> object:
    def which(name: str) -> str | None:
        path = Path(name) if "/" in name else folder / name
        return str(path) if path.is_file() else None

    return which


def stub(tmp_path: Path, *steps: str) -> None:
    """A program `blender` that notes its arguments and variables, then runs shell commands.

    `$out` is the folder in which the results belong.
    """
    lines = [
        "#!/bin/sh",
        f'printf "%s\\n" "$@" > {tmp_path}/arguments',
        f"env > {tmp_path}/variables",
        'while [ "$1" != "--" ]; do shift; done',
        "out=$4",
        *steps,
    ]
    program = tmp_path / "bin" / "blender"
    program.write_text("\n".join(lines) + "\n")
    program.chmod(0o755)


def exporting(tmp_path: Path) -> tuple[str, ...]:
    """Steps that leave a chair of 100 units and notes."""
    made = Builder()
    made.node(mesh=made.mesh(100 * SQUARE), name="chair")
    made.save(tmp_path / "made.glb")
    (tmp_path / "made.json").write_text(json.dumps(NOTES))
    return (
        f"cp {tmp_path}/made.glb $out/scene.glb",
        f"cp {tmp_path}/made.json $out/notes.json",
    )


def imported(tmp_path: Path, name: str = "chair.blend") -> Scene:
    path = tmp_path / "in" / name
    path.parent.mkdir(exist_ok=True)
    path.write_bytes(b"BLENDER-v405")
    return import_scene(path, tmp_path / "out")


@pytest.mark.usefixtures("_no_blender")
@pytest.mark.parametrize("name", ["chair.blend", "chair.fbx"])
def test_without_blender_the_message_says_what_to_do(tmp_path: Path, name: str) -> None:
    with pytest.raises(MachineError, match=r"pbrnet\[blender\].*export the file to glTF"):
        imported(tmp_path, name)
    assert not (tmp_path / "out").exists()


@pytest.mark.usefixtures("_no_blender")
def test_a_program_that_is_not_there_is_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv(VARIABLE, "/nowhere/blender")
    with pytest.raises(MachineError, match=f"{VARIABLE}=/nowhere/blender"):
        imported(tmp_path)


@pytest.mark.usefixtures("_no_blender")
def test_the_order_in_which_blender_is_found(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    stub(tmp_path)
    path = Path("a.blend")
    assert blender_command(path)[0] == str(tmp_path / "bin" / "blender")
    monkeypatch.setattr(reader, "find_spec", lambda name: object())
    assert blender_command(path)[:2] == [reader.sys.executable, "-I"]
    python = tmp_path / "python3.13"
    python.touch()
    monkeypatch.setenv(VARIABLE, str(python))
    assert blender_command(path)[:2] == [str(python), "-I"]


@pytest.mark.usefixtures("_no_blender")
def test_what_blender_exports_is_imported(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PYTHONPATH", "/somewhere")
    stub(tmp_path, *exporting(tmp_path))
    scene = imported(tmp_path)
    assert scene.source["kind"] == "blend"
    chair = next(each for each in scene.objects if each.category == "chair")
    assert np.subtract(chair.bbox_max, chair.bbox_min)[:2] == pytest.approx([1, 1])  # 1 cm a unit
    assert "hair and particles were left out: cat" in scene.changes
    arguments = (tmp_path / "arguments").read_text().split("\n")
    for word in ("--background", "--factory-startup", "--disable-autoexec"):
        assert word in arguments
    assert arguments.index("--disable-autoexec") < arguments.index("--python")
    variables = dict(
        line.split("=", 1) for line in (tmp_path / "variables").read_text().splitlines()
    )
    assert "PYTHONPATH" not in variables and variables["HOME"] != os.environ.get("HOME")


@pytest.mark.usefixtures("_no_blender")
@pytest.mark.parametrize(
    ("steps", "message"),
    [
        (("echo 'no DNA block' > $out/message", "exit 4"), "no DNA block"),
        (
            ("printf 'Traceback:\\n  File x\\nKeyError: 3\\n' > $out/message", "exit 4"),
            r"\(KeyError: 3\)",
        ),
        (("kill -SEGV $$",), "damaged"),
        ((), "did not finish"),
        (("sleep 60",), "more than"),
        (("echo '{' > $out/notes.json",), "did not finish"),
        (("echo '[[[' > $out/notes.json",), "did not finish"),
        (('echo \'{"notes": {"a": 3}}\' > $out/notes.json',), "did not finish"),
        (("mkfifo $out/notes.json",), "did not finish"),
        (("ln -s /dev/zero $out/notes.json",), "did not finish"),
    ],
)
def test_a_blender_that_fails_ends_in_one_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, steps: tuple[str, ...], message: str
) -> None:
    monkeypatch.setattr(reader, "_SECONDS", -14.5)  # 1 s in all
    stub(tmp_path, *steps)
    with pytest.raises(InputError, match=message) as caught:
        imported(tmp_path)
    assert "chair.blend" in str(caught.value) and "Traceback" not in str(caught.value)
    assert not (tmp_path / "out").exists()


@pytest.mark.usefixtures("_no_blender")
def test_errors_in_what_blender_wrote_name_the_users_file(tmp_path: Path) -> None:
    steps = exporting(tmp_path)
    made = Builder()
    made.node(mesh=7)
    made.save(tmp_path / "made.glb")
    stub(tmp_path, *steps)
    with pytest.raises(InputError, match=r"in/chair\.blend, exported: nodes"):
        imported(tmp_path)


@pytest.mark.check
@pytest.mark.skipif(
    not Path(REAL).name.startswith("python"), reason=f"{VARIABLE} names no Python with bpy"
)
def test_a_real_blender_exports_without_running_scripts(tmp_path: Path) -> None:
    folder = tmp_path / "in"
    folder.mkdir()
    script = ROOT / "tests" / "fixtures" / "blend_room.py"
    subprocess.run([REAL, "-I", str(script), str(folder)], check=True, timeout=300)
    for name, lights in (("room.blend", ["area"]), ("room.fbx", ["point"])):
        scene = import_scene(folder / name, tmp_path / name.replace(".", "_"))
        (room,) = scene.rooms
        assert np.ptp(np.array(room.floor), axis=0) == pytest.approx([4, 3], abs=0.02)
        assert room.ceiling_z - room.floor_z == pytest.approx(2.6, abs=0.02)
        assert [light.kind for light in scene.lights] == lights
        assert any(each.category == "table" for each in scene.objects)
        assert ("wardrobe" in {each.category for each in scene.objects}) == (name == "room.fbx")
        assert (
            len(scene.source["views"]) == (1 if name == "room.blend" else 0) or name[-3:] == "fbx"
        )
        left_out = "a panoramic camera was left out: panorama" in scene.changes
        assert left_out == (name == "room.blend")
    assert sorted(path.name for path in folder.iterdir()) == ["room.blend", "room.fbx"]
    (folder / "cut.blend").write_bytes((folder / "room.blend").read_bytes()[:50_000])
    with pytest.raises(InputError, match=r"cut\.blend"):
        import_scene(folder / "cut.blend", tmp_path / "cut")
