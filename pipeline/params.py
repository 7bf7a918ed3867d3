"""Parameters of the pipeline: frozen, checked dataclasses, read from `params.yaml`."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Literal

import yaml

from pbrnet.pipeline.channels import SETS, ChannelSet
from pbrnet.scenes.checked import OPTIONAL, build, shown, within
from pbrnet.scenes.errors import InputError, ParameterError
from pbrnet.scenes.files import exists, regular_file
from pbrnet.scenes.params import AssetParams, SceneParams

_MAX_BYTES = 2**20  # of a parameter file
MAX_SEED = 2**63 - 1
Variant = Literal["auto", "llvm_ad_rgb", "cuda_ad_rgb", "scalar_rgb"]
# Baselines of the comparison; `_own`: trained with the loss of its own paper.
Baseline = Literal[
    "plus",
    "hybrid",
    "unet",
    "end_to_end",
    "can",
    "can_own",
    "pix2pix",
    "pix2pix_own",
    "cyclegan",
    "cyclegan_own",
]
Projection = Literal["perspective", "equirectangular"]


@dataclass(frozen=True)
class ImageParams:
    """Projection and size of every frame.

    The field of view follows PBRS at 4:3 (half-angle in x is fixed); an equirectangular image shows
    all directions, and `half_fov_x` is not used.
    """

    width: int = field(default=160, metadata=within(16, 8192))
    height: int = field(default=120, metadata=within(16, 8192))
    half_fov_x: float = field(default=0.5534, metadata=within(0.05, 1.4))  # radians
    projection: Projection = field(default="perspective", metadata=OPTIONAL)

    @property
    def is_panorama(self) -> bool:
        """True if images show all directions."""
        return self.projection == "equirectangular"

    def verify(self, where: str) -> None:
        """Raise ValueError for an equirectangular image that is not twice as wide as high."""
        if self.is_panorama and self.width != 2 * self.height:
            raise ValueError(
                f"{where}: {self.width} x {self.height} pixels; with projection: equirectangular "
                "the width is twice the height"
            )


@dataclass(frozen=True)
class FarmParams:
    """Distribution of the work over dask workers; never changes a pixel."""

    workers: int = field(default=0, metadata=within(0, 4096))  # 0: one per allowed CPU
    batch: int = field(default=8, metadata=within(1, 1024))  # views of one scene per task
    window: int = field(default=2, metadata=within(1, 64))  # tasks in flight per worker
    retries: int = field(default=2, metadata=within(0, 10))  # further attempts for a failing view
    time_limit: int = field(
        default=3600, metadata=within(0, 1_000_000)
    )  # seconds per view; 0: none
    recycle: int = field(default=100, metadata=within(0, 1_000_000))  # scenes per process; 0: any
    checksums: bool = True  # compare the pixels of frames that are kept with their checksums
    # scenes and frames in the shared data folder, through dask, or chosen for each worker
    transfer: Literal["auto", "shared", "send"] = "auto"
    cache_mb: int = field(default=4096, metadata=within(1, 1 << 30))  # received scenes, per machine
    variant: Variant = "auto"


@dataclass(frozen=True)
class TrajectoryFile:
    """A file of camera poses, see `cameras.trajectory_files`, and the scene's id."""

    scene: str
    file: str


@dataclass(frozen=True)
class RoomShare:
    """Share of the rooms of a type that get views, drawn for each room by itself."""

    type: str
    share: float = field(default=1.0, metadata=within(0, 1))


