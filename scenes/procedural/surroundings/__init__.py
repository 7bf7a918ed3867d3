"""Surroundings of procedural homes: buildings, plants and streets outside the windows."""
