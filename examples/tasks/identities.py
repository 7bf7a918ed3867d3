"""Identities: what the columns promise, checked in every row. python identities.py FOLDER"""

import json
import sys
from collections import defaultdict
from pathlib import Path

import numpy as np
from command import arguments, counted
from pbrnet_reader import read

TABLES = ("instances", "layout", "light_sources")


def light(row):
    """The parts of the light add up to colour; none is below 0 or above it."""
    images = {name: row[name].astype(np.float32) for name in row if hasattr(row[name], "astype")}
    color = images["color"]
    least = np.maximum(color, 0.01 * color.mean())  # darker pixels: a share of that
    parts = [images[name] for name in ("direct", "indirect", "diffuse", "specular")]
    product = images["reflectance"] * images["irradiance"]
    for title, found in (
        ("direct + indirect", parts[0] + parts[1]),
        ("diffuse + specular", parts[2] + parts[3]),
        ("reflectance x irradiance + residual", product + images["residual"]),
        ("sum of lights", images["lights"].sum(0) if "lights" in images else color),
    ):
        yield f"{title} - color, share", (np.abs(found - color) / least).max(), 1e-3
    wrong = max(max(-part.min(), (part - color).max()) for part in parts)
    yield "parts of light below 0 or above color", max(wrong, 0), 0
    yield "log2 of radiance_scale, off a whole number", np.log2(row["radiance_scale"]) % 1, 0
    if row.get("denoiser"):  # single samples may be of any brightness
        yield "subnormal halves in color, share", (color[color > 0] < 2.0**-14).mean(), 0.01


def masks(row):
    """Masks and values are 0 where nothing is seen or known; elsewhere values are possible."""
    nothing, unknown, seen = row["valid"] == 0, row["material_known"] == 0, row["valid"] > 0
    empty = ("depth", "normal", "reflectance", "instance", "material", "material_known")
    left = [row[name][nothing] for name in empty]
    shares = ("roughness", "metalness", "specular_color")
    left += [row[name][unknown] for name in shares]
    yield "values where there is none", max(np.abs(each).max(initial=0) for each in left), 0
    values = [row[name] for name in (*shares, "reflectance")]
    beyond = max(max(-each.min(), each.max() - 1) for each in values)
    yield "materials beyond 0 to 1", max(beyond, 0), 0
    nameless = (row["material"] > len(row["material_names"])) | ((row["material"] > 0) != seen)
    yield "material without a name, pixels", nameless.sum(), 0
    for name in ("normal", "normal_bump"):
        vectors = row[name][seen].astype(np.float32)
        yield f"length of {name} - 1", np.abs(np.linalg.norm(vectors, axis=-1) - 1).max(), 2e-3
        yield (
            f"{name} away from the camera",
            max((vectors * rays(row)[seen]).sum(-1).max(), 0),
            2e-3,
        )


def rays(row):
    """Direction (H, W, 3) of each pixel in camera axes, of z-depth 1."""
    height, width = row["depth"].shape
    column, line = np.meshgrid(np.arange(width) + 0.5, np.arange(height) + 0.5)
    return np.stack([column, line, np.ones_like(line)], -1) @ np.linalg.inv(row["K"]).T


def pose(row):
    """Rotation (3, 3) and eye (3,) of the camera."""
    matrix = np.array(row["camera_to_world"])
    return matrix[:3, :3], matrix[:3, 3]


def points(row):
    """World point (H, W, 3) of each pixel."""
    rotation, eye = pose(row)
    return rays(row) * row["depth"][..., None] @ rotation.T + eye


def normals(row):
    """Normals are those of depth, where 3 x 3 pixels of an instance show a plane."""
    space = rays(row) * row["depth"][..., None]
    across, down = space[1:-1, 2:] - space[1:-1, :-2], space[2:, 1:-1] - space[:-2, 1:-1]
    found, stored = np.cross(down, across), row["normal"][1:-1, 1:-1].astype(float)
    inverse = 1 / np.where(row["depth"] > 0, row["depth"], np.nan).astype(float)
    plane = np.ones(stored.shape[:2], bool)
    for axis in (0, 1):
        ends = [np.roll(inverse, step, axis)[1:-1, 1:-1] for step in (1, -1)]
        plane &= np.abs(ends[0] + ends[1] - 2 * inverse[1:-1, 1:-1]) < 2e-5 * ends[0]
        for step in (1, -1):
            plane &= (np.roll(row["instance"], step, axis) == row["instance"])[1:-1, 1:-1]
    sine = np.linalg.norm(np.cross(found, stored), axis=-1)
    angle = np.degrees(np.arctan2(sine, (found * stored).sum(-1)))[plane]
    if len(angle) > 100:
        yield "normal off that of depth on planes, degrees, median", np.median(angle), 0.1


