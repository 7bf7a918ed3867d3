"""Furniture of one's own: a folder of model files with a table, converted to assets."""
