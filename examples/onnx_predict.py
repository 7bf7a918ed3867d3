"""Predict a view from its frames with an exported network, without torch and pbrnet.

python onnx_predict.py model.onnx picture.png data/{inputs,illumination}/S/V.exr
for plus: data/{inputs,transport,materials}/S/V.exr
"""

import json
import sys

import numpy as np
import onnxruntime
import OpenEXR
from PIL import Image

model, picture, *paths = sys.argv[1:]
frames = [OpenEXR.File(path, separate_channels=True) for path in paths]
bands = {name: band.pixels for frame in frames for name, band in frame.channels().items()}
view = json.loads(frames[0].header()["pbrnet"])["view"]
inputs = {name: band for name, band in bands.items() if "." not in name}  # roughness and so on
inputs |= {"depth": bands["Z"], "intensity": bands.get("intensity.Y")}
inputs["distance"] = bands.get("distance.Z")
inputs["normal"] = np.stack([bands[f"N.{axis}"] for axis in "XYZ"], axis=-1)
inputs["reflectance"] = np.stack([bands[f"albedo.{band}"] for band in "RGB"], axis=-1)
if "indirect.R" in bands:
    for name, prefix in {"direct": "direct.", "indirect": "indirect.", "color": ""}.items():
        image = np.stack([bands[prefix + band] for band in "RGB"], axis=-1)
        inputs[f"transport_{name}"] = image
session = onnxruntime.InferenceSession(model, providers=["CPUExecutionProvider"])
names = [each.name for each in session.get_inputs()]
_, color = session.run(None, {name: inputs[name].astype(np.float32) for name in names})
Image.fromarray((color * 255).round().astype(np.uint8)).save(picture)
print(f"{picture}: {view['scene_id']}/{view['view_id']}, {color.shape[1]}x{color.shape[0]}")
