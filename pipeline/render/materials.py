"""Material values of visible surfaces: roughness, metalness, specular colour, bumped normal.

`RULES` is the one table of BSDF types; a type without a rule (measured reflectance, hair) leaves
its pixels unknown. Conventions:

* roughness is perceptual, as glTF 2.0 and Burley 2012 ("Physically Based Shading at Disney")
  define it: the square root of the width `alpha` of the microfacet distribution, for anisotropic
  ones of the geometric mean of both widths. Lambertian surfaces have 1, smooth ones 0.
* metalness is the share of the metallic lobe: 1 for conductors, `metallic` of `principled`.
* specular colour is F0, the linear RGB reflectance at normal incidence of the specular lobe:
  ((eta - 1) / (eta + 1))^2 times `specular_reflectance` for dielectrics, the conductor's Fresnel
  reflectance for metals; 0 for surfaces without such a lobe. Clearcoat and sheen are left out.
* The normal is the one that shades, after bump and normal maps (Mitsuba 3.9's formulas, with
  its flip of invalid normals).

A blend mixes the values of its two materials by its weight, and skips one that is nothing at all
(`null`). Textures are evaluated at the hit as the renderer evaluates them.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable
from dataclasses import dataclass, fields, replace
from functools import cached_property, partial

import mitsuba as mi
import numpy as np
import numpy.typing as npt

from pbrnet.pipeline.render import raycast
from pbrnet.pipeline.render.neutral import normal_incidence
from pbrnet.pipeline.render.scene_geometry import Hits, SceneGeometry, TextureSlot, Way
from pbrnet.pipeline.render.scenegraph import Graph
from pbrnet.scenes.arrays import AnyArray, BoolArray, Float64Array, Int32Array
from pbrnet.scenes.color import luminance
from pbrnet.scenes.geometry.directions import unit

Lookup = Callable[[int, Way], Float64Array]  # texture node, way of evaluation -> (P, bands)
_BANDS: dict[Way, int] = {"eval_1": 1, "eval": 3, "eval_3": 3, "eval_1_grad": 2}


@dataclass(frozen=True)
class SurfacePoints:
    """P points of one material; vectors (P, 3) are in the shading frame, whose z is the normal.

    `lookup` evaluates a texture at the points. `towards_eye` is the unit direction to the camera,
    `geometric` the geometric normal, `dp_du` and `dp_dv` the derivatives of the position.
    """

    lookup: Lookup
    towards_eye: Float64Array
    geometric: Float64Array
    dp_du: Float64Array
    dp_dv: Float64Array


@dataclass(frozen=True)
class MaterialValues:
    """Values of P points: roughness, metalness, known, presence (P,), specular, normal (P, 3).

    `normal` is the unit shading normal in the shading frame, (0, 0, 1) without bumps. `known` is
    0 where the material cannot say its values, `presence` 0 where it is nothing.
    """

    roughness: Float64Array
    metalness: Float64Array
    specular: Float64Array
    normal: Float64Array
    known: Float64Array
    presence: Float64Array


_FIELDS = fields(MaterialValues)
Number = Float64Array | float  # of P points, or of all
Values = tuple[Number, Number, Number]  # roughness, metalness, specular colour


class MaterialTable:
    """Materials of a scene, numbered in the order of `scene.xml`, and their values at hits."""

    def __init__(self, graph: Graph, bsdfs_of_shapes: Iterable[tuple[str, list[int]]]) -> None:
        """Number the materials; `bsdfs_of_shapes` gives each shape's id and BSDF nodes.

        A shape with more than one BSDF (an instance of a group) has the first.
        """
        self._graph = graph
        shapes = [(name, bsdfs[0] if bsdfs else -1) for name, bsdfs in bsdfs_of_shapes]
        self._nodes = sorted({node for _, node in shapes})  # the parser's nodes are in file order
        first = {node: name for name, node in reversed(shapes)}
        self.names = _distinct([self._name(node, first[node]) for node in self._nodes])
        numbers = {node: number for number, node in enumerate(self._nodes)}
        self.of_shape: Int32Array = np.array([numbers[node] for _, node in shapes], dtype=np.int32)

    def ids(self, shapes: Int32Array) -> npt.NDArray[np.uint32]:
        """Return the index in `names` + 1 of each shape's material; 0 for shape -1."""
        return (np.append(self.of_shape, -1)[shapes] + 1).astype(np.uint32)

    def values(
        self,
        geometry: SceneGeometry,
        hits: Hits,
        eye: Float64Array,
        directions: Float64Array,
        textures: list[AnyArray] | None = None,
    ) -> tuple[MaterialValues, BoolArray]:
        """Return the values at the hits of rays from `eye` (3,), and which hits have bumps (P,).

        The normals are in the world and on the shading side of the camera; where a ray hits
        nothing, all is 0. `textures` is what `raycast.textured_surfaces` returns for
        the `slots` and these rays, if it is known already; else it is evaluated if a visible
        material has textures.
        """
        count = len(directions)
        found = MaterialValues(*(np.zeros((count, 3) if i in (2, 3) else count) for i in range(6)))
        bumped = np.zeros(count, dtype=bool)
        material = np.append(self.of_shape, -1)[hits.shape]
        back = (hits.shading_normal * directions).sum(axis=1) > 0
        seen = [int(number) for number in np.unique(material[material >= 0])]
        textured = [number for number in seen if self._textures[number]]
        constant = np.array([number not in textured for number in range(len(self.names))] + [False])
        rows = np.flatnonzero(constant[material])
        side = 2 * material[rows] + back[rows]  # front and back of each material in turn
        for name, values in vars(found).items():
            values[rows] = getattr(self._constants, name)[side]
        if textured:
            if textures is None:
                _, textures = raycast.textured_surfaces(geometry, self.slots, eye, directions)
            *sampled, s, du, dv = textures
            frames = np.stack([s, du, dv]).astype(np.float64)
        for number in textured:
            rows = np.flatnonzero(material == number)
            points, axes = self._points(number, rows, hits, directions, frames, sampled)
            got = _values(self._graph, self._nodes[number], points)
            for name, values in vars(found).items():
                values[rows] = getattr(got, name)
            if self._bumps[number]:
                turned = got.normal[:, 2:] * points.towards_eye[:, 2:] < 0
                facing = np.where(turned, -got.normal, got.normal)
                found.normal[rows] = np.einsum("pij,pi->pj", axes, facing)
                bumped[rows] = True
        return found, bumped

    def _points(
        self,
        number: int,
        rows: npt.NDArray[np.intp],
        hits: Hits,
        directions: Float64Array,
        frames: Float64Array,
        sampled: list[AnyArray],
    ) -> tuple[SurfacePoints, Float64Array]:
        """Return a material's points, and the axes of their shading frames as rows (P, 3, 3)."""
        normal = hits.shading_normal[rows].astype(np.float64)
        s, du, dv = frames[:, rows]
        axes = np.stack([s, np.cross(normal, s), normal], axis=1)

        def local(vectors: AnyArray) -> Float64Array:
            return np.einsum("pij,pj->pi", axes, vectors.astype(np.float64))

        def lookup(texture: int, way: Way) -> Float64Array:
            slot = self._first_slot[way] + self._textures[number][way].index(texture)
            return sampled[slot].reshape(len(directions), -1)[rows].astype(np.float64)

        towards_eye, geometric = local(-directions[rows]), local(hits.geometric_normal[rows])
        return SurfacePoints(lookup, towards_eye, geometric, local(du), local(dv)), axes

    @cached_property
    def _probed(self) -> list[tuple[dict[Way, list[int]], MaterialValues]]:
        """For each material, the texture nodes that its rules evaluate, by way of evaluation.

        And its values in front and at the back where these textures are 0.
        """
        found = []
        for node in self._nodes:
            wanted: dict[Way, list[int]] = {}
            found.append((wanted, _values(self._graph, node, _two_points(wanted))))
        return found

    @property
    def _textures(self) -> list[dict[Way, list[int]]]:
        return [wanted for wanted, _ in self._probed]

    @cached_property
    def _constants(self) -> MaterialValues:
        """Values of every material's front and back in turn; meant for those without textures."""
        each = [values for _, values in self._probed]
        return MaterialValues(
            *(np.concatenate([getattr(one, field.name) for one in each]) for field in _FIELDS)
        )

    @cached_property
    def _bumps(self) -> list[bool]:
        return [_has_bumps(self._graph, node) for node in self._nodes]

    @cached_property
    def _slots_of_way(self) -> dict[Way, int]:
        """Number of slots for each way of evaluation: the most textures of one material."""
        return {
            way: max((len(textures.get(way, ())) for textures in self._textures), default=0)
            for way in _BANDS
        }

    @cached_property
    def _first_slot(self) -> dict[Way, int]:
        ends = np.cumsum([0, *self._slots_of_way.values()])
        return {way: int(start) for way, start in zip(_BANDS, ends, strict=False)}

    @cached_property
    def slots(self) -> tuple[TextureSlot, ...]:
        """The textures of each shape's material, slot by slot."""
        slots = []
        for way, count in self._slots_of_way.items():
            for place in range(count):
                nodes = [textures.get(way, [])[place : place + 1] for textures in self._textures]
                made = [self._graph.make(node[0]) if node else None for node in nodes]
                textures = tuple(made[number] for number in self.of_shape)
                slots.append(TextureSlot(way, _BANDS[way], textures))
        return tuple(slots)

    def _name(self, node: int, shape: str) -> str:
        if node < 0:
            return "default"
        name = str(self._graph.props(node).id())
        return name or f"{shape}: {self._graph.plugin(node)}"


