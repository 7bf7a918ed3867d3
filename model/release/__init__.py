"""Release of trained networks: packed weights and ONNX export."""
