"""`pbrnet depth`: depth, normals and classes of photographs by a network trained on renderings."""

from __future__ import annotations

import math
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import click
import numpy as np
from PIL import Image

from pbrnet.pipeline.commands.options import (
    FILE,
    FOLDER,
    PATH,
    NumberRange,
    idle_seed_option,
)
from pbrnet.pipeline.terminal import say
from pbrnet.scenes.arrays import AnyArray, Float32Array, UInt8Array
from pbrnet.scenes.checked import plain
from pbrnet.scenes.errors import InputError
from pbrnet.scenes.files import atomic_file, regular_file, write_json
from pbrnet.scenes.image_files import eight_bits, open_image

if TYPE_CHECKING:
    from pbrnet.model.studies.photographs.network import PhotographNetwork

MOST = 1024  # pixels, longer side of what is written
ASSUMED = 28.0  # millimetres on film of 36 x 24 mm, where a photograph states no focal length
_DIAGONAL = math.hypot(36, 24)
_EXIF, _FOCAL_35MM = 0x8769, 0xA405  # directory of EXIF, and its FocalLengthIn35mmFilm
_ENDINGS = (".jpg", ".jpeg", ".png", ".webp", ".tif", ".tiff")


@dataclass(frozen=True)
class Photo:
    """A photograph of at most `MOST` pixels a side, and its focal length in pixels.

    `image` is uint8 sRGB (H, W, 3); `stated` says where the focal length is from.
    """

    image: UInt8Array
    focal: float
    stated: str


@click.command(
    "depth",
    epilog="""\b
Examples:
  pbrnet depth room.jpg                          depth/room.png, room.exr, room-depth.png
  pbrnet depth photos --out depths               all photographs of a folder
  pbrnet depth room.jpg --fov 65                 horizontal field of view in degrees
  pbrnet depth room.jpg --weights data/studies/photographs/ROW/0/weights.safetensors

Writes NAME.png (photograph, depth, normals, classes), NAME.exr (Z: z-depth in metres; N.X, N.Y,
N.Z: normals in camera axes, x right, y down, z forward; class: of NYU40), NAME-depth.png (z-depth
in millimetres, 16 bits) and NAME.json (camera), with at most 1024 pixels a side. The focal length
comes from --fov, or from the photograph's EXIF, or is assumed; a wrong one scales all depths. The
network works at a focal length of 129 pixels, so fine detail is lost. Exit code 1 if a photograph
could not be read.""",
)
@click.argument("photos", type=PATH, nargs=-1, required=True)
@click.option(
    "--out", type=FOLDER, default=Path("depth"), show_default=True, help="Folder to write."
)
@click.option(
    "--fov",
    type=NumberRange(1, 170),
    metavar="DEGREES",
    help="Horizontal field of view.  [default: by EXIF, else that of a 28 mm lens]",
)
@click.option("--weights", type=FILE, help="Weights.  [default: the pretrained ones]")
@idle_seed_option
def depth(photos: tuple[Path, ...], out: Path, fov: float | None, weights: Path | None) -> None:
    """Estimate depth, normals and classes of photographs of rooms.

    The network has an encoder pretrained on ImageNet and is trained on rendered images;
    docs/photographs.md has its errors.
    """
    from pbrnet.model.studies.photographs.release import load_depth

    network, failed = load_depth(weights), 0
    files = _files(photos)
    _check_outputs(files, out)
    for file in files:
        try:
            photo = read_photo(file, fov)
            line = _written(file, photo, network, out)
        except InputError as error:
            say(f"Error: {error}", err=True)
            failed += 1
        else:
            say(line)
    if failed:
        say(f"Error: {failed} of {len(files)} photographs failed", err=True)
        sys.exit(1)


def _outputs(stem: Path) -> list[Path]:
    """Files of a photograph: sheet, depth in millimetres, images, camera."""
    return [stem.with_name(stem.name + end) for end in (".png", "-depth.png", ".exr", ".json")]


def _check_outputs(files: list[Path], out: Path) -> None:
    """Raise `InputError` for a file of two photographs, and one that is a photograph itself."""
    made = [(path.resolve(), file) for file in files for path in _outputs(out / file.stem)]
    of = dict(made)
    for file in files:
        if file.resolve() in of:
            raise InputError(f"{file}: would be replaced by a result; choose another --out")
    for path, file in made:
        if of[path] != file:
            raise InputError(f"{file} and {of[path]}: one file for both; give them one by one")


