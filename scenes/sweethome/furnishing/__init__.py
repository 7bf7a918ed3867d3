"""Furniture, lamps and finishes of a Sweet Home 3D home."""
