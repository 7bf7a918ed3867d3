"""Table of image channels: every image of a view, in its frame and in the dataset.

Frame layouts, dataset columns, their cells, the checks, the dataset card and `pbrnet inspect`
follow from `CHANNELS`. Add a channel here, and its renderer in the pass that renders its kind.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np

Kind = Literal[
    "inputs",
    "illumination",
    "visibility",
    "shading",
    "color",
    "noisy",
    "materials",
    "labels",
    "video",
    "environment",
    "light",
    "transport",
]
KINDS: tuple[Kind, ...] = get_args(Kind)
ChannelSet = Literal[
    "paper", "materials", "light", "labels", "environment", "video", "transport", "all"
]
# Kinds of frames of each set of the parameter `channels`; `all` stands for every set.
SETS: dict[ChannelSet, tuple[Kind, ...]] = {
    "paper": ("inputs", "illumination", "shading", "color"),
    "materials": ("materials",),
    "labels": ("labels",),
    "video": ("video",),
    "environment": ("environment",),
    "light": ("light",),
    "transport": ("transport",),
}

RGB = ("R", "G", "B")
NORMAL = ("N.X", "N.Y", "N.Z")
ALBEDO = ("albedo.R", "albedo.G", "albedo.B")
TINT = ("tint.R", "tint.G", "tint.B")
NOISY_SHADING = ("shading.R", "shading.G", "shading.B")
SPECULAR = ("specular.R", "specular.G", "specular.B")
BUMPED = ("bumped.X", "bumped.Y", "bumped.Z")
HALF = ("half.R", "half.G", "half.B")
DENOISED = ("denoised.R", "denoised.G", "denoised.B")
DENOISED_SHADING = ("denoised.shading.R", "denoised.shading.G", "denoised.shading.B")
# Of each direction in time: flow along columns and rows, occlusion, and outside of the image.
VIDEO_BANDS = {
    way: (f"{way}.X", f"{way}.Y", f"{way}.occluded", f"{way}.outside")
    for way in ("forward", "backward")
}
DIRECT = ("direct.R", "direct.G", "direct.B")
DIFFUSE = ("diffuse.R", "diffuse.G", "diffuse.B")
IRRADIANCE = ("irradiance.R", "irradiance.G", "irradiance.B")
TRANSPORT_DIRECT = ("direct.R", "direct.G", "direct.B")
TRANSPORT_INDIRECT = ("indirect.R", "indirect.G", "indirect.B")

RADIANCE = "W/(m^2 sr), relative"
_FEW = "path traced with few samples, independent of"
_SPHERE = "The same panorama:"
_NEXT, _LAST = "next frame of the trajectory", "previous frame of the trajectory"


@dataclass(frozen=True)
class Channel:
    """One image of a view.

    `name` is the dataset column, `kind` the frame that holds the image, `bands` its EXR channels
    there, each (H, W) of the NumPy type `dtype`. `description` and `unit` are published with the
    dataset. A view is rejected if a `nonnegative` channel holds a value below 0.
    """

    name: str
    kind: Kind
    bands: tuple[str, ...]
    dtype: type
    description: str
    unit: str = ""
    nonnegative: bool = False
    mask: bool = False  # 0 or 1, in the dataset a uint8
    in_dataset: bool = True  # False: in the frame only
    derived: bool = False  # in the dataset only: computed from other channels when it is packed

    @property
    def dataset_dtype(self) -> type:
        """NumPy type of the dataset's column; torch lacks most operations on unsigned integers."""
        if self.mask:
            return np.uint8
        return np.int32 if self.dtype is np.uint32 else self.dtype

    @property
    def is_panorama(self) -> bool:
        """True for images over the sphere, False for those in the camera's image plane."""
        return self.kind in ("illumination", "environment")

    @property
    def shape(self) -> tuple[int, ...]:
        """Shape of a pixel's value: () or (bands,); derived channels are RGB."""
        count = 3 if self.derived else len(self.bands)
        return (count,) if count > 1 else ()


def _video(way: str, neighbour: str) -> tuple[Channel, ...]:
    """Return flow, occlusion and outside towards a neighbour in a trajectory."""
    flow, occluded, outside = VIDEO_BANDS[way][:2], VIDEO_BANDS[way][2:3], VIDEO_BANDS[way][3:]
    return (
        Channel(
            f"flow_{way}",
            "video",
            flow,
            np.float32,
            f"Optical flow to the {neighbour}: where the surface point moves, columns right, rows "
            "down; 0: no such frame, or behind its camera.",
            "pixel",
        ),
        Channel(
            f"occluded_{way}",
            "video",
            occluded,
            np.float16,
            f"1 where the surface point lies in the image of the {neighbour} but is hidden there.",
            mask=True,
        ),
        Channel(
            f"outside_{way}",
            "video",
            outside,
            np.float16,
            f"1 where the surface point lies outside the image of the {neighbour}, or there is "
            "none.",
            mask=True,
        ),
    )


