"""Random damage to files: bytes, text, JSON values, and things that are no regular file."""

import json
import os
import re
import struct
from collections.abc import Callable
from pathlib import Path
from random import Random
from typing import Any

LONG = "7" * 5000
# Where a number, a string or a value of any type stood.
NUMBERS = (
    "nan", "inf", "-inf", "-1", "0", "1e308", "-1e308", "1e-300", "99999999999", "2147483648",
    "-2147483649", "1e9", "0x10", "", "one", "1,5", "\u0661", "7" * 400, LONG, "1" * 400 + ".5",
)  # fmt: skip
TEXTS = (
    "", " ", "..", "../../outside", "/dev/zero", "/dev/stdin", "/proc/self/mem", "../" * 40 + "x",
    "C:\\x", "a\0b", "\ud800", "\U0001f600", "%s%n", "-rf", "--out", "A" * 70_000, "<a>&b;", "\n\n",
    "CON", ".", "~", "$HOME", "`id`", "{{7*7}}", "a/b", "\x1b[31m",
)  # fmt: skip


def deep(depth: int = 100_000, sign: str = "[]") -> str:
    """Lists in lists, as JSON and YAML write them."""
    return sign[0] * depth + sign[1] * depth


VALUES: tuple[Any, ...] = (
    None,
    True,
    False,
    -1,
    0,
    1,
    1e308,
    -1e308,
    1e-320,
    2**31,
    2**63,
    2**64,
    -(2**63),
    10**400,
    float("nan"),
    float("inf"),
    "",
    "x",
    "../../outside",
    "/dev/zero",
    "\ud800",
    "a\0b",
    [],
    {},
    [[]],
    [None],
    [1e308] * 3,
    [0.0] * 16,
    {"a": 1},
    [[1, 2], [3]],
    ["x"] * 3,
    "A" * 70_000,
)


def damaged_bytes(data: bytes, rng: Random) -> bytes:
    """Cut, flip, remove, repeat or overwrite some bytes."""
    if not data:
        return bytes(rng.randrange(256) for _ in range(rng.randrange(1, 64)))
    hurt = bytearray(data)
    at = rng.randrange(len(hurt))
    size = rng.randrange(1, 1 + max(1, len(hurt) // 4))
    way = rng.randrange(8)
    if way == 0:
        del hurt[at:]
    elif way == 1:
        for _ in range(rng.randrange(1, 24)):
            hurt[rng.randrange(len(hurt))] = rng.randrange(256)
    elif way == 2:
        word = rng.choice([0, 1, 0x7F, 0xFF, 0x7FFFFFFF, 0x80000000, 0xFFFFFFFF, 0x00010000])
        hurt[at : at + 4] = struct.pack(rng.choice("<>") + "I", word)
    elif way == 3:
        value = rng.choice([float("nan"), float("inf"), 1e308, -1e38, 1e-310, -1.0])
        hurt[at : at + 8] = struct.pack("<d", value)
    elif way == 4:
        del hurt[at : at + size]
    elif way == 5:
        hurt[at:at] = hurt[at : at + size] * rng.choice([1, 2, 50])
    elif way == 6:
        hurt[at : at + size] = bytes(size)
    else:
        hurt[at : at + size] = rng.randbytes(size)
    return bytes(hurt)


def damaged_text(data: bytes, rng: Random) -> bytes:
    """Exchange numbers or quoted texts, remove, repeat or swap lines or signs."""
    text = data.decode("utf-8", "replace")
    way = rng.randrange(8)
    if way <= 2:
        text = _exchanged(text, r"-?\d+(?:\.\d+)?(?:e-?\d+)?", NUMBERS, rng)
    elif way == 3:
        text = _exchanged(text, r"(?<=[\"'])[^\"'<>\n]*(?=[\"'])", TEXTS, rng)
    elif way == 4:
        text = _exchanged(text, r"[A-Za-z_]{2,}", ("", "x", "\u00e9\u4e2d", *TEXTS[:6]), rng)
    elif way == 5:
        lines = text.splitlines(keepends=True) or [""]
        at = rng.randrange(len(lines))
        lines[at : at + 1] = lines[at : at + 1] * rng.choice([0, 2, 3000])
        text = "".join(lines)
    elif way == 6:
        lines = text.splitlines(keepends=True)
        rng.shuffle(lines)
        text = "".join(lines)
    else:
        return damaged_bytes(data, rng)
    return text.encode("utf-8", "surrogatepass")


def _exchanged(text: str, pattern: str, others: tuple[str, ...], rng: Random) -> str:
    found = list(re.finditer(pattern, text))
    for match in sorted(
        rng.sample(found, min(len(found), rng.choice([1, 1, 1, 3]))), key=lambda one: -one.start()
    ):
        text = text[: match.start()] + rng.choice(others) + text[match.end() :]
    return text


def damaged_json(data: bytes, rng: Random) -> bytes:
    """Exchange, remove or repeat values anywhere in a JSON file."""
    if rng.random() < 0.15:
        return damaged_text(data, rng)
    try:
        content = damaged_value(json.loads(data), rng)
    except ValueError:
        return damaged_bytes(data, rng)
    return json.dumps(content).encode("utf-8", "surrogatepass")


def damaged_value(content: Any, rng: Random) -> Any:
    """The JSON value with one to three of its parts exchanged, removed or repeated."""
    for _ in range(rng.choice([1, 1, 2, 3])):
        places = list(_places(content))
        if not places:
            return rng.choice(VALUES)
        parent, key = rng.choice(places)
        way = rng.randrange(8)
        if way == 0:
            del parent[key]
        elif way == 1 and isinstance(parent, list):
            parent[key:key] = [parent[key]] * rng.choice([1, 2, 300])
        elif way == 2:
            parent[key] = [parent[key]]
        elif way == 3:
            parent[key] = {"a": parent[key]}
        elif way == 4 and isinstance(parent, dict):
            parent[rng.choice(TEXTS)] = parent.pop(key)
        else:
            parent[key] = rng.choice(VALUES)
    return content


def _places(content: Any) -> Any:
    pairs = (
        content.items()
        if isinstance(content, dict)
        else enumerate(content)
        if isinstance(content, list)
        else ()
    )
    for key, value in pairs:
        yield content, key
        yield from _places(value)


def odd_file(path: Path, rng: Random) -> None:
    """Put something at `path` that is no file of the expected kind: a pipe, a device, a loop."""
    path.unlink(missing_ok=True)
    way = rng.randrange(8)
    if way == 0:
        os.mkfifo(path)
    elif way == 1:
        path.symlink_to("/dev/zero")
    elif way == 2:
        path.symlink_to(path.name)
    elif way == 3:
        path.mkdir()
    elif way == 4:
        path.write_bytes(b"")
    elif way == 5:
        with path.open("wb") as stream:
            stream.truncate(8 * 2**30)  # a hole: no disk is used
    elif way == 6:
        path.symlink_to("/dev/full")
    else:
        path.write_bytes(rng.randbytes(3000))


Damage = Callable[[bytes, Random], bytes]


def damage_file(path: Path, damage: Damage, rng: Random, odd: float = 0.06) -> None:
    """Damage a file in place, or with the chance `odd` put something else there."""
    if rng.random() < odd:
        odd_file(path, rng)
    else:
        path.write_bytes(damage(path.read_bytes(), rng))
