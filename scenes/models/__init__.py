"""Importer of single model files: glTF, GLB and OBJ."""
