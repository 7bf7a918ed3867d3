"""Pictures of scenes, frames, datasets and networks: plans, channels, previews, layer sizes."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from typing import Any

import numpy as np
import pyarrow.parquet as pq
import shapely
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.patches import Polygon, Rectangle, Wedge

from pbrnet.pipeline.channels import (
    ALBEDO,
    NORMAL,
    RADIANCE,
    RGB,
    TINT,
    Channel,
    channels_of,
    light_bands,
)
from pbrnet.pipeline.frames import Frame
from pbrnet.pipeline.images import (
    Picture,
    color_map,
    contact_sheet,
    depth_picture,
    enlarge,
    fit,
    flow_picture,
    intensity_picture,
    label_picture,
    normal_picture,
    read_picture,
    reflectance_picture,
    share_picture,
    tint_picture,
)
from pbrnet.pipeline.inspection.renders import draw_dollhouse, quick_renders
from pbrnet.pipeline.photograph import meter, photograph
from pbrnet.pipeline.terminal import counted
from pbrnet.pipeline.views import CameraFile, View
from pbrnet.scenes.contract import Room, Scene

ROOM_COLORS = {
    "living": "#f2d6a2",
    "bedroom": "#c9d8f0",
    "kitchen": "#f3c5b5",
    "bathroom": "#bfe5e1",
    "study": "#d9ceec",
    "dining": "#e6e2a8",
}
_CENTRED: dict[str, Any] = {"ha": "center", "va": "center"}
_SHEET_PICTURES = 24
# Channels that `draw_frame` draws in a form of their own; all others look alike.
_DRAWN = (
    *("depth", "normal", "reflectance", "valid", "object"),
    *("intensity", "distance", "tint", "visibility", "shading", "color", "noisy_color"),
    "environment",
)


def draw_scene(scene: Scene, views: Sequence[View] = ()) -> Picture:
    """Draw the plan, and below it the dollhouse view and two quick renders."""
    pictures = quick_renders(scene, views)
    renders = contact_sheet([picture for _, picture in pictures], 1, [name for name, _ in pictures])
    house = draw_dollhouse(scene)
    below = contact_sheet([house, renders], 2, ["without its ceilings", "quick renders"])
    plan = fit(draw_plan(scene, views), below.shape[1])
    aside = below.shape[1] - plan.shape[1]
    paper = ((0, 0), (aside // 2, aside - aside // 2), (0, 0))
    return np.concatenate([np.pad(plan, paper, constant_values=255), below])


def draw_plan(scene: Scene, views: Sequence[View] = ()) -> Picture:
    """Draw a plan per storey: rooms, furniture, lights, portals and cameras."""
    levels = sorted({round(room.floor_z, 1) for room in scene.rooms}) or [0.0]
    figure = Figure(figsize=(9 * len(levels), 8.5), dpi=110, layout="constrained")
    all_axes = figure.subplots(1, len(levels), squeeze=False)[0]
    for axes, level, above in zip(all_axes, levels, [*levels[1:], math.inf], strict=True):
        _draw_storey(axes, scene, views, level, above)
        storey = f", floor at {level:g} m" if len(levels) > 1 else ""
        axes.set_title(
            f"{scene.scene_id}{storey} · {scene.lighting} · {counted(len(views), 'view')}",
            fontsize=10,
        )
    figure.supxlabel(
        "yellow: lit · blue: clear window or opening · grey bar: frosted or closed · red: cameras",
        fontsize=8,
    )
    return picture_of(figure)


def draw_frame(frame: Frame) -> Picture:
    """Draw all channels of a frame as labelled pictures."""
    channels = frame.channels
    names = set(channels)
    pictures: list[tuple[str, Picture]] = []
    if set(RGB) <= names:
        image = frame.rgb
        settings = meter(image)
        label = f"photographed, exposure {settings.gain:.4g}"
        pictures.append((label, photograph(image, settings)))
        logarithm = np.log10(np.maximum(image.mean(axis=-1), 1e-8))
        low, high = float(np.percentile(logarithm, 1)), float(logarithm.max())
        pictures.append(
            (f"log10 of the mean, {low:.1f} to {high:.1f}", color_map(logarithm, low, high))
        )
    if "Z" in names:
        valid, depth = channels["valid"], channels["Z"]
        seen = depth[valid > 0]
        span = f"{seen.min():.2f} to {seen.max():.2f} m" if seen.size else "no surface"
        pictures += [
            (f"depth, {span}", depth_picture(depth, valid)),
            ("normal", normal_picture(frame.stack(*NORMAL), valid)),
            ("reflectance", reflectance_picture(frame.stack(*ALBEDO))),
            (f"objects, {len(np.unique(channels['object']))}", label_picture(channels["object"])),
        ]
    if "intensity.Y" in names:
        intensity, distance = channels["intensity.Y"], channels["distance.Z"]
        lit = distance[distance > 0]
        span = f"{lit.min():.2f} to {lit.max():.2f} m" if lit.size else "no light source"
        pictures += [
            (f"intensity, log, up to {intensity.max():.4g}", intensity_picture(intensity)),
            (f"distance, {span}", depth_picture(distance)),
        ]
    if set(TINT) <= names:
        pictures.append(("tint", tint_picture(frame.stack(*TINT))))
    if "visibility.Y" in names:
        shadows = share_picture(channels["visibility.Y"])
        pictures.append(("share of the direct light that arrives", shadows))
    for channel in channels_of(frame.meta.get("kind", "")):
        if channel.name not in _DRAWN and names.issuperset(channel.bands):
            pictures.append(_channel_picture(channel, frame))
    for number, name in enumerate(frame.meta.get("light_names", ())):
        if name:
            image = frame.stack(*light_bands(number))
            pictures.append((f"light: {name}", photograph(image)))
    return contact_sheet(
        [enlarge(fit(picture, 640), 480) for _, picture in pictures],
        2 if len(pictures) > 1 else 1,
        [label for label, _ in pictures],
    )


def draw_previews(files: Sequence[pq.ParquetFile]) -> Picture:
    """Draw a contact sheet of previews, spread evenly over the rows."""
    total = sum(file.metadata.num_rows for file in files)
    wanted = set(
        np.unique(np.linspace(0, total - 1, min(total, _SHEET_PICTURES)).astype(int)).tolist()
    )
    pictures, labels, row = [], [], 0
    columns = ["scene_id", "view_id", "split", "preview"]
    for file in files:
        for batch in file.iter_batches(64, columns=columns):
            chosen = [index for index in range(batch.num_rows) if row + index in wanted]
            for record in batch.take(chosen).to_pylist():
                pictures.append(enlarge(fit(read_picture(record["preview"]["bytes"]), 256), 240))
                labels.append(f"{record['scene_id']} {record['view_id']} {record['split']}")
            row += batch.num_rows
    return contact_sheet(pictures, 4, labels)


def draw_cameras(cameras: CameraFile) -> Picture:
    """Draw cameras from above without a plan."""
    figure = Figure(figsize=(8, 8), dpi=110, layout="constrained")
    axes = figure.subplots()
    for view in cameras.views:
        _draw_camera(axes, view)
    axes.set_aspect("equal")
    axes.margins(0.3)
    axes.autoscale_view()
    axes.set_title(f"{cameras.scene_id}: cameras from above (scene not found)", fontsize=10)
    return picture_of(figure)


def draw_layers(name: str, counts: Counter[str]) -> Picture:
    """Draw the number of parameters of each layer of a network as bars."""
    shown = list(counts.items())[:60]
    figure = Figure(figsize=(9, 1.2 + 0.2 * len(shown)), dpi=110, layout="constrained")
    axes = figure.subplots()
    labels = [label for label, _ in shown]
    axes.barh(range(len(shown)), [count for _, count in shown], color="#3b76af")
    axes.set_yticks(range(len(shown)), labels, fontsize=7)
    axes.invert_yaxis()
    axes.set_xscale("log")
    axes.set_xlabel("parameters")
    more = f" (first {len(shown)} of {len(counts)} layers)" if len(counts) > len(shown) else ""
    axes.set_title(f"{name}: {sum(counts.values()):,} parameters{more}", fontsize=10)
    return picture_of(figure)


def picture_of(figure: Figure) -> Picture:
    """Render a figure to pixels."""
    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    return np.asarray(canvas.buffer_rgba())[..., :3].copy()


def _draw_storey(
    axes: Axes, scene: Scene, views: Sequence[View], level: float, above: float
) -> None:
    """Draw what stands between a storey's floor and the one above."""
    emitting = {shape for light in scene.lights for shape in light.shapes}
    for room in scene.rooms:
        if round(room.floor_z, 1) == level:
            _draw_room(axes, room)
    here = [
        item
        for item in scene.objects
        if level - 0.5 <= item.bbox_min[2] < above - 0.3 and not item.is_structure
    ]
    # The largest first, so that small items on furniture stay visible.
    for item in sorted(here, key=lambda item: -_footprint(item)):
        (left, bottom, _), (right, top, _) = item.bbox_min, item.bbox_max
        lit = not emitting.isdisjoint(item.shapes)
        width, depth = right - left, top - bottom
        fill, edge, alpha = ("#ffd84d", "#8a6d00", 0.9) if lit else ("#ffffff", "#666666", 0.55)
        style = {"facecolor": fill, "edgecolor": edge, "alpha": alpha, "linewidth": 0.8}
        axes.add_patch(Rectangle((left, bottom), width, depth, **style))
        if min(width, depth) > 0.45:
            middle = (left + right) / 2, (bottom + top) / 2
            axes.text(*middle, item.category, fontsize=6, clip_on=True, **_CENTRED)
    for portal in scene.portals:
        points = np.array(portal.polygon)
        if level - 0.5 <= points[:, 2].mean() < above:
            ends = _extent(points[:, :2])
            color = "#0b84d8" if portal.clear else "#7a8b99"
            axes.plot(ends[:, 0], ends[:, 1], color=color, linewidth=4, solid_capstyle="butt")
    for view in views:
        if level - 0.5 <= view.eye[2] < above:
            _draw_camera(axes, view)
    axes.set_aspect("equal")
    axes.autoscale_view()
    axes.set_xlabel("x, metres")
    axes.set_ylabel("y, metres")
    axes.grid(alpha=0.25, linewidth=0.5)


