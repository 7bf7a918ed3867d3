"""The `pbrnet` command: a click group whose commands are imported on use."""

from __future__ import annotations

import importlib
import io
import os
import sys
import tempfile
import traceback
from itertools import accumulate
from typing import Any

import click

from pbrnet.pipeline.terminal import present, quiet_libraries, say
from pbrnet.scenes.errors import MachineError, PbrnetError

UNEXPECTED = 70  # exit code of a fault of pbrnet, as in sysexits.h
_LONG_LINE, _LONG_MESSAGE = 1000, 3500  # characters; a hostile file may put any number into one


def _of(module: str, **lines: str) -> dict[str, tuple[str, str]]:
    """Return the commands that a module below `pbrnet` defines: definition, and line of help."""
    return {
        name.removesuffix("_command").replace("_", "-"): (f"pbrnet.{module}:{name}", line)
        for name, line in lines.items()
    }


# Command: its definition and its line in `pbrnet --help`, which then imports no command.
GROUPS: dict[str, dict[str, tuple[str, str]]] = {
    "Project": _of(
        "pipeline.commands.project",
        init="Turn a folder into a project: parameters, stages, DVC.",
        preset="Write a parameter preset to params.yaml.",
        params="Print the effective parameters and their meaning.",
    ),
    "Stages, in the order of dvc.yaml": {
        **_of(
            "pipeline.commands.stages",
            assets="Fetch and convert furniture catalogues (optional).",
            scenes="Generate procedural homes, import scenes.",
            cameras="Sample views that see much furniture.",
            inputs="Render depth, normals and reflectance.",
            illumination="Render panoramas of the visible light sources.",
            groundtruth="Path-trace shading and colour of every view.",
            dataset="Check the frames and pack them into Parquet.",
        ),
        **_of(
            "model.commands.networks",
            backbone="Get the pretrained features of the perceptual loss.",
            train="Train a network or a baseline.",
            evaluate="Evaluate the networks on the test scenes.",
        ),
        **_of("model.commands.report", report="Write a self-contained HTML report."),
    },
    "All stages at once": _of(
        "pipeline.commands.stages",
        run="Run the stages from assets to the dataset on any data folder.",
    ),
    "Halves of groundtruth": _of(
        "pipeline.commands.stages",
        shading="Path-trace textureless shading only.",
        color="Path-trace colour only.",
    ),
    "Tools": {
        **_of("pipeline.commands.import_scene", import_command="Import one scene file."),
        **_of("pipeline.commands.inspect", inspect="Describe a file and draw it."),
        **_of("model.studies.commands", study="Run the studies of the paper."),
        **_of("model.commands.predict", predict="Render images with the trained networks."),
        **_of(
            "model.commands.depth",
            depth="Estimate depth, normals and classes of photographs.",
        ),
        **_of("model.commands.serve", serve="Show a scene in the browser, with a camera to move."),
        **_of(
            "model.commands.score",
            score="Score images of a list of views against the ground truth.",
        ),
        **_of(
            "model.commands.networks",
            pretrained="Pack trained networks for distribution.",
            reference="Save a run's metrics and images as reference.",
            export="Export the networks to ONNX.",
        ),
        **_of(
            "pipeline.commands.release",
            release="Make a dataset from a recipe and compare its checksums.",
        ),
        **_of(
            "pipeline.commands.export_data",
            export_data="Write the dataset in a format of another project.",
        ),
        **_of(
            "pipeline.commands.export_scene",
            export_scene_command="Write a scene as GLB, USD or archive, for other programs.",
        ),
        **_of("pipeline.commands.cost", cost="Forecast the core-hours of a run."),
        **_of("model.commands.doctor", doctor="Report what this machine has and lacks."),
    },
}
COMMANDS = {name: entry for group in GROUPS.values() for name, entry in group.items()}


class LazyGroup(click.Group):
    """Group whose commands are imported on use and listed by topic."""

    def list_commands(self, context: click.Context) -> list[str]:
        """Return all command names, in the order of `GROUPS`."""
        return list(COMMANDS)

    def get_command(self, context: click.Context, name: str) -> click.Command | None:
        """Import and return a command, or None if there is none of this name."""
        if name not in COMMANDS:
            return None
        module, attribute = COMMANDS[name][0].split(":")
        command: click.Command = getattr(importlib.import_module(module), attribute)
        return command

    def resolve_command(
        self, context: click.Context, words: list[str]
    ) -> tuple[str | None, click.Command | None, list[str]]:
        """Find a command and its arguments, whose old names are replaced by the present ones."""
        command, *options = words
        command = present(f"pbrnet {command}").removeprefix("pbrnet ")
        for number, word in enumerate(options):
            name, equals, value = word.partition("=")
            name = present(f"pbrnet {command} {name}").removeprefix(f"pbrnet {command} ")
            options[number] = name + equals + value
        return super().resolve_command(context, [command, *options])

    def format_commands(self, context: click.Context, formatter: click.HelpFormatter) -> None:
        """List the commands by topic without importing them."""
        for title, group in GROUPS.items():
            with formatter.section(title):
                formatter.write_dl([(name, line) for name, (_, line) in group.items()])


