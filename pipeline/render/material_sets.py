"""Material sets of an open scene: its own materials, or a neutral twin of each.

The two sets share the shapes' geometry and textures; one of them is applied at a time.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from contextlib import suppress
from functools import cached_property
from typing import Any, NamedTuple, TypeVar, cast

import drjit as dr
import mitsuba as mi

from pbrnet.pipeline.render.bsdfs import Bsdf, BsdfMaker, describe
from pbrnet.pipeline.render.neutral import (
    basis_twin,
    diffuse_lobe,
    lobes_of,
    neutral_twin,
    reflectance_twin,
)
from pbrnet.pipeline.render.scenegraph import Graph, create, shapes_of
from pbrnet.scenes.errors import InputError

_INITIAL_ALBEDO = 0.5
_MIRROR = 0.92  # reflectance of the mirrors of procedural homes
T = TypeVar("T")

MaterialSet = list[tuple[Any, Any]]  # shape and BSDF
Lobes = list[tuple[Any, Any, Any]]  # own BSDF, its diffuse lobe, its reflectance twin


class Basis(NamedTuple):
    """BSDFs that a joint trace evaluates for another: its basis, or itself and its neutral twin.

    `colour` is the reflectance twin, which has the base colour.
    """

    own: Any
    basis: Any | None  # see `basis_twin`
    twin: Any | None  # where there is no basis
    colour: Any


class MaterialSets:
    """The own and the neutral materials of a scene's shapes, and which of them are applied.

    Dr.Jit compiles every material that exists into each path tracing kernel. What a joint trace
    needs beside a scene's own materials (`bases`) is therefore made when the scene is opened. The
    neutral set itself is made when it is first applied.
    """

    def __init__(self, graph: Graph) -> None:
        """Make the own materials of a scene's shapes, before its shapes are made."""
        self._graph = graph
        self._described = {node: describe(graph, node) for node in sorted(graph.shaders)}
        self._described |= _usual(self._described.values())
        self._maker = BsdfMaker(graph)
        self._made = self._maker.make(self._described)
        graph.made.update(self._made.made)
        self._own: MaterialSet = []
        self._neutral: MaterialSet = []
        self._twins: dict[int, Any] = {}  # neutral, by node; also those that no shape has
        self._neutral_albedo: float | None = None
        self._applied: float | None = None  # the albedo of the applied set; None: own materials
        self._bases: list[Basis] | None = None
        self._basis_bsdfs: dict[int, Any] = {}  # by node; also those that no shape has
        self._bases_albedo: float | None = None
        self._lobes: Lobes | None = None
        self._lobe_bsdfs: dict[int, Any] = {}  # by node; also those that no shape has
        self._kept: dict[Callable[..., Any], tuple[int, Any]] = {}
        self.version = 0  # counts the sets of BSDFs made; launches recorded before are void

    def know_shapes(self) -> None:
        """Note which shapes there are, once they are made."""
        self._maker.tables.number_shapes()
        shapes = [self._graph.make(node) for node, _ in _shapes(self._graph)]
        self._own = [(shape, shape.bsdf()) for shape in shapes]
        with suppress(InputError):  # raised again when they are needed
            self.bases(_INITIAL_ALBEDO)

    @cached_property
    def reflectances(self) -> dict[int, Any]:
        """Reflectance twin of each BSDF node of a shape; of -1, Mitsuba's default material's."""
        twins = {
            node: reflectance_twin(self._graph, bsdf) for node, bsdf in self._described.items()
        }
        return {-1: create(mi.Properties("diffuse")), **self._maker.make(twins, (self._made,)).made}

    @property
    def own(self) -> list[Any]:
        """Every shape's own BSDF."""
        return [bsdf for _, bsdf in self._own]

    def apply(self, albedo: float | None) -> None:
        """Give all shapes neutral materials of this albedo, or their own (None).

        Raises `InputError` for a material that has no neutral twin.
        """
        if albedo == self._applied:
            return
        if albedo is not None and albedo != self._neutral_albedo:
            self.apply(None)
            # Freed before the next are made, so that the number of BSDFs stays.
            self._neutral, self._twins = [], {}
            self._make_neutral(albedo)
        for shape, bsdf in self._own if albedo is None else self._neutral:
            shape.set_bsdf(bsdf)
        self._applied = albedo

    def bases(self, albedo: float) -> list[Basis]:
        """Return every shape's own BSDF and what a joint trace evaluates in its place.

        Valid until those of another albedo are needed. Raises `InputError` as `apply` does.
        """
        if self._bases is None or albedo != self._bases_albedo:
            self._bases, self._basis_bsdfs = None, {}  # freed before the next are made
            self._bases = self._make_bases(albedo)
            self._bases_albedo = albedo
            self.version += 1
        return self._bases

    def lobes(self) -> Lobes:
        """Return every shape's own BSDF with its diffuse lobe and its reflectance twin.

        They are made on first use, because every BSDF that exists is compiled.
        """
        if self._lobes is None:
            self._lobes = self._make_lobes()
            self.version += 1
        return self._lobes

    def kept(self, kind: Callable[..., T], *arguments: Any, version: int = 0) -> T:
        """Return what `kind` made of the arguments when it was first called for this scene.

        It makes another one for another `version`. All end with the scene.
        """
        known, found = self._kept.get(kind, (None, None))
        if known != version:
            found = kind(*arguments)
            self._kept[kind] = version, found
        return cast(T, found)

    def _make_lobes(self) -> Lobes:
        lobes = {node: diffuse_lobe(bsdf) for node, bsdf in self._described.items()}
        made = self._lobe_bsdfs = self._maker.make(lobes, (self._made,)).made
        found = []
        for (_, material), (_, own) in zip(_shapes(self._graph), self._own, strict=True):
            if material < 0:  # Mitsuba's default material is diffuse
                found.append((own, own, own))
            else:
                found.append((own, made[material], self.reflectances[material]))
        return found

    def _make_bases(self, albedo: float) -> list[Basis]:
        """Make the bases of materials that have one, and neutral twins of the others."""
        bases: dict[int, Bsdf | None] = {}
        if dr.is_jit_v(mi.Float):
            lobes = frozenset[str]().union(*map(lobes_of, self._described.values()))
            bases = {node: basis_twin(bsdf, lobes) for node, bsdf in self._described.items()}
        described = {
            node: bases.get(node) or neutral_twin(self._graph, bsdf, albedo)
            for node, bsdf in self._described.items()
        }
        made = self._basis_bsdfs = self._maker.make(described, (self._made,)).made
        found: list[Basis] = []
        for (_, material), (_, own) in zip(_shapes(self._graph), self._own, strict=True):
            if material < 0:
                made[-1] = made.get(-1) or _diffuse(albedo)
                found.append(Basis(own, None, made[-1], own))
                continue
            colour = self.reflectances[material]
            twin = made[material]
            basis, twin = (twin, None) if bases.get(material) else (None, twin)
            found.append(Basis(own, basis, twin, colour))
        return found

    def _make_neutral(self, albedo: float) -> None:
        self._neutral_albedo = None
        twins = {
            node: neutral_twin(self._graph, bsdf, albedo) for node, bsdf in self._described.items()
        }
        made = self._maker.make(twins, (self._made,)).made
        if any(material < 0 for _, material in _shapes(self._graph)):
            made[-1] = _diffuse(albedo)
        self._neutral = [
            (shape, made[material])
            for (shape, _), (_, material) in zip(self._own, _shapes(self._graph), strict=True)
        ]
        self._twins = made
        self.version += 1
        self._neutral_albedo = albedo


