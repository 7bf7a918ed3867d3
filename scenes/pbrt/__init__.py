"""Importer of PBRT scenes, versions 3 and 4."""
