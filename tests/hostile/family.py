"""A family of hostile inputs: files, the command line that reads them, and their number."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from random import Random

from tests.hostile.mutations import Damage, damage_file

STAND_IN = "stand-in"  # program of a case that the importer may run
Arguments = list[str]  # of pbrnet; paths are relative to the case's folder
Base = Callable[[Path], object]  # writes sound files into a folder
Made = Callable[[Path], Arguments]  # writes files made by hand and returns the command line


@dataclass(frozen=True)
class Victim:
    """A file of a family's base, the damage that suits it, and command lines that read it."""

    path: str
    damage: Damage
    commands: tuple[str, ...]  # split at blanks; one is drawn for each case


@dataclass(frozen=True)
class Family:
    """Inputs of one kind: first those made by hand, then random damage to sound files.

    Damaged files may follow from the victims by `after`, which packs what was damaged.
    """

    name: str
    cases: int
    base: Base
    victims: Sequence[Victim] = ()
    made: Sequence[Made] = ()
    after: Callable[[Path], object] | None = None
    ends_early: tuple[str, ...] = ()  # commands that lack something after they have read the files
    costly: frozenset[int] = frozenset()  # cases that take many seconds: in `make check` only
    seconds: float = 0.3  # of a core, about, for one case: expensive ones are in `make check` only

    @property
    def sound(self) -> tuple[str, ...]:
        """Command lines that succeed on undamaged files."""
        lines = dict.fromkeys(line for victim in self.victims for line in victim.commands)
        return tuple(line for line in lines if line not in self.ends_early)

    def write(self, folder: Path, rng: Random, number: int) -> Arguments:
        """Write a case into a folder that holds the base; returns its command line.

        Negative numbers are the command lines of `sound`, on undamaged files.
        """
        if number < 0:
            return self.sound[-1 - number].split()
        if number < len(self.made):
            return self.made[number](folder)
        victim = rng.choice(list(self.victims))
        damage_file(folder / victim.path, victim.damage, rng)
        if self.after:
            self.after(folder)
        return rng.choice(victim.commands).split()
