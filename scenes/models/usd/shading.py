"""Materials of a USD stage as plain data: UsdPreviewSurface, and the like of MDL and MaterialX.

Runs in the child process that holds OpenUSD. A material is a dictionary of inputs, each a value
(a number or a list of numbers, linear) or a texture; `materials.py` translates it.
"""

from __future__ import annotations

from typing import Any

from pxr import Gf, Sdf, UsdShade

# Our name of an input -> its name in other shaders, of which only these inputs are read.
_OMNI_PBR: dict[str, tuple[str, ...]] = {
    "diffuseColor": ("diffuse_texture", "diffuse_color_constant", "diffuse_tint"),
    "roughness": ("reflectionroughness_texture", "reflection_roughness_constant"),
    "metallic": ("metallic_texture", "metallic_constant"),
    "opacity": ("opacity_texture", "opacity_constant"),
    "emissiveColor": ("emissive_color_texture", "emissive_color"),
    "normal": ("normalmap_texture",),
}
_STANDARD_SURFACE: dict[str, tuple[str, ...]] = {
    "diffuseColor": ("base_color",),
    "roughness": ("specular_roughness",),
    "metallic": ("metalness",),
    "opacity": ("opacity",),
    "emissiveColor": ("emission_color",),
    "ior": ("specular_IOR",),
}
_PREVIEW = (
    "diffuseColor", "emissiveColor", "metallic", "roughness", "clearcoat", "clearcoatRoughness",
    "opacity", "opacityThreshold", "ior", "normal", "useSpecularWorkflow", "specularColor",
)  # fmt: skip
_MOST_STEPS = 32  # of a chain of shaders


def material_data(material: Any, time: Any) -> dict[str, Any]:
    """Return `name`, `kind` and the inputs of a `UsdShade.Material`; `kind` is "" without one.

    `stated` is the text that `pbrnet export-scene` wrote beside them, or None.
    """
    prim = material.GetPrim()
    made: dict[str, Any] = {"name": prim.GetName(), "kind": "", "inputs": {}}
    made["stated"] = prim.GetCustomDataByKey("pbrnet")
    for context in ("", "mtlx", "mdl"):
        shader, _, _ = material.ComputeSurfaceSource(context)
        if shader and shader.GetPrim().IsValid():
            kind = _kind(shader)
            if kind and (not made["kind"] or kind == "UsdPreviewSurface"):
                made.update(kind=kind, inputs=_inputs(shader, kind, time))
            if kind == "UsdPreviewSurface":
                break
    return made


def _kind(shader: Any) -> str:
    name = str(shader.GetShaderId() or "")
    if not name:
        asset = shader.GetSourceAsset("mdl")
        name = str(asset.path).rpartition("/")[2] if asset else ""
    return name


def _inputs(shader: Any, kind: str, time: Any) -> dict[str, Any]:
    if kind == "UsdPreviewSurface":
        names: dict[str, tuple[str, ...]] = {name: (name,) for name in _PREVIEW}
    elif "standard_surface" in kind:
        names = _STANDARD_SURFACE
    else:
        names = _OMNI_PBR
    made = {}
    for ours, candidates in names.items():
        for name in candidates:
            value = _input(shader.GetInput(name), time)
            if value is not None:
                made[ours] = value
                break
    if names is _OMNI_PBR:
        _apply_switches(shader, made, time)
    return made


def _apply_switches(shader: Any, made: dict[str, Any], time: Any) -> None:
    """Emission and opacity of OmniPBR count only if they are enabled."""
    for ours, switch in (("emissiveColor", "enable_emission"), ("opacity", "enable_opacity")):
        enabled = _input(shader.GetInput(switch), time)
        if not (isinstance(enabled, dict) and enabled.get("value")):
            made.pop(ours, None)
    strength = _input(shader.GetInput("emissive_intensity"), time)
    if "emissiveColor" in made and isinstance(strength, dict) and "value" in strength:
        made["emissiveColor"]["strength"] = strength["value"]


