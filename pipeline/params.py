"""Parameters of the pipeline: frozen, checked dataclasses, read from `params.yaml`.

Each section is defined beside the code that it controls, and imported when parameters are read.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pbrnet.pipeline.channels import PARTS, SETS, ChannelSet, Kind, kinds_of_sets
from pbrnet.pipeline.lenses.calibration import read_calibration
from pbrnet.pipeline.lenses.settings import calibrated, check_lens
from pbrnet.pipeline.terminal import REMOVED, RENAMED, present
from pbrnet.scenes.checked import build, param, section, shown, within
from pbrnet.scenes.errors import ParameterError
from pbrnet.scenes.files import exists
from pbrnet.scenes.yaml_files import read_yaml

if TYPE_CHECKING:
    from pbrnet.model.settings import BackboneParams, EvaluateParams, TrainParams
    from pbrnet.pipeline.cameras.settings import CameraParams
    from pbrnet.pipeline.dataset.settings import DatasetParams
    from pbrnet.pipeline.farm.settings import FarmParams
    from pbrnet.pipeline.lenses.settings import OpticsParams
    from pbrnet.pipeline.passes.settings import (
        EnvironmentParams,
        GroundTruthParams,
        IlluminationParams,
        LightParams,
        NoisyParams,
        ShadingParams,
    )
    from pbrnet.pipeline.tonemap import ToneParams
    from pbrnet.pipeline.transport.settings import TransportParams
    from pbrnet.pipeline.views import ImageParams
    from pbrnet.scenes.params import AssetParams, SceneParams

MAX_SEED = 2**63 - 1
_PASSES, _NETWORKS = "pbrnet.pipeline.passes.settings", "pbrnet.model.settings"


@dataclass(frozen=True)
class Params:
    """Content of `params.yaml`."""

    seed: int = param(0, "root seed of all random choices", within(0, MAX_SEED))
    channels: tuple[ChannelSet, ...] = param(
        ("paper",), "sets of images, or all; see docs/dataset.md"
    )
    image: ImageParams = section(
        "pbrnet.pipeline.views:ImageParams", "size and projection of frames"
    )
    farm: FarmParams = section(
        "pbrnet.pipeline.farm.settings:FarmParams",
        "distribution over workers; never changes a pixel",
    )
    assets: AssetParams = section("pbrnet.scenes.params:AssetParams", "furniture catalogues")
    scenes: SceneParams = section(
        "pbrnet.scenes.params:SceneParams", "procedural and imported scenes"
    )
    cameras: CameraParams = section(
        "pbrnet.pipeline.cameras.settings:CameraParams", "view sampling after PBRS"
    )
    illumination: IlluminationParams = section(
        f"{_PASSES}:IlluminationParams", "panoramas of visible light sources"
    )
    groundtruth: GroundTruthParams = section(
        f"{_PASSES}:GroundTruthParams", "path-traced shading and colour"
    )
    optics: OpticsParams = section(
        "pbrnet.pipeline.lenses.settings:OpticsParams",
        "lens and shutter of colour, see docs/cameras.md",
    )
    light: LightParams = section(f"{_PASSES}:LightParams", "channel set light")
    transport: TransportParams = section(
        "pbrnet.pipeline.transport.settings:TransportParams", "channel set transport"
    )
    noisy: NoisyParams = section(f"{_PASSES}:NoisyParams", "noisy renders as network inputs")
    environment: EnvironmentParams = section(
        f"{_PASSES}:EnvironmentParams", "panoramas of channel set environment"
    )
    shading: ShadingParams = section(f"{_PASSES}:ShadingParams", "textureless shading")
    tone: ToneParams = section(
        "pbrnet.pipeline.tonemap:ToneParams", "Reinhard's operator as in PBRS"
    )
    dataset: DatasetParams = section(
        "pbrnet.pipeline.dataset.settings:DatasetParams", "packing into shards"
    )
    backbone: BackboneParams = section(
        f"{_NETWORKS}:BackboneParams", "features of the perceptual loss"
    )
    train: TrainParams = section(f"{_NETWORKS}:TrainParams", "training of networks")
    evaluate: EvaluateParams = section(
        f"{_NETWORKS}:EvaluateParams", "evaluation on held-out plans"
    )

    @property
    def kinds(self) -> tuple[Kind, ...]:
        """Kinds of frames that the dataset needs of each view, in rendering order."""
        kinds = kinds_of_sets(self.channels)
        more: tuple[tuple[Kind, int], ...] = (
            ("visibility", self.illumination.shadow_rays if "illumination" in kinds else 0),
            ("noisy", self.noisy.spp),
        )
        return (*kinds, *(kind for kind, wanted in more if wanted))

    def size_of(self, kind: Kind) -> tuple[int, int]:
        """Return (width, height) of frames of a kind."""
        around = {"illumination": self.illumination.width, "environment": self.environment.width}
        width = around.get(kind)
        return (width, width // 2) if width else (self.image.width, self.image.height)

    def calibrated(self) -> Params:
        """Return the parameters with the numbers of the calibration file, if they name one."""
        image = self.image
        if not image.lens.calibration:
            return self
        found = read_calibration(Path(image.lens.calibration), image.lens.camera)
        params = replace(self, image=replace(image, lens=calibrated(image, found)))
        try:
            params.image.verify("image")
            params.verify("")
        except ValueError as error:
            raise ParameterError(f"{image.lens.calibration}: {error}") from None
        return params

    def verify(self, where: str) -> None:
        """Raise ValueError unless `channels` names sets that can be rendered, each once."""
        for index, name in enumerate(self.channels):
            if name != "all" and name not in (*SETS, *PARTS):
                allowed = ", ".join((*SETS, "all", *PARTS))
                raise ValueError(f"channels[{index}]: {name!r} cannot be rendered yet; {allowed}")
        if not self.channels or len(set(self.channels)) < len(self.channels):
            names = list(self.channels)
            raise ValueError(f"channels: {names}; one or more sets are needed, each once")
        if {"light", "all"} & set(self.channels) and not self.groundtruth.joint:
            raise ValueError("channels: light needs groundtruth.joint: true")
        if "light" in self.channels and "color" not in self.kinds:
            raise ValueError("channels: light needs color, or paper")
        if self.cameras.half_fov_x:
            check_lens(replace(self.image, half_fov_x=self.cameras.half_fov_x[1]), "cameras")
        if self.optics.active:
            self._verify_optics()
        if self.image.is_panorama and self.cameras.framing != "paper":
            raise ValueError(
                "cameras.framing: photograph is not for equirectangular images; set "
                "cameras.framing: paper"
            )
        if not self.image.is_pinhole:
            self._verify_lens()

    def _verify_optics(self) -> None:
        """Raise ValueError for what needs colour of a pinhole that stands still."""
        if "light" in self.kinds:
            raise ValueError(
                "channels: light holds parts of sharp colour; set optics.f_number, "
                "optics.exposure and optics.readout to 0"
            )
        if self.optics.f_number and self.image.projection == "orthographic":
            raise ValueError("optics.f_number: orthographic views have no focal length")

    def _verify_lens(self) -> None:
        """Raise ValueError for what views have only through a pinhole."""
        projection = self.image.projection
        missing = ["all", "transport"]
        if projection == "equirectangular":
            missing += ["video", "environment"]
        elif projection == "orthographic":
            missing += ["environment"]
        for name in self.channels:
            if name in missing:
                raise ValueError(
                    f"channels: {name} needs image.projection: perspective without distortion; "
                    f"{projection} views cannot have {', '.join(missing[1:])}"
                )
        if not self.groundtruth.joint:
            raise ValueError(
                "groundtruth.joint: false needs image.projection: perspective without distortion"
            )
        for option in ("half_fov_x", "stereo_baseline", "overlap_views"):
            if self.image.is_panorama and getattr(self.cameras, option):
                raise ValueError(f"cameras.{option}: not with image.projection: equirectangular")
        if projection == "orthographic" and self.cameras.half_fov_x:
            raise ValueError("cameras.half_fov_x: orthographic views have none; see image.lens")


def texture_size_for(width: int) -> int:
    """Return the side of textures for images so many pixels wide: a power of two, 64 to 4096.

    The least that is 1.6 times the width or more: a wall that fills the view then has about as
    many texels as pixels.
    """
    return min(4096, max(64, 1 << max(0, math.ceil(math.log2(1.6 * width)))))


def _rename(data: Any) -> None:
    """Replace old names in the content of a parameter file, in place, each within its section."""
    for old in (*RENAMED, *REMOVED):
        *sections, key = old.split(".")
        place = data
        for name in sections:
            place = place.get(name) if isinstance(place, dict) else None
        if isinstance(place, dict) and key in place:
            place.setdefault(present(old).rpartition(".")[2], place.pop(key))


def build_params(data: Any) -> Params:
    """Return the parameters in the content of a parameter file; raises `ParameterError`.

    `scenes.texture_size: auto` and `image.lens.calibration` become numbers here, so that all else
    sees numbers only.
    """
    _rename(data)
    scenes = data.get("scenes", {}) if isinstance(data, dict) else None
    if not isinstance(scenes, dict) or scenes.get("texture_size", "auto") != "auto":
        return build(Params, data).calibrated()
    known = {name: value for name, value in scenes.items() if name != "texture_size"}
    params = build(Params, {**data, "scenes": known}).calibrated()
    size = texture_size_for(params.image.width)
    return replace(params, scenes=replace(params.scenes, texture_size=size))


def load_params(path: Path, seed: int | None = None) -> Params:
    """Read and check a parameter file; `seed`, if given, overrides its root seed.

    Raises `ParameterError` that names file, key, value and what is allowed.
    """
    if not exists(path):
        raise ParameterError(f"{path}: no such parameter file; write one with: pbrnet preset quick")
    try:
        params = build_params(read_yaml(path) or {})
    except ParameterError as error:
        raise ParameterError(f"{path}: {str(error).removeprefix(f'{path}: ')}") from None
    if seed is None:
        return params
    if not 0 <= seed <= MAX_SEED:
        raise ParameterError(f"--seed: {shown(seed)} is not allowed; must be from 0 to {MAX_SEED}")
    return replace(params, seed=seed)
