"""Readers of file formats: OBJ, MTL, PLY, 3DS, COLLADA, Mitsuba's `.serialized`, and archives."""
