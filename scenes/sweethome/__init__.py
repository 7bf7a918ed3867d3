"""Homes drawn with Sweet Home 3D (`.sh3d`), brought into scene folders.

The file format is the application's: a zip with `Home.xml` (its DTD stands in the sources of
`HomeXMLHandler`), models and textures. Lengths there are centimetres, the plan's y points down,
angles are radians clockwise; ours are metres, Z up: (X, Y, Z) = (x, -y, elevation) / 100.
"""
