"""Choice of the variant: a card counts once it has traced a ray, and none costs nothing."""

import json
import os
import shutil
import subprocess
import sys
from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path

import pytest

from pbrnet.model.commands.doctor import examine
from pbrnet.pipeline.render import variants
from pbrnet.pipeline.render.variants import PROBED, Cards, best_variant, cards, trace_triangle
from pbrnet.scenes.errors import MachineError

CARD = Cards((8 << 30,), ("Test card",))
NO_OPTIX = Cards(CARD.memory, CARD.names, "OptiX is missing")
# A CUDA driver without OptiX, as in most container images: it answers, and has one card.
DRIVER = """
int cuInit(unsigned flags) { return FAILS; }
int cuDriverGetVersion(int *version) { *version = 12040; return 0; }
int cuDeviceGetCount(int *count) { *count = 1; return 0; }
int cuDeviceGet(int *device, int number) { *device = number; return 0; }
int cuDeviceTotalMem_v2(unsigned long *bytes, int device) { *bytes = 8ul << 30; return 0; }
int cuDeviceGetName(char *name, int size, int device) { name[0] = 'T'; name[1] = 0; return 0; }
"""

Driver = Callable[[str], None]


@pytest.fixture
def driver(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Driver:
    """Install a stand-in for libcuda, whose cuInit returns a number, in this process's tree."""
    compiler = shutil.which("cc")
    if compiler is None:
        pytest.skip("there is no C compiler")

    def install(fails: str) -> None:
        source, library = tmp_path / "cuda.c", tmp_path / f"libcuda{fails}.so"
        source.write_text(DRIVER)
        options = ["-shared", "-fPIC", "-w", f"-DFAILS={fails}", "-o", str(library)]
        subprocess.run([compiler, str(source), *options], check=True)
        monkeypatch.setenv("DRJIT_LIBCUDA_PATH", str(library))
        monkeypatch.setenv("DRJIT_LIBOPTIX_PATH", str(tmp_path / "no-optix.so"))
        monkeypatch.setenv(PROBED, "")  # restored afterwards

    return install


def test_a_triangle_is_where_it_is(variant: str) -> None:
    if variant == "scalar_rgb":
        pytest.skip("a single ray has no array of distances")
    assert trace_triangle() == pytest.approx(2, abs=1e-5)


def test_without_a_driver_no_process_is_started(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(variants, "_probed", lambda: pytest.fail("a process was started"))
    monkeypatch.setattr(variants, "driver_version", lambda: "")
    assert cards() == Cards() and not cards().usable
    monkeypatch.setattr(variants, "driver_version", lambda: "12040")
    monkeypatch.setenv("CUDA_VISIBLE_DEVICES", "")  # switched off
    assert cards() == Cards()


@pytest.mark.parametrize(
    ("fails", "words"),
    [
        ("0", ("OptiX", "NVIDIA_DRIVER_CAPABILITIES=graphics,compute,utility")),
        ("803", ("error 803", "module differ")),
        ("100", ()),
    ],
)
def test_a_card_that_traces_no_ray_is_named_with_the_remedy(
    driver: Driver, fails: str, words: tuple[str, ...]
) -> None:
    driver(fails)
    problem = cards().problem
    assert all(word in problem for word in words) and bool(problem) == bool(words)
    assert not cards().usable and best_variant() != "cuda_ad_rgb"
    found = next(one for one in examine() if one.topic == "GPU")
    assert found.ok == (not words) and all(word in found.advice for word in words)
    if words:
        with pytest.raises(MachineError, match=words[0]):
            variants.require("cuda_ad_rgb")


def test_auto_takes_llvm_with_one_line_where_optix_is_missing(driver: Driver) -> None:
    driver("0")
    code = "from pbrnet.pipeline.render.scene import set_variant as s; print(s(), s())"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=200)
    assert done.stdout.split() == ["llvm_ad_rgb"] * 2, done.stderr
    said = [line for line in done.stderr.splitlines() if line.startswith("pbrnet: ")]
    assert len(said) == 1 and "llvm_ad_rgb renders, not the card: OptiX" in said[0]


def test_children_take_the_answer_of_their_machine_and_driver(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    probes: list[int] = []
    monkeypatch.setenv(PROBED, "")
    monkeypatch.setattr(variants, "driver_version", lambda: "12040")
    monkeypatch.setattr(variants, "_probed", lambda: probes.append(1) or CARD)  # type: ignore[func-returns-value]
    assert cards() == cards() == CARD and len(probes) == 1
    assert best_variant() == "cuda_ad_rgb"
    monkeypatch.setattr(variants, "driver_version", lambda: "12060")  # another driver
    assert cards() == CARD and len(probes) == 2
    for damaged in ("{", "[]", '{"asked": 1}', json.dumps(asdict(NO_OPTIX))):
        monkeypatch.setenv(PROBED, damaged)
        assert cards() == CARD
    assert len(probes) == 6
    answer = {"asked": f"{os.uname().nodename} 12060", **asdict(NO_OPTIX)}
    monkeypatch.setenv(PROBED, json.dumps(answer))
    assert cards() == NO_OPTIX and best_variant() != "cuda_ad_rgb"


@pytest.mark.parametrize("child", ["exit 9", "kill -9 $$", "echo {}", "echo far; echo >&2 lost"])
def test_a_child_that_crashes_is_a_problem_not_an_error(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, child: str
) -> None:
    program = tmp_path / "python"
    program.write_text(f"#!/bin/sh\n{child}\n")
    program.chmod(0o755)
    monkeypatch.setattr(sys, "executable", str(program))
    assert variants._probed().problem.startswith("the driver failed (")
