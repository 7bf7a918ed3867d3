"""Hostile parameter files."""

from random import Random

import yaml

from tests.hostile.family import Family, Made, Victim
from tests.hostile.made import with_file, with_link
from tests.hostile.mutations import LONG, damaged_text, damaged_value, deep
from tests.hostile.project_files.base import write_ledger

PARAMS = ("cost --data data", "dataset --data data", "evaluate --data data --models data")


def damaged_yaml(data: bytes, rng: Random) -> bytes:
    """Exchange values anywhere in a YAML file."""
    content = damaged_value(yaml.safe_load(data), rng)
    return yaml.dump(content, allow_unicode=True).encode("utf-8", "surrogatepass")


def _yaml(text: str) -> Made:
    return with_file("params.yaml", text, PARAMS[0])


_ALIASES = "a: &a [x, x, x, x, x, x, x, x, x]\n" + "".join(
    f"{b}: &{b} [{', '.join([f'*{a}'] * 9)}]\n" for a, b in zip("abcdefgh", "bcdefghi", strict=True)
)


def _doubling(inside: str) -> str:
    """Mappings that hold the one before twice or more."""
    lines = [f"k{n}: &k{n} {{{inside.format(f'k{n - 1}')}}}\n" for n in range(1, 28)]
    return "k0: &k0 {x: 1}\n" + "".join(lines)


PARAMS_MADE = (
    _yaml(_ALIASES + "seed: *i\n"),
    _yaml(_ALIASES + "train: *i\n"),
    _yaml(_ALIASES + "scenes: {imports: *i}\n"),
    _yaml(_ALIASES + "*i : 1\n"),
    _yaml("seed: " + deep(3000)),
    _yaml("seed: " + deep()),
    _yaml(deep(5000, "{}")),
    _yaml("- " * 3000 + "x"),
    _yaml(f"seed: {LONG}\n"),
    _yaml("seed: " + "9" * 400),
    _yaml("image: {half_fov_x: " + "9" * 400 + "}\n"),
    _yaml("image: {width: 1" + "0" * 399 + "}\n"),
    *(
        _yaml(f"optics: {{{value}}}\n")
        for value in (
            *("f_number: -1", "f_number: .nan", "f_number: .inf", "f_number: 0.01"),
            *("focus_distance: -2", "focus_distance: 1.0e-9", "focus_distance: .nan"),
            *("blades: 1", "blades: 2.5", "sensor_width: 0", "frame_rate: 0"),
            *("exposure: -0.5", "exposure: 1.5", "exposure: .nan", "readout: 2", "readout: [0]"),
        )
    ),
    _yaml("{channels: [paper, light], optics: {f_number: 2}}\n"),
    _yaml("{image: {projection: orthographic}, optics: {f_number: 2}}\n"),
    _yaml("seed: &a [*a]\n"),
    _yaml("a: &a {b: *a}\n"),
    _yaml("!!python/object/apply:os.system ['true']\n"),
    _yaml("seed: !!binary aGk=\n"),
    _yaml("seed: 2001-01-01\n"),
    _yaml("seed: 9999-99-99 99:99:99\n"),
    _yaml("seed: !!set {a, b}\n"),
    _yaml("seed: 1:1:1:1\n"),
    _yaml("? [a, b]\n: 1\n"),
    _yaml("<<: [1, 2]\n"),
    _yaml("seed: \x00\n"),
    _yaml("\ufeffseed: 0\n"),
    _yaml("%YAML 9.9\n---\nseed: 0\n--- \nseed: 1\n"),
    _yaml("a" * 200_000 + ": 1\n"),
    _yaml("train: {baselines: [unet, unet]}\n"),
    _yaml("scenes: {imports: [{file: /dev/zero}, {file: x.sh3d, id: ../../x}]}\n"),
    _yaml("assets: {enabled: true, debian: ['--option=x']}\n"),
    _yaml("".join(f"k{n}: {n}\n" for n in range(20_000))),
    _yaml(_doubling("<<: [*{0}, *{0}]")),
    _yaml(_doubling("<<: *{0}, x: *{0}, y: *{0}")),
    _yaml(_doubling("x: *{0}, y: *{0}") + "scenes: *k27\n"),
    _yaml("seed: " + "1:" * 300_000 + "1\n"),
    _yaml("seed: " + "1:" * 400 + "1.5\n"),
    *(
        _yaml(f"seed: {value}\n")
        for value in (
            *("!!int ''", "!!int '+'", "!!int 0x", "!!float ''", "!!float x", "!!bool x"),
            *("!!timestamp x", "!!timestamp ''", "!!binary \u00e9", "!!omap [1]", "!!pairs [1]"),
            *(
                "!!set [1]",
                "!!null x",
                "!!merge x",
                "!!value x",
                "!!yaml x",
                "!x y",
                "!!python/tuple [1]",
            ),
        )
    ),
    with_link("params.yaml", "params.yaml", PARAMS[0]),
    with_link("params.yaml", "/dev/zero", PARAMS[0]),
)


FAMILIES = (
    Family(
        "params",
        220,
        write_ledger,
        (
            Victim("params.yaml", damaged_text, PARAMS[:2]),
            Victim("params.yaml", damaged_yaml, PARAMS),
        ),
        PARAMS_MADE,
        ends_early=PARAMS[1:],
        seconds=0.1,
    ),
)