def _shapes(graph: Graph) -> Iterator[tuple[int, int]]:
    """Yield the nodes of every shape with a BSDF and of that BSDF, -1 for the default."""
    for node in shapes_of(graph):
        if graph.plugin(node) not in ("shapegroup", "instance"):
            yield node, next(iter(graph.nested(node, "BSDF")), -1)


def _usual(others: Iterable[Bsdf]) -> dict[int, Bsdf]:
    """Mirror, glass and lampshade of procedural homes, by node numbers that no shape has.

    Dr.Jit compiles every BSDF that exists, so homes with and without them share kernels. The shade
    has an image of one of the other materials; there is none for scenes without images.
    """
    if not dr.is_jit_v(mi.Float):
        return {}
    reflectance = mi.ScalarColor3d(_MIRROR)
    mirror = Bsdf(-2, "conductor", {"material": "none", "specular_reflectance": reflectance})
    found = {-2: Bsdf(-2, "twosided", {"_arg_0": mirror}), -3: Bsdf(-3, "thindielectric", {})}
    image = next(filter(None, map(_base_image, others)), None)
    if image is not None:
        shade = {"base_color": image, "roughness": 1.0, "diff_trans": 1.0, "eta": 1.2}
        found[-4] = Bsdf(-4, "principledthin", shade)
    return found


def _base_image(bsdf: Bsdf) -> Any:
    """Return the reference to the image of a principled material's base colour, or None."""
    if bsdf.plugin == "principled":
        value = bsdf.properties.get("base_color")
        return value if isinstance(value, mi.Properties.ResolvedReference) else None
    return next(filter(None, map(_base_image, bsdf.held.values())), None)


def _diffuse(albedo: float) -> Any:
    """Return the neutral twin of Mitsuba's default material, for shapes without one."""
    properties = mi.Properties("diffuse")
    properties["reflectance"] = albedo
    return create(properties)
