"""Training data by physically based rendering, and networks that imitate the renderer."""
