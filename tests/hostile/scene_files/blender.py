"""Hostile .blend and .fbx files, and programs in Blender's place that misbehave."""

import json
import os
from pathlib import Path
from random import Random

from tests.hostile.family import STAND_IN, Arguments, Family, Made, Victim
from tests.hostile.made import case, with_file, with_link
from tests.hostile.mutations import LONG, damaged_bytes, damaged_json, deep
from tests.hostile.scene_files.models import write_gltf

BLEND, FBX = "import a.blend --out out --scale 1", "import a.fbx --out out --scale 1"
NOTES = {
    "notes": {"hair and particles were left out: {}": ["cat"]},
    "files": ["t.png"],
    "unit": 1.0,
    "outdoors": False,
}
_WRITES = "cp $case/a.glb $out/scene.glb\ncp $case/notes.json $out/notes.json"


def _program(folder: Path, steps: str) -> None:
    """A shell script in Blender's place; `$out` is the folder of the results, `$case` the case."""
    program = folder / STAND_IN
    program.write_text(
        f'#!/bin/sh\ncase={folder}\nwhile [ "$1" != -- ]; do shift; done\nout=$4\n{steps}\n'
    )
    program.chmod(0o755)


def _blender(folder: Path) -> None:
    """An export as Blender would make it, and files whose content nothing gets to see."""
    write_gltf(folder)
    (folder / "notes.json").write_text(json.dumps(NOTES))
    (folder / "a.blend").write_bytes(b"BLENDER-v405" + bytes(200))
    (folder / "a.fbx").write_bytes(b"Kaydara FBX Binary  \0\x1a\0" + bytes(200))


class Blender(Family):
    """Files whose reader is a stand-in that copies prepared results unless a case replaces it."""

    def write(self, folder: Path, rng: Random, number: int) -> Arguments:
        """Point the reader to the stand-in, then write the case."""
        os.environ["PBRNET_BLENDER"] = str(folder / STAND_IN)
        _program(folder, _WRITES)
        return super().write(folder, rng, number)


@case
def _stand_in(folder: Path, steps: str, command: str = BLEND) -> str:
    _program(folder, steps)
    return command


@case
def _named(folder: Path, program: str) -> str:
    """`PBRNET_BLENDER` names something else."""
    os.environ["PBRNET_BLENDER"] = program.format(folder)
    return BLEND


def _notes(text: str | bytes) -> Made:
    return with_file("notes.json", text, BLEND)


def _notes_with(**changes: object) -> Made:
    return _notes(json.dumps({**NOTES, **changes}))


MADE = (
    *(
        _stand_in(steps, command)
        for command in (BLEND, FBX)
        for steps in (
            "exit 0",
            "exit 1",
            "exit 3",
            "kill -SEGV $$",
            "kill -KILL $$",
            "head -c 20000000 /dev/urandom; head -c 20000000 /dev/urandom >&2; exit 1",
            "printf '\\033[31m%05000d\\n' 0 > $out/message; exit 3",
            "head -c 3000000 /dev/urandom > $out/message; exit 3",
            "head -c 3000000 /dev/urandom > $out/message; exit 4",
            "ln -s /dev/zero $out/message; exit 3",
            "mkfifo $out/message; exit 3",
            f"{_WRITES}; ln -sf /dev/zero $out/notes.json",
            f"{_WRITES}; rm $out/notes.json; mkfifo $out/notes.json",
            f"{_WRITES}; ln -sf /dev/zero $out/scene.glb",
            f"{_WRITES}; rm $out/scene.glb; mkfifo $out/scene.glb",
            f"{_WRITES}; rm $out/scene.glb; mkdir $out/scene.glb",
            f"{_WRITES}; ln -sf $case/a.glb $out/scene.glb",
            f"{_WRITES}; ln -sf $out/scene.glb $out/scene.glb",
            f"{_WRITES}; : > $out/scene.glb",
            f"{_WRITES}; head -c 100 $case/a.glb > $out/scene.glb",
            f"{_WRITES}; truncate -s 8G $out/scene.glb",
            f"{_WRITES}; truncate -s 8G $out/notes.json",
            f"{_WRITES}; cp $case/a.gltf $out/scene.glb",
            f"{_WRITES}; rm -rf $out",
            f"{_WRITES}; chmod 0 $out/scene.glb $out",
            f"{_WRITES}; yes 2> /dev/null | head -c 1000 > $out/other; mkdir $out/images",
        )
    ),
    *(
        _named(program)
        for program in ("/nowhere", "{}", "{}/a.blend", "/dev/null", "-x", "a b", "x" * 5000)
    ),
    _named("{}/notes.json"),
    *(
        _notes(text)
        for text in ("", "[]", "null", "{}", deep(), LONG, '{"notes":' * 5000, b"\xff\xfe", "NaN")
    ),
    _notes_with(unit=0),
    _notes_with(unit=-1),
    _notes_with(unit=float("nan")),
    _notes_with(unit=1e308),
    _notes_with(unit=1e-308),
    _notes_with(unit=10**400),
    _notes_with(unit="x"),
    _notes_with(files=["/dev/zero", "../../../x", "\ud800", "a\0b", "x" * 5000]),
    _notes_with(files=3),
    _notes_with(files=[[]]),
    _notes_with(notes=[["a", ["b"]]]),
    _notes_with(notes=[1]),
    _notes_with(notes={"a": 3}),
    _notes_with(notes={"a": [[], {}, None]}),
    _notes_with(notes={"{} {} {x}": ["\ud800" * 3]}),
    _notes_with(notes={"{0.__class__}": ["x"] * 50_000}),
    _notes_with(notes={f"n{n} {{}}": ["A" * 70_000] for n in range(50)}),
    _notes_with(outdoors=[]),
    with_link("a.blend", "a.blend", BLEND),
    with_link("a.blend", "/dev/zero", BLEND),
    with_link("a.fbx", "/dev/full", FBX),
)

FAMILIES = (
    Blender(
        "blender",
        180,
        _blender,
        (
            Victim("a.blend", damaged_bytes, (BLEND,)),
            Victim("a.fbx", damaged_bytes, (FBX,)),
            Victim("a.glb", damaged_bytes, (BLEND, FBX)),
            Victim("a.glb", damaged_bytes, (BLEND, FBX)),
            Victim("notes.json", damaged_json, (BLEND, FBX)),
        ),
        MADE,
    ),
)
