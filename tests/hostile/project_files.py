"""Hostile files of the pipeline itself: parameters, cameras, frames, shards, networks, folders."""

from __future__ import annotations

import json
import os
import zipfile
from collections.abc import Callable
from pathlib import Path
from random import Random
from typing import Any

import click
import numpy as np
import yaml

from tests.fixtures import catalogue as drawn
from tests.fixtures.paths import ROOT
from tests.hostile.family import Arguments, Family, Made, Victim
from tests.hostile.mutations import (
    LONG,
    NUMBERS,
    TEXTS,
    damaged_bytes,
    damaged_json,
    damaged_text,
    damaged_value,
    deep,
)
from tests.hostile.scene_files import _gltf, _home, _obj, _with_file, _with_link, _xml

FRAME = "data/inputs/box/v0.exr"
PREDICT = (
    "predict --inputs data/inputs/box/v0.exr --illumination data/illumination/box/v0.exr "
    "--models models --data data"
)
RENDER = (
    "predict scenes/room --eye 0,0,1.5 --towards 1,0.2,-0.2 --size 32x24 --models models "
    "--data data"
)
CHECKED = (
    "inspect data/dataset --out p.png",
    "inspect data/dataset --diversity --out p.png",
    "train unet --data data --models made",
    "evaluate --data data --models models",
)


def _params(folder: Path, **sections: Any) -> None:
    content = yaml.safe_load((ROOT / "params.yaml").read_text(encoding="utf-8"))
    for name, section in sections.items():
        content[name] = {**content[name], **section}
    (folder / "params.yaml").write_text(yaml.safe_dump(content), encoding="utf-8")


def _small(folder: Path) -> None:
    tiny = {"width": 2, "levels": 1, "epochs": 1}
    _params(
        folder,
        image={"width": 32, "height": 24},
        illumination={"width": 32},
        scenes={"homes": 1},
        farm={"workers": 1},
        train={"unet": tiny},
    )


PARAMS = ("cost --data data", "dataset --data data", "evaluate --data data --models data")


def damaged_yaml(data: bytes, rng: Random) -> bytes:
    """Exchange values anywhere in a YAML file."""
    content = damaged_value(yaml.safe_load(data), rng)
    return yaml.dump(content, allow_unicode=True).encode("utf-8", "surrogatepass")


def _yaml(text: str) -> Made:
    return _with_file("params.yaml", text, PARAMS[0])


_ALIASES = "a: &a [x, x, x, x, x, x, x, x, x]\n" + "".join(
    f"{b}: &{b} [{', '.join([f'*{a}'] * 9)}]\n" for a, b in zip("abcdefgh", "bcdefghi", strict=True)
)
PARAMS_MADE = (
    _yaml(_ALIASES + "seed: *i\n"),
    _yaml(_ALIASES + "train: *i\n"),
    _yaml(_ALIASES + "scenes: {imports: *i}\n"),
    _yaml(_ALIASES + "*i : 1\n"),
    _yaml("seed: " + deep(3000)),
    _yaml("seed: " + deep()),
    _yaml(deep(5000, "{}")),
    _yaml("- " * 3000 + "x"),
    _yaml(f"seed: {LONG}\n"),
    _yaml("seed: " + "9" * 400),
    _yaml("image: {half_fov_x: " + "9" * 400 + "}\n"),
    _yaml("image: {width: 1" + "0" * 399 + "}\n"),
    _yaml("seed: &a [*a]\n"),
    _yaml("a: &a {b: *a}\n"),
    _yaml("!!python/object/apply:os.system ['true']\n"),
    _yaml("seed: !!binary aGk=\n"),
    _yaml("seed: 2001-01-01\n"),
    _yaml("seed: 9999-99-99 99:99:99\n"),
    _yaml("seed: !!set {a, b}\n"),
    _yaml("seed: 1:1:1:1\n"),
    _yaml("? [a, b]\n: 1\n"),
    _yaml("<<: [1, 2]\n"),
    _yaml("seed: \x00\n"),
    _yaml("\ufeffseed: 0\n"),
    _yaml("%YAML 9.9\n---\nseed: 0\n--- \nseed: 1\n"),
    _yaml("a" * 200_000 + ": 1\n"),
    _yaml("train: {baselines: [unet, unet]}\n"),
    _yaml("scenes: {imports: [{file: /dev/zero}, {file: x.sh3d, id: ../../x}]}\n"),
    _yaml("assets: {enabled: true, debian: ['--option=x']}\n"),
    _yaml("".join(f"k{n}: {n}\n" for n in range(20_000))),
    _with_link("params.yaml", "params.yaml", PARAMS[0]),
    _with_link("params.yaml", "/dev/zero", PARAMS[0]),
)