@dataclass(frozen=True)
class CameraParams:
    """View sampling after PBRS (Zhang et al. 2017), with a clearance test."""

    views_per_room: int = field(default=2, metadata=within(1, 64))
    views_per_scene: int = field(default=8, metadata=within(1, 1024))
    grid: float = field(default=0.25, metadata=within(0.05, 5))  # metres, jittered in the cell
    eye_height: float = field(default=1.55, metadata=within(0.2, 3))  # metres above the floor
    eye_jitter: float = field(default=0.05, metadata=within(0, 1.5))  # metres up and down
    tilt: float = field(default=-0.2, metadata=within(-2, 2))  # towards.z before normalising
    # ranges in radians, drawn evenly: [least, most]; empty: image.half_fov_x, the pitch that
    # `tilt` gives, and no roll
    half_fov_x: tuple[float, ...] = field(default=(), metadata=within(0.05, 1.4))
    pitch: tuple[float, ...] = field(default=(), metadata=within(-1.4, 1.4))  # above the horizon
    roll: tuple[float, ...] = field(default=(), metadata=within(-math.pi, math.pi))  # clockwise
    sectors: int = field(default=6, metadata=within(1, 36))
    min_objects: int = field(default=3, metadata=within(0, 100))
    min_coverage: float = field(default=0.01, metadata=within(0, 1))  # of the pixels, per object
    min_score: float = field(default=0.0, metadata=within(0))
    clearance: float = field(default=0.10, metadata=within(0, 2))  # metres around the eye
    # a view is blocked if more than `max_near` of it is nearer than `near` metres
    near: float = field(default=0.8, metadata=within(0, 10))
    max_near: float = field(default=0.2, metadata=within(0, 1))
    # least share of the counted objects that must be in the camera's own room
    min_own: float = field(default=0.5, metadata=within(0, 1))
    # largest share of furniture pixels that two views of one room may have in common
    max_alike: float = field(default=0.6, metadata=within(0, 1))
    stored_views: bool = True  # keep the cameras that imported scenes bring with them
    outside_views: bool = False  # also those of them that are in no room
    # id render: width of the candidate images in pixels, and candidates per room and sector
    id_width: int = field(default=80, metadata=within(16, 640))
    candidates: int = field(default=12, metadata=within(1, 4096))
    # walks per scene, frames of each, and the most metres and radians from frame to frame
    walks: int = field(default=0, metadata=within(0, 64) | OPTIONAL)
    walk_frames: int = field(default=24, metadata=within(24, 240) | OPTIONAL)
    walk_step: float = field(default=0.06, metadata=within(0.005, 0.5) | OPTIONAL)
    walk_turn: float = field(default=0.05, metadata=within(0.005, 0.5) | OPTIONAL)
    # paper: PBRS' rule alone; photograph: no blank wall, lamp or object that fills the view, and a
    # subject on a third is better; see docs/cameras.md
    framing: Literal["paper", "photograph"] = field(default="paper", metadata=OPTIONAL)
    # balance of room types: of types that are not named, every room gets views
    room_shares: tuple[RoomShare, ...] = field(default=(), metadata=OPTIONAL)
    # metres from each view to a partner on its right; 0: none
    stereo_baseline: float = field(default=0.0, metadata=within(0, 2) | OPTIONAL)
    # views of the overlapping set of each room, 0: none, and least median overlap of their pairs
    overlap_views: int = field(default=0, metadata=within(0, 16) | OPTIONAL)
    overlap: float = field(default=0.5, metadata=within(0.05, 0.95) | OPTIONAL)
    # the same cameras in all scenes of a plan, where they have room
    share_cameras: bool = field(default=False, metadata=OPTIONAL)
    # trajectories from files, in the world of the scene that each names
    trajectories: tuple[TrajectoryFile, ...] = field(default=(), metadata=OPTIONAL)
    # what becomes of such a trajectory where frames touch or pass surfaces: left out, or kept and
    # reported, or kept unchecked
    collisions: Literal["reject", "warn", "accept"] = field(default="warn", metadata=OPTIONAL)

    def share_of(self, room_type: str) -> float:
        """Return the share of the rooms of a type that get views."""
        return next((each.share for each in self.room_shares if each.type == room_type), 1.0)

    @property
    def most_views(self) -> int:
        """Most views of a scene, without overlapping sets, trajectories and stored cameras."""
        views = self.views_per_scene + self.walks * self.walk_frames
        return 2 * views if self.stereo_baseline else views

    @property
    def has_links(self) -> bool:
        """True if some views belong together: in trajectories, pairs, sets, or across a plan."""
        return bool(
            self.walks
            or self.trajectories
            or self.stereo_baseline
            or self.overlap_views
            or self.share_cameras
        )

    def verify(self, where: str) -> None:
        """Raise ValueError for a set of one view, or a range that is not two ascending numbers."""
        if self.overlap_views == 1:
            raise ValueError(f"{where}.overlap_views: 1; a set has at least 2 views, or 0: none")
        for name in ("half_fov_x", "pitch", "roll"):
            bounds = getattr(self, name)
            if bounds and (len(bounds) != 2 or bounds[0] > bounds[1]):
                raise ValueError(f"{where}.{name}: {list(bounds)}; a range is [least, most], or []")


