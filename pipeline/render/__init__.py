"""Mitsuba scenes of a view: loading, ray casting, sensors, lights, material sets."""