CHANNELS = (
    Channel(
        "depth",
        "inputs",
        ("Z",),
        np.float32,
        "Distance along the optical axis (z-depth, not ray distance); 0: no surface.",
        "metre",
        nonnegative=True,
    ),
    Channel(
        "normal",
        "inputs",
        NORMAL,
        np.float16,
        "Unit surface normal facing the camera, in camera axes: x right, y down, z forward.",
    ),
    Channel("reflectance", "inputs", ALBEDO, np.float16, "Linear RGB base colour, 0 to 1."),
    Channel(
        "valid", "inputs", ("valid",), np.float16, "1 where a surface is seen, else 0.", mask=True
    ),
    Channel(
        "object",
        "inputs",
        ("object",),
        np.uint32,
        "Index + 1 into the objects of scene.json; 0: none.",
        in_dataset=False,
    ),
    Channel(
        "intensity",
        "illumination",
        ("intensity.Y",),
        np.float32,
        "Equirectangular panorama in the camera's frame, centre column straight ahead, top "
        "row up: Rec. 709 luminance of the light source visible there; 0: none.",
        RADIANCE,
        nonnegative=True,
    ),
    Channel(
        "distance",
        "illumination",
        ("distance.Z",),
        np.float32,
        f"{_SPHERE} distance to that light source, for the sky to the window; 0: none.",
        "metre",
        nonnegative=True,
    ),
    Channel(
        "tint",
        "illumination",
        TINT,
        np.float16,
        f"{_SPHERE} the light's colour, linear RGB of luminance 1; 0: none. The paper has no such "
        "input.",
        nonnegative=True,
    ),
    Channel(
        "shading",
        "shading",
        RGB,
        np.float16,
        "Linear HDR RGB, path traced with every colour and texture replaced by one grey.",
        RADIANCE,
        nonnegative=True,
    ),
    Channel(
        "color",
        "color",
        RGB,
        np.float16,
        "Linear HDR RGB, path traced full scene.",
        RADIANCE,
        nonnegative=True,
    ),
    Channel(
        "visibility",
        "visibility",
        ("visibility.Y",),
        np.float16,
        "Share of the direct light of the panorama's sources that reaches the surface, by shadow "
        "rays; 1 where there is none. The paper has no such input.",
    ),
    Channel(
        "noisy_color",
        "noisy",
        RGB,
        np.float16,
        f"Linear HDR RGB, {_FEW} color's; unbiased.",
        RADIANCE,
        nonnegative=True,
    ),
    Channel(
        "noisy_shading",
        "noisy",
        NOISY_SHADING,
        np.float16,
        f"Linear HDR RGB, {_FEW} shading's; of the same paths as noisy_color.",
        RADIANCE,
        nonnegative=True,
    ),
    Channel(
        "noisy_half",
        "noisy",
        HALF,
        np.float16,
        "Linear HDR RGB: noisy_color of half of its samples, rounded down; its difference from "
        "noisy_color tells the noise. With one sample noisy_color itself.",
        RADIANCE,
        nonnegative=True,
    ),
    Channel(
        "denoised_color",
        "noisy",
        DENOISED,
        np.float16,
        "Linear HDR RGB: noisy_color through Intel's Open Image Denoise.",
        RADIANCE,
        nonnegative=True,
    ),
    Channel(
        "denoised_shading",
        "noisy",
        DENOISED_SHADING,
        np.float16,
        "Linear HDR RGB: noisy_shading through Intel's Open Image Denoise.",
        RADIANCE,
        nonnegative=True,
    ),
    Channel(
        "roughness",
        "materials",
        ("roughness",),
        np.float16,
        "Perceptual roughness as in glTF, the square root of the microfacet width alpha, 0 to 1; "
        "1: Lambertian.",
        nonnegative=True,
    ),
    Channel(
        "metalness",
        "materials",
        ("metalness",),
        np.float16,
        "Share of the metallic lobe, 0 to 1.",
        nonnegative=True,
    ),
    Channel(
        "specular_color",
        "materials",
        SPECULAR,
        np.float16,
        "Linear RGB reflectance at normal incidence (F0) of the specular lobe, 0 to 1; 0: none.",
        nonnegative=True,
    ),
    Channel(
        "normal_bump",
        "materials",
        BUMPED,
        np.float16,
        "As normal, with bump and normal maps.",
    ),
    Channel(
        "emission",
        "materials",
        ("emission",),
        np.float16,
        "1 where the surface emits light to the camera, else 0.",
        mask=True,
    ),
    Channel(
        "material",
        "materials",
        ("material",),
        np.uint32,
        "Index + 1 into material_names; 0: none.",
    ),
    Channel(
        "material_known",
        "materials",
        ("material_known",),
        np.float16,
        "1 where roughness, metalness and specular_color are known, else 0: no surface, or a "
        "material that cannot say them.",
        mask=True,
    ),
    Channel(
        "instance",
        "labels",
        ("instance",),
        np.uint32,
        "Object of scene.json, its index + 1, which instances describes; 0: none.",
    ),
    Channel(
        "category",
        "labels",
        ("category",),
        np.uint32,
        "Category of the object, a number that the schema's table `category` names; 0: none.",
    ),
    Channel("nyu40", "labels", ("nyu40",), np.uint32, "NYU40 class of the category; 0: none."),
    Channel("nyu13", "labels", ("nyu13",), np.uint32, "Class of NYU40's 13-class map; 0: none."),
    Channel(
        "material",
        "labels",
        ("material",),
        np.uint32,
        "Index + 1 into material_names; 0: none.",
    ),
    *_video("forward", _NEXT),
    *_video("backward", _LAST),
    Channel(
        "environment",
        "environment",
        RGB,
        np.float32,
        "Equirectangular panorama in the camera's frame, centre column straight ahead, top row up: "
        "linear HDR RGB of all that the camera position sees, path traced; rounded to the "
        "precision of half floats.",
        RADIANCE,
        nonnegative=True,
    ),
    Channel(
        "environment_depth",
        "environment",
        ("distance.Z",),
        np.float32,
        f"{_SPHERE} distance along the ray through the pixel's centre, not z-depth; 0: no surface.",
        "metre",
        nonnegative=True,
    ),
    Channel(
        "environment_normal",
        "environment",
        NORMAL,
        np.float16,
        f"{_SPHERE} unit surface normal facing the camera, in camera axes: x right, y down, z "
        "forward; 0: no surface.",
    ),
    Channel(
        "direct",
        "light",
        DIRECT,
        np.float16,
        "Part of color: light scattered at most once, lamps that are seen included. Mirrors and "
        "clear glass show direct light, too.",
        RADIANCE,
        nonnegative=True,
    ),
    Channel(
        "indirect",
        "light",
        (),
        np.float16,
        "Part of color: light scattered more often. direct + indirect = color.",
        RADIANCE,
        derived=True,
    ),
    Channel(
        "diffuse",
        "light",
        DIFFUSE,
        np.float16,
        "Part of color: light that the surface seen reflects by its diffuse lobes.",
        RADIANCE,
        nonnegative=True,
    ),
    Channel(
        "specular",
        "light",
        (),
        np.float16,
        "Part of color: all other light, on lamps and in the sky their own. diffuse + specular = "
        "color.",
        RADIANCE,
        derived=True,
    ),
    Channel(
        "irradiance",
        "light",
        IRRADIANCE,
        np.float32,
        "Diffuse light over the reflectance: irradiance / pi, as the diffuse lobes see it; 0 "
        "where they reflect nothing.",
        RADIANCE,
        nonnegative=True,
    ),
    Channel(
        "residual",
        "light",
        (),
        np.float32,
        "What is left of color; negative where a pixel's centre is brighter than the pixel. "
        "reflectance x irradiance + residual = color.",
        RADIANCE,
        derived=True,
    ),
    Channel(
        "transport_direct",
        "transport",
        TRANSPORT_DIRECT,
        np.float16,
        "Direct light of all sources on the surface, computed without paths: irradiance / pi, "
        "linear RGB, without the surface's reflectance; 0: no surface.",
        RADIANCE,
        nonnegative=True,
    ),
    Channel(
        "transport_indirect",
        "transport",
        TRANSPORT_INDIRECT,
        np.float16,
        "Indirect light on the surface by radiosity; as transport_direct.",
        RADIANCE,
        nonnegative=True,
    ),
    Channel(
        "transport_color",
        "transport",
        RGB,
        np.float16,
        "Linear HDR RGB, picture from transport_direct and transport_indirect: what the surface "
        "reflects of them, gloss, mirrors, lamps and sky.",
        RADIANCE,
        nonnegative=True,
    ),
)


