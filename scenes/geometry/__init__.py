"""Triangle meshes and the primitive shapes of Mitsuba."""
