"""USD: a scene as a crate file with textures beside it, or as one USDZ package.

Metres, Z up. Materials are UsdPreviewSurface; the sun is a distant light in lux, the sky a dome
light with an image in cd/m^2 (middle column by OpenEXR's convention), lamps are surfaces that emit
cd/m^2 and lights of UsdLux. Objects are Xforms with semantic labels. The layer's custom data hold
`scene.json`, from which `pbrnet import` restores rooms, portals and objects.
"""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from pxr import Gf, Sdf, Tf, Usd, UsdGeom, UsdLux, UsdPhysics, UsdShade, UsdUtils, Vt

from pbrnet.pipeline.scene_export import pictures
from pbrnet.pipeline.scene_export.content import Content, Eye, Lamp, Leaf, Piece
from pbrnet.pipeline.scene_export.description import (
    SUN,
    description,
    labels_of,
    pane_labels,
)
from pbrnet.pipeline.scene_export.light_variants import differing
from pbrnet.pipeline.scene_export.looks import Glow, Look, Picture
from pbrnet.pipeline.scene_export.outdoors import SKY, Lit, Outdoors, save_sky
from pbrnet.scenes.arrays import AnyArray, Float64Array
from pbrnet.scenes.checked import plain
from pbrnet.scenes.contract import SceneObject
from pbrnet.scenes.errors import MachineError
from pbrnet.scenes.geometry.transforms import frame_along
from pbrnet.scenes.importing.names import numbered
from pbrnet.scenes.models.stated import Statement

_GLASS = 0.1  # opacity of clear glass, which UsdPreviewSurface cannot refract
_POINT = 0.01  # metres: radius of a light without extent
_SUN_ANGLE = 0.5358  # degrees across
_APERTURE = 20.955  # of cameras, in tenths of a unit: the width of 35 mm film
_SKY_POSE = np.array([[-1.0, 0, 0, 0], [0, 0, 1, 0], [0, 1, 0, 0], [0, 0, 0, 1]])
_WRAPS = {"clamp": "clamp", "mirror": "mirror"}


def write_usd(
    lit: Lit, stage: Path, textures: Path, prefix: str, variants: Sequence[Lit] = ()
) -> None:
    """Write the crate file `stage`, its images to the folder `textures`, named `prefix`/NAME.

    `variants` are scenes that differ in light, see `light_variants`: variants of the root. What
    USD cannot say is noted in the `lost` of the scene.
    """
    textures.mkdir(exist_ok=True)
    made = Usd.Stage.CreateNew(str(stage))
    try:
        _Writer(*lit, made, textures, prefix).write(variants)
        made.GetRootLayer().Save()
    except Tf.ErrorException as error:
        raise MachineError(f"{stage}: OpenUSD could not write it ({error})") from None


def write_usdz(lit: Lit, target: Path, work: Path, variants: Sequence[Lit] = ()) -> None:
    """Write the package `target`; `work` is an empty folder for its parts."""
    stage = work / f"{lit[0].scene.scene_id}.usdc"
    write_usd(lit, stage, work / "textures", "textures", variants)
    packed = work / "packed.usdz"
    if not UsdUtils.CreateNewUsdzPackage(Sdf.AssetPath(str(stage)), str(packed)):
        raise MachineError(f"{target}: OpenUSD could not write the package")
    target.write_bytes(packed.read_bytes())


