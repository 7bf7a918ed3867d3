"""Rooms with every material that scenes use, and images of them from two ways of tracing."""

from __future__ import annotations

import io
from pathlib import Path
from typing import Any

import mitsuba as mi
import numpy as np
from PIL import Image

from pipeline.passes.groundtruth import _integrator
from pipeline.pathtrace import integrator as joint
from pipeline.pathtrace.light_sampling import PlannedLights, UniformLights
from pipeline.render.scene import RenderScene, open_scene
from pipeline.render.sensors import make_sensor
from pipeline.views import View
from tests.render_fixtures import ball, diffuse, make_view, quad, room_walls, write_scene

ALBEDO = 0.5
MAX_DEPTH = 6
SPACING, RADIUS, DISTANCE = 0.62, 0.28, 3.0  # metres
CELL = 12  # pixels from ball to ball


def rgb(name: str, value: str) -> str:
    """A colour property."""
    return f'<rgb name="{name}" value="{value}"/>'


def number(name: str, value: float) -> str:
    """A float property."""
    return f'<float name="{name}" value="{value}"/>'


def bsdf(kind: str, inside: str = "") -> str:
    """A material."""
    return f'<bsdf type="{kind}">{inside}</bsdf>'


def bitmap(name: str, file: str, raw: bool = False) -> str:
    """A texture."""
    linear = '<boolean name="raw" value="true"/>' if raw else ""
    return (
        f'<texture type="bitmap" name="{name}"><string name="filename" value="textures/{file}"/>'
        f"{linear}</texture>"
    )


def png(pixels: np.ndarray) -> bytes:
    """An 8-bit PNG of (H, W, 3) in [0, 1]."""
    stream = io.BytesIO()
    Image.fromarray((pixels * 255).astype(np.uint8)).save(stream, "PNG")
    return stream.getvalue()


