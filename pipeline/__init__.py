"""Stages from scenes to dataset and the command line; knows nothing of `model`."""
