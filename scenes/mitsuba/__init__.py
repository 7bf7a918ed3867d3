"""Importer of Mitsuba scenes, versions 0.4 to 3.x."""
