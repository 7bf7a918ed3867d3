"""Parts shared by all importers: materials, textures, objects, names, credits, daylight."""
