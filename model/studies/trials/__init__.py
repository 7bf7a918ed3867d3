"""Training trials shared by the studies."""
