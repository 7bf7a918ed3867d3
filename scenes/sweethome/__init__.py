"""Importer of Sweet Home 3D homes (`.sh3d`).

A home is a zip with `Home.xml` (the DTD is in the sources of `HomeXMLHandler`), models and
textures. Lengths there are centimetres, the plan's y points down,
angles are radians clockwise; ours are metres, Z up: (X, Y, Z) = (x, -y, elevation) / 100.
"""