def _frames(folder: Path) -> None:
    """Frames, cameras and a scene of a box room, and networks that nobody trained."""
    from pipeline.params import load_params
    from pipeline.views import CameraFile, save_cameras
    from tests.fixtures.predict import box_frames, box_room
    from tests.fixtures.predictor import untrained_models

    _small(folder)
    load_params(folder / "params.yaml")
    view = box_frames(folder / "data", width=32, height=24, panorama=32)
    box_frames(folder / "data", name="v1", width=32, height=24, panorama=32)
    box_room(folder / "data", view)
    save_cameras(folder / "data" / "cameras" / "box.json", CameraFile("box", (view,)))
    untrained_models(folder / "models", width=2, levels=2)


def _exr(
    meta: Callable[[dict[str, Any]], Any] | None = None,
    channels: Callable[[dict[str, Any]], Any] | None = None,
    path: str = FRAME,
    command: str = PREDICT,
    text: str | None = None,
) -> Made:
    """A frame with another attribute or other channels, its digest right."""

    def write(folder: Path) -> Arguments:
        import OpenEXR

        from pipeline.frames import pixels_digest, read_frame

        frame = read_frame(folder / path)
        pixels = dict(frame.channels)
        if channels:
            channels(pixels)
        pixels = {name: np.ascontiguousarray(values) for name, values in pixels.items()}
        content = {**frame.meta, "digest": pixels_digest(pixels)}
        changed = meta(content) if meta else None
        content = content if changed is None else changed
        words = text if text is not None else json.dumps(content)
        with OpenEXR.File({"pbrnet": words}, pixels) as file:
            file.write(str(folder / path))
        return command.split()

    return write


def _but(**changes: Any) -> Callable[[dict[str, Any]], Any]:
    return lambda content: content.update(changes)


def _view(**changes: Any) -> Callable[[dict[str, Any]], Any]:
    return lambda content: content["view"].update(changes)


def _resized(pixels: dict[str, Any]) -> None:
    for name, values in pixels.items():
        pixels[name] = values[:5, :7]


def _filled(value: float, *names: str) -> Callable[[dict[str, Any]], Any]:
    def change(pixels: dict[str, Any]) -> None:
        for name in names:
            pixels[name] = np.full_like(pixels[name], value)

    return change