# Rules


class _Leaf:
    """Properties of one BSDF at P points: constants, or textures evaluated there."""

    def __init__(self, graph: Graph, index: int, points: SurfacePoints) -> None:
        self._textures = {
            name: node
            for name, node in graph.references(index).items()
            if graph.kind(node) == "Texture"
        }
        self._points = points
        self.count = len(points.towards_eye)
        self._object = graph.leaf(index)
        self._params = mi.traverse(self._object)

    def scalar(self, name: str, default: float) -> Float64Array:
        """Return a number (P,); of a colour, its luminance."""
        if name in self._textures:
            return self._points.lookup(self._textures[name], "eval_1")[:, 0]
        value = self._constant(name, default)
        return np.full(self.count, luminance(value) if value.size == 3 else value[0])

    def color(self, name: str, default: float) -> Float64Array:
        """Return linear RGB (P, 3)."""
        if name in self._textures:
            return np.broadcast_to(
                self._points.lookup(self._textures[name], "eval"), (self.count, 3)
            )
        return np.broadcast_to(self._constant(name, default), (self.count, 3))

    def has(self, name: str) -> bool:
        """Test whether the BSDF has this property, constant or textured."""
        return name in self._textures or f"{name}.value" in self._params or name in self._params

    def is_zero(self, name: str) -> bool:
        """Test whether a number, 0 by default, is 0 everywhere."""
        return name not in self._textures and not self._constant(name, 0.0).any()

    def interface(self) -> Float64Array:
        """Return the Fresnel reflectance of a dielectric at normal incidence, (P,)."""
        eta = self.scalar("eta", 1.5)
        reflectance: Float64Array = ((eta - 1) / (eta + 1)) ** 2
        return reflectance

    def metal(self) -> Float64Array:
        """Return the Fresnel reflectance of a conductor at normal incidence, RGB (P, 3)."""
        if "eta" in self._textures or "k" in self._textures:
            eta, k = self.color("eta", 0.0), self.color("k", 1.0)
            return np.clip(((eta - 1) ** 2 + k**2) / ((eta + 1) ** 2 + k**2), 0, 1)
        return np.broadcast_to(normal_incidence(self._object), (self.count, 3))

    def _constant(self, name: str, default: float) -> Float64Array:
        for key in (f"{name}.value", name):
            if key in self._params:
                return np.array(self._params[key], dtype=np.float64).ravel()
        return np.array([default])

    def tint(self) -> Float64Array:
        """Return the tint (P, 3) of a principled material's dielectric lobe."""
        if self.is_zero("spec_tint"):
            return np.ones((self.count, 3))
        base = self.color("base_color", 0.5)
        light = luminance(base)[:, None]
        hue = np.divide(base, light, out=np.ones_like(base), where=light > 0)
        return 1 + self.scalar("spec_tint", 0.0)[:, None] * (hue - 1)

    def from_alpha(self) -> Float64Array:
        """Return perceptual roughness: the root of alpha, or of the mean of alpha_u and alpha_v."""
        if self.has("alpha_u"):
            area = self.scalar("alpha_u", 0.1) * self.scalar("alpha_v", 0.1)
            return np.asarray(np.maximum(area, 0) ** 0.25)
        return np.sqrt(np.maximum(self.scalar("alpha", 0.1), 0))