@dataclass
class _Writer:
    content: Content
    outdoors: Outdoors | None
    stage: Any
    textures: Path
    prefix: str
    sky: str = SKY  # name of its image
    _names: dict[str, dict[str, int]] = field(default_factory=dict)
    _materials: dict[int, Any] = field(default_factory=dict)  # made when a shape has them
    _files: dict[Any, str] = field(default_factory=dict)

    def write(self, variants: Sequence[Lit]) -> None:
        UsdGeom.SetStageUpAxis(self.stage, UsdGeom.Tokens.z)
        UsdGeom.SetStageMetersPerUnit(self.stage, 1.0)
        world = UsdGeom.Xform.Define(self.stage, "/World").GetPrim()
        self.stage.SetDefaultPrim(world)
        Usd.ModelAPI(world).SetKind("assembly")
        text = json.dumps(description(self.content, self.outdoors), allow_nan=False)
        self.stage.GetRootLayer().customLayerData = {"pbrnet": text}
        for group in ("Materials", "Objects", "Lights", "Cameras"):
            UsdGeom.Scope.Define(self.stage, f"/World/{group}")
        varied = differing(self.content, [content for content, _ in variants])
        for thing in self.content.scene.objects:
            if thing.id not in varied:
                self._object(thing)
        for piece in self.content.unowned():
            self._shape(piece, "/World/Objects", np.zeros(3))
        for eye in self.content.eyes:
            self._camera(eye)
        if variants:
            self._variants(world, variants, varied)
        else:
            self._lights()

    def _variants(self, world: Any, variants: Sequence[Lit], varied: set[str]) -> None:
        """A variant of the root for each light, with the objects that differ; the last is shown."""
        choice = world.GetVariantSets().AddVariantSet("light")
        for content, outdoors in (*variants, (self.content, self.outdoors)):
            # Images are shared; names of prims are those of this writer.
            names = {key: dict(taken) if key else taken for key, taken in self._names.items()}
            each = replace(self, content=content, outdoors=outdoors, _names=names, _materials={})
            light = Tf.MakeValidIdentifier(content.scene.lighting)
            if content is not self.content:
                each.sky = f"{light}-{SKY}"
            choice.AddVariant(light)
            choice.SetVariantSelection(light)
            with choice.GetVariantEditContext():
                for thing in content.scene.objects:
                    if thing.id in varied:
                        each._object(thing)
                each._lights()

    def _lights(self) -> None:
        for lamp in self.content.lamps:
            self._lamp(lamp)
        self._sky()

    def _path(self, parent: str, name: str) -> str:
        taken = self._names.setdefault(parent, {})
        return f"{parent}/{numbered(Tf.MakeValidIdentifier(name), '_', taken)}"

    def _object(self, thing: SceneObject) -> None:
        low, high = np.array(thing.bbox_min), np.array(thing.bbox_max)
        pivot = np.array([*(0.5 * (low + high))[:2], low[2]])
        path = self._path("/World/Objects", thing.id)
        xform = UsdGeom.Xform.Define(self.stage, path)
        xform.AddTranslateOp().Set(Gf.Vec3d(*pivot.tolist()))
        prim = xform.GetPrim()
        Usd.ModelAPI(prim).SetKind("component")
        prim.AddAppliedSchema("SemanticsLabelsAPI:category")
        label = prim.CreateAttribute("semantics:labels:category", Sdf.ValueTypeNames.TokenArray)
        label.Set(Vt.TokenArray([thing.category]))
        for key, value in labels_of(thing).items():
            prim.SetCustomDataByKey(f"pbrnet:{key}", value)
        for piece in self.content.fixed(thing):
            self._shape(piece, path, pivot)
        for leaf in self.content.leaves.get(thing.id, ()):
            self._leaf(path, leaf, pivot)

    def _leaf(self, path: str, leaf: Leaf, pivot: Float64Array) -> None:
        """The part that a joint moves, as a rigid body, and its joint with the object."""
        joint, at = leaf.joint, np.array(leaf.joint.pivot)
        slides = joint.kind == "slide"
        name = self._path(path, "leaf")
        body = UsdGeom.Xform.Define(self.stage, name)
        body.AddTranslateOp().Set(Gf.Vec3d(*(at - pivot).tolist()))
        UsdPhysics.RigidBodyAPI.Apply(body.GetPrim())
        for moving in leaf.moving:
            self._shape(self.content.pieces[moving], name, at)
        kind = UsdPhysics.PrismaticJoint if slides else UsdPhysics.RevoluteJoint
        made = kind.Define(self.stage, self._path(path, joint.kind))
        made.CreateBody0Rel().SetTargets([Sdf.Path(path)])
        made.CreateBody1Rel().SetTargets([Sdf.Path(name)])
        made.CreateAxisAttr(UsdGeom.Tokens.z)
        made.CreateLowerLimitAttr(joint.limits[0])
        made.CreateUpperLimitAttr(joint.limits[1])
        # Both frames have the joint's axis as their Z; at 0, closed, they are the same.
        along = Gf.Rotation(Gf.Vec3d(0, 0, 1), Gf.Vec3d(*leaf.axis.tolist()))
        closed = Gf.Rotation(Gf.Vec3d(0, 0, 1), 0.0 if slides else -joint.value) * along
        start = at - pivot - (joint.value if slides else 0.0) * leaf.axis
        made.CreateLocalPos0Attr(Gf.Vec3f(*start.tolist()))
        made.CreateLocalRot0Attr(Gf.Quatf(closed.GetQuat()))
        made.CreateLocalPos1Attr(Gf.Vec3f(0))
        made.CreateLocalRot1Attr(Gf.Quatf(along.GetQuat()))

    def _shape(self, piece: Piece, parent: str, pivot: Float64Array) -> None:
        mesh = piece.mesh
        made = UsdGeom.Mesh.Define(self.stage, self._path(parent, piece.id))
        made.GetPrim().SetDisplayName(piece.id)
        if piece.id in self.content.panes:
            for key, value in pane_labels(self.content.panes[piece.id]).items():
                made.GetPrim().SetCustomDataByKey(f"pbrnet:{key}", value)
        points = _vectors(mesh.vertices - pivot)
        made.CreatePointsAttr(Vt.Vec3fArray.FromNumpy(points))
        made.CreateFaceVertexCountsAttr(Vt.IntArray.FromNumpy(np.full(len(mesh.faces), 3, "i4")))
        indices = np.ascontiguousarray(mesh.faces.reshape(-1), "i4")
        made.CreateFaceVertexIndicesAttr(Vt.IntArray.FromNumpy(indices))
        made.CreateSubdivisionSchemeAttr("none")
        made.CreateExtentAttr(Vt.Vec3fArray.FromNumpy(np.stack([points.min(0), points.max(0)])))
        if mesh.normals is not None:
            made.CreateNormalsAttr(Vt.Vec3fArray.FromNumpy(_vectors(mesh.normals)))
            made.SetNormalsInterpolation(UsdGeom.Tokens.vertex)
        if mesh.uvs is not None:
            table = UsdGeom.PrimvarsAPI(made).CreatePrimvar(
                "st", Sdf.ValueTypeNames.TexCoord2fArray, UsdGeom.Tokens.vertex
            )
            table.Set(Vt.Vec2fArray.FromNumpy(_vectors(mesh.uvs * [1, -1] + [0, 1])))
        made.CreateDoubleSidedAttr(self.content.materials[piece.material][1].two_sided)
        binding = UsdShade.MaterialBindingAPI.Apply(made.GetPrim())
        if piece.material not in self._materials:
            made_of = self._material(*self.content.materials[piece.material])
            self._materials[piece.material] = made_of
        binding.Bind(self._materials[piece.material])

    # Materials

    def _material(self, name: str, look: Look, glow: Glow | None) -> Any:
        path = self._path("/World/Materials", name)
        material = UsdShade.Material.Define(self.stage, path)
        stated = _statement(look)
        if stated is not None:
            text = json.dumps(plain(stated, brief=True))
            material.GetPrim().SetCustomDataByKey("pbrnet", text)
        shader = UsdShade.Shader.Define(self.stage, f"{path}/surface")
        shader.CreateIdAttr("UsdPreviewSurface")
        output = shader.CreateOutput("surface", Sdf.ValueTypeNames.Token)
        material.CreateSurfaceOutput().ConnectToSource(output)
        folder = self.content.scene.folder
        self._color(shader, "diffuseColor", look.base, path)
        for key, value in (("roughness", look.roughness), ("metallic", look.metallic)):
            self._number(shader, key, value, path)
        if look.normal is not None:
            texture = self._texture(
                path, "normal", look.normal, pictures.stored_bytes(folder, look.normal), "raw"
            )
            texture.CreateInput("scale", Sdf.ValueTypeNames.Float4).Set(Gf.Vec4f(2, 2, 2, 1))
            texture.CreateInput("bias", Sdf.ValueTypeNames.Float4).Set(Gf.Vec4f(-1, -1, -1, 0))
            _connect(shader, "normal", Sdf.ValueTypeNames.Normal3f, texture, "rgb")
        self._opacity(shader, look, path)
        if look.clearcoat > 0:
            _set(shader, "clearcoat", look.clearcoat)
            _set(shader, "clearcoatRoughness", look.clearcoat_roughness)
        if glow is not None:
            self._emission(shader, glow, path)
        if look.sheen > 0:
            self.content.lost.note("the sheen of cloth is in custom data alone")
        if look.diffuse_transmission > 0:
            self.content.lost.note("thin sheets pass light in custom data alone")
        return material

    def _opacity(self, shader: Any, look: Look, path: str) -> None:
        root = math.sqrt(min(max(0.08 * look.specular, 0.0), 0.99))
        ior = look.ior if look.transmission > 0 else (1 + root) / (1 - root)
        _set(shader, "ior", max(ior, 1.0))
        if look.transmission > 0.5:
            _set(shader, "opacity", _GLASS)
            self.content.lost.note(
                "glass is clear and thin; how it refracts is in custom data alone"
            )
            return
        self._number(shader, "opacity", look.opacity, path)
        if isinstance(look.opacity, Picture):
            band = pictures.grey(self.content.scene.folder, look.opacity)
            if pictures.is_cut(band):
                _set(shader, "opacityThreshold", 0.5)

    def _emission(self, shader: Any, glow: Glow, path: str) -> None:
        kind = Sdf.ValueTypeNames.Color3f
        if glow.image is None:
            shader.CreateInput("emissiveColor", kind).Set(Gf.Vec3f(*glow.color))
            return
        data = (self.content.scene.folder / glow.image.file).read_bytes()
        space = "raw" if glow.image.file.lower().endswith((".exr", ".hdr")) else "sRGB"
        texture = self._texture(path, "emission", glow.image, data, space)
        scale = texture.CreateInput("scale", Sdf.ValueTypeNames.Float4)
        scale.Set(Gf.Vec4f(*glow.color, 1.0))
        _connect(shader, "emissiveColor", kind, texture, "rgb")

    def _color(self, shader: Any, key: str, value: Any, path: str) -> None:
        kind = Sdf.ValueTypeNames.Color3f
        if not isinstance(value, Picture):
            shader.CreateInput(key, kind).Set(Gf.Vec3f(*(float(one) for one in value)))
            return
        data = pictures.color_bytes(self.content.scene.folder, value)
        texture = self._texture(path, key, value, data, "sRGB")
        _connect(shader, key, kind, texture, "rgb")

    def _number(self, shader: Any, key: str, value: float | Picture, path: str) -> None:
        if not isinstance(value, Picture):
            _set(shader, key, min(max(value, 0.0), 1.0))
            return
        data = pictures.png(pictures.grey(self.content.scene.folder, value))
        texture = self._texture(path, key, value, data, "raw")
        _connect(shader, key, Sdf.ValueTypeNames.Float, texture, "r")

    def _texture(self, path: str, key: str, picture: Picture, data: bytes, space: str) -> Any:
        texture = UsdShade.Shader.Define(self.stage, f"{path}/{key}_texture")
        texture.CreateIdAttr("UsdUVTexture")
        file = texture.CreateInput("file", Sdf.ValueTypeNames.Asset)
        file.Set(Sdf.AssetPath(self._stored(picture, data)))
        wrap = _WRAPS.get(picture.wrap, "repeat")
        for name, value in (("wrapS", wrap), ("wrapT", wrap), ("sourceColorSpace", space)):
            texture.CreateInput(name, Sdf.ValueTypeNames.Token).Set(value)
        if picture.nearest:  # UsdUVTexture knows no filter
            texture.GetPrim().SetCustomDataByKey("pbrnet:nearest", True)
        reader = UsdShade.Shader.Define(self.stage, f"{path}/{key}_st")
        reader.CreateIdAttr("UsdPrimvarReader_float2")
        reader.CreateInput("varname", Sdf.ValueTypeNames.String).Set("st")
        if picture.to_uv:
            reader = self._placed(path, key, picture, reader)
        _connect(texture, "st", Sdf.ValueTypeNames.Float2, reader, "result")
        return texture

    def _placed(self, path: str, key: str, picture: Picture, reader: Any) -> Any:
        """UsdTransform2d of an affine map of coordinates: scale, rotate, translate, v upwards."""
        flip = np.array([[1.0, 0, 0], [0, -1, 1], [0, 0, 1]])
        matrix = flip @ np.array([*picture.to_uv, (0.0, 0.0, 1.0)]) @ flip
        (a, b, x), (c, d, y) = matrix[:2]
        sign = 1.0 if a * d - b * c >= 0 else -1.0
        made = UsdShade.Shader.Define(self.stage, f"{path}/{key}_place")
        made.CreateIdAttr("UsdTransform2d")
        kinds = Sdf.ValueTypeNames
        made.CreateInput("rotation", kinds.Float).Set(math.degrees(math.atan2(c, a)))
        scale = Gf.Vec2f(math.hypot(a, c), sign * math.hypot(b, d))
        made.CreateInput("scale", kinds.Float2).Set(scale)
        made.CreateInput("translation", kinds.Float2).Set(Gf.Vec2f(x, y))
        _connect(made, "in", kinds.Float2, reader, "result")
        return made

    def _stored(self, picture: Picture, data: bytes) -> str:
        """The path of an image in the stage; equal images are stored once."""
        if data not in self._files:
            stem, _, suffix = picture.file.rpartition("/")[2].rpartition(".")
            suffix = _suffix(data) or f".{suffix}"
            name = numbered(stem, "_", self._names.setdefault("", {})) + suffix
            (self.textures / name).write_bytes(data)
            self._files[data] = f"./{self.prefix}/{name}"
        return self._files[data]

    # Lights and cameras

    def _lamp(self, lamp: Lamp) -> None:
        strength = max(*lamp.intensity, 1e-12)
        path = self._path("/World/Lights", lamp.name)
        if lamp.kind == "directional":
            light: Any = UsdLux.DistantLight.Define(self.stage, path)
            light.CreateAngleAttr(_SUN_ANGLE)
            light.CreateNormalizeAttr(True)
            light.CreateIntensityAttr(strength)
        else:
            light = UsdLux.SphereLight.Define(self.stage, path)
            light.CreateRadiusAttr(_POINT)
            light.CreateTreatAsPointAttr(True)
            light.CreateIntensityAttr(strength / (math.pi * _POINT**2))
        light.CreateColorAttr(Gf.Vec3f(*(value / strength for value in lamp.intensity)))
        if lamp.kind == "spot":
            shaping = UsdLux.ShapingAPI.Apply(light.GetPrim())
            shaping.CreateShapingConeAngleAttr(math.degrees(lamp.outer))
            shaping.CreateShapingConeSoftnessAttr(1 - lamp.inner / max(lamp.outer, 1e-6))
        _place(light, frame_along(lamp.position, -lamp.direction))

    def _sky(self) -> None:
        if self.outdoors is None:
            return
        if self.outdoors.direction is not None:
            sun = Lamp("directional", SUN, self.outdoors.illuminance, np.zeros(3),
                       self.outdoors.direction)  # fmt: skip
            self._lamp(sun)
        save_sky(self.textures / self.sky, self.outdoors.sky)
        dome = UsdLux.DomeLight.Define(self.stage, self._path("/World/Lights", "sky"))
        dome.CreateTextureFileAttr(Sdf.AssetPath(f"./{self.prefix}/{self.sky}"))
        dome.CreateTextureFormatAttr("latlong")
        dome.CreateIntensityAttr(1.0)
        _place(dome, _SKY_POSE)

    def _camera(self, eye: Eye) -> None:
        camera = UsdGeom.Camera.Define(self.stage, self._path("/World/Cameras", eye.name))
        camera.CreateHorizontalApertureAttr(_APERTURE)
        camera.CreateVerticalApertureAttr(_APERTURE / eye.aspect)
        camera.CreateFocalLengthAttr(0.5 * _APERTURE / math.tan(eye.half_fov_x))
        camera.CreateClippingRangeAttr(Gf.Vec2f(0.01, 10_000.0))
        _place(camera, eye.pose)


