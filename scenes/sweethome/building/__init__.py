"""Walls, slabs, openings, rooms and portals of a Sweet Home 3D home."""