def _draw_room(axes: Axes, room: Room) -> None:
    color = ROOM_COLORS.get(room.type, "#dddddd")
    axes.add_patch(
        Polygon(room.floor, facecolor=color, edgecolor="#222222", linewidth=2, alpha=0.8)
    )
    # In the corner, because furniture covers the middle.
    corner = max(room.floor, key=lambda point: point[1] - point[0])
    axes.annotate(
        f"{room.name}, {shapely.Polygon(room.floor).area:.1f} m²",
        corner,
        (5, -5),
        textcoords="offset points",
        fontsize=8,
        fontweight="bold",
        va="top",
        color="#333333",
        zorder=6,
    )


def _draw_camera(axes: Axes, view: View) -> None:
    forward = view.pose[:3, 2]
    half = math.degrees(view.half_fov_x)
    heading = math.degrees(math.atan2(forward[1], forward[0]))
    x, y = view.eye[:2]
    alpha = 0.02 if view.frame > 0 else 0.25  # the frames of a trajectory lie over each other
    axes.add_patch(
        Wedge((x, y), 0.9, heading - half, heading + half, color="#d62728", alpha=alpha, zorder=4)
    )
    axes.plot([x], [y], "o", color="#d62728", markersize=4, zorder=5)
    if view.frame > 0:
        return
    axes.text(
        x + 0.95 * math.cos(math.radians(heading)),
        y + 0.95 * math.sin(math.radians(heading)),
        view.view_id,
        fontsize=6,
        color="#8b0000",
        zorder=6,
        **_CENTRED,
    )