def _dielectric(leaf: _Leaf, rough: bool) -> Values:
    specular = leaf.interface()[:, None] * leaf.color("specular_reflectance", 1.0)
    return leaf.from_alpha() if rough else 0.0, 0.0, specular


def _conductor(leaf: _Leaf, rough: bool) -> Values:
    specular = leaf.metal() * leaf.color("specular_reflectance", 1.0)
    return leaf.from_alpha() if rough else 0.0, 1.0, specular


def _principled(leaf: _Leaf) -> Values:
    metalness = leaf.scalar("metallic", 0.0)
    # `specular` is the reflectance at normal incidence in units of 8 %.
    reflectance = 0.08 * leaf.scalar("specular", 0.5) if leaf.has("specular") else leaf.interface()
    dielectric = reflectance[:, None] * leaf.tint()
    specular = (1 - metalness)[:, None] * dielectric
    if not leaf.is_zero("metallic"):
        specular = specular + metalness[:, None] * leaf.color("base_color", 0.5)
    return leaf.scalar("roughness", 0.5), metalness, specular


def _principled_thin(leaf: _Leaf) -> Values:
    roughness = leaf.scalar("roughness", 0.5)
    if leaf.is_zero("spec_trans"):  # the weight of the specular lobes
        return roughness, 0.0, 0.0
    lobe = leaf.scalar("spec_trans", 0.0) * leaf.interface()
    return roughness, 0.0, lobe[:, None] * leaf.tint()


