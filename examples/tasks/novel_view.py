"""Novel views: points of one view projected into another. python novel_view.py FOLDER"""

from itertools import pairwise

import numpy as np
from command import arguments, counted
from pbrnet_reader import read
from PIL import Image


def points(view):
    """World coordinates (H W, 3) of each pixel's surface, and where there is one."""
    height, width = view["depth"].shape
    column, line = np.meshgrid(np.arange(width) + 0.5, np.arange(height) + 0.5)
    rays = np.stack([column, line, np.ones_like(line)], -1) @ np.linalg.inv(view["K"]).T
    camera = (rays * view["depth"][..., None]).reshape(-1, 3)
    pose = np.array(view["camera_to_world"])
    return camera @ pose[:3, :3].T + pose[:3, 3], view["depth"].ravel() > 0


def drawn(source, target):
    """Colours and depth of the source's points in the target's image, nearest last; 0: no point."""
    world, there = points(source)
    pose = np.array(target["camera_to_world"])
    camera = (world[there] - pose[:3, 3]) @ pose[:3, :3]
    color = source["color"].reshape(-1, 3)[there].astype(float) * source["radiance_scale"]
    height, width = target["depth"].shape
    with np.errstate(divide="ignore", invalid="ignore"):
        column, line, _ = np.floor(camera @ np.array(target["K"]).T / camera[:, 2:]).T
    inside = (camera[:, 2] > 0) & (column >= 0) & (column < width) & (line >= 0) & (line < height)
    order = np.flatnonzero(inside)[np.argsort(-camera[inside, 2])]
    index = line[order].astype(int), column[order].astype(int)
    image, depth = np.zeros((height, width, 3)), np.zeros((height, width))
    image[index], depth[index] = color[order], camera[order, 2]
    return image, depth


names = ["scene_id", "view_set", "K", "camera_to_world", "depth", "color", "radiance_scale"]
rows = counted(read(*arguments(__doc__), names, "all"), "rows")
views = [view for view in rows if view["view_set"]]
sheet = []
for source, target in pairwise(views):
    if (source["scene_id"], source["view_set"]) != (target["scene_id"], target["view_set"]):
        continue
    image, depth = drawn(source, target)
    truth = target["color"].astype(float) * target["radiance_scale"]
    seen = (depth > 0) & (np.abs(depth - target["depth"]) < 0.02 * depth)  # not behind something
    before = source["color"].astype(float) * source["radiance_scale"]
    off, unmoved = (
        np.median(np.abs(each - truth).sum(2)[seen] / truth.sum(2)[seen].clip(1e-6))
        for each in (image, before)
    )
    print(f"{target['scene_id']}: sees {seen.mean():.0%}, off by {off:.3f}, unmoved {unmoved:.3f}")
    scale = 0.4 / np.median(truth)
    sheet.append(
        np.hstack([(1 - np.exp(-scale * each)) ** 0.45 for each in (before, image, truth)])
    )
Image.fromarray((255 * np.vstack(sheet)).astype(np.uint8)).save("novel_view.png")
