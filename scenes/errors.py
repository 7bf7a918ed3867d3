"""Exceptions with a message for the user: the problem, its place and a remedy."""

from __future__ import annotations


class PbrnetError(Exception):
    """A failure the user can act on; the command line prints its text, not a traceback.

    The arguments are the lines of the text, nearly always one: names in it that hold line breaks
    begin no further line. Subclasses set `exit_code`, which the command line returns:
    1 some of the work failed, 2 bad usage or parameters, 3 bad input file, 4 the machine
    lacks something (disk space, a library, weights).
    """

    exit_code = 1

    def __str__(self) -> str:
        return "\n".join(map(str, self.args))


def in_one_line(error: Exception, most: int | None = None) -> str:
    """Return the text of an error in one line of at most `most` characters, or its type's name."""
    return " ".join(str(error).split())[:most] or type(error).__name__


class ParameterError(PbrnetError):
    """A parameter is unknown, of the wrong type or impossible."""

    exit_code = 2


class InputError(PbrnetError):
    """An input file cannot be used: damaged, missing, hostile or of an unknown kind."""

    exit_code = 3


class MachineError(PbrnetError):
    """The machine lacks what the work needs: disk space, a library, weights."""

    exit_code = 4
