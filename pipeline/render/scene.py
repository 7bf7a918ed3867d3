"""Entry to the renderer: Mitsuba variant, scenes opened for rendering, rays.

Call `set_variant` in each thread that renders, before anything else here.
"""

from __future__ import annotations

import gc
from dataclasses import dataclass, replace
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np
import numpy.typing as npt
import psutil

from pbrnet.pipeline.farm.settings import Variant
from pbrnet.pipeline.keys import key
from pbrnet.pipeline.render import raycast, variants
from pbrnet.pipeline.render.boxes import ObjectBoxes
from pbrnet.pipeline.render.bsdf_calls import level_ids
from pbrnet.pipeline.render.drjit_arrays import bounds_of
from pbrnet.pipeline.render.lights import Lights, collect_lights
from pbrnet.pipeline.render.material_sets import MaterialSets
from pbrnet.pipeline.render.materials import MaterialTable
from pbrnet.pipeline.render.neutral import traits
from pbrnet.pipeline.render.raycast import meshes
from pbrnet.pipeline.render.scene_geometry import SceneGeometry
from pbrnet.pipeline.render.scenegraph import Graph, parse, shapes_of
from pbrnet.scenes.arrays import Float32Array, Float64Array, Int32Array
from pbrnet.scenes.contract import Scene
from pbrnet.scenes.errors import InputError, MachineError
from pbrnet.scenes.geometry.directions import unit


def set_variant(requested: Variant = "auto") -> str:
    """Choose the Mitsuba variant of this process and return its name.

    "auto" takes `cuda_ad_rgb` where a card traces rays, else `llvm_ad_rgb` where libLLVM loads,
    else `scalar_rgb`, and says on standard error why a card or LLVM is not used. Further calls cost
    nothing; "auto" keeps the variant that is set. Raises `MachineError` if the requested variant
    cannot run here, or if the process already uses another one.

    Switches Dr.Jit's approximate functions off in the calling thread: reciprocal square roots
    would differ by the processor's instruction set and vendor. So every thread that renders calls
    this first.
    """
    dr.set_flag(dr.JitFlag.FastMath, False)
    current = mi.variant()
    if current is None:
        chosen = variants.choose(requested)
        mi.set_variant(chosen)
        return chosen
    if requested not in ("auto", current):
        raise MachineError(
            f"this process already renders with {current}; {requested} requires a separate process"
        )
    return str(current)


def renderer_version(variant: str | None = None) -> str:
    """Return the renderer, its versions and the variant, by default this process's.

    It is part of the fingerprint of every frame and camera file.
    """
    variant = variant or mi.variant()
    return f"mitsuba {mi.__version__}, drjit {dr.__version__}, {variant}, core {key('render')}"


@dataclass(frozen=True)
class RenderScene:
    """A scene ready to render, in its own colours or (`albedo` given) as its neutral twin.

    The two forms share geometry, textures and the ray tracing structure: they are one Mitsuba
    scene whose shapes get other materials. Everything that shades calls `apply_materials` first.
    Not for use from several threads at once.
    """

    scene: Scene
    geometry: SceneGeometry
    lights: Lights
    bbox: Float64Array  # (2, 3) world metres
    materials: MaterialSets
    table: MaterialTable
    boxes: ObjectBoxes
    albedo: float | None = None

    @property
    def mitsuba(self) -> Any:
        """The Mitsuba scene, with this form's materials applied."""
        self.apply_materials()
        return self.geometry.scene

    def neutral(self, albedo: float | None) -> RenderScene:
        """Return this scene with every colour replaced by the grey `albedo`.

        None returns the scene in its own colours. Costs almost nothing: the geometry is shared.
        """
        return replace(self, albedo=albedo)

    def apply_materials(self) -> None:
        """Give the shared shapes this form's materials, unless they have them already.

        Raises `InputError` for a material that has no neutral twin.
        """
        self.materials.apply(self.albedo)


