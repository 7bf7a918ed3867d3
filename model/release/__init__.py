"""Networks for other programs: ONNX export and packed weights."""