@dataclass(frozen=True)
class IlluminationParams:
    """Panorama of visible light sources; its height is half its width."""

    width: int = field(default=160, metadata=within(16, 4096))
    supersampling: int = field(default=4, metadata=within(1, 16))  # per axis, per pixel
    light_samples: int = field(default=64, metadata=within(1, 4096))  # per small light
    shadow_rays: int = field(default=8, metadata=within(0, 1024))  # per pixel; 0: no visibility

    def verify(self, where: str) -> None:
        """Raise ValueError unless the height is a whole number."""
        if self.width % 2:
            raise ValueError(f"{where}.width: {self.width} is odd; the height is half of it")


@dataclass(frozen=True)
class GroundTruthParams:
    """Path-traced shading and colour."""

    spp: int = field(default=64, metadata=within(1, 1 << 20))
    block_spp: int = field(default=16, metadata=within(1, 4096))  # at most, in one seeded block
    # relative error below which a view is finished, after min_spp to spp samples; 0: always spp
    noise: float = field(default=0.0, metadata=within(0, 1))
    min_spp: int = field(default=16, metadata=within(1, 1 << 20))
    # of the views of the training and validation splits, without a noise target; 0: as the others
    train_spp: int = field(default=0, metadata=within(0, 1 << 20) | OPTIONAL)
    max_depth: int = field(default=11, metadata=within(1, 1000))
    rr_depth: int = field(default=3, metadata=within(1, 1000))
    denoise: Literal["none", "oidn"] = "none"
    joint: bool = True  # both from one trace of paths, if the variant can
    # emitter sampling of a joint trace: by contribution to the view, or uniform
    lights: Literal["planned", "uniform"] = "planned"

    def verify(self, where: str) -> None:
        """Raise ValueError unless block_spp divides spp and min_spp is at most spp."""
        if self.noise and self.min_spp > self.spp:
            raise ValueError(f"{where}.min_spp: {self.min_spp} is more than spp ({self.spp})")
        if self.spp % self.block_spp and self.spp > self.block_spp:
            raise ValueError(f"{where}.spp: {self.spp} is not a multiple of block_spp")

    def sampled(self, spp: int, denoise: Literal["none", "oidn"] = "none") -> GroundTruthParams:
        """The same with exactly `spp` samples per pixel."""
        block = min(self.block_spp, spp & -spp)  # the largest power of two in spp
        return replace(self, spp=spp, block_spp=block, noise=0.0, train_spp=0, denoise=denoise)


@dataclass(frozen=True)
class NoisyParams:
    """A few samples per pixel, independent of the ground truth, as input of a network."""

    spp: int = field(default=0, metadata=within(0, 16))  # 0: none
    # [least, most] drawn for each scene of the training and validation splits; (): spp
    train: tuple[int, ...] = field(default=(), metadata=OPTIONAL)

    def verify(self, where: str) -> None:
        """Raise ValueError unless `train` is empty or a range that is above 0."""
        if not self.train:
            return
        if len(self.train) != 2 or not 1 <= self.train[0] <= self.train[1] <= 16:
            raise ValueError(f"{where}.train: {list(self.train)}; [least, most], from 1 to 16")
        if not self.spp:
            raise ValueError(f"{where}.train: {list(self.train)} needs spp, that of the test split")


@dataclass(frozen=True)
class EnvironmentParams:
    """Panorama of all that a camera position sees; its height is half its width."""

    width: int = field(default=256, metadata=within(16, 4096))
    spp: int = field(default=64, metadata=within(1, 1 << 20))

    def verify(self, where: str) -> None:
        """Raise ValueError unless the height is a whole number."""
        if self.width % 2:
            raise ValueError(f"{where}.width: {self.width} is odd; the height is half of it")


