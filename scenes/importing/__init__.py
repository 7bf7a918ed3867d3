"""Modules that all importers share: materials, textures, objects, assembly of the scene folder."""