def _input(source: Any, time: Any) -> dict[str, Any] | None:
    """Return an input as `{"value": ...}` or as the texture that it is connected to, or None."""
    if not source:
        return None
    for attribute in source.GetValueProducingAttributes():
        prim = attribute.GetPrim()
        shader = UsdShade.Shader(prim)
        if UsdShade.Utils.GetType(attribute.GetName()) == UsdShade.AttributeType.Output and shader:
            return _texture(shader, attribute.GetBaseName().removeprefix("outputs:"), time)
        value = attribute.Get(time)
        if isinstance(value, Sdf.AssetPath):
            return {"file": _path(value), "channel": "rgb"} if value.path else None
        if value is not None:
            return {"value": _plain(value)}
    return None


def _texture(shader: Any, channel: str, time: Any) -> dict[str, Any] | None:
    """Return the image texture behind the output `channel` of a shader, or None."""
    for _ in range(_MOST_STEPS):
        kind = str(shader.GetShaderId() or "")
        file = shader.GetInput("file")
        if file:
            break
        inner = shader.GetInput("in") or shader.GetInput("in1")
        sources = inner.GetConnectedSources()[0] if inner else []
        if not sources:
            return None
        shader = UsdShade.Shader(sources[0].source.GetPrim())
    else:
        return None
    value = _input(file, time)
    if value is None or "file" not in value:
        return None
    made = {**value, "channel": channel if channel in ("r", "g", "b", "a") else "rgb"}
    for name, key in (("scale", "scale"), ("bias", "bias"), ("fallback", "fallback"),
                      ("wrapS", "wrap"), ("sourceColorSpace", "space")):  # fmt: skip
        given = _input(shader.GetInput(name), time)
        if given is not None and "value" in given:
            made[key] = given["value"]
    made["nearest"] = bool(shader.GetPrim().GetCustomDataByKey("pbrnet:nearest"))
    if "image" in kind and channel == "out":  # MaterialX
        made["channel"] = "rgb"
    coordinates = shader.GetInput("st") or shader.GetInput("texcoord")
    _coordinates(coordinates, made, time)
    return made


def _coordinates(source: Any, made: dict[str, Any], time: Any) -> None:
    """Add the name of the texture coordinates, and their transform, to a texture."""
    for _ in range(_MOST_STEPS):
        sources = source.GetConnectedSources()[0] if source else []
        if not sources:
            return
        shader = UsdShade.Shader(sources[0].source.GetPrim())
        if not shader:
            # An input of a node graph or of the material passes the connection on.
            found = sources[0].source.GetInput(sources[0].sourceName)
            if not found or found.GetAttr() == source.GetAttr():
                return
            source = found
            continue
        kind = str(shader.GetShaderId() or "")
        if kind == "UsdTransform2d" and "transform" not in made:
            parts = {}
            for name in ("rotation", "scale", "translation"):
                given = _input(shader.GetInput(name), time)
                if given is not None and "value" in given:
                    parts[name] = given["value"]
            made["transform"] = parts
        read = _input(shader.GetInput("varname") or shader.GetInput("geomprop"), time)
        if read is not None and isinstance(read.get("value"), str):
            made["coordinates"] = read["value"]
            return
        source = shader.GetInput("in")


def _path(value: Any) -> str:
    """The path of an asset: resolved by OpenUSD where it could, else as written."""
    return str(value.resolvedPath or value.path)


def _plain(value: Any) -> Any:
    """A value of USD as JSON has it; single-precision numbers as short as they were written."""
    if isinstance(value, Gf.Vec2f | Gf.Vec3f | Gf.Vec4f | Gf.Vec2d | Gf.Vec3d | Gf.Vec4d):
        return [float(f"{each:.7g}") for each in value]
    if isinstance(value, float):
        return float(f"{value:.7g}")
    return value if isinstance(value, bool | int | float | str) else str(value)
