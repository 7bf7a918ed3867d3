"""Command lines with impossible values."""

import os
from pathlib import Path
from random import Random

import click

from tests.hostile.family import Arguments, Family, Made
from tests.hostile.mutations import LONG, NUMBERS, TEXTS
from tests.hostile.project_files.base import small_params
from tests.hostile.scene_files.homes import write_home
from tests.hostile.scene_files.mitsuba import write_xml
from tests.hostile.scene_files.models import write_gltf


def _line(folder: Path) -> None:
    write_home(folder)
    write_gltf(folder)
    write_xml(folder)
    small_params(folder)
    (folder / "empty").mkdir()


_COMMANDS = (
    "import", "import", "import", "import", "inspect", "predict", "cost", "dataset", "preset",
    "cameras", "inputs", "illumination", "groundtruth", "evaluate", "report", "export",
    "pretrained", "reference",
)  # fmt: skip

_PATHS = (
    "missing", "a.obj", ".", "empty", "a\0b", "loop.obj", "A" * 5000, "a.obj/x", "fifo.obj",
    "zero.glb", "\udcff", "a\nb", "params.yaml",
)  # fmt: skip


class CommandLines(Family):
    """Command lines with impossible values, of options that the commands themselves list."""

    def write(self, folder: Path, rng: Random, number: int) -> Arguments:
        """Return a command line made by hand, or a random one."""
        os.mkfifo(folder / "fifo.obj")
        (folder / "loop.obj").symlink_to("loop.obj")
        (folder / "zero.glb").symlink_to("/dev/zero")
        if number < len(self.made):
            return self.made[number](folder)
        from pbrnet.pipeline.cli import LazyGroup, cli

        name = rng.choice(_COMMANDS)
        assert isinstance(cli, LazyGroup)
        command = cli.get_command(click.Context(cli), name)
        assert command is not None
        sources = ("a.obj", "a.glb", "home.sh3d", "scene.xml", "a.gltf", *_PATHS)
        line = [name, *([rng.choice(sources)] if name in ("import", "inspect") else ())]
        if name == "import":
            line += ["--out", "out"]
        options = [
            one
            for one in command.params
            if isinstance(one, click.Option)
            and one.name not in ("out", "help", "scheduler", "workers")
        ]
        for one in rng.sample(options, min(len(options), rng.choice([1, 1, 2, 3]))):
            line.append(one.opts[0])
            if not one.is_flag:
                path = isinstance(one.type, click.Path)
                line.append(rng.choice(_PATHS if path else (*NUMBERS, *TEXTS)))
        return [word.replace("\0", "") for word in line]  # no system passes a NUL


def _call(line: str) -> Made:
    return lambda folder: line.split(" ")


LINES_MADE = tuple(
    _call(line)
    for line in (
        "",
        "nothing",
        "--nothing",
        "import",
        "import a.obj",
        "inspect",
        "import a.obj --out ",
        *(
            f"import a.obj --out out --scale {value}"
            for value in ("nan", "inf", "-1", "0", "1e308", "1e-308", "x", LONG)
        ),
        *(f"import a.glb --out out --scale {value}" for value in ("nan", "1e300", "1e-300")),
        *(f"import scene.xml --out out --scale {value}" for value in ("nan", "1e300", "1e-300")),
        *(f"import a.obj --out out --id {value}" for value in ("../../x", "a/b", "-x", "..", "")),
        "import home.sh3d --out out --time nan",
        "import home.sh3d --out out --variants 1000",
        "import loop.obj --out out",
        "import fifo.obj --out out",
        "import zero.glb --out out",
        "import /dev/zero --out out",
        "import /dev/null --out out",
        "import . --out out",
        "import a.obj --out a.obj",
        "import a.obj --out a.obj/x",
        "import a.obj --out loop.obj",
        "import a.obj --out out --seed -1",
        f"import a.obj --out out --seed {LONG}",
        "inspect loop.obj",
        "inspect fifo.obj",
        "inspect /dev/zero",
        "inspect .",
        "inspect empty",
        "inspect /proc/self/mem",
        f"inspect {'A' * 5000}",
        "inspect scene.xml --leaks",
        "cost --cores 0",
        f"cost --views {LONG}",
        f"cost --seed {LONG}",
        "cost --params fifo.obj",
        "cost --params loop.obj",
        "cost --params zero.glb",
        "cost --params empty",
        "cost --data a.obj",
        "dataset --data loop.obj",
        "preset nothing",
        "preset ../../x",
        "predict a.obj --view x",
        "predict empty --eye nan,0,0 --towards 1,0,0",
        "predict --inputs fifo.obj --illumination fifo.obj",
        "predict --inputs empty --illumination empty",
        "train nothing",
        "train shading --data empty",
        "evaluate --data empty --models empty",
        "report --data empty",
        "study nothing",
        "export --onnx x.onnx --models empty",
        "reference --metrics empty",
    )
)


FAMILIES = (CommandLines("command lines", 260, _line, (), LINES_MADE),)