INSPECT = f"inspect {FRAME} --out p.png"
FRAMES_MADE = (
    *(
        _exr(text=text, command=command)
        for text in (
            "[]",
            "3",
            "null",
            '"x"',
            "{",
            deep(),
            LONG,
            "{}",
            '{"view": []}',
            '{"view": {"scene_id": "\\ud800"}}',
        )
        for command in (PREDICT, INSPECT)
    ),
    _exr(_view(view_id="v9")),
    _exr(_view(scene_id="../../x")),
    _exr(_view(width=10**400)),
    _exr(_view(width=200_000, height=200_000)),
    _exr(_view(K=[[1, 2], [3]])),
    _exr(_view(K=[[0] * 3] * 3)),
    _exr(_view(camera_to_world=[[1e308] * 4] * 4)),
    _exr(_view(view_id="a/b"), command=INSPECT),
    _exr(_but(view=None), command=INSPECT),
    _exr(_but(kind=["x"]), command=INSPECT),
    _exr(_but(noise={"a": [1]}), command=INSPECT),
    *(
        _exr(channels=lambda pixels, name=name: pixels.pop(name))  # type: ignore[misc]
        for name in ("Z", "N.X", "albedo.G", "valid", "object")
    ),
    *(
        _exr(
            channels=lambda pixels, name=name: pixels.pop(name),  # type: ignore[misc]
            path="data/illumination/box/v0.exr",
        )
        for name in ("intensity.Y", "distance.Z", "tint.R")
    ),
    _exr(channels=_resized),
    _exr(channels=_resized, path="data/illumination/box/v0.exr"),
    _exr(channels=_resized, path="data/color/box/v0.exr", command=PREDICT + " --compare"),
    _exr(channels=_filled(float("nan"), "Z")),
    _exr(channels=_filled(float("nan"), "N.X", "N.Y")),
    _exr(channels=_filled(float("inf"), "intensity.Y"), path="data/illumination/box/v0.exr"),
    _exr(channels=_filled(-1.0, "Z", "albedo.R")),
    _exr(channels=_filled(0.0, "valid", "Z")),
    _exr(
        channels=_filled(float("nan"), "R"),
        path="data/color/box/v0.exr",
        command=PREDICT + " --compare",
    ),
    _exr(channels=_filled(float("nan"), "Z"), command=INSPECT),
    _with_link(FRAME, "v0.exr", PREDICT),
    _with_link(FRAME, "/dev/zero", INSPECT),
)
CAMERAS = "data/cameras/box.json"
CAMERA = (
    f"inspect {CAMERAS} --out p.png",
    f"inspect {CAMERAS} --json --text-only",
    f"predict data/scenes/box --camera {CAMERAS} --view v0 --models models --data data",
    f"predict data/scenes/box --camera {CAMERAS} --all-views --models data --data data",
)


def _with_value(file: str, command: str, path: tuple[str | int, ...], value: Any) -> Made:
    """Change one value of a JSON file."""

    def write(folder: Path) -> Arguments:
        content = json.loads((folder / file).read_text())
        place = content
        for key in path[:-1]:
            place = place[key]
        place[path[-1]] = value
        (folder / file).write_text(json.dumps(content))
        return command.split()

    return write


def _camera(*path: str | int, value: Any, command: int = 2) -> Made:
    return _with_value(CAMERAS, CAMERA[command], path, value)


CAMERAS_MADE = (
    *(
        _with_file(CAMERAS, text, CAMERA[command])
        for command in (0, 2)
        for text in (
            "",
            "[]",
            "null",
            deep(),
            LONG,
            '{"views": ' + deep() + "}",
            '{"scene_id": "box", "views": [' + "1" * 400 + "]}",
            "\ud800",
            "NaN",
        )
    ),
    *(_camera("views", 0, "view_id", value=value) for value in ("../../x", "", "a/b", "-v", "\0")),
    *(
        _camera("scene_id", value=value, command=0)
        for value in ("../../..", "/etc", "box/../box", "\ud800")
    ),
    *(_camera("views", 0, "width", value=value) for value in (200_000, 0, -1, 10**400, 2**31)),
    _camera("views", 0, "height", value=200_000),
    _camera("views", 0, "score", value=10**400),
    _camera("views", 0, "seen", value={"\ud800": 1}, command=0),
    _camera("views", 0, "camera_to_world", value=[[1e308] * 4] * 4),
    _camera(
        "views",
        0,
        "camera_to_world",
        value=[[1, 0, 0, 1e300], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]],
        command=0,
    ),
    _camera("views", 0, "K", value=[[1e300, 0, 0], [0, 1e-300, 0], [0, 0, 1]]),
    _camera("rejected", value={str(n): n for n in range(5000)}, command=0),
)


def _dataset(folder: Path) -> None:
    from pipeline.dataset.pack import pack_dataset
    from pipeline.params import load_params
    from tests.fixtures.dataset import make_data
    from tests.fixtures.predictor import untrained_models

    _small(folder)
    params = load_params(folder / "params.yaml")
    make_data(folder / "data", params, scenes=3, views=1)
    pack_dataset(folder / "data", params)
    untrained_models(folder / "models", width=2, levels=2)


SHARD = "data/dataset/train-00000-of-00001.parquet"


