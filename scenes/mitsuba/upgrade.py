"""Upgrade of scene files of Mitsuba 0.2 to 0.5 to the names and meanings of 0.6.

The rules follow the upgrade stylesheets of Mitsuba 0.6 (`data/schema/`). Later changes of
spelling (camelCase, `extEta`, ...) need no upgrade: `values.Properties` reads both.
"""

from __future__ import annotations

from pbrnet.scenes.mitsuba.reader import Node

# (tag, old type) -> new type.
_TYPES = {
    ("bsdf", "bump"): "bumpmap",
    ("bsdf", "lambertian"): "diffuse",
    ("bsdf", "microfacet"): "roughplastic",
    ("bsdf", "roughmetal"): "roughconductor",
    ("bsdf", "roughglass"): "roughdielectric",
    ("bsdf", "composite"): "mixturebsdf",
    ("texture", "ldrtexture"): "bitmap",
    ("texture", "exrtexture"): "bitmap",
}
# (tag, new type or "" for any) -> {old property: new property}.
_PROPERTIES: dict[tuple[str, str], dict[str, str]] = {
    ("luminaire", ""): {"intensityScale": "scale"},
    ("luminaire", "area"): {"intensity": "radiance"},
    ("luminaire", "constant"): {"intensity": "radiance"},
    ("luminaire", "directional"): {"intensity": "irradiance"},
    ("camera", ""): {"focusDepth": "focusDistance"},
    ("bsdf", "roughplastic"): {"alphaB": "alpha"},
    ("bsdf", "roughconductor"): {"alphaB": "alpha", "ior": "eta"},
    ("bsdf", "roughdielectric"): {"alphaB": "alpha"},
    ("bsdf", "ward"): {"alphaX": "alphaU", "alphaY": "alphaV"},
    ("texture", "checkerboard"): {"brightColor": "color0", "darkColor": "color1"},
    ("texture", "gridtexture"): {"brightColor": "color0", "darkColor": "color1"},
    ("shape", "sphere"): {"inverted": "flipNormals"},
}


def upgrade(root: Node, version: tuple[int, ...]) -> None:
    """Change the tree of a scene older than 0.5 in place to the names of version 0.6."""
    if version >= (0, 5):
        return
    before_0_3 = version < (0, 3)
    for node in list(root.walk()):
        if node.tag == "bsdf" and node.type == "mirror":
            node.attributes["type"] = "conductor"
            node.children.append(_property(node, "string", "material", "Cr"))
        kind = _TYPES.get((node.tag, node.type))
        if kind is not None:
            node.attributes["type"] = kind
        for key in ((node.tag, ""), (node.tag, node.type)):
            _rename(node, _PROPERTIES.get(key, {}))
        if before_0_3 and (node.tag, node.type) == ("shape", "cylinder"):
            _rename(node, {"p1": "p0", "p2": "p1"})
        if node.tag == "camera":
            _turn_into_sensor(node)
        elif node.tag == "luminaire":
            node.tag = "emitter"


def _turn_into_sensor(node: Node) -> None:
    """Change a `<camera>` into a `<sensor>`.

    The field of view of a camera is that of the shorter side by default, and its +X points to
    the right.
    """
    node.tag = "sensor"
    shorter = True
    for child in list(node.children):
        if child.name == "mapSmallerSide":
            shorter = child.attributes.get("value", "").strip().lower() != "false"
            node.children.remove(child)
        elif child.tag == "transform" and child.name == "toWorld":
            child.children.insert(0, Node("scale", {"x": "-1"}, child.file, child.line))
    if node.type == "perspective" and not any(child.name == "fovAxis" for child in node.children):
        axis = "smaller" if shorter else "larger"
        node.children.append(_property(node, "string", "fovAxis", axis))


def _rename(node: Node, names: dict[str, str]) -> None:
    for child in node.children:
        if child.name in names:
            child.attributes["name"] = names[child.name]


def _property(node: Node, tag: str, name: str, value: str) -> Node:
    return Node(tag, {"name": name, "value": value}, node.file, node.line)