def open_scene(scene: Scene, neutral_albedo: float | None = None) -> RenderScene:
    """Load a scene folder for rendering; `neutral_albedo` opens its neutral twin.

    To render both, open it once and call `neutral()`. Raises `InputError` naming file, line
    and element for broken XML, missing or damaged meshes and textures, unknown plugins.
    """
    if mi.variant() is None:
        raise RuntimeError("call set_variant before open_scene")
    graph = parse(scene.xml)
    materials = MaterialSets(graph)
    root = graph.make(0)
    materials.know_shapes()
    bounds = bounds_of(root)
    if not np.isfinite(bounds).all():
        raise InputError(f"{scene.xml}: there is no geometry, or some vertices are not finite")
    index_of = {shape: i for i, item in enumerate(scene.objects) for shape in item.shapes}
    rows, bsdfs_of_shapes = [], []
    for node in shapes_of(graph):
        if graph.plugin(node) == "shapegroup":
            continue
        shape = graph.make(node)
        bsdfs, own = _bsdfs_of(graph, node), next(iter(graph.nested(node, "BSDF")), None)
        bsdfs_of_shapes.append((shape.id(), bsdfs))
        twin = materials.reflectances[-1 if own is None else own]
        rows.append((shape, index_of.get(shape.id(), -1), *traits(graph, bsdfs, own), twin))
    columns: Any = zip(*rows, strict=True) if rows else ((),) * 7
    shapes, objects, clear, masked, mirrors, transmitted, twins = columns
    missing = sorted(set(index_of) - {shape.id() for shape in shapes})
    if missing:
        raise InputError(
            f"{scene.xml}: the shape {missing[0]!r}, which scene.json names, is missing"
        )
    geometry = SceneGeometry(
        root,
        shapes,
        np.array(objects, dtype=np.int32),
        np.array(clear, dtype=bool),
        np.array(masked, dtype=bool),
        mirrors,
        np.array(transmitted, dtype=np.float32),
        twins,
    )
    level_ids()
    return RenderScene(
        scene,
        geometry,
        collect_lights(graph, geometry),
        bounds,
        materials,
        MaterialTable(graph, bsdfs_of_shapes),
        ObjectBoxes(geometry),
        neutral_albedo,
    )


def free_memory() -> None:
    """Return the memory of scenes that are no longer referenced to the system.

    Dr.Jit keeps every kernel that it ever ran, and some scenes need kernels of their own. They are
    freed too; Dr.Jit's cache on disk restores them in milliseconds. Without the last step the heap
    stays fragmented and grows.
    """
    meshes.forget()
    gc.collect()
    dr.flush_malloc_cache()
    dr.flush_kernel_cache()
    if hasattr(psutil, "heap_trim"):  # absent where the C library does not support it
        psutil.heap_trim()


def cast(
    render_scene: RenderScene,
    origins: npt.ArrayLike,
    directions: npt.ArrayLike,
    through_glass: bool = False,
) -> tuple[Float32Array, Int32Array]:
    """Return the distance to the first surface along each ray and the index of its object.

    `origins` (N, 3) or (3,), `directions` (N, 3), world, any length but zero. Distances are
    metres, infinite where nothing is hit; the object is -1 there and for shapes that belong to
    no object. Clear glass stops these rays unless `through_glass`.
    """
    shape, distance = raycast.nearest(
        render_scene.geometry, origins, unit(np.asarray(directions)), through_glass
    )
    return distance, np.append(render_scene.geometry.objects, -1)[shape].astype(np.int32)


def _bsdfs_of(graph: Graph, node: int) -> list[int]:
    """Return the BSDF nodes of a shape; for an instance, those of every shape in its group."""
    if graph.plugin(node) != "instance":
        return graph.nested(node, "BSDF")
    return [
        bsdf
        for group in graph.nested(node, "Shape")
        for shape in graph.nested(group, "Shape")
        for bsdf in graph.nested(shape, "BSDF")
    ]
