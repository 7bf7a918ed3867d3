"""Lenses: projections of cameras with their distortion, and calibration files."""
