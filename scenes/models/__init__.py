"""Importer of single model files: glTF, OBJ, COLLADA and others."""
