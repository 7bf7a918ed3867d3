"""Relighting: a page with a slider for each light of a view. python relight.py FOLDER [SCENE--VIEW]

Writes relight.html, which needs no server and no network. Needs a dataset with `light.groups`.
Without a view's name it takes the one, of the first 100, that shows most lamps that are on.
"""

import base64
import json
from itertools import islice
from pathlib import Path

import numpy as np
from command import arguments, counted
from pbrnet_reader import read


def visible(view):
    """Numbers of the lights that reach the view: a hundredth of its light or more."""
    light = view["lights"].astype(float).sum((1, 2, 3))
    return np.flatnonzero(light > 0.01 * light.sum()).tolist()


def lamps(view):
    """Number of those lights that are objects in view, and of all of them."""
    objects = {entry["object"] for entry in json.loads(view.get("instances") or "[]")}
    lit = visible(view)
    return sum(view["light_names"][number] in objects for number in lit), len(lit)


FOLDER, NAME = arguments(__doc__, VIEW="")
views = counted(read(FOLDER, "relighting", "all"), "rows")
if NAME:
    views = (v for v in views if f"{v['scene_id']}--{v['view_id']}" == NAME)
view = max(islice(views, 100), key=lamps, default=None)
if view is None:
    raise SystemExit(f"{FOLDER}: no view {NAME}")
name, lit = f"{view['scene_id']}--{view['view_id']}", visible(view)
lights, color = view["lights"].astype(float), view["color"].astype(float)
off = np.abs(lights.sum(0) - color).max(2) / np.maximum(color.max(2), 0.01 * color.mean())
print(f"{name}: {len(lit)} lights, their sum equals colour within {off.max():.3%}")

labels = [view["light_names"][number] for number in lit]
dim = [number for number in range(len(lights)) if number not in lit and lights[number].any()]
if dim:  # they go with the brightest
    brightest = max(lit, key=lambda number: lights[number].sum())
    lights[brightest] += lights[dim].sum(0)
    labels[lit.index(brightest)] += " and what is too dim to see"
data = {
    "title": name,
    "width": color.shape[1],
    "height": color.shape[0],
    "labels": labels,
    "exposure": 0.18 / np.exp(np.log(color.mean(2) + 1e-4).mean()),
    # Half floats, a third of the size of numbers in text.
    "lights": base64.b64encode(lights[lit].astype("<f2").tobytes()).decode(),
}
page = Path(__file__).with_suffix(".html").read_text(encoding="utf-8")
Path("relight.html").write_text(page.replace("DATA", json.dumps(data)), encoding="utf-8")
