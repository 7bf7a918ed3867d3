"""Furniture catalogues (`.sh3f`): read, converted once into meshes of ours, and indexed."""