def _channel_picture(channel: Channel, frame: Frame) -> tuple[str, Picture]:
    """Return a label and a picture of any channel: labels, HDR colour, colour or a scalar."""
    values = frame.stack(*channel.bands)
    if channel.is_direction:
        return channel.name, normal_picture(values)
    if len(channel.bands) == 2:
        longest = float(np.sqrt((values**2).sum(axis=-1)).max())
        return f"{channel.name}, up to {longest:.4g} pixels", flow_picture(values)
    if channel.is_label:
        return channel.name, label_picture(frame.channels[channel.bands[0]])
    if len(channel.bands) == 3:
        if channel.unit == RADIANCE:
            return channel.name, photograph(values)
        return channel.name, reflectance_picture(values)
    low, high = float(values.min()), float(values.max())
    if channel.unit == "metre":
        return f"{channel.name}, up to {high:.2f} m", depth_picture(values[..., 0])
    # From 0 to at least 1, so that equal shares and masks look alike in all frames.
    label = f"{channel.name}, {low:.4g} to {high:.4g}"
    return label, color_map(values[..., 0], min(low, 0), max(high, 1))


def _extent(points: np.ndarray[Any, Any]) -> np.ndarray[Any, Any]:
    """Return the two points (2, 2) farthest apart: a vertical polygon is a line in the plan."""
    gaps = np.linalg.norm(points[:, None] - points[None], axis=-1)
    first, last = np.unravel_index(gaps.argmax(), gaps.shape)
    return points[[first, last]]


def _footprint(item: Any) -> float:
    return float((item.bbox_max[0] - item.bbox_min[0]) * (item.bbox_max[1] - item.bbox_min[1]))
