"""Reader of glTF 2.0 files and of the compressions that they use."""