@dataclass(frozen=True)
class LightParams:
    """Light groups, if `channels` names `light`."""

    groups: int = field(default=0, metadata=within(0, 32))  # lamps with an image each; 0: none

    @property
    def images(self) -> int:
        """Number of light groups: lamps, sky, sun and the rest; 0 without groups."""
        return self.groups + 3 if self.groups else 0


TRANSPORT_SAMPLES = (1, 2, 4, 8, 16, 64)
SURFELS_A_SAMPLE = 4000  # of light transport with few samples: balanced in error
USUAL_SURFELS = 16000  # in images of 160x120
MIN_SURFELS = 8


@dataclass(frozen=True)
class TransportParams:
    """Light transport without paths, if `channels` names `transport`."""

    samples: int = field(default=0, metadata=within(0, 64))  # per pixel; 0: by the image's size
    surfels: int = field(default=0, metadata=within(0, 32000))  # 0: by the image's size
    bounces: int = field(default=8, metadata=within(0, 64))  # of light between surfels

    def verify(self, where: str) -> None:
        """Raise ValueError for a number of samples that is no grid of nearly equal sides."""
        if self.samples and self.samples not in TRANSPORT_SAMPLES:
            raise ValueError(f"{where}.samples: {self.samples}; 0, 1, 2, 4, 8, 16 or 64")
        if 0 < self.surfels < MIN_SURFELS:
            raise ValueError(f"{where}.surfels: {self.surfels}; 0, or at least {MIN_SURFELS}")

    def reduced(self, samples: int) -> TransportParams:
        """The same with so many samples per pixel, and no more surfels than suit them."""
        enough = SURFELS_A_SAMPLE * samples
        surfels = enough if enough < (self.surfels or USUAL_SURFELS) else self.surfels
        return replace(self, samples=samples, surfels=surfels)


@dataclass(frozen=True)
class ShadingParams:
    """Neutral reflectance of the textureless shading."""

    albedo: float = field(default=0.5, metadata=within(0.01, 1))


@dataclass(frozen=True)
class CheckParams:
    """Limits beyond which a view is rejected from the dataset; every rejection is listed."""

    # Relative standard error, root mean square over pixels: 0 is exact; 1 is an image in which
    # every pixel has its light from a single block of samples.
    max_noise: float = field(default=0.75, metadata=within(0))
    min_valid: float = field(default=0.5, metadata=within(0, 1))  # share of pixels with a surface
    max_black: float = field(default=0.9, metadata=within(0, 1))  # share of pixels at exactly 0
    max_blown: float = field(default=0.5, metadata=within(0, 1))  # share at the half-float limit
    max_fireflies: float = field(default=0.02, metadata=within(0, 1))
    max_firefly_light: float = field(default=0.5, metadata=within(0, 1))  # in the brightest


@dataclass(frozen=True)
class SplitParams:
    """Shares of the floor plans in each split; the rest is the training split."""

    validation: float = field(default=0.1, metadata=within(0, 0.9))
    test: float = field(default=0.2, metadata=within(0, 0.9))
    # Further plans of the test split: names of plans, or of scenes for their whole plan, or
    # patterns such as "villa-*".
    test_only: tuple[str, ...] = ()


@dataclass(frozen=True)
class DatasetParams:
    """Packing into Parquet."""

    shard_mb: int = field(default=192, metadata=within(1, 4096))
    row_group: int = field(default=16, metadata=within(1, 1024))
    preview_width: int = field(default=256, metadata=within(16, 2048))
    splits: SplitParams = SplitParams()
    checks: CheckParams = CheckParams()


@dataclass(frozen=True)
class BackboneParams:
    """Pretrained features of the perceptual loss."""

    # auto: VGG-19 from `weights` or torch's cache, else by download if allowed, else EfficientNet
    network: Literal["auto", "vgg19", "efficientnet_lite0"] = "auto"
    weights: str = ""  # file with VGG-19 weights under torchvision's state-dict names
    download: bool = False


@dataclass(frozen=True)
class LossParams:
    """Part-perceptual loss (paper, equations 1 and 2): input, then conv1_2 ... conv5_2."""

    kind: Literal["part", "full", "fifth", "l1"] = "part"
    part: tuple[float, ...] = (1.0, 1.5, 1.5, 0.5, 0.0, 0.0)

    def verify(self, where: str) -> None:
        """Raise ValueError unless there are six weights."""
        if len(self.part) != 6:
            raise ValueError(f"{where}.part: {len(self.part)} weights; six are needed")