def _column(name: str, make: Callable[[int], Any] | None, command: int = 0) -> Made:
    """A shard in which one column is another, or absent."""

    def write(folder: Path) -> Arguments:
        import pyarrow as pa
        import pyarrow.parquet as pq

        for shard in sorted((folder / "data" / "dataset").glob("*.parquet")):
            table = pq.read_table(shard)
            place = table.column_names.index(name)
            field = table.schema.field(name)
            table = table.remove_column(place)
            if make:
                values = pa.array(make(table.num_rows))
                changed = pa.field(name, values.type, metadata=field.metadata)
                table = table.add_column(place, changed, values)
            pq.write_table(table, shard)
        return CHECKED[command].split()

    return write


def _shape(text: str, command: int = 0) -> Made:
    """A shard whose images have another shape in their metadata."""

    def write(folder: Path) -> Arguments:
        import pyarrow.parquet as pq

        for shard in sorted((folder / "data" / "dataset").glob("*.parquet")):
            table = pq.read_table(shard)
            fields = [
                one.with_metadata({**one.metadata, b"shape": text.encode()})
                if one.metadata and b"shape" in one.metadata
                else one
                for one in table.schema
            ]
            import pyarrow as pa

            pq.write_table(table.cast(pa.schema(fields)), shard)
        return CHECKED[command].split()

    return write


SHARDS_MADE = (
    *(
        _column(name, make, command)
        for command in (0, 1, 2)
        for name, make in (
            ("scene_id", None),
            ("depth", None),
            ("preview", None),
            ("depth", lambda n: ["x"] * n),
            ("depth", lambda n: [[1.0]] * n),
            ("preview", lambda n: [3] * n),
            ("preview", lambda n: [b"no picture"] * n),
            ("scene_id", lambda n: [1] * n),
            ("scene_id", lambda n: [None] * n),
            ("split", lambda n: [None] * n),
            ("K", lambda n: ["x"] * n),
            ("K", lambda n: [[1.0]] * n),
            ("exposure_color", lambda n: ["x"] * n),
            ("exposure_color", lambda n: [None] * n),
            ("color", lambda n: [None] * n),
        )
    ),
    *(
        _shape(text, command)
        for command in (0, 1, 2)
        for text in ("x", "[]", "[1e9, 2]", '["a"]', deep(), f"[{LONG}]", "{}", "[-1, 4]")
    ),
)


def _ledger(folder: Path) -> None:
    from pipeline.costs.ledger import Ledger

    _small(folder)
    (folder / "data").mkdir()
    ledger = Ledger(folder / "data")
    for stage in ("scenes", "cameras", "inputs", "illumination", "color", "shading"):
        for scene in "abc":
            view = "" if stage in ("scenes", "cameras") else "000"
            ledger.add(
                (stage, scene, view),
                seconds=1.5,
                opening=0.1,
                first=True,
                threads=1,
                width=32,
                height=24,
                spp=16,
                noise=0.1,
                bytes=100,
                peak_mb=100.0,
                memory_mb=90.0,
                worker="w",
                attempt=1,
                renderer="r",
            )
    ledger.save()


LEDGER = "data/ledger.parquet"
COSTS = (f"inspect {LEDGER} --out p.png", "cost --data data", "cost --data data --check --json")


def _ledger_made(name: str, make: Callable[[int], Any] | None, command: int) -> Made:
    def write(folder: Path) -> Arguments:
        import pyarrow as pa
        import pyarrow.parquet as pq

        table = pq.read_table(folder / LEDGER)
        place = table.column_names.index(name)
        table = table.remove_column(place)
        if make:
            table = table.add_column(place, name, pa.array(make(table.num_rows)))
        pq.write_table(table, folder / LEDGER)
        return COSTS[command].split()

    return write