@click.group(
    cls=LazyGroup,
    context_settings={
        "help_option_names": ["-h", "--help"],
        "max_content_width": 100,
        "show_default": True,
    },
    epilog="""\b
Examples:
  pbrnet init rooms                       a new project, with the quick start's parameters
  dvc repro                               run the stages that are out of date
  pbrnet groundtruth --workers 8          run one stage
  pbrnet run --params P.yaml --data D     run all stages up to the dataset in another folder
  pbrnet import room.xml --out data/scenes/room
  pbrnet inspect data/dataset

Exit codes: 0 success, 1 some scenes or views failed, 2 wrong usage or parameters, 3 bad input
file, 4 the machine lacks something, 70 a fault of pbrnet, 130 interrupted.
Shell completion: eval "$(_PBRNET_COMPLETE=bash_source pbrnet)" (or zsh_source, fish_source).""",
)
@click.version_option(package_name="pbrnet")
def cli() -> None:
    """Render indoor training data by path tracing, and train networks that imitate the renderer."""


def main(arguments: list[str] | None = None) -> Any:
    """Run the command line; turn every failure into a message and an exit code."""
    if isinstance(sys.stdout, io.TextIOWrapper):  # names of files may not be text
        sys.stdout.reconfigure(errors="backslashreplace")
    with quiet_libraries():
        sys.exit(_status(arguments))


def _status(arguments: list[str] | None) -> int:
    """Run a command and return its exit code."""
    try:
        status = cli.main(args=arguments, prog_name="pbrnet", standalone_mode=False)
    except click.ClickException as error:
        if isinstance(error, click.UsageError) and error.ctx is not None:
            say(*error.ctx.get_usage().split("\n"), err=True)
        message = error.format_message()
        if isinstance(error, click.MissingParameter):  # click lists choices line by line
            message = " ".join(message.split())
        return _failed(error.exit_code, message)
    except (KeyboardInterrupt, click.Abort):
        say(
            "",
            "Interrupted. Finished files are kept; run the same command again to resume.",
            err=True,
        )
        return 130
    except BrokenPipeError:
        # The reader of the output has gone; keep the interpreter from reporting it at exit.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 1
    except PbrnetError as error:
        return _failed(error.exit_code, *error.args)
    except MemoryError:
        return _failed(MachineError.exit_code, "this requires more memory than is available")
    except OSError as error:
        reason = os.strerror(error.errno) if error.errno else str(error)
        return _failed(MachineError.exit_code, f"{_shortened(error.filename or 'file')}: {reason}")
    except Exception as error:
        if os.environ.get("PBRNET_DEBUG"):
            raise
        return _failed(UNEXPECTED, *unexpected(error))
    return status if isinstance(status, int) else 0


def _failed(code: int, *lines: object) -> int:
    """Print an error, shortened, and return its exit code."""
    shown = list(map(_shortened, lines))
    length = list(accumulate(map(len, shown)))
    kept = [line for line, end in zip(shown, length, strict=True) if end <= _LONG_MESSAGE]
    say(f"Error: {kept[0]}", *kept[1:], *(["..."] if len(kept) < len(shown) else []), err=True)
    return code


def _shortened(line: object) -> str:
    """Leave the middle of a long line out."""
    text = str(line)
    return text if len(text) <= _LONG_LINE else f"{text[: _LONG_LINE - 300]} ... {text[-250:]}"


def unexpected(error: Exception) -> list[str]:
    """Keep an unexpected error's traceback in a file; return lines that say where."""
    lines = str(error).strip().splitlines() or [""]
    message = f"unexpected {type(error).__name__}: {lines[0][:200]}".rstrip(": ")
    text = "".join(traceback.format_exception(error))
    try:
        with tempfile.NamedTemporaryFile(
            "w", prefix="pbrnet-error-", suffix=".log", encoding="utf-8", errors="replace",
            delete=False,
        ) as file:  # fmt: skip
            file.write(f"{sys.argv}\n{text}")
    except OSError as failure:
        return [f"{message} (details could not be written: {failure.strerror})"]
    return [message, f"This is a fault of pbrnet. Details to report: {file.name}"]


if __name__ == "__main__":
    main()