def _textures() -> dict[str, bytes]:
    rows, columns = np.indices((16, 32))
    checks = ((rows // 4 + columns // 4) % 2)[..., None]
    waves = 0.5 + 0.5 * np.sin(columns)[..., None].repeat(3, axis=-1)
    slope = 0.3 * np.cos(columns)
    normals = np.stack([slope, 0 * slope, np.sqrt(1 - slope**2)], axis=-1)
    return {
        "textures/checks.png": png(checks * np.array([0.9, 0.5, 0.2])),  # half of it is black
        "textures/black.png": png(np.zeros((4, 4, 3))),
        "textures/waves.png": png(waves),
        "textures/normals.png": png(0.5 + 0.5 * normals),
    }


TEXTURES = _textures()
RED = rgb("reflectance", "0.8,0.1,0.05")
COPPER = '<string name="material" value="Cu"/>'
BENT = bsdf("roughconductor", '<string name="material" value="Au"/>' + number("alpha", 0.2))

# Twins that choose every direction as the original does: with the same random numbers, and no
# roulette, both images are those of two separate renders.
FAITHFUL = {
    "diffuse": bsdf("diffuse", RED),
    "texture": bsdf("diffuse", bitmap("reflectance", "checks.png")),
    "black texture": bsdf("diffuse", bitmap("reflectance", "black.png")),
    "principled": bsdf(
        "principled",
        bitmap("base_color", "checks.png")
        + number("roughness", 0.3)
        + number("metallic", 0.4)
        + number("clearcoat", 0.8)
        + number("sheen", 0.5)
        + number("sheen_tint", 0.8),
    ),
    "principled glass": bsdf(
        "principled",
        rgb("base_color", "0.9,0.4,0.3") + number("spec_trans", 0.8) + number("roughness", 0.2),
    ),
    "principled pane": bsdf(
        "principledthin",
        rgb("base_color", "0.4,0.7,0.3") + number("spec_trans", 0.5) + number("diff_trans", 0.6),
    ),
    "gold": bsdf("conductor", '<string name="material" value="Au"/>'),
    "mirror": bsdf("conductor", '<string name="material" value="none"/>'),
    "rough copper": bsdf("roughconductor", COPPER + number("alpha", 0.3)),
    "glass": bsdf("dielectric", rgb("specular_transmittance", "0.9,0.5,0.3")),
    "pane": bsdf("thindielectric", rgb("specular_transmittance", "0.3,0.6,0.9")),
    "rough glass": bsdf(
        "roughdielectric", number("alpha", 0.2) + rgb("specular_transmittance", "0.9,0.5,0.3")
    ),
    "mask": bsdf("mask", bitmap("opacity", "waves.png", raw=True) + bsdf("diffuse", RED)),
    "blend": bsdf(
        "blendbsdf", bitmap("weight", "waves.png", raw=True) + bsdf("diffuse", RED) + BENT
    ),
    "bumps": bsdf(
        "bumpmap", bitmap("", "waves.png", raw=True).replace(' name=""', "") + bsdf("diffuse", RED)
    ),
    "normals": bsdf("normalmap", bitmap("normalmap", "normals.png", raw=True) + BENT),
    "two sides": bsdf("twosided", bsdf("diffuse", RED) + bsdf("roughconductor", COPPER)),
    "null": bsdf("null"),
}
# Twins whose choice of a lobe differs, since it goes by how bright the colours are.
DARK = rgb("diffuse_reflectance", "0.15,0.02,0.05")
PARTING = {
    "plastic": bsdf("plastic", DARK),
    "bright plastic": bsdf("plastic", rgb("diffuse_reflectance", "0.9,0.85,0.3")),
    "black plastic": bsdf("plastic", rgb("diffuse_reflectance", "0")),
    "textured plastic": bsdf("plastic", bitmap("diffuse_reflectance", "checks.png")),
    "rough plastic": bsdf("roughplastic", DARK + number("alpha", 0.2)),
    "polarized plastic": bsdf("pplastic", DARK + number("alpha", 0.2)),
    "tinted gloss": bsdf(
        "principled",
        rgb("base_color", "0.1,0.7,0.1") + number("spec_tint", 0.9) + number("roughness", 0.3),
    ),
    "masked plastic": bsdf("mask", number("opacity", 0.6) + bsdf("plastic", DARK)),
    "blended plastic": bsdf("blendbsdf", number("weight", 0.5) + bsdf("plastic", DARK) + BENT),
    "coated plastic": bsdf("twosided", bsdf("normalmap", bitmap("normalmap", "normals.png", True)
                           + bsdf("roughplastic", DARK + number("alpha", 0.1)))),
}  # fmt: skip


def shelf(
    folder: Path, materials: dict[str, str], wide: bool = False, more: str = ""
) -> tuple[RenderScene, View, dict[str, Any]]:
    """A room with a ball of each material; its view, and by the material's name the pixels (H, W)
    of its ball, and of the "room" around them.

    It is lit by a lamp, a bulb and a window, or by a `wide` lamp, which both ways of sampling find.
    `more` stands there, too.
    """
    focal = CELL / SPACING * DISTANCE
    columns = int(np.ceil(np.sqrt(len(materials) * 4 / 3)))
    rows = -(-len(materials) // columns)
    walls, _ = room_walls(diffuse("0.8,0.7,0.4"), window=True)
    lamp = f'{diffuse(0)}<emitter type="area">{rgb("radiance", "6,5,3")}</emitter>'
    half = (1.6, 0.8) if wide else (0.6, 0.4)
    body = walls + quad("lamp", (0, -1, 2.95), (0, 0, -1), half, lamp, (0, 1, 0))
    if not wide:
        body += (
            '<emitter type="point"><point name="position" x="-1.5" y="-1" z="2"/>'
            + rgb("intensity", "0.3,0.5,0.7")
            + '</emitter><emitter type="constant">'
            + rgb("radiance", "1,1.5,2")
            + "</emitter>"
        )
    view = make_view((0, -1.8, 1.5), size=(CELL * columns, CELL * rows), focal=focal)
    rays = np.stack(np.meshgrid(np.arange(view.width), np.arange(view.height)), axis=-1) + 0.5
    regions: dict[str, Any] = {}
    for index, (name, material) in enumerate(materials.items()):
        x = SPACING * (index % columns - (columns - 1) / 2)
        z = SPACING * (index // columns - (rows - 1) / 2)
        body += ball(f"ball{index}", (x, DISTANCE - 1.8, 1.5 + z), RADIUS, material)
        centre = np.array([view.width / 2, view.height / 2]) + CELL / SPACING * np.array([x, -z])
        regions[name] = np.linalg.norm(rays - centre, axis=-1) < 0.9 * CELL / SPACING * RADIUS
    regions["room"] = ~np.any(list(regions.values()), axis=0)
    scene = write_scene(folder / "shelf", body + more, files=TEXTURES)
    return open_scene(scene), view, regions


def plain(
    scene: RenderScene, view: View, albedo: float | None, rr: int, spp: int, copies: int, seed: int
) -> np.ndarray:
    """Independent images by Mitsuba's `path`, float64 (copies, H, W, 3)."""
    integrator = _integrator(MAX_DEPTH, rr)
    return _images(scene.neutral(albedo).mitsuba, integrator, view, spp, copies, seed)


def joined(
    scene: RenderScene,
    view: View,
    rr: int,
    spp: int,
    copies: int,
    seed: int,
    kind: type[joint.JointPath] = joint.JointPath,
    lights: UniformLights | PlannedLights | None = None,
) -> tuple[np.ndarray, np.ndarray]:
    """Independent pairs of images by the joint trace: colour and neutral, as `plain` gives them."""
    path = kind(joint.twin_table(scene.twins(ALBEDO)), MAX_DEPTH, rr, lights or UniformLights())
    images = _images(scene.mitsuba, path.integrator(), view, spp, copies, seed)
    return images[..., :3], images[..., 3:]


def _images(
    scene: Any, integrator: Any, view: View, spp: int, copies: int, seed: int
) -> np.ndarray:
    launch = mi.render(
        scene, sensor=make_sensor(view, copies), integrator=integrator, spp=spp, seed=seed
    )
    pixels = np.asarray(launch, dtype=np.float64)
    return np.moveaxis(pixels.reshape(view.height, copies, view.width, -1), 1, 0)


def region_means(images: np.ndarray, regions: dict[str, Any]) -> np.ndarray:
    """Mean of each region in each image and band, (copies, regions, 3)."""
    return np.stack([images[:, pixels].mean(axis=1) for pixels in regions.values()], axis=1)


def deviations(ours: np.ndarray, theirs: np.ndarray) -> np.ndarray:
    """Difference of two estimates in standard errors, from independent (copies, regions, 3)."""
    variance = sum(each.var(axis=0, ddof=1) / len(each) for each in (ours, theirs))
    gap = ours.mean(axis=0) - theirs.mean(axis=0)
    return np.where(variance > 0, gap / np.sqrt(np.maximum(variance, 1e-30)), gap * 1e6)
