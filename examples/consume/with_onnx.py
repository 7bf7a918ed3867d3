"""Predict a view of the dataset without torch: python with_onnx.py model.onnx data/dataset"""

import io
import sys
from pathlib import Path

import numpy as np
import onnxruntime
import pyarrow.parquet as pq
from PIL import Image

session = onnxruntime.InferenceSession(sys.argv[1], providers=["CPUExecutionProvider"])
names = [each.name for each in session.get_inputs()]
columns = ["scene_id", "view_id", "radiance_scale", *names]
shard = min(Path(sys.argv[2]).glob("test-*.parquet"))
view = pq.ParquetFile(shard).read_row_group(0, columns=columns).slice(0, 1)
inputs = {}
for name in names:
    cell = view[name][0].as_py()
    if isinstance(cell, bytes):  # an image: a .npy file of the bytes of its values, plane by plane
        planes = np.load(io.BytesIO(cell))
        cell = np.stack(planes, -1).view(planes.dtype.names[0])[..., 0]
    inputs[name] = np.atleast_1d(np.array(cell, np.float32))  # noisy_spp is a number
unit = view["radiance_scale"][0].as_py()
for name in names:
    if name == "intensity" or name.startswith(("transport", "noisy_c", "noisy_h", "denoised")):
        inputs[name] *= unit
outputs = [each.name for each in session.get_outputs()]
images = dict(zip(outputs, session.run(outputs, inputs), strict=True))
color = images["color"]
shown = [image for name, image in images.items() if name != "radiance"]
Image.fromarray((np.hstack(shown) * 255).round().astype(np.uint8)).save("picture.png")
print(f"picture.png: {view['scene_id'][0]}/{view['view_id'][0]}, {color.shape[1]}x{color.shape[0]}")