def labels(row, classes):
    """Images of numbers agree with the tables, and boxes hold their pixels' points."""
    image, table = row["instance"], {one["instance"]: one for one in row["instances"]}
    yield (
        "instances without an entry, or entries unseen",
        len(set(image[image > 0]) ^ set(table)),
        0,
    )
    nyu40, nyu13 = np.array(classes["nyu40_of_category"]), np.array(classes["nyu13_of_nyu40"])
    wrong = (nyu40[row["category"]] != row["nyu40"]) | (nyu13[row["nyu40"]] != row["nyu13"])
    (rotation, eye), world = pose(row), points(row)
    counts, outside, turned = 0, 0.0, 0.0
    for number, one in table.items():
        here = image == number
        if not here.any():
            continue
        wrong |= here & (row["category"] != one["category"])
        lines, columns = np.nonzero(here)
        extent = [columns.min(), lines.min(), columns.max() + 1, lines.max() + 1]
        fraction = one["pixels"] / one["pixels_alone"]
        counts += one["extent"] != extent or one["pixels"] != here.sum() or fraction > 1
        counts += abs(one["visible_fraction"] - fraction) > 1e-5
        counts += abs(one["visible_fraction"] + one["occlusion"] - 1) > 1e-5
        centre, axes = np.array(one["centre"]), np.array(one["axes"])
        beyond = (np.abs((world[here] - centre) @ axes.T) - one["half_sizes"]).max(-1)
        far = np.linalg.norm(world[here] - eye, axis=-1)
        outside = max(outside, (beyond - 1e-4 * far).max())  # rounding of depth
        turned = max(turned, np.abs((centre - eye) @ rotation - one["centre_camera"]).max())
        turned = max(turned, np.abs(axes @ rotation - one["axes_camera"]).max())
    yield "classes that disagree, pixels", wrong.sum(), 0
    yield "pixel counts, fractions, extents that disagree", counts, 0
    yield "points outside their instance's box, metres", outside, 1e-4
    yield "boxes in camera axes, metres", turned, 1e-5


def outside(polygon, places):
    """Distance (N,) of places (N, 2) from a polygon; 0 inside."""
    count, nearest = np.zeros(len(places), int), np.full(len(places), np.inf)
    for start, end in zip(np.roll(polygon, 1, 0), np.array(polygon), strict=True):
        along = end - start
        share = ((places - start) @ along / max(along @ along, 1e-12)).clip(0, 1)
        gap = places - start - share[:, None] * along
        nearest = np.minimum(nearest, np.linalg.norm(gap, axis=-1))
        right = start[0] + (places[:, 1] - start[1]) * along[0] / (along[1] or 1)
        count += ((start[1] > places[:, 1]) != (end[1] > places[:, 1])) & (places[:, 0] < right)
    return np.where(count % 2, 0, nearest)


def layout(row):
    """Camera, lamps and floors are in their rooms."""
    rooms, world = {room["id"]: room for room in row["layout"]["rooms"]}, points(row)

    def apart(name, place):
        room = rooms[name]
        height = max(room["floor_z"] - place[2], place[2] - room["ceiling_z"])
        return max(outside(room["floor"], np.array([place[:2]]))[0], height)

    if row["layout"]["room"]:
        far = apart(row["layout"]["room"], pose(row)[1])
        yield "camera outside its room, metres", max(far, 0), 0.1
    lamps = [lamp for lamp in row["light_sources"] if lamp["room"] in rooms and lamp["centre"]]
    far = max((apart(lamp["room"], lamp["centre"]) for lamp in lamps), default=0)
    yield "lamps outside their rooms, metres", max(far, 0), 0.1
    for one in row["instances"]:
        room, here = rooms.get(one["room"]), row["instance"] == one["instance"]
        if one["category_name"] == "floor" and room:  # one floor may serve several rooms
            here &= np.abs(world[..., 2] - room["floor_z"]) < 0.02
            far = [outside(each["floor"], world[here][:, :2]) for each in rooms.values()]
            if here.sum() > 24:  # doorsills are floor, too
                yield "floors outside all rooms, share", (np.min(far, 0) > 0.5).mean(), 0.01


