"""Base classes of import options: each scene source describes its options as a frozen dataclass.

The fields of such a dataclass become keyword arguments of `import_scene`, options of
`pbrnet import` and keys of `scenes.imports`. Modules of options import no importer, so that
parameters load fast: a source names its importer as "module:function".
"""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, ClassVar, Literal

from pbrnet.scenes.checked import within

FILE = "FILE"  # metavar of options that are paths of files, not of folders
_SWITCHED = "Sweet Home 3D homes"  # files whose lamps can be all on or all off


def described(text: str, metavar: str | None = None, **checks: Any) -> dict[str, Any]:
    """Field metadata: the help text of `pbrnet import`, and `checks` as of `within`."""
    return {"help": text, "metavar": metavar, **checks}


@dataclass(frozen=True, kw_only=True)
class SourceOptions:
    """Options that every source takes; a source adds its own in a subclass."""

    title: ClassVar[str]  # of the source, for headings
    suffixes: ClassVar[tuple[str, ...]]  # of its files, lower case
    importer: ClassVar[str]  # "module:function", see `registry.Importer`
    can_switch_lamps: ClassVar[bool] = False  # whether lamps can be all on or all off
    # "unlit" for files whose units of light are arbitrary: a lamp beside theirs may be far too
    # bright or faint
    auto_lamps: ClassVar[Literal["auto", "unlit"]] = "auto"

    licence: str = field(
        default="", metadata=described("Licence, such as CC-BY-4.0, if no file states it.")
    )
    author: str = field(default="", metadata=described("Author, if no file states it."))
    lamps: Literal["auto", "home", "on", "off", "fill"] = field(
        default="auto",
        metadata=described(
            "home: lamps of the file; fill: plus a plain ceiling lamp in every room without light; "
            "auto: plus lamps in closed rooms without light, for Mitsuba and PBRT only if no room "
            "has light. Sweet Home 3D only: all on, or all off."
        ),
    )

    @property
    def lamp_rule(self) -> Literal["auto", "home", "on", "off", "fill", "unlit"]:
        """`lamps`, where "auto" is "unlit" if lamps are added only where no room has light."""
        return self.auto_lamps if self.lamps == "auto" else self.lamps

    def verify(self, where: str) -> None:
        """Check values beyond their types; raises ValueError that begins with `where`."""
        if self.lamps in ("on", "off") and not self.can_switch_lamps:
            raise ValueError(
                f"{where}.lamps: {self.lamps!r} is for {_SWITCHED}; others take 'auto', 'home' or "
                "'fill'"
            )


@dataclass(frozen=True, kw_only=True)
class FreeAxesOptions(SourceOptions):
    """Options of sources whose files state no unit, no up axis and open other files."""

    scale: float | None = field(
        default=None,
        metadata=described(
            "Metres per unit of the file; estimated by default.", **within(1e-6, 1e6)
        ),
    )
    up: Literal["auto", "x", "y", "z"] = field(
        default="auto", metadata=described("Axis that points up in the file.")
    )
    root: Path | None = field(
        default=None,
        metadata=described("Parent folder of the file in which the import may open files."),
    )
    sky: bool = field(
        default=False,
        metadata=described(
            "Add sun and sky to a scene without any, for rooms that are otherwise too dark."
        ),
    )
