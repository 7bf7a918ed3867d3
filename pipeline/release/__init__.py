"""Releases: datasets made from a recipe, and compared with the record of an earlier making."""
