"""Kernels are compiled for the materials that calls meet, and for nothing of one scene alone."""

from pathlib import Path

import drjit as dr
import mitsuba as mi
import pytest

from pbrnet.pipeline.passes.groundtruth import render_both
from pbrnet.pipeline.render import bsdf_calls
from pbrnet.pipeline.render.drjit_arrays import registry_id
from pbrnet.pipeline.render.scene import RenderScene, free_memory, open_scene
from tests.fixtures.joint import own_and_neutral
from tests.fixtures.params import plain_truth
from tests.fixtures.render import ball, glow, make_view, room_walls, write_scene

pytestmark = pytest.mark.usefixtures("wavefront")

VIEW = make_view((0, -1.8, 1.5), (0.2, 1, -0.1), size=(12, 9))
PARAMS = plain_truth(spp=4, block_spp=2, denoise="none")


def lacquer(color: float, roughness: float) -> str:
    """A two-sided material as those of procedural homes, without textures."""
    return (
        '<bsdf type="twosided"><bsdf type="principled">'
        f'<rgb name="base_color" value="{color}"/><float name="roughness" value="{roughness}"/>'
        "</bsdf></bsdf>"
    )


def room(folder: Path, roughness: list[float]) -> RenderScene:
    """A room with a ball of each roughness, and a lamp."""
    walls, _ = room_walls(lacquer(0.6, 0.8))
    balls = "".join(
        ball(f"ball-{place}", (place - 1, 1, 0.5), 0.3, lacquer(0.1 + 0.2 * place, each))
        for place, each in enumerate(roughness)
    )
    lamp = ball("lamp", (0, 0, 2.5), 0.1 + 0.01 * len(roughness), glow(4.0))
    return open_scene(write_scene(folder, walls + balls + lamp))


def largest_kernel(scene: RenderScene) -> str:
    """Render a view; return the hash of the largest kernel."""
    free_memory()  # materials of other tests would be compiled in
    with dr.scoped_set_flag(dr.JitFlag.KernelHistory):
        dr.kernel_history_clear()
        render_both(scene, VIEW, PARAMS, 0.5, 1)
        kernels = dr.kernel_history([dr.KernelType.JIT])
    return str(max(kernels, key=lambda kernel: kernel["operation_count"])["hash"])


def test_scenes_of_the_same_kinds_of_material_share_the_path_tracing_kernel(tmp_path: Path) -> None:
    one = largest_kernel(room(tmp_path / "one", [0.3]))
    other = largest_kernel(room(tmp_path / "other", [0.2, 0.7, 0.5]))
    assert one == other


def test_calls_meet_no_material_that_only_another_one_holds() -> None:
    held = mi.load_dict({"type": "principled"})
    outer = mi.load_dict({"type": "twosided", "bsdf": held})
    si = dr.zeros(mi.SurfaceInteraction3f)
    si.wi = mi.Vector3f(0, 0, 1)
    number = registry_id(held, mi.BSDFPtr)
    before = mi.Color3f(outer.eval(mi.BSDFContext(), si, si.wi))
    assert bsdf_calls.available()
    bsdf_calls.keep_from_calls(held)
    bsdf_calls.keep_from_calls(held)
    assert registry_id(mi.load_dict({"type": "diffuse"}), mi.BSDFPtr) == number
    assert dr.all(mi.Color3f(outer.eval(mi.BSDFContext(), si, si.wi)) == before, axis=None)


def test_materials_that_differ_in_numbers_alone_are_one_and_have_one_twin(tmp_path: Path) -> None:
    scene = room(tmp_path / "room", [0.3, 0.3, 0.4])
    twins = {own.ptr: neutral.ptr for own, neutral in own_and_neutral(scene, 0.5)}
    # Of walls and balls, and of the lamp.
    assert len(twins) == len(set(twins.values())) == 2