@dataclass(frozen=True)
class StageTrainParams:
    """One network's training."""

    epochs: int = field(default=12, metadata=within(1, 100_000))
    steps_per_epoch: int = field(default=0, metadata=within(0, 10_000_000))  # 0: every view once
    width: int = field(default=32, metadata=within(1, 1024))  # channels of the first level
    # depth: resolutions of a U-Net, layers of CAN, halvings of pix2pix, blocks of CycleGAN
    levels: int = field(default=5, metadata=within(1, 16))


@dataclass(frozen=True)
class TrainParams:
    """Two-stage training: the shading network, then fixed, the composition network."""

    learning_rate: float = field(default=1e-4, metadata=within(above=0))
    batch: int = field(default=1, metadata=within(1, 256))
    precision: Literal["auto", "float32", "bfloat16"] = "auto"
    device: Literal["auto", "cpu", "cuda"] = "auto"
    # constant: as in the paper; cosine: the rate falls to 0 by the last step, best for short runs
    decay: Literal["constant", "cosine"] = "constant"
    exposure: Literal["own", "shared"] = "shared"
    flips: bool = True  # mirror views at random with probability 1/2
    # placement of the panorama in the network's input, see docs/networks.md
    panorama: Literal["resize", "normal"] = "normal"
    checkpoint_steps: int = field(default=500, metadata=within(1))
    loss: LossParams = LossParams()
    shading: StageTrainParams = StageTrainParams()
    composition: StageTrainParams = StageTrainParams(levels=3)
    # baselines that `pbrnet train baselines` trains and `pbrnet evaluate` measures
    baselines: tuple[Baseline, ...] = ("unet",)
    plus: StageTrainParams = StageTrainParams()  # direct light as a further input
    hybrid: StageTrainParams = StageTrainParams(width=16)  # noisy samples as a further input
    unet: StageTrainParams = StageTrainParams()  # one U-Net from inputs to colour
    end_to_end: StageTrainParams = (
        StageTrainParams()
    )  # both networks trained together, on colour alone
    can: StageTrainParams = StageTrainParams(width=32, levels=10)
    can_own: StageTrainParams = StageTrainParams(width=32, levels=10)
    pix2pix: StageTrainParams = StageTrainParams(width=64, levels=8)
    pix2pix_own: StageTrainParams = StageTrainParams(width=64, levels=8)
    cyclegan: StageTrainParams = StageTrainParams(width=64, levels=9)
    cyclegan_own: StageTrainParams = StageTrainParams(width=64, levels=9)

    def verify(self, where: str) -> None:
        """Raise ValueError for a repeated baseline or for too few levels."""
        if len(set(self.baselines)) < len(self.baselines):
            raise ValueError(f"{where}.baselines: {list(self.baselines)} names a baseline twice")
        for name, least in (("can", 3), ("pix2pix", 2)):
            for section in (name, f"{name}_own"):
                levels = getattr(self, section).levels
                if levels < least:
                    raise ValueError(f"{where}.{section}.levels: {levels}; at least {least}")


@dataclass(frozen=True)
class ToneParams:
    """Reinhard's photographic operator as in PBRS."""

    key: float = field(default=0.8, metadata=within(above=0))
    burn: float = field(default=0.2, metadata=within(above=0))


@dataclass(frozen=True)
class EvaluateParams:
    """Evaluation on the test split."""

    split: Literal["test", "validation", "train"] = "test"
    timing_views: int = field(default=4, metadata=within(1, 1000))


