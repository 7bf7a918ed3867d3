"""Predict a view from its frames with an exported network, without torch and pbrnet.

python onnx_predict.py model.onnx picture.png data/{inputs,illumination,visibility}/S/V.exr
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
inputs = {"depth": bands["Z"], "valid": bands["valid"], "K": np.reshape(view["K"], (3, 3))}
inputs["normal"] = np.stack([bands[f"N.{axis}"] for axis in "XYZ"], axis=-1)
inputs["reflectance"] = np.stack([bands[f"albedo.{band}"] for band in "RGB"], axis=-1)
inputs |= {"intensity": bands["intensity.Y"], "distance": bands["distance.Z"]}
inputs |= {"visibility": bands["visibility.Y"]} if "visibility.Y" in bands else {}
inputs["tint"] = np.stack([bands[f"tint.{band}"] for band in "RGB"], axis=-1)
session = onnxruntime.InferenceSession(model, providers=["CPUExecutionProvider"])
names = [each.name for each in session.get_inputs()]
shading, color = session.run(None, {name: inputs[name].astype(np.float32) for name in names})
Image.fromarray((color * 255).round().astype(np.uint8)).save(picture)
print(f"{picture}: {view['scene_id']}/{view['view_id']}, {color.shape[1]}x{color.shape[0]}")
