"""Mitsuba scenes of versions 0.4 to 3.x, brought into the scene contract."""