@dataclass(frozen=True)
class Params:
    """Everything in `params.yaml`."""

    seed: int = field(default=0, metadata=within(0, MAX_SEED))
    channels: tuple[ChannelSet, ...] = ("paper",)  # sets of images; `paper` is always included
    image: ImageParams = ImageParams()
    farm: FarmParams = FarmParams()
    assets: AssetParams = AssetParams()
    scenes: SceneParams = SceneParams()
    cameras: CameraParams = CameraParams()
    illumination: IlluminationParams = IlluminationParams()
    groundtruth: GroundTruthParams = GroundTruthParams()
    light: LightParams = LightParams()
    transport: TransportParams = TransportParams()
    noisy: NoisyParams = NoisyParams()
    environment: EnvironmentParams = EnvironmentParams()
    shading: ShadingParams = ShadingParams()
    tone: ToneParams = ToneParams()
    dataset: DatasetParams = DatasetParams()
    backbone: BackboneParams = BackboneParams()
    train: TrainParams = TrainParams()
    evaluate: EvaluateParams = EvaluateParams()

    def verify(self, where: str) -> None:
        """Raise ValueError unless `channels` names sets that can be rendered, each once."""
        for index, name in enumerate(self.channels):
            if name != "all" and name not in SETS:
                allowed = ", ".join((*SETS, "all"))
                raise ValueError(f"channels[{index}]: {name!r} cannot be rendered yet; {allowed}")
        if not self.channels or len(set(self.channels)) < len(self.channels):
            names = list(self.channels)
            raise ValueError(f"channels: {names}; one or more sets are needed, each once")
        if {"light", "all"} & set(self.channels) and not self.groundtruth.joint:
            raise ValueError("channels: light needs groundtruth.joint: true")
        if self.image.is_panorama and self.cameras.framing != "paper":
            raise ValueError("cameras.framing: photograph is for perspective images")
        if self.image.is_panorama:
            self._verify_panoramas()

    def _verify_panoramas(self) -> None:
        """Raise ValueError for what equirectangular views cannot have."""
        flat = [
            name for name in self.channels if name in ("all", "video", "environment", "transport")
        ]
        if flat:
            raise ValueError(
                f"channels: {flat[0]} needs image.projection: perspective; equirectangular views "
                "have paper, materials, labels and light, and are their own environment"
            )
        if not self.groundtruth.joint:
            raise ValueError("groundtruth.joint: false needs image.projection: perspective")
        for name in ("half_fov_x", "stereo_baseline", "overlap_views"):
            if getattr(self.cameras, name):
                raise ValueError(f"cameras.{name}: needs image.projection: perspective")


def texture_size_for(width: int) -> int:
    """Return the side of textures for images so many pixels wide: a power of two, 64 to 4096.

    The least that is 1.6 times the width or more: a wall that fills the view then has about as
    many texels as pixels.
    """
    return min(4096, max(64, 1 << max(0, math.ceil(math.log2(1.6 * width)))))


def build_params(data: Any) -> Params:
    """Return the parameters in the content of a parameter file; raises `ParameterError`.

    `scenes.texture_size: auto` becomes a number here, so that all else sees numbers only.
    """
    scenes = data.get("scenes") if isinstance(data, dict) else None
    if not isinstance(scenes, dict) or scenes.get("texture_size") != "auto":
        return build(Params, data)
    known = {name: value for name, value in scenes.items() if name != "texture_size"}
    params = build(Params, {**data, "scenes": known})
    size = texture_size_for(params.image.width)
    return replace(params, scenes=replace(params.scenes, texture_size=size))


def load_params(path: Path, seed: int | None = None) -> Params:
    """Read and check a parameter file; `seed`, if given, overrides its root seed.

    Raises `ParameterError` that names file, key, value and what is allowed.
    """
    if not exists(path):
        raise ParameterError(f"{path}: no such parameter file; write one with: pbrnet preset quick")
    try:
        data = yaml.safe_load(regular_file(path, _MAX_BYTES).read_text(encoding="utf-8"))
    except InputError as error:
        raise ParameterError(str(error)) from None
    except RecursionError:
        raise ParameterError(f"{path}: not valid YAML (nested too deep)") from None
    except (yaml.YAMLError, ValueError) as error:  # wrong syntax, bytes, dates or long numbers
        raise ParameterError(f"{path}: not valid YAML ({error})") from None
    try:
        params = build_params(data or {})
    except ParameterError as error:
        raise ParameterError(f"{path}: {error}") from None
    if seed is None:
        return params
    if not 0 <= seed <= MAX_SEED:
        raise ParameterError(f"--seed: {shown(seed)} is not allowed; must be from 0 to {MAX_SEED}")
    return replace(params, seed=seed)