def _statement(look: Look) -> Statement | None:
    """Statement of all that UsdPreviewSurface does not say of a material."""
    if look.diffuse_transmission > 0:
        return Statement("principledthin", transmitted=2 * look.diffuse_transmission)
    faint = not isinstance(look.opacity, Picture) and look.opacity < 1
    if look.stated is None and look.transmission <= 0 and (look.sheen > 0 or faint):
        return Statement("principled", sheen=min(look.sheen, 1.0))
    return look.stated


def _place(prim: Any, pose: Float64Array) -> None:
    UsdGeom.Xformable(prim).AddTransformOp().Set(Gf.Matrix4d(pose.T.tolist()))


def _set(shader: Any, name: str, value: float) -> None:
    shader.CreateInput(name, Sdf.ValueTypeNames.Float).Set(float(value))


def _connect(shader: Any, name: str, kind: Any, source: Any, output: str) -> None:
    kinds = {"rgb": Sdf.ValueTypeNames.Float3, "result": Sdf.ValueTypeNames.Float2}
    made = source.CreateOutput(output, kinds.get(output, Sdf.ValueTypeNames.Float))
    shader.CreateInput(name, kind).ConnectToSource(made)


def _vectors(values: AnyArray) -> AnyArray:
    return np.ascontiguousarray(values, "f4")


def _suffix(data: bytes) -> str:
    magics = {b"\x89PNG": ".png", b"\xff\xd8\xff": ".jpg"}
    return next((suffix for magic, suffix in magics.items() if data.startswith(magic)), "")