LEDGERS_MADE = tuple(
    _ledger_made(name, make, command)
    for command in (0, 1, 2)
    for name, make in (
        ("seconds", lambda n: ["x"] * n),
        ("seconds", lambda n: [float("nan")] * n),
        ("seconds", lambda n: [1e308] * n),
        ("seconds", lambda n: [-1.0] * n),
        ("seconds", lambda n: [None] * n),
        ("stage", lambda n: [None] * n),
        ("stage", lambda n: [1] * n),
        ("stage", lambda n: ["\U0001f600" * 99] * n),
        ("seconds", None),
        ("scene_id", None),
        ("width", lambda n: [0] * n),
        ("width", lambda n: [2**31 - 1] * n),
        ("spp", lambda n: [None] * n),
        ("peak_mb", lambda n: [float("inf")] * n),
    )
)
CARD, WEIGHTS = "models/shading.json", "models/shading.safetensors"
MODEL = (PREDICT, PREDICT, f"inspect {WEIGHTS} --out p.png", f"inspect {CARD} --json --text-only")


def _digests(folder: Path) -> None:
    """Let the cards hold the digests of the weights, so that damage is not seen by them."""
    from scenes.files import digest_file

    if not (folder / WEIGHTS).is_file() or (folder / WEIGHTS).stat().st_size > 2**28:
        return
    digest = digest_file(folder / WEIGHTS)
    for name in ("shading", "composition"):
        path = folder / f"models/{name}.json"
        content = json.loads(path.read_text())
        if name == "shading":
            content["sha256"] = digest
        else:
            content["needs"]["shading"] = digest
        path.write_text(json.dumps(content))


def _weights(value: float, command: str = PREDICT, whole: bool = True) -> Made:
    def write(folder: Path) -> Arguments:
        from safetensors.numpy import load_file, save_file

        state = load_file(folder / WEIGHTS)
        for name in state if whole else list(state)[:1]:
            state[name] = np.full_like(state[name], value)
        save_file(state, folder / WEIGHTS)
        _digests(folder)
        return command.split()

    return write


def _card(*path: str, value: Any, command: int = 0) -> Made:
    return _with_value(CARD, MODEL[command], path, value)


CARDS_MADE = (
    *(
        _with_file(CARD, text, MODEL[command])
        for command in (0, 2, 3)
        for text in (
            "",
            "[]",
            "null",
            deep(),
            LONG,
            '{"a": ' + "1" * 400 + "}",
            '{"a": "\\ud800"}',
            '{"a":' * 5000 + "1" + "}" * 5000,
        )
    ),
    *(
        _card("architecture", name, value=value)
        for name in ("width", "levels")
        for value in (0, -1, 1_000_000, 10**9, 10**400, 64, 1.5, "8", None, True)
    ),
    *(_card("architecture", "kind", value=value) for value in ("x", [], "pix2pix", "plus")),
    *(_card("white", value=value) for value in (0, -1, 1e308, 10**400)),
    *(_card("tone", value=value) for value in ({}, {"key": 0, "burn": 0}, {"x": 1}, [], None)),
    _card("needs", value={"../../x": "y"}),
    _card("name", value="../../../x"),
    _card("training", value=[]),
    _card("training", value={"noisy_spp": 10**9}),
    _card("training", value={"shadows": "x", "noisy_spp": "y"}),
    _card("data", value={}),
    _card("licence", value="\ud800"),
    _card("precision", value="x"),
)


def _folder(folder: Path) -> None:
    """A scene folder with a mesh, a texture and a lamp, as `pbrnet import` leaves them."""
    from tests.fixtures.model_file import POINTS, TRIANGLES
    from tests.fixtures.predictor import untrained_models
    from tests.fixtures.render import ball, diffuse, glow, write_scene

    _small(folder)
    _obj(folder)
    vertices = "\n".join(" ".join(map(str, row)) for row in POINTS.tolist())
    faces = "\n".join("3 " + " ".join(map(str, row)) for row in TRIANGLES)
    ply = (
        f"ply\nformat ascii 1.0\nelement vertex {len(POINTS)}\nproperty float x\nproperty float y\n"
        f"property float z\nelement face {len(TRIANGLES)}\nproperty list uchar int vertex_indices\n"
        f"end_header\n{vertices}\n{faces}\n"
    )
    (folder / "outside.ply").write_text(ply)
    picture = (folder / "t.png").read_bytes()
    body = (
        '<shape type="ply" id="box"><string name="filename" value="meshes/box.ply"/>'
        '<bsdf type="twosided"><bsdf type="diffuse"><texture type="bitmap" name="reflectance">'
        '<string name="filename" value="textures/t.png"/></texture></bsdf></bsdf></shape>'
        + ball("bulb", (0, 0, 2.5), 0.1, glow(5))
        + ball("sofa", (1.5, 0, 0.4), 0.4, diffuse())
    )
    write_scene(
        folder / "scenes" / "room",
        body,
        {"box": ("box",), "sofa": ("sofa",)},
        files={"meshes/box.ply": ply.encode(), "textures/t.png": picture},
    )
    untrained_models(folder / "models", width=2, levels=2)