# BSDF type -> rule. The wrappers twosided, mask, bumpmap, normalmap and blendbsdf are in `_values`.
RULES: dict[str, Callable[[_Leaf], Values]] = {
    "diffuse": lambda leaf: (1.0, 0.0, 0.0),
    "plastic": partial(_dielectric, rough=False),
    "roughplastic": partial(_dielectric, rough=True),
    "pplastic": partial(_dielectric, rough=True),
    "dielectric": partial(_dielectric, rough=False),
    "thindielectric": partial(_dielectric, rough=False),
    "roughdielectric": partial(_dielectric, rough=True),
    "conductor": partial(_conductor, rough=False),
    "roughconductor": partial(_conductor, rough=True),
    "principled": _principled,
    "principledthin": _principled_thin,
    "null": lambda leaf: (0.0, 0.0, 0.0),
}


def _values(graph: Graph, index: int, points: SurfacePoints) -> MaterialValues:
    """Return the values of BSDF node `index` at P points; -1 is Mitsuba's default, diffuse."""
    count = len(points.towards_eye)
    if index < 0:
        return _plain(count, 1.0, 0.0, 0.0)
    plugin, children = graph.plugin(index), graph.nested(index, "BSDF")
    if plugin == "twosided":
        return _two_sided(graph, children, points)
    if plugin == "blendbsdf":
        weight = _Leaf(graph, index, points).scalar("weight", 0.5)
        first, second = (_values(graph, child, points) for child in children)
        return _blended(first, second, np.clip(weight, 0, 1))
    if plugin == "mask":
        return _values(graph, children[0], points)
    if plugin in ("bumpmap", "normalmap"):
        inner = _values(graph, children[0], points)
        return replace(inner, normal=_perturbed(graph, index, points))
    rule = RULES.get(plugin)
    if rule is None:
        return replace(_plain(count, 0.0, 0.0, 0.0), known=np.zeros(count))
    found = _plain(count, *rule(_Leaf(graph, index, points)))
    return replace(found, presence=np.zeros(count)) if plugin == "null" else found


