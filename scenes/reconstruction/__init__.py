"""Rooms found in triangles, and the gaps of their enclosure closed."""
