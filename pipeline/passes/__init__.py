"""Render passes of a view: inputs, illumination, visibility, ground truth, denoising."""
