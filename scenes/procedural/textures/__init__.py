"""Families of surfaces: tileable maps of colour, roughness and height that belong together."""
