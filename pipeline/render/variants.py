"""Variants of the renderer that work on this machine, and its graphics cards.

Whether a card can render is known only once it has traced a ray: CUDA may work where OptiX, the
part of the driver that traces rays, is missing, as in most container images. So a child process
traces one triangle, once in a process tree: children find the answer in the environment. Where
there is no CUDA driver no process is started. `python -m pbrnet.pipeline.render.variants` is that
child.
"""

from __future__ import annotations

import ctypes
import json
import os
import subprocess
import sys
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from functools import cache
from typing import Any

import drjit as dr
import mitsuba as mi

from pbrnet.pipeline.farm.settings import VISIBLE_CARDS, Variant
from pbrnet.pipeline.terminal import say
from pbrnet.scenes.errors import MachineError, in_one_line

PREFERRED: tuple[Variant, ...] = ("cuda_ad_rgb", "llvm_ad_rgb", "scalar_rgb")
PROBED = "PBRNET_CARDS"  # the environment variable with the answer of an earlier process
_PATIENCE = 120.0  # seconds: a first kernel takes some ten, more on a busy machine
_NO_DEVICE = 100  # of cuInit
_MISMATCH = 803
_OPTIX = (
    "OptiX (libnvoptix.so.1) is missing: install the driver's graphics libraries (Debian: "
    "libnvoptix1; Ubuntu: libnvidia-gl of the driver's version); start a container with "
    "NVIDIA_DRIVER_CAPABILITIES=graphics,compute,utility; or set DRJIT_LIBOPTIX_PATH"
)

_SCALAR_WARNING = (
    "pbrnet: no usable libLLVM was found, so everything is rendered by the scalar_rgb variant: "
    "the same images, several times slower. To get it: apt-get install libllvm15, or set "
    "DRJIT_LIBLLVM_PATH to a libLLVM.so of version 15 or later."
)


@dataclass(frozen=True)
class Cards:
    """Graphics cards of this machine: bytes of memory and names of those that are visible.

    `problem` is why they cannot render, with the remedy; empty if they can, or if there are none.
    """

    memory: tuple[int, ...] = ()
    names: tuple[str, ...] = ()
    problem: str = ""

    @property
    def usable(self) -> bool:
        """True if a GPU can render."""
        return bool(self.memory) and not self.problem


def cards() -> Cards:
    """Return the graphics cards, from the environment or by tracing a triangle in a child."""
    driver = driver_version()
    if not driver or os.environ.get(VISIBLE_CARDS) == "":
        return Cards()
    asked = f"{os.uname().nodename} {driver}"
    known = _known(os.environ, asked)
    if known is None:
        known = _probed()
        os.environ[PROBED] = json.dumps({"asked": asked, **asdict(known)})
    return known


def on_card() -> bool:
    """Return whether this process renders on a card."""
    return str(mi.variant()).startswith("cuda")


def card_ids() -> tuple[str, ...]:
    """Return the names of the usable cards for `CUDA_VISIBLE_DEVICES`."""
    given = os.environ.get(VISIBLE_CARDS)
    count = len(cards().memory) if cards().usable else 0
    return tuple(given.split(",")[:count] if given else map(str, range(count)))


def driver_version() -> str:
    """Return the version of CUDA that the driver supports, as "12040"; empty without a driver."""
    for name in (os.environ.get("DRJIT_LIBCUDA_PATH"), "libcuda.so.1", "libcuda.so"):
        if name:
            try:
                library = ctypes.CDLL(name)
            except OSError:
                continue
            version = ctypes.c_int()
            if hasattr(library, "cuDriverGetVersion"):
                library.cuDriverGetVersion(ctypes.byref(version))
            return str(version.value)
    return ""


def choose(requested: Variant = "auto") -> Variant:
    """Return the variant to render with on this machine.

    For "auto", a line on standard error says why a card or LLVM is not used. Raises `MachineError`
    if another one is requested that does not work here.
    """
    if requested != "auto":
        require(requested)
        return requested
    chosen = best_variant()
    if problem := cards().problem:
        _say(f"pbrnet: {chosen} renders, not the card: {problem}")
    if chosen == "scalar_rgb":
        _say(_SCALAR_WARNING)
    return chosen


@cache
def _say(line: str) -> None:
    """Print a line on standard error, once in a process."""
    say(line, err=True)


def accepted(requested: Variant = "auto") -> tuple[Variant, ...]:
    """Return the variants whose frames hold, the best on this machine first.

    With "auto" each worker takes its own, and the command's machine may be the one without a card.
    Scalar workers cannot make frames of light, so they are for commands that have nothing else.
    """
    if requested != "auto":
        return (requested,)
    own = best_variant()
    return (own, *(variant for variant in PREFERRED[:2] if variant != own))


def best_variant() -> Variant:
    """Return the first of `PREFERRED` that works on this machine."""
    return next(variant for variant in PREFERRED if works(variant))