LOOK, COPY = "inspect scenes/room --plan-only --out p.png", "import scenes/room --out out"


def _scene(old: str, new: str, command: str = RENDER) -> Made:
    """`scene.xml` with some text exchanged."""

    def write(folder: Path) -> Arguments:
        path = folder / "scenes/room/scene.xml"
        path.write_text(path.read_text().replace(old, new))
        return command.split()

    return write


def _linked(name: str, target: str, command: str) -> Made:
    return _with_link(f"scenes/room/{name}", target, command)


_PARTS = {
    "include": ("<shape", "<include filename='/etc/passwd'/><shape"),
    "own": ("<shape", "<include filename='scene.xml'/><shape"),
    "include out": ("<shape", "<include filename='../../a.obj'/><shape"),
    "mesh out": ("meshes/box.ply", "../../outside.ply"),
    "mesh absolute": ("meshes/box.ply", "/dev/zero"),
    "texture out": ("textures/t.png", "../../t.png"),
    "texture device": ("textures/t.png", "/dev/zero"),
    "path": ("<shape", "<path value='/'/><shape"),
    "plugin": ('type="ply"', 'type="nothing"'),
    "entity": ("<scene", "<!DOCTYPE x [<!ENTITY i SYSTEM '/etc/passwd'>]><scene"),
    "default": ("<shape", "<default name='a' value='meshes'/><shape"),
    "variable": ("meshes/box.ply", "$a/../../../outside.ply"),
    "cut": ("</scene>", ""),
    "deep": ("<shape", "<bsdf type='twosided'>" * 500 + "<shape"),
}
FOLDERS_MADE = (
    *(_scene(*part, command) for part in _PARTS.values() for command in (RENDER, LOOK, COPY)),
    *(
        _linked(name, target, command)
        for name, target in (
            ("meshes/box.ply", "/dev/zero"),
            ("meshes/box.ply", "box.ply"),
            ("meshes/box.ply", "../../../outside.ply"),
            ("scene.xml", "/dev/zero"),
            ("scene.json", "/dev/zero"),
            ("scene.json", "scene.json"),
            ("textures/t.png", "/etc/passwd"),
        )
        for command in (RENDER, LOOK, COPY)
    ),
)


def _catalogue(folder: Path) -> None:
    properties, members = drawn.catalogue()
    _params(folder, assets={"enabled": True, "folder": "library"}, farm={"workers": 1})
    (folder / "library").mkdir()
    for name, data in {"PluginFurnitureCatalog.properties": properties, **members}.items():
        path = folder / "members" / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(data if isinstance(data, bytes) else data.encode("latin-1"))
    _catalogue_packed(folder)


def _catalogue_packed(folder: Path) -> None:
    with zipfile.ZipFile(folder / "library/a.sh3f", "w", zipfile.ZIP_DEFLATED) as archive:
        for path in sorted((folder / "members").rglob("*")):
            if path.is_file() and path.stat().st_size < 2**26:
                archive.write(path, path.relative_to(folder / "members"))


ASSETS = "assets --data data --workers 1"
PROPERTIES = "members/PluginFurnitureCatalog.properties"


def _properties(text: str) -> Made:
    def write(folder: Path) -> Arguments:
        (folder / PROPERTIES).write_text(text, encoding="latin-1", errors="replace")
        _catalogue_packed(folder)
        return ASSETS.split()

    return write


