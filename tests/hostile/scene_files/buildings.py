"""Hostile COLLADA, 3DS, USD and IFC files; those of optional libraries only where these are."""

import zipfile
from importlib.util import find_spec
from pathlib import Path

from tests.fixtures import model_file as models
from tests.fixtures import usd
from tests.fixtures.encoded import zipped
from tests.fixtures.ifc import house
from tests.hostile.family import Arguments, Family, Victim
from tests.hostile.mutations import damaged_bytes, damaged_text

DAE, MAX, USD, USDZ, IFC = (
    f"import {name} --out out" for name in ("a.dae", "a.3ds", "a.usda", "a.usdz", "a.ifc")
)
STAGE = usd.stage(usd.SHELL, usd.PAINT)


def _models(folder: Path) -> None:
    (folder / "a.dae").write_text(models.dae(geometries=models.box(models.POINTS * [2.5, 2.6, 1])))
    (folder / "a.3ds").write_bytes(models.file_3ds())


def _stage(folder: Path) -> None:
    (folder / "a.usda").write_text(STAGE)
    _package(folder, {"a.usda": STAGE})


def _house(folder: Path) -> None:
    (folder / "a.ifc").write_text(house().text)


def _package(folder: Path, members: dict[str, str], compression: int = zipfile.ZIP_STORED) -> None:
    (folder / "a.usdz").write_bytes(zipped(members, compression))


def _cycle(folder: Path) -> Arguments:
    world = 'def "x" (references = @./a.usda@)\n{\n}'
    (folder / "a.usda").write_text(usd.stage(world))
    return USD.split()


def _outside(folder: Path) -> Arguments:
    (folder / "a.usda").write_text(usd.stage('def "x" (payload = @/dev/zero@)\n{\n}'))
    return USD.split()


def _many_instances(folder: Path) -> Arguments:
    """Instancers of instancers: 200^4 boxes."""
    inside = usd.box("box", [0, 0, 0], [1, 1, 1])
    for level in range(4):
        inside = f"""
def PointInstancer "i{level}"
{{
    rel prototypes = <{"/World" + "".join(f"/i{k}/p" for k in range(3, level, -1))}/i{level}/p>
    int[] protoIndices = {[0] * 200}
    point3f[] positions = {usd.points([[2 * k, 0, 0] for k in range(200)])}
    def Xform "p"
    {{
        {inside}
    }}
}}
"""
    (folder / "a.usda").write_text(usd.stage(inside))
    return USD.split()


def _bomb(folder: Path) -> Arguments:
    _package(folder, {"a.usda": STAGE, "t.png": "0" * 2**27}, zipfile.ZIP_DEFLATED)
    return USDZ.split()


def _leads_out(folder: Path) -> Arguments:
    _package(folder, {"a.usda": STAGE, "../../out.txt": "no"})
    return USDZ.split()


_FAMILIES = [
    Family(
        "collada",
        60,
        _models,
        (Victim("a.dae", damaged_text, (DAE,)), Victim("a.3ds", damaged_bytes, (MAX,))),
        seconds=1.0,
    ),
]
if find_spec("pxr"):
    _FAMILIES.append(
        Family(
            "usd",
            60,
            _stage,
            (Victim("a.usda", damaged_text, (USD,)), Victim("a.usdz", damaged_bytes, (USDZ,))),
            (_cycle, _outside, _many_instances, _bomb, _leads_out),
            seconds=2.0,
        )
    )
if find_spec("ifcopenshell"):
    _FAMILIES.append(
        Family("ifc", 40, _house, (Victim("a.ifc", damaged_text, (IFC,)),), seconds=3.0)
    )
FAMILIES = tuple(_FAMILIES)
