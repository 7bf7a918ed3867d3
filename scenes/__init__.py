"""Scene sources and the scene contract; knows nothing of `pipeline` or `model`."""
