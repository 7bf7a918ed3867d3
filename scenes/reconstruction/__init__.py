"""Reconstruction of rooms and openings from triangles, and sealing of gaps between them."""
