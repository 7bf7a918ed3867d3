"""Reader of .blend and .fbx files, which Blender exports to glTF in a process of its own."""