def flow(row, other, way):
    """Flow, occlusion and what is outside follow from depth and both cameras."""
    height, width = row["depth"].shape
    there, (rotation, eye) = row["depth"] > 0, pose(other)
    towards = np.where(there[..., None], points(row) - eye, rays(row) @ pose(row)[0].T) @ rotation
    before = towards[..., 2] > 1e-4
    image = towards @ np.array(row["K"]).T
    places = image[..., :2] / np.where(before, image[..., 2], 1)[..., None]
    column, line = np.meshgrid(np.arange(width) + 0.5, np.arange(height) + 0.5)
    moved = places - np.stack([column, line], -1)
    yield f"flow_{way} off, pixels", np.abs(row[f"flow_{way}"] - moved)[before].max(initial=0), 0.01
    margin = np.minimum(places, np.array([width, height]) - places).min(-1)
    wrong = (row[f"outside_{way}"] > 0) == (before & (margin > 0))
    yield f"outside_{way} wrong, pixels", (wrong & (np.abs(margin) > 1e-3)).sum(), 0
    # Occlusion, where the four pixels around a place leave no doubt.
    some = before & there & (margin > 0.5)
    across, down = np.floor(places[some] - 0.5).astype(int).T
    near = np.stack([other["depth"][down + j, across + i] for j in (0, 1) for i in (0, 1)])
    depth, hidden = towards[..., 2][some], row[f"occluded_{way}"][some] > 0
    flat = (near.min(0) > 0) & (near.max(0) < 1.02 * near.min(0))
    seen = flat & (np.abs(near - depth).max(0) < 0.02 * depth)
    behind = flat & (near.max(0) < 0.95 * depth)
    for title, called, limit in (
        ("visible points that occluded_{} hides, share", hidden[seen], 0.05),
        ("hidden points that occluded_{} shows, share", ~hidden[behind], 0.2),
    ):
        if len(called) > 24:
            yield title.format(way), called.mean(), limit


def surroundings(row):
    """The panorama shows the view's light, within noise, and its distances."""
    high, wide, _ = row["environment"].shape
    length = np.linalg.norm(rays(row), axis=-1)
    x, y, z = np.moveaxis(rays(row) / length[..., None], -1, 0)
    cell = (np.arccos(-y) / np.pi * high).astype(int) * wide
    cell += ((np.arctan2(x, z) / (2 * np.pi) + 0.5) * wide).astype(int)
    angle = np.linalg.det(np.linalg.inv(row["K"])) / length**3  # solid angle of a pixel
    covered = np.bincount(cell.ravel(), angle.ravel(), high * wide)
    whole = np.repeat(-np.diff(np.cos(np.pi * np.arange(high + 1) / high)), wide) * 2 * np.pi / wide
    full = np.flatnonzero(covered > 0.97 * whole)  # pixels that the view covers
    if len(full) < 8:
        return
    within = np.isin(cell, full)
    view = (angle[..., None] * row["color"])[within].sum()
    around = (whole[:, None] * row["environment"].reshape(-1, 3))[full].sum()
    noise = np.hypot(row["noise_environment"], row["noise_color"]) / len(full) ** 0.5
    yield "panorama's light off the view's, standard errors", abs(around / view - 1) / noise, 5
    far, metres = row["environment_depth"].ravel(), row["depth"] * length
    apart = [
        not metres[cell == number].min() * 0.98 < far[number] < metres[cell == number].max() * 1.02
        for number in full
        if far[number] > 0 and (metres[cell == number] > 0).all()
    ]
    if apart:
        yield "panorama's distances off the view's, share", np.mean(apart), 0.05


def checks(row, before, classes):
    """Yield (title, error, limit) of what the row's columns allow; `before` is the row before."""
    if "irradiance" in row:
        yield from light(row)
    if "roughness" in row and "instance" in row:
        yield from masks(row)
    if "instance" in row:
        yield from normals(row)
        yield from labels(row, classes)
        yield from layout(row)
    if "environment" in row:
        yield from surroundings(row)
    if before and "flow_forward" in row and row["trajectory"]:
        video = [(each["scene_id"], each["trajectory"]) for each in (before, row)]
        if video[0] == video[1] and row["frame"] == before["frame"] + 1:
            yield from flow(before, row, "forward")
            yield from flow(row, before, "backward")


def main(folder):
    """Print rows, median, worst, limit and rows beyond it of each identity; return the latter."""
    file = Path(folder) / "classes.json"
    classes = json.loads(file.read_text()) if file.is_file() else {}
    found, before = defaultdict(list), None
    for row in counted(read(folder, split="all"), "rows"):
        row |= {name: json.loads(row[name]) for name in TABLES if name in row}
        for title, error, limit in checks(row, before, classes):
            found[title].append((float(error), limit, f"{row['scene_id']}/{row['view_id']}"))
        before = row
    print(f"{'checks':>6} {'median':>8} {'worst':>8} {'limit':>6} {'fail':>4}")
    failing = 0
    for title, entries in found.items():
        errors, (limit, *_) = [error for error, *_ in entries], {limit for _, limit, _ in entries}
        wrong = [name for error, limit, name in entries if not error <= limit]
        figures = f"{len(errors):6} {np.median(errors):8.2g} {max(errors):8.2g} {limit:6.2g}"
        print(f"{figures} {len(wrong):4}  {title}", *wrong[:3])
        failing += len(wrong)
    return failing


if __name__ == "__main__":
    sys.exit(main(*arguments(__doc__)) > 0)