CATALOGUES_MADE = (
    _properties(""),
    _properties("=" * 1000),
    _properties("a\\\n" * 100_000),
    _properties("id=\\u\nname=\\uZZZZ\n"),
    _properties("id#1=x\nname#1=" + "x" * 10**6),
    _properties(f"id#{LONG}=x\nname#{LONG}=y\n"),
    _properties("name#1=a\nmodel#1=/../../x\n"),
    _with_link("library/a.sh3f", "a.sh3f", ASSETS),
    _with_link("library/a.sh3f", "/dev/zero", ASSETS),
    _with_file("library/a.sh3f", b"PK\x05\x06" + bytes(18), ASSETS),
    _with_file("library/a.sh3f", b"PK" * 500, ASSETS),
)


def _line(folder: Path) -> None:
    _home(folder)
    _gltf(folder)
    _xml(folder)
    _small(folder)
    (folder / "empty").mkdir()


_COMMANDS = (
    "import",
    "import",
    "import",
    "import",
    "inspect",
    "predict",
    "cost",
    "dataset",
    "preset",
    "cameras",
    "inputs",
    "illumination",
    "groundtruth",
    "evaluate",
    "report",
    "export",
    "pretrained",
    "reference",
)
_PATHS = (
    "missing",
    "a.obj",
    ".",
    "empty",
    "a\0b",
    "loop.obj",
    "A" * 5000,
    "a.obj/x",
    "fifo.obj",
    "zero.glb",
    "\udcff",
    "a\nb",
    "params.yaml",
)


class CommandLines(Family):
    """Command lines with impossible values, of options that the commands themselves list."""

    def write(self, folder: Path, rng: Random, number: int) -> Arguments:
        """Return a command line made by hand, or a random one."""
        os.mkfifo(folder / "fifo.obj")
        (folder / "loop.obj").symlink_to("loop.obj")
        (folder / "zero.glb").symlink_to("/dev/zero")
        if number < len(self.made):
            return self.made[number](folder)
        from pipeline.cli import LazyGroup, cli

        name = rng.choice(_COMMANDS)
        assert isinstance(cli, LazyGroup)
        command = cli.get_command(click.Context(cli), name)
        assert command is not None
        sources = ("a.obj", "a.glb", "home.sh3d", "scene.xml", "a.gltf", *_PATHS)
        line = [name, *([rng.choice(sources)] if name in ("import", "inspect") else ())]
        if name == "import":
            line += ["--out", "out"]
        options = [
            one
            for one in command.params
            if isinstance(one, click.Option)
            and one.name not in ("out", "help", "scheduler", "workers")
        ]
        for one in rng.sample(options, min(len(options), rng.choice([1, 1, 2, 3]))):
            line.append(one.opts[0])
            if not one.is_flag:
                path = isinstance(one.type, click.Path)
                line.append(rng.choice(_PATHS if path else (*NUMBERS, *TEXTS)))
        return [word.replace("\0", "") for word in line]  # no system passes a NUL


def _call(line: str) -> Made:
    return lambda folder: line.split(" ")


