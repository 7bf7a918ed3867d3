"""Relighting: a page with a slider for each light of a view. python relight.py FOLDER [SCENE--VIEW]

Writes relight.html, which needs no server and no network. Needs a dataset with `light.groups`.
"""

import base64
import json
import sys
from pathlib import Path

import numpy as np
from pbrnet_reader import read

names = ["scene_id", "view_id", "lights", "light_names", "color"]
wanted = sys.argv[2] if len(sys.argv) > 2 else ""
for view in read(sys.argv[1], names, "all"):
    name = f"{view['scene_id']}--{view['view_id']}"
    if wanted in ("", name):
        break
else:
    raise SystemExit(f"{sys.argv[1]}: no view {wanted}")

lit = [number for number, light in enumerate(view["light_names"]) if light]
lights, color = view["lights"][lit].astype(float), view["color"].astype(float)
off = np.abs(lights.sum(0) - color).max(2) / np.maximum(color.max(2), 0.01 * color.mean())
print(f"{name}: {len(lit)} lights, their sum is the colour within {off.max():.3%}")

data = {
    "title": name,
    "width": color.shape[1],
    "height": color.shape[0],
    "labels": [view["light_names"][number] for number in lit],
    "exposure": 0.18 / np.exp(np.log(color.mean(2) + 1e-4).mean()),
    # Half floats, a third of the size of numbers in text.
    "lights": base64.b64encode(view["lights"][lit].astype("<f2").tobytes()).decode(),
}
page = Path(__file__).with_suffix(".html").read_text(encoding="utf-8")
Path("relight.html").write_text(page.replace("DATA", json.dumps(data)), encoding="utf-8")
