"""Triangle meshes, primitive shapes of Mitsuba, directions and camera frames."""