def _files(photos: tuple[Path, ...]) -> list[Path]:
    """Return the photographs, those of folders by name; raises `InputError` for two of one name."""
    files: list[Path] = []
    for path in photos:
        inside = sorted(path.iterdir()) if path.is_dir() else [path]
        files += [one for one in inside if one == path or one.suffix.lower() in _ENDINGS]
    if not files:
        raise InputError(f"{photos[0]}: no photographs ({', '.join(_ENDINGS)})")
    names = [file.stem for file in files]
    if twice := next((name for name in names if names.count(name) > 1), None):
        raise InputError(f"two photographs are named {twice}; give them one after another")
    return files


def read_photo(file: Path, fov: float | None) -> Photo:
    """Read a photograph, upright, with the focal length of `fov` (degrees), its EXIF, or a guess.

    Raises `InputError` for a file that is no image.
    """
    try:
        regular_file(file)
        opened = open_image(file, upright=True)
        share = min(1.0, MOST / max(opened.size))
        width, height = (max(1, round(share * side)) for side in opened.size)
        small = eight_bits(opened).convert("RGB").resize((width, height), Image.Resampling.BOX)
        image = np.array(small)
    except (InputError, OSError) as error:
        raise InputError(f"{file}: {error}") from None
    if fov is not None:
        focal = width / 2 / math.tan(math.radians(fov) / 2)
        return Photo(image, focal, f"field of view of {fov:g} degrees")
    millimetres = _focal_of(opened)
    stated = "by EXIF" if millimetres else "assumed; state it with --fov"
    millimetres = millimetres or ASSUMED
    focal = millimetres / _DIAGONAL * math.hypot(width, height)
    return Photo(image, focal, f"{millimetres:g} mm lens, {stated}")


def _focal_of(image: Image.Image) -> float | None:
    """Return the focal length on film of 36 x 24 mm in millimetres; None if EXIF has none."""
    try:
        found = float(image.getexif().get_ifd(_EXIF).get(_FOCAL_35MM, 0))
    except (OSError, SyntaxError, TypeError, ValueError, ZeroDivisionError):
        return None
    return found if 4 <= found <= 1000 else None


def _written(file: Path, photo: Photo, network: PhotographNetwork, out: Path) -> str:
    """Predict for a photograph and write all files; returns the line about it."""
    import torch

    from pbrnet.model.studies.photographs.samples import resampled
    from pbrnet.model.studies.photographs.sets.contract import Intrinsics, Key, Photograph
    from pbrnet.model.studies.photographs.training import predict
    from pbrnet.pipeline.export.images import write_depth, write_exr
    from pbrnet.pipeline.images import (
        contact_sheet,
        depth_picture,
        fit,
        label_picture,
        normal_picture,
        png_bytes,
    )

    height, width = photo.image.shape[:2]
    camera = Intrinsics(photo.focal, photo.focal, width / 2, height / 2)
    nothing = np.zeros((height, width), np.float32)
    sample = resampled(
        Photograph(
            key=Key(file.name, file.name),
            image=photo.image,
            depth=nothing,
            normal=np.zeros((height, width, 3), np.float32),
            intrinsics=camera,
        )
    )
    found = predict(network, sample, torch.device("cpu"))
    metres = _enlarged(found.depth, width, height)
    normal = np.stack([_enlarged(found.normal[..., k], width, height) for k in range(3)], -1)
    normal /= np.maximum(np.linalg.norm(normal, axis=-1, keepdims=True), 1e-6)
    rows, columns = (
        ((np.arange(size) + 0.5) * own / size).astype(int)
        for size, own in zip((height, width), found.depth.shape, strict=True)
    )
    classes = found.label40[np.ix_(rows, columns)]
    sheet, millimetres, images, about = _outputs(out / file.stem)
    pictures = [
        photo.image,
        depth_picture(metres),
        normal_picture(normal),
        label_picture(classes.astype(np.int32)),
    ]
    with atomic_file(sheet) as partial:
        titles = ["photograph", "depth", "normals", "classes"]
        partial.write_bytes(png_bytes(contact_sheet([fit(p, 480) for p in pictures], 2, titles)))
    with atomic_file(millimetres) as partial:
        write_depth(partial, metres, 1000)
    with atomic_file(images) as partial:
        planes = {f"N.{axis}": normal[..., k] for k, axis in enumerate("XYZ")}
        write_exr(partial, {"Z": metres, "class": classes.astype(np.uint32), **planes})
    write_json(about, plain(camera))
    near, middle, far = np.quantile(metres, [0.02, 0.5, 0.98])
    return (
        f"{sheet}: {width}x{height}, {near:.1f} to {far:.1f} m, median {middle:.1f} m; "
        f"{photo.stated}"
    )


def _enlarged(values: AnyArray, width: int, height: int) -> Float32Array:
    """Return an image (h, w) interpolated to (height, width)."""
    image = Image.fromarray(np.asarray(values, np.float32))
    return np.asarray(image.resize((width, height), Image.Resampling.BILINEAR), np.float32)
