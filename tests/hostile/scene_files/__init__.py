"""Families of hostile scene files: homes, Mitsuba and PBRT scenes, models, buildings, images."""
