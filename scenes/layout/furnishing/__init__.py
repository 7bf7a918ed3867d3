"""Furniture of a layout: a piece for each box, placed clear of walls and of each other."""
