"""Study of generalisation to unseen scenes."""
