"""Hostile furniture catalogues."""

from pathlib import Path

from tests.fixtures import catalogue as drawn
from tests.hostile.family import Family, Victim
from tests.hostile.made import case, pack, with_file, with_link
from tests.hostile.mutations import LONG, damaged_bytes, damaged_text
from tests.hostile.project_files.base import write_params


def _catalogue(folder: Path) -> None:
    properties, members = drawn.catalogue()
    write_params(folder, assets={"enabled": True, "folder": "library"}, farm={"workers": 1})
    (folder / "library").mkdir()
    for name, data in {"PluginFurnitureCatalog.properties": properties, **members}.items():
        path = folder / "members" / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(data if isinstance(data, bytes) else data.encode("latin-1"))
    _catalogue_packed(folder)


def _catalogue_packed(folder: Path) -> None:
    pack(folder / "members", folder / "library/a.sh3f")


ASSETS = "assets --data data --workers 1"

PROPERTIES = "members/PluginFurnitureCatalog.properties"


@case
def _properties(folder: Path, text: str) -> str:
    (folder / PROPERTIES).write_text(text, encoding="latin-1", errors="replace")
    _catalogue_packed(folder)
    return ASSETS


CATALOGUES_MADE = (
    _properties(""),
    _properties("=" * 1000),
    _properties("a\\\n" * 100_000),
    _properties("id=\\u\nname=\\uZZZZ\n"),
    _properties("id#1=x\nname#1=" + "x" * 10**6),
    _properties(f"id#{LONG}=x\nname#{LONG}=y\n"),
    _properties("name#1=a\nmodel#1=/../../x\n"),
    with_link("library/a.sh3f", "a.sh3f", ASSETS),
    with_link("library/a.sh3f", "/dev/zero", ASSETS),
    with_file("library/a.sh3f", b"PK\x05\x06" + bytes(18), ASSETS),
    with_file("library/a.sh3f", b"PK" * 500, ASSETS),
)


FAMILIES = (
    Family(
        "catalogues",
        60,
        _catalogue,
        (
            Victim(PROPERTIES, damaged_text, (ASSETS,)),
            Victim("members/models/table.obj", damaged_text, (ASSETS,)),
            Victim("library/a.sh3f", damaged_bytes, (ASSETS,)),
        ),
        CATALOGUES_MADE,
        _catalogue_packed,
        seconds=5.0,
    ),
)