LINES_MADE = tuple(
    _call(line)
    for line in (
        "",
        "nothing",
        "--nothing",
        "import",
        "import a.obj",
        "inspect",
        "import a.obj --out ",
        *(
            f"import a.obj --out out --scale {value}"
            for value in ("nan", "inf", "-1", "0", "1e308", "1e-308", "x", LONG)
        ),
        *(f"import a.glb --out out --scale {value}" for value in ("nan", "1e300", "1e-300")),
        *(f"import scene.xml --out out --scale {value}" for value in ("nan", "1e300", "1e-300")),
        *(f"import a.obj --out out --id {value}" for value in ("../../x", "a/b", "-x", "..", "")),
        "import home.sh3d --out out --time nan",
        "import home.sh3d --out out --variants 1000",
        "import loop.obj --out out",
        "import fifo.obj --out out",
        "import zero.glb --out out",
        "import /dev/zero --out out",
        "import /dev/null --out out",
        "import . --out out",
        "import a.obj --out a.obj",
        "import a.obj --out a.obj/x",
        "import a.obj --out loop.obj",
        "import a.obj --out out --seed -1",
        f"import a.obj --out out --seed {LONG}",
        "inspect loop.obj",
        "inspect fifo.obj",
        "inspect /dev/zero",
        "inspect .",
        "inspect empty",
        "inspect /proc/self/mem",
        f"inspect {'A' * 5000}",
        "inspect scene.xml --leaks",
        "cost --cores 0",
        f"cost --views {LONG}",
        f"cost --seed {LONG}",
        "cost --params fifo.obj",
        "cost --params loop.obj",
        "cost --params zero.glb",
        "cost --params empty",
        "cost --data a.obj",
        "dataset --data loop.obj",
        "preset nothing",
        "preset ../../x",
        "predict a.obj --view x",
        "predict empty --eye nan,0,0 --towards 1,0,0",
        "predict --inputs fifo.obj --illumination fifo.obj",
        "predict --inputs empty --illumination empty",
        "train nothing",
        "train shading --data empty",
        "evaluate --data empty --models empty",
        "report --data empty",
        "study nothing",
        "export --onnx x.onnx --models empty",
        "reference --metrics empty",
    )
)

PROJECT = (
    Family(
        "params",
        200,
        _ledger,
        (
            Victim("params.yaml", damaged_text, PARAMS[:2]),
            Victim("params.yaml", damaged_yaml, PARAMS),
        ),
        PARAMS_MADE,
        ends_early=PARAMS[1:],
        seconds=0.1,
    ),
    Family(
        "cameras",
        130,
        _frames,
        (
            Victim(CAMERAS, damaged_json, (*CAMERA[:2], CAMERA[0], CAMERA[3])),
            Victim(CAMERAS, damaged_text, CAMERA[:2]),
        ),
        CAMERAS_MADE,
        ends_early=CAMERA[3:],
    ),
    Family(
        "frames",
        160,
        _frames,
        (
            Victim(FRAME, damaged_bytes, (INSPECT, PREDICT)),
            Victim("data/illumination/box/v0.exr", damaged_bytes, (PREDICT,)),
        ),
        FRAMES_MADE,
    ),
    Family(
        "shards",
        140,
        _dataset,
        (Victim(SHARD, damaged_bytes, CHECKED),),
        SHARDS_MADE,
        ends_early=CHECKED[2:],
        seconds=1.5,
    ),
    Family("ledgers", 80, _ledger, (Victim(LEDGER, damaged_bytes, COSTS),), LEDGERS_MADE),
    Family(
        "weights",
        80,
        _frames,
        (Victim(WEIGHTS, damaged_bytes, MODEL[:3]),),
        (
            _weights(float("nan")),
            _weights(float("inf")),
            _weights(1e30),
            _weights(float("nan"), whole=False),
            _weights(float("nan"), MODEL[2]),
            _with_link(WEIGHTS, "/dev/zero", MODEL[2]),
            _with_link(WEIGHTS, "x", PREDICT),
        ),
        _digests,
        seconds=1.0,
    ),
    Family(
        "model cards",
        140,
        _frames,
        (Victim(CARD, damaged_json, MODEL), Victim(CARD, damaged_text, MODEL)),
        CARDS_MADE,
    ),
    Family(
        "scene folders",
        160,
        _folder,
        (
            Victim("scenes/room/scene.xml", damaged_text, (LOOK, COPY, RENDER)),
            Victim("scenes/room/scene.json", damaged_json, (LOOK, COPY)),
            Victim("scenes/room/meshes/box.ply", damaged_text, (LOOK, COPY)),
        ),
        FOLDERS_MADE,
        seconds=2.0,
    ),
    Family(
        "catalogues",
        60,
        _catalogue,
        (
            Victim(PROPERTIES, damaged_text, (ASSETS,)),
            Victim("members/models/table.obj", damaged_text, (ASSETS,)),
            Victim("library/a.sh3f", damaged_bytes, (ASSETS,)),
        ),
        CATALOGUES_MADE,
        _catalogue_packed,
        seconds=5.0,
    ),
    CommandLines("command lines", 260, _line, (), LINES_MADE),
)
