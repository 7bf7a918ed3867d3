"""Scenes and single objects from glTF, GLB and OBJ files."""
