"""Estimate the depth of a photograph with the exported network, without torch and pbrnet.

pbrnet export --method depth --onnx depth.onnx
python depth_onnx.py depth.onnx photo.jpg 65 depth.png     (65: horizontal field of view in degrees)
"""

import json
import math
import sys

import numpy as np
import onnxruntime
from PIL import Image, ImageOps

model, photo, fov, out = sys.argv[1:]
session = onnxruntime.InferenceSession(model, providers=["CPUExecutionProvider"])
height, width = session.get_inputs()[0].shape[2:]
focal = json.loads(session.get_modelmeta().custom_metadata_map["depth"])["focal"]
picture = ImageOps.exif_transpose(Image.open(photo)).convert("RGB")
scale = focal / (picture.width / 2 / math.tan(math.radians(float(fov)) / 2))
whole = (round(picture.width * scale), round(picture.height * scale))
size = (min(whole[0], width), min(whole[1], height))  # the middle of wider pictures
left, top = (whole[0] - size[0]) // 2, (whole[1] - size[1]) // 2
small = picture.resize(whole, Image.Resampling.BOX).crop((left, top, left + size[0], top + size[1]))
right, below = width - size[0], height - size[1]
image = np.pad(np.float32(small) / 255, ((0, below), (0, right), (0, 0)), "edge")
x = (np.arange(width, dtype=np.float32) + 0.5 - size[0] / 2) / focal
y = (np.arange(height, dtype=np.float32) + 0.5 - size[1] / 2) / focal
rays = np.stack(np.meshgrid(x, y))[None]
depth, normal, classes = session.run(None, {"image": image.transpose(2, 0, 1)[None], "rays": rays})
depth = depth[: -(-size[1] // 2), : -(-size[0] // 2)]  # z-depth in metres, at half the size
Image.fromarray((1000 * depth).astype(np.uint16)).save(out)
print(f"{out}: {depth.shape[1]}x{depth.shape[0]}, {depth.min():.2f} to {depth.max():.2f} m")
