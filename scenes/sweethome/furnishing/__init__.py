"""Furniture, lamps and surface finishes of a Sweet Home 3D home."""