def _two_sided(graph: Graph, children: list[int], points: SurfacePoints) -> MaterialValues:
    """Return the values of a two-sided material: seen from behind, its mirror image."""
    back = points.towards_eye[:, 2] < 0
    mirror = np.where(back, -1.0, 1.0)[:, None] * [0, 0, 1] + [1, 1, 0]
    turned = replace(points, towards_eye=points.towards_eye * mirror)
    sides = [_values(graph, child, turned) for child in children]
    if len(sides) == 1:
        return replace(sides[0], normal=sides[0].normal * mirror)
    chosen = MaterialValues(
        **{
            name: np.where(
                back[:, None] if value.ndim == 2 else back, getattr(sides[1], name), value
            )
            for name, value in vars(sides[0]).items()
        }
    )
    return replace(chosen, normal=chosen.normal * mirror)


def _blended(first: MaterialValues, second: MaterialValues, weight: Float64Array) -> MaterialValues:
    """Return the mixture of two materials; `weight` (P,) is the second's share."""
    shares = (1 - weight) * first.presence, weight * second.presence
    total = shares[0] + shares[1]
    share = np.divide(shares[1], total, out=np.zeros_like(total), where=total > 0)
    mixed = {
        name: value
        + (share[:, None] if value.ndim == 2 else share) * (getattr(second, name) - value)
        for name, value in vars(first).items()
    }
    mixed["normal"] = unit(mixed["normal"])
    unknown = (shares[0] * (1 - first.known) > 0) | (shares[1] * (1 - second.known) > 0)
    return MaterialValues(**{**mixed, "known": np.where(unknown, 0.0, 1.0), "presence": total})


def _perturbed(graph: Graph, index: int, points: SurfacePoints) -> Float64Array:
    """Return the unit normals (P, 3) of a bump or normal map, in the shading frame."""
    props = graph.props(index)
    texture = graph.nested(index, "Texture")[0]
    if graph.plugin(index) == "normalmap":
        normal = points.lookup(texture, "eval_3") * 2 - 1
    else:
        slope = points.lookup(texture, "eval_1_grad") * float(props.get("scale", 1.0))
        along_u = np.column_stack([points.dp_du[:, :2], slope[:, 0]])
        along_v = np.column_stack([points.dp_dv[:, :2], slope[:, 1]])
        normal = np.cross(along_u, along_v)
        normal = np.where((normal * points.geometric).sum(1, keepdims=True) < 0, -normal, normal)
    lost = ~(np.linalg.norm(normal, axis=1) > 0)  # a surface without texture coordinates
    normal = unit(np.where(lost[:, None], [0.0, 0.0, 1.0], normal))
    if props.get("flip_invalid_normals", True):
        cosine = (points.towards_eye * normal).sum(1)
        invalid = points.towards_eye[:, 2] * cosine <= 0
        normal = np.where(invalid[:, None], normal * [-1, -1, 1], normal)
    return normal


def _plain(count: int, roughness: Number, metalness: Number, specular: Number) -> MaterialValues:
    """Return known values of `count` points, clipped to [0, 1], without bumps."""
    return MaterialValues(
        np.clip(np.broadcast_to(roughness, count), 0, 1),
        np.clip(np.broadcast_to(metalness, count), 0, 1),
        np.clip(np.broadcast_to(specular, (count, 3)), 0, 1),
        np.tile([0.0, 0.0, 1.0], (count, 1)),
        np.ones(count),
        np.ones(count),
    )


def _two_points(wanted: dict[Way, list[int]]) -> SurfacePoints:
    """Return a front and a back of a material, whose textures are 0 and noted in `wanted`."""

    def record(texture: int, way: Way) -> Float64Array:
        if texture not in wanted.setdefault(way, []):
            wanted[way].append(texture)
        return np.zeros((2, _BANDS[way]))

    sides = np.array([[0.0, 0.0, 1.0], [0.0, 0.0, -1.0]])
    return SurfacePoints(record, sides, sides, sides, sides)


def _has_bumps(graph: Graph, node: int) -> bool:
    return node >= 0 and (
        graph.plugin(node) in ("bumpmap", "normalmap")
        or any(_has_bumps(graph, child) for child in graph.nested(node, "BSDF"))
    )


def _distinct(names: list[str]) -> tuple[str, ...]:
    """Return the names, with a number added to those that occur more than once."""
    counts = Counter(names)
    return tuple(
        name if counts[name] == 1 else f"{name} {names[: place + 1].count(name)}"
        for place, name in enumerate(names)
    )
