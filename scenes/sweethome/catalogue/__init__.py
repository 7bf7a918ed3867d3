"""Furniture libraries of Sweet Home 3D, converted to assets."""