def channels_of(*kinds: str) -> tuple[Channel, ...]:
    """Return the channels of these kinds of frames, in the order of the table."""
    return tuple(c for c in CHANNELS if c.kind in kinds and not c.derived)


def dataset_channels(kinds: Sequence[str]) -> tuple[Channel, ...]:
    """Return the channels of these kinds that are columns of the dataset.

    An image that two kinds of frames hold (`material`) is a column once, from the first.
    """
    columns: dict[str, Channel] = {}
    for channel in CHANNELS:
        if channel.kind in kinds and channel.in_dataset:
            columns.setdefault(channel.name, channel)
    return tuple(columns.values())


def kinds_of_sets(sets: Sequence[ChannelSet]) -> tuple[Kind, ...]:
    """Return the kinds of frames of these sets and of `paper`, in the order of `SETS`."""
    chosen = [name for name in SETS if name == "paper" or name in sets or "all" in sets]
    return tuple(dict.fromkeys(kind for name in chosen for kind in SETS[name]))


def layout(kind: str, lights: int = 0) -> dict[str, type]:
    """Return the NumPy type of each EXR channel of a kind of frame.

    `lights` is the number of light groups that a `light` frame holds.
    """
    bands = {band: channel.dtype for channel in channels_of(kind) for band in channel.bands}
    return bands | {band: np.float16 for number in range(lights) for band in light_bands(number)}


def light_bands(number: int) -> tuple[str, ...]:
    """Return the EXR channels of a light group."""
    return tuple(f"light{number:02d}.{band}" for band in RGB)