def works(variant: str) -> bool:
    """Return whether a variant can render on this machine."""
    if variant not in mi.variants():
        return False
    if variant.startswith("cuda"):
        return cards().usable
    return variant.startswith("scalar") or bool(dr.has_backend(dr.JitBackend.LLVM))


def require(variant: str) -> None:
    """Raise `MachineError`, with the remedy, unless a variant works on this machine."""
    if not works(variant):
        raise MachineError(f"the variant {variant} cannot run here: {_remedy(variant)}")


def _remedy(variant: str) -> str:
    if variant not in mi.variants():
        return f"Mitsuba was built without it (it has {', '.join(mi.variants())})"
    if variant.startswith("cuda"):
        return cards().problem or "no CUDA device was found; use llvm_ad_rgb or auto"
    path = os.environ.get("DRJIT_LIBLLVM_PATH")
    tried = f" (DRJIT_LIBLLVM_PATH is {path})" if path else ""
    return f"libLLVM did not load{tried}; apt-get install libllvm15, or use scalar_rgb or auto"


def _known(environment: Mapping[str, str], asked: str) -> Cards | None:
    """Return the answer of an earlier process of this machine and driver."""
    try:
        answer = json.loads(environment[PROBED])
        if answer.pop("asked") != asked:
            return None
        return Cards(tuple(answer["memory"]), tuple(answer["names"]), str(answer["problem"]))
    except (KeyError, TypeError, ValueError, AttributeError):
        return None


def _probed() -> Cards:
    """Run this module in a child, which may crash or hang with a broken driver."""
    command = [sys.executable, "-m", __name__]
    try:
        done = subprocess.run(command, capture_output=True, text=True, timeout=_PATIENCE)
        answer = json.loads(done.stdout.splitlines()[-1])
        return Cards(tuple(answer["memory"]), tuple(answer["names"]), answer["problem"])
    except subprocess.TimeoutExpired:
        return Cards(problem=f"the driver did not trace a triangle within {_PATIENCE:.0f} s")
    except (IndexError, KeyError, ValueError):
        said = done.stderr.strip().splitlines()
        return Cards(problem=f"the driver failed ({said[-1] if said else done.returncode})")


def _examined() -> Cards:
    """Return the graphics cards as the CUDA driver and a traced triangle have them."""
    try:
        found = _devices()
    except (OSError, RuntimeError, AttributeError) as error:
        return Cards(problem=in_one_line(error))
    if not found.memory:
        return found
    problem = ""
    try:
        ctypes.CDLL(os.environ.get("DRJIT_LIBOPTIX_PATH") or "libnvoptix.so.1")
        mi.set_variant("cuda_ad_rgb")
        distance = trace_triangle()
        if abs(distance - 2) > 1e-3:
            problem = f"the driver traced a triangle wrongly, at {distance:g} m instead of 2"
    except OSError:
        problem = _OPTIX
    except (ImportError, RuntimeError) as error:
        problem = in_one_line(error)
    return Cards(found.memory, found.names, problem)


def _devices() -> Cards:
    """Ask the CUDA driver for its devices; raises RuntimeError with its number of an error."""
    cuda: Any = ctypes.CDLL(os.environ.get("DRJIT_LIBCUDA_PATH") or "libcuda.so.1")
    code = cuda.cuInit(0)
    if code == _NO_DEVICE:
        return Cards()
    if code:
        also = (
            ": the driver's libraries and the kernel's module differ" if code == _MISMATCH else ""
        )
        raise RuntimeError(f"the CUDA driver does not start (error {code}{also})")
    count, device = ctypes.c_int(), ctypes.c_int()
    cuda.cuDeviceGetCount(ctypes.byref(count))
    memory, names = [], []
    for number in range(count.value):
        size, name = ctypes.c_size_t(), ctypes.create_string_buffer(256)
        cuda.cuDeviceGet(ctypes.byref(device), number)
        cuda.cuDeviceTotalMem_v2(ctypes.byref(size), device)
        cuda.cuDeviceGetName(name, len(name), device)
        memory.append(size.value)
        names.append(name.value.decode(errors="replace"))
    return Cards(tuple(memory), tuple(names))


def trace_triangle() -> float:
    """Return the distance to a triangle 2 m away, with the current variant."""
    triangle = mi.Mesh("triangle", 3, 1)
    parameters = mi.traverse(triangle)
    parameters["vertex_positions"] = [-1.0, -1.0, 0.0, 1.0, -1.0, 0.0, 0.0, 1.0, 0.0]
    parameters["faces"] = [0, 1, 2]
    parameters.update()
    scene = mi.load_dict({"type": "scene", "triangle": triangle})
    ray = mi.Ray3f(mi.Point3f(0, 0, 2), mi.Vector3f(0, 0, -1))
    return float(scene.ray_intersect_preliminary(ray).t[0])


if __name__ == "__main__":
    print(json.dumps(asdict(_examined())))
