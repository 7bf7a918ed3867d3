"""Hostile calibration files of cameras, which parameters name."""

from pathlib import Path

from tests.hostile.family import Family, Made, Victim
from tests.hostile.made import entities, with_file, with_link
from tests.hostile.mutations import damaged_json, damaged_text, deep
from tests.hostile.project_files.base import write_ledger, write_params
from tests.hostile.project_files.params import damaged_yaml
from tests.pipeline.lenses.test_calibration import FILES

_NAMES = ("a.yaml", "a.xml", "camchain.yaml", "transforms.json")
_READ = {name: f"cost --data data --params for-{name}.params.yaml" for name in _NAMES}


def _write(folder: Path) -> None:
    write_ledger(folder)
    for name in _NAMES:
        (folder / name).write_text(FILES[name])
        image = {"width": 320, "height": 240, "lens": {"calibration": name}}
        write_params(folder, image=image)
        (folder / "params.yaml").rename(folder / f"for-{name}.params.yaml")
    write_params(folder)


def _yaml(text: str) -> Made:
    return with_file("a.yaml", text, _READ["a.yaml"])


_ALIASES = "a: &a [x, x, x, x, x, x, x, x, x]\n" + "".join(
    f"{b}: &{b} [{', '.join([f'*{a}'] * 9)}]\n" for a, b in zip("abcdefgh", "bcdefghi", strict=True)
)
_MATRIX = "camera_matrix: {data: [%s]}\ndistortion_coefficients: {data: [%s]}\n"
_SOUND = "300, 0, 160, 0, 300, 120, 0, 0, 1"

MADE = (
    _yaml(_ALIASES + "camera_matrix: *i\n"),
    _yaml("camera_matrix: " + deep(3000)),
    _yaml("%YAML:1.0\n---\n!!python/object/apply:os.system ['true']\n"),
    _yaml("camera_matrix: !!opencv-matrix [1]\n"),
    _yaml("camera_matrix: !!opencv-matrix {? [a] : b}\n"),
    _yaml(_MATRIX % (_SOUND, "1e308, -1e308, 0, 0")),
    _yaml(_MATRIX % (_SOUND, "-1e4, 1e4, -1e4, 1e4, 1e4, -1e4, -1e4, -1e4")),
    _yaml(_MATRIX % ("1e308, 0, 160, 0, 1e-308, 120, 0, 0, 1", "0, 0, 0, 0")),
    _yaml(_MATRIX % ("-300, 0, 160, 0, 300, 120, 0, 0, 1", "0, 0, 0, 0")),
    _yaml("image_width: 1e300\nimage_height: 1\n" + _MATRIX % (_SOUND, "")),
    _yaml("cam0: &a {camera_model: *a}\n"),
    _yaml("cam0: {camera_model: pinhole, distortion_model: [radtan], intrinsics: 3}\n"),
    *(
        with_file("a.xml", entities(kind) + "<x>&i;</x>", _READ["a.xml"])
        for kind in ("bomb", "file", "net")
    ),
    with_file("a.xml", "<a>" * 50_000, _READ["a.xml"]),
    with_file("transforms.json", '{"frames": ' + deep(5000) + "}", _READ["transforms.json"]),
    with_file("transforms.json", '{"frames": [1, {"fl_x": true}]}', _READ["transforms.json"]),
    with_link("a.yaml", "a.yaml", _READ["a.yaml"]),
    with_link("a.yaml", "/dev/zero", _READ["a.yaml"]),
)


FAMILIES = (
    Family(
        "calibrations",
        160,
        _write,
        (
            Victim("a.yaml", damaged_text, (_READ["a.yaml"],)),
            Victim("a.xml", damaged_text, (_READ["a.xml"],)),
            Victim("camchain.yaml", damaged_yaml, (_READ["camchain.yaml"],)),
            Victim("transforms.json", damaged_json, (_READ["transforms.json"],)),
        ),
        MADE,
        seconds=0.1,
    ),
)
